"""The constants of a run, and the state of an episode, in the memory of compiled code."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import product
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from desim_uav.copies import Unchanging, owned
from desim_uav.engine.base import RunSettings
from desim_uav.engine.compiled.calls import set_functions
from desim_uav.engine.compiled.components import (
    LOSS_SLOTS,
    PROCESSOR_SLOTS,
    RADIO_SLOTS,
    SLOTS,
    TYPE_SLOTS,
    FunctionSlot,
    components_of,
    point_at,
    why_not_compiled,
)
from desim_uav.engine.compiled.largest_sums import too_large, too_many
from desim_uav.engine.compiled.scratch import NEEDS
from desim_uav.engine.compiled.slots import tournaments
from desim_uav.engine.compiled.standing import legs_in_table, tabulate
from desim_uav.engine.constants import constants_of
from desim_uav.engine.sky import Room, complete, scene_of, sky_of
from desim_uav.engine.state import Buffers, state_of
from desim_uav.errors import ScenarioError
from desim_uav.model.geometry.coverage import WalkLeg
from desim_uav.model.mobility.walking import walking_of
from desim_uav.model.motion.planner import MOST_PLANNING
from desim_uav.model.rules import US
from desim_uav.rowcode.components import compiled
from desim_uav.rowcode.packing import locate, located, packed, packed_apart
from desim_uav.rowcode.rows import Table, Words, blank, held_by
from desim_uav.rowcode.views import View, array_of, zeros
from desim_uav.rules.due import crossing_slot, slots
from desim_uav.rules.rows import Begun, BegunCourse, Constants, Drone, State
from desim_uav.world import World

Array = np.ndarray[Any, Any]


def lacking(world: World) -> list[str]:
    """Return the reasons why the compiled engine cannot run a world, which are none if it can."""
    lacks = []
    keys = tuple(".".join(map(str, key)) for key in world.scenario.fleet_keys)
    choices: list[tuple[str, FunctionSlot, Any]] = []
    for key, own in zip(keys, world.types, strict=True):
        choices += [(f"{key}.{slot.key}", slot, slot.chosen(own)) for slot in TYPE_SLOTS]
    choices += [(slot.key, slot, slot.chosen(world)) for slot in SLOTS]
    keys += tuple(f"access_points[{k}]" for k in range(len(world.scenario.access_points)))
    for key, links in zip(keys, world.links, strict=True):
        slots_of_radio = (*RADIO_SLOTS, *LOSS_SLOTS)
        choices += [
            (f"{key}.radio.{slot.key}", slot, slot.chosen(links)) for slot in slots_of_radio
        ]
    for key, processor in zip(keys, world.processors, strict=True):
        choices += [(f"{key}.{slot.key}", slot, slot.chosen(processor)) for slot in PROCESSOR_SLOTS]
    for key, slot, component in choices:
        if why := why_not_compiled(slot, component, world.services.names):
            lacks.append(f"{key}: {type(component).__name__!r} is not compiled: {why}")
    return lacks + too_many(world) + too_large(world) + _too_slow(world)


def _too_slow(world: World) -> list[str]:
    """Return the keys by which returns take too long to plan, if so."""
    places = math.prod(world.grid.blocked.shape)
    if len(world.planners) * places * places <= MOST_PLANNING:
        return []
    return [f"map.cells, map.levels: ways back from {places:,} places take too long"]


@dataclass(frozen=True, eq=False)
class Fixed(Unchanging):
    """The constants of a world and run settings in memory, with functions by their addresses."""

    block: Words
    components: dict[str, Any]
    """The components that are compiled, by the keys of their slots."""
    types: tuple[dict[str, Any], ...]
    """Those of each type of drones, by the keys of TYPE_SLOTS."""
    radios: tuple[dict[str, Any], ...]
    """Those of each radio, by the keys of RADIO_SLOTS and LOSS_SLOTS."""
    processors: tuple[dict[str, Any], ...]
    """Those of each processor, by the keys of PROCESSOR_SLOTS; none if no service needs any."""
    services: tuple[str, ...]
    graded: bool
    in_air: bool
    at: int = field(init=False, default=0)
    """The address of the constants."""

    @cached_property
    def constants(self) -> Any:
        """The constants by name, of all engines of this world and these settings."""
        return View(self.block, Constants)

    @cached_property
    def plans(self) -> Array:
        """The planned returns, as an array of rows."""
        return array_of(self.block, Constants, "plans")

    @cached_property
    def hops(self) -> Array:
        """Their hops, as an array of rows."""
        return array_of(self.block, Constants, "hops")

    def __post_init__(self) -> None:
        """Write the addresses, which are valid only in this process."""
        constants = self.constants
        set_functions(constants, self.graded, self.in_air)
        codes = []
        placed = (
            (SLOTS, [constants], [self.components]),
            (TYPE_SLOTS, constants.types, self.types),
            (RADIO_SLOTS, constants.radios, self.radios),
            (LOSS_SLOTS, constants.scene.radios, self.radios),
            (PROCESSOR_SLOTS, constants.processors, self.processors),
        )
        for slots_of, rows, choices in placed:
            for (row, components), slot in product(zip(rows, choices, strict=True), slots_of):
                if slot.key in components:
                    component = components[slot.key]
                    codes.append(compiled(slot.functions, component, self.services))
                    point_at(row, slot, codes[-1])
        complete(constants.scene)
        object.__setattr__(self, "at", int(self.block.ctypes.data))
        object.__setattr__(self, "_loaded", codes)  # the constants point at their values

    def __setstate__(self, value: dict[str, Any]) -> None:
        """Restore the constants from a pickle, with the addresses of this process."""
        for name, one in value.items():
            object.__setattr__(self, name, owned(one) if name == "block" else one)
        self.__post_init__()


_PACKED: WeakKeyDictionary[World, dict[RunSettings, Fixed]] = WeakKeyDictionary()
"""The constants in memory, which are kept as long as their worlds exist."""


def pack(world: World, settings: RunSettings) -> Fixed:
    """Return the constants of a run in memory. Raises ScenarioError if ``lacking`` has reasons."""
    fixed_of = _PACKED.setdefault(world, {})
    if settings not in fixed_of:
        fixed_of[settings] = _pack(world, settings)
    return fixed_of[settings]


def _pack(world: World, settings: RunSettings) -> Fixed:
    problems = lacking(world)
    if problems:
        raise ScenarioError(*(f"{problem}; --engine des runs it" for problem in problems))
    constants: Any = constants_of(world, settings)
    constants.scene = scene_of(world)
    constants.plans, constants.hops = _plans(world, settings)
    constants.known_at, constants.known = tabulate(world)
    for number, own in enumerate(constants.types):
        own.first_known = number * legs_in_table(world)
    components = components_of(SLOTS, world)
    types = tuple(components_of(TYPE_SLOTS, own) for own in world.types)
    radios = tuple(components_of((*RADIO_SLOTS, *LOSS_SLOTS), links) for links in world.links)
    needed = world.processors[: len(constants.processors)]
    processors = tuple(components_of(PROCESSOR_SLOTS, each) for each in needed)
    chosen = components, types, radios, processors
    return Fixed(packed(constants), *chosen, world.services.names, world.graded, world.in_air)


def _plans(world: World, settings: RunSettings) -> tuple[Array, Array]:
    """Return the planned returns (2 * places, 5) and their hops (hops, 3), as rows of integers.

    There are so many for each planner. The first half of these is without the drones' ceiling, the
    second half below it. Returns that do not exist or are not needed are rows of -1.
    """
    nx, ny = world.grid.cells
    planners, places = world.planners, len(world.grid.levels_m) * nx * ny
    plans = np.full((max(len(planners), 1), 2, places, 5), -1, np.int64)
    hops = np.empty((1024, 3), np.int64)
    used = 0
    for number, planner in enumerate(planners):
        for ceiling in set(settings.ceilings):
            for level, x, y in np.ndindex(world.grid.levels(ceiling), nx, ny):
                back = planner.search((x, y, level), ceiling)
                if back is not None:
                    first, used = used, used + len(back.hops)
                    if used > len(hops):
                        hops = np.concatenate((hops, np.empty((used, 3), np.int64)))
                    hops[first:used] = np.array(back.hops, np.int64).reshape(-1, 3)
                    plans[number, int(ceiling), (level * nx + x) * ny + y] = (
                        *(back.station, back.duration_us, back.drain),
                        *(first, used),
                    )
    return plans.reshape(-1, 5), hops[:used]


def legs_of_step(world: World) -> int:
    """Return the initial buffer for users' legs in a step; 0 if whole walks are drawn before."""
    mobility, users = world.row_mobility, len(world.homes)
    if mobility is None:
        return 0
    return int(mobility.expected_legs(users, world.area, world.step_us / US)) + 2 * users + 16


