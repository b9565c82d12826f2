"""The compiled engine (see ``Engine``)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, cached_property
from pickle import UnpicklingError
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from desim_uav.commands.given import Command
from desim_uav.copies import owned, usable
from desim_uav.engine.base import Carried, RunSettings
from desim_uav.engine.compiled import calls, loop
from desim_uav.engine.compiled.loop import RESET, START_AFRESH, STEP
from desim_uav.engine.compiled.pack import legs_of_step, pack, pack_state
from desim_uav.engine.compiled.paths import paths_of
from desim_uav.engine.compiled.saving import Block
from desim_uav.engine.compiled.scratch import need, scratch
from desim_uav.engine.courses import aims_of
from desim_uav.engine.episode import Engine
from desim_uav.engine.saved import Kept, Rows, SavedState, copied, write
from desim_uav.engine.state import Buffers, most_loose
from desim_uav.errors import ScenarioError, SimulationError
from desim_uav.model.mobility.walking import walking_of
from desim_uav.model.mobility.walks import misstep
from desim_uav.model.state import Snapshot
from desim_uav.rowcode.code_digest import code_digest
from desim_uav.rowcode.rows import Words, held_by, is_row, named
from desim_uav.rowcode.views import View, array_of
from desim_uav.rules.rows import LookRow, PlanRow, State
from desim_uav.rules.words import LOST, OUT_OF_MEMORY, UNFINISHED
from desim_uav.sample_path import SamplePath, SamplePaths
from desim_uav.scenario.description import code_of, own_classes
from desim_uav.world import World

BUFFER, REQUESTS_A_USER, CROSSINGS_A_USER = 256, 2, 2
"""The initial buffers, which are doubled when an episode needs more: for the log of a step (rows in
all, and rows per user), and for the crossings of a leg (rows per user)."""

FEW = 3
"""The share of these crossings for which there is memory at first, if links have no classes and the
episode can be repeated."""

DERIVED = ("state", "state_at", "drones", "constants", "session")
"""The attributes that a copy makes again: views of an engine's memory, and who has its address."""