STRETCHES = 64
"""The least number of blocked stretches of a line of sight for which there is memory."""


def room_for(users: int, buffers: Buffers, legs: int) -> Room:
    """Return how much memory there is, which grows with the buffers for crossings."""
    crossings = buffers.crossings
    return Room(crossings, 2 * users + 4 * crossings, legs + crossings, STRETCHES + crossings // 4)


def forget_packed() -> None:
    """Forget the constants and states that are kept, as if no engine had been made."""
    _PACKED.clear()
    _pack_state.cache_clear()


def pack_state(world: World, settings: RunSettings, buffers: Buffers, legs: int) -> Words:
    """Return a state in memory, with a buffer for this many legs of users in a step (``legs``)."""
    return _pack_state(world, settings, buffers, legs).copy()


@lru_cache(maxsize=4)
def _pack_state(world: World, settings: RunSettings, buffers: Buffers, legs: int) -> Words:
    state: Any = state_of(world, settings, buffers, State)
    drones, users, count = len(state.drones), len(state.users), slots(state)
    state.slot_times, state.slot_keys = _whole(count), _whole(count)
    state.winners = tournaments(count, crossing_slot(state, 0), len(state.senders))
    state.before = Table(_begun(drone) for drone in state.drones)
    look = state.look
    state.sky = sky_of(world, room_for(users, buffers, legs))
    if world.links[0].radio.reuse == 0:
        state.sky.changes = Table()  # kernels write to ``Drone.ahead``
    if world.row_mobility:
        model: Any = type(world.row_mobility)
        look.walking = walking = blank(walking_of(model))
        walking.width_m, walking.depth_m = world.area
        walking.horizon_us = world.horizon_us
        walker = held_by(walking.kinds["walkers"])
        walking.walkers, walking.legs_at = np.zeros((users, walker.words), int), _whole(users + 1)
        walking.legs = zeros(WalkLeg, legs)
    state.drones = Table()  # which are the first of the senders
    block, scratch_words = packed_apart(state)
    block[NEEDS] = scratch_words
    locate(block, State, "drones", 0, located(block, State, "senders")[0], drones)
    return block


def _begun(drone: Drone) -> Begun:
    """Return memory for what an episode begins with of a drone."""
    begun = blank(Begun)
    begun.course = None if drone.course is None else blank(BegunCourse)
    return begun


def _whole(count: int) -> Array:
    """Return a table of whole numbers, which are 0."""
    return np.zeros(count, np.int64)