class BatchSimulation(Engine):
    """The compiled engine (see ``Engine``).

    Raises ScenarioError if a component of the scenario is not compiled.

    Copies and pickles are those of ``Engine``, and take the time to copy the memory of the state. A
    pickle can only be read by the code that wrote it, because other code may lay out the memory
    differently.
    """

    name = "batch"
    path: Words
    memory: Words
    session: Callable[[], Any] = staticmethod(lambda: None)
    """Returns the session that has the address of the state, if there is one (see ``tell``)."""

    def __init__(self, world: World, settings: RunSettings) -> None:
        super().__init__(world, settings)
        self.fixed = pack(world, settings)
        users = len(world.homes)
        crossings = _most_crossings(world) // (1 if world.graded else FEW)
        self.buffers = Buffers(BUFFER + REQUESTS_A_USER * users, crossings, users)
        self.leg_buffer = legs_of_step(world)
        self._make_room()

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes, and a digest of the code that determines the layout of memory."""
        value = {key: part for key, part in vars(self).items() if key not in DERIVED}
        return {**value, "code": _code_of(self.world)}

    def __setstate__(self, value: dict[str, Any]) -> None:
        """Restore the attributes in new memory. Raises UnpicklingError if other code wrote them."""
        if value["code"] != _code_of(value["world"]):
            raise UnpicklingError(
                "the compiled engine in this pickle was written by another version of desim-uav, "
                "of Python, or of a component of its scenario, which may lay out its memory "
                "differently; use the same versions"
            )
        vars(self).update({key: part for key, part in value.items() if key != "code"})
        if "path" in value:
            self.path = usable(self.path)
        self.memory = owned(self.memory)
        self._name_parts()

    def make_room_at_once(self) -> None:
        """Enlarge the buffers, also by the number of classes, for who cannot repeat an episode.

        There is memory for all users who can become loose in an instant.
        It must be called before the first episode.
        """
        rings = max(len(links.efficiencies) - 1 for links in self.world.links)
        loose = most_loose(len(self.world.homes), len(self.state.senders))
        self.buffers = Buffers(self.buffers.log, rings * _most_crossings(self.world), loose)
        if rings > 1:
            self.leg_buffer *= 2
        self._make_room()

    def make_room_for_stores(self, paths: SamplePaths) -> None:
        """Enlarge the stores of drones for episodes on these paths, for who cannot repeat them.

        No more updates come into a store than are taken. Drones begin the next episode as before.
        """
        if self.state.uploads:
            are_sensors = np.array(self.world.senses) >= 0
            most = max(int(np.diff(one.offsets)[are_sensors].sum()) for one in paths.requests)
            if most > self.buffers.log:
                carried = self.carried()
                self.buffers = self.buffers._replace(log=most)
                self._make_room()
                self.carry(carried)

    def _make_room(self) -> None:
        """Make a new state in memory."""
        self.memory = pack_state(self.world, self.settings, self.buffers, self.leg_buffer)
        self._name_parts()

    def _name_parts(self) -> None:
        """Set the attributes through which Python reads and writes the memory."""
        vars(self).pop("drones", None)
        self.constants = self.fixed.constants
        self.state_at = int(self.memory.ctypes.data)
        self.state = View(self.memory, State)
        need(self.memory)

    @cached_property
    def drones(self) -> Any:  # type: ignore[override]
        """The drones' rows in memory, which are made only for who asks for them."""
        return self.state.drones

    def refuse_unseen(self) -> None:
        """Raise ScenarioError if the scenario's observation is not compiled."""
        if "observation" not in self.fixed.components:
            name = type(self.world.scenario.observation).__name__
            raise ScenarioError(f"observation: {name!r} is not compiled; engine='des' runs it")

    def move_to(self, world: World, settings: RunSettings) -> bool:
        """Go to another world of the same scenario, where the drones begin afresh, if it fits.

        Returns whether it does: whether the state of that world takes the same memory.
        """
        same = world.scenario is self.world.scenario and settings == self.settings
        if not same or world.in_air or world.reach_m != self.world.reach_m:
            return False
        self.world, self.fixed = world, pack(world, settings)
        self.constants = self.fixed.constants
        self.carry(None)
        return True

    # ---- access to the rows

    def addresses(self) -> tuple[int, int, int]:
        """Return the addresses of constants, sample path (0 before the first one) and state."""
        path = vars(self).get("path")
        return self.fixed.at, 0 if path is None else path.ctypes.data, self.state_at

    def entries(self, name: str) -> Sequence[Any]:
        """Return the numbers or rows in this table or queue of the state."""
        of = held_by(State.kinds[name])
        if not is_row(of):
            numbers: list[Any] = getattr(self.state, name).tolist()
            return numbers
        return list(map(named(of)._make, array_of(self.memory, State, name).tolist()))

    def plan(self, number: int) -> Any:
        """Return the planned return with this number."""
        return named(PlanRow)._make(self.fixed.plans[number].tolist())

    def hops(self, first: int, end: int) -> list[tuple[int, int, int]]:
        """Return the hops with the numbers ``first`` to ``end`` - 1, as (dx, dy, dlevel)."""
        hops: list[tuple[int, int, int]] = self.fixed.hops[first:end].tolist()
        return hops

    def route(self, hops: Sequence[tuple[int, int, int]]) -> tuple[int, int]:
        """Return the numbers of hops, which are the end of some planned return."""
        all_rows, rows = self.fixed.hops.view(np.int64).reshape(-1, 3), np.array(hops, np.int64)
        starts = np.flatnonzero((all_rows[: len(all_rows) - len(rows) + 1] == rows[0]).all(axis=1))
        for first in starts.tolist():
            if (all_rows[first : first + len(rows)] == rows).all():
                return first, first + len(rows)
        raise SimulationError(f"carry: {tuple(hops)} is no way back of this world")

    def start_afresh(self) -> None:
        """Put all drones at their starting cells with full batteries, and empty the stations."""
        calls.run(self.fixed.at, self.state_at, self.state_at, START_AFRESH, scratch())

    def features(self) -> list[tuple[float, ...]]:
        """Return each drone's features, as far as an observation over rows has written them."""
        if "observation" not in self.fixed.components:
            return [()] * len(self.drones)
        calls.describe(self.fixed.at, self.state_at)
        return [tuple(drone.features.tolist()) for drone in self.drones]

    # ---- episodes

    def reset(self, path: SamplePath) -> Snapshot:
        """Begin an episode and run up to its first decision epoch."""
        self.begin(path)
        return self.snapshot()

    def begin(self, path: SamplePath) -> None:
        """Begin an episode without a snapshot."""
        self.latest = None
        self._began = self._carried, self._goes_on
        self.path, _ = self.prepare(SamplePaths.of(path))
        self.drawn = path
        calls.run(*self.addresses(), RESET, scratch())
        self.drain()

    def begin_on(self, path: Words, drawn: Callable[[], SamplePath], episode: int) -> bool:
        """Prepare for ``calls.begin_all``, which begins an episode on a path in memory.

        ``drawn`` draws this path again. Returns whether it has to put the drones at their starts.
        """
        self.latest = None
        self._began = carried, goes_on = self._carried, self._goes_on
        self.path, self._drawn = path, drawn
        if not goes_on and carried:
            self.load(carried)
        self.set_under_way(episode)
        return not goes_on and not carried

    def _before(self) -> Carried | None:
        """Return the states in which drones began the episode, which may have to be repeated."""
        carried, goes_on = self._began
        if goes_on:
            begun = self.state.before
            places = [drone.place for drone in begun]
            carried = self.drones_of(self.state.before_us, begun, places)
            self._began = carried, False
        return carried

    def prepare(self, paths: SamplePaths) -> tuple[Words, NDArray[np.int64]]:
        """Put the drones where they begin episodes on these paths; return the paths in memory."""
        self.take_up(paths.episodes[-1])
        self.drawn = paths[-1]
        return paths_of(paths)

    # ---- saved states

    def _keep(self) -> tuple[Carried | None, Kept]:
        """Return the states in which drones began the episode, and a copy of the memory."""
        return self._before(), Block(
            self.memory.copy(), self.path, self.fixed, self.buffers, self.leg_buffer
        )

    def _take(self, saved: SavedState) -> None:
        """Copy the memory of a saved state or, if an engine of another kind saved it, its rows."""
        self._began, memory = (saved.before, False), saved.kept
        if isinstance(memory, Block) and memory.fixed is self.fixed:
            self._set_memory(memory.words, memory.buffers, memory.leg_buffer)
            self.path, self.latest = memory.path, saved.latest
        else:
            self.path, _ = paths_of(SamplePaths.of(saved.path))
            self._resume(saved.rows)

    def _set_memory(self, words: Words, buffers: Buffers, leg_buffer: int) -> None:
        """Copy the memory of a state with these buffers into that of this engine."""
        if (buffers, leg_buffer) == (self.buffers, self.leg_buffer):
            np.copyto(self.memory, words)
        else:
            self.memory, self.buffers, self.leg_buffer = words.copy(), buffers, leg_buffer
            self._name_parts()

    def _resume(self, rows: Rows) -> None:
        """Go on from rows on the present sample path."""
        self._take_rows(rows)
        calls.resume(*self.addresses(), np.array(rows.due, np.int64).reshape(-1, 3))

    def _take_rows(self, rows: Rows) -> None:
        """Write rows into the memory, which is enlarged if there are too many crossings for it."""
        crossings = max(len(sender.ahead) for sender in rows.state.senders)
        stored = max(len(sender.store) for sender in rows.state.senders)
        if crossings > self.buffers.crossings or stored > self.buffers.log:
            crossings = max(2 * crossings, self.buffers.crossings)
            log = max(2 * stored, self.buffers.log)
            self.buffers = self.buffers._replace(crossings=crossings, log=log)
            self._make_room()
        state = rows.state
        if stored and not (self.settings.keep_steps or self.settings.keep_events or state.uploads):
            state = state._replace(senders=[one._replace(store=()) for one in state.senders])
        write(self.state, State, state)
        self.set_routes(rows.routes)

    def enlarge(self) -> None:
        """Double the buffers, and keep the present state."""
        saved = self.save()
        self.buffers = self.buffers.doubled()
        self.leg_buffer *= 2
        self._make_room()
        self._resume(saved.rows)
        if (session := self.session()) is not None:
            session.tell()

    def _ready(self) -> bool:
        """Return whether the last step, or the reset, has not failed."""
        return bool(self.state.faults == 0)

    def fork_into(self, siblings: Sequence[BatchSimulation]) -> None:
        """Let other engines of this world and these settings go on from the present state.

        They share its sample path and its constants. Raises SimulationError as ``save`` does, and
        if a sibling is of another world or has other settings.
        """
        if any(each.fixed is not self.fixed for each in siblings):
            raise SimulationError("fork_into: a sibling is of another world or has other settings")
        self.require_epoch("fork_into")
        before = self._before(), False
        for each in siblings:
            each._set_memory(self.memory, self.buffers, self.leg_buffer)
            each.path, each.latest, each._began = self.path, self.latest, before
            each._drawn = self._drawn
            each.log = copied(self.log, self.settings)
            each._served_by = {number: drones[:] for number, drones in self._served_by.items()}
            each._carried, each._under_way = None, True

    def check_components(self) -> None:
        """Raise SimulationError if a component has broken its contract."""
        super().check_components()
        if self.state.faults & UNFINISHED:
            raise SimulationError("an earlier step of this episode has failed: reset it")
        if self.state.faults & LOST:
            mobility: Any = self.world.row_mobility
            model: Any = type(mobility)
            at = (State.byte_of["look"] + LookRow.byte_of["walking"]) // 8
            raise misstep(mobility, View(self.memory, walking_of(model), at))

    def check(self) -> None:
        """Check episodes that a kernel has run. Raises SimulationError if one had a fault."""
        self.log.crashed[:] = self.entries("crashed")
        self.check_components()
        if self.state.faults & OUT_OF_MEMORY:
            legs = (
                f", or a step more than {self.leg_buffer} legs of users" if self.leg_buffer else ""
            )
            raise SimulationError(
                f"a drone's leg has more than {self.buffers.crossings} crossings{legs}; "
                "--engine des has room"
            )

    def step(self, commands: Sequence[Command]) -> Snapshot:
        """Give the commands and run to the next decision epoch, or to the episode's end."""
        self.hear(commands)
        calls.run(*self.addresses(), STEP, scratch())
        self.drain()
        return self.snapshot()

    def drain(self) -> None:
        """Add a step to the log; if it ran out of memory, run the episode again in more memory."""
        while self.state.faults & OUT_OF_MEMORY:
            heard = self.state.history.reshape(-1, len(self.drones))[: self.state.step].tolist()
            aims = self.state.aims.copy()
            self._before()  # which the memory holds that is given up now
            self.buffers = self.buffers.doubled()
            self.leg_buffer *= 2
            self._make_room()
            # Of the steps that follow only the last one can have run out of memory.
            for step in range(self.go_back(), len(heard)):
                self.drain_log()
                for drone, command in zip(self.drones, heard[step], strict=True):
                    drone.command = command
                if len(aims):
                    aims_of(aims, step, self.drones)
                calls.run(*self.addresses(), STEP, scratch())
        self.check_components()
        self.drain_log()

    def go_back(self) -> int:
        """Begin the episode anew in memory that has been made anew; return the step, 0."""
        self.load(self._before())
        self.new_log(self.log.episode)
        calls.run(*self.addresses(), RESET, scratch())
        return 0


def _most_crossings(world: World) -> int:
    """Return how many crossings few legs exceed, if links have no classes."""
    return CROSSINGS_A_USER * len(world.homes) + 16


_CODES: WeakKeyDictionary[World, list[str]] = WeakKeyDictionary()


def _code_of(world: World) -> list[str]:
    """Return digests of the code that determines the layout of a world's engines in memory."""
    if world not in _CODES:
        own = {code_of(cls) for cls in own_classes(world.scenario)}
        _CODES[world] = [kernels_digest(), *sorted(own)]
    return _CODES[world]


@cache
def kernels_digest() -> str:
    """Return a digest of the code of a step's kernels, which changes with the layout of rows."""
    run: Any = loop.run
    return code_digest(getattr(run, "py_func", run))
