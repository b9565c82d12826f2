"""The compiled engine (see ``Engine``)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pickle import UnpicklingError
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.copies import owned, usable
from desim_uav.engine.base import Place, RunSettings
from desim_uav.engine.compiled import calls, loop
from desim_uav.engine.compiled.loop import RESET, START_AFRESH, STEP
from desim_uav.engine.compiled.pack import pack, pack_state
from desim_uav.engine.compiled.paths import paths_of
from desim_uav.engine.compiled.walking import legs_of_step
from desim_uav.engine.episode import RowEngine
from desim_uav.engine.state import Room
from desim_uav.errors import ScenarioError, SimulationError
from desim_uav.model.code_digest import code_digest
from desim_uav.model.rows import (
    View,
    Words,
    array_of,
    held_by,
    named,
    room_of,
)
from desim_uav.model.state import Snapshot
from desim_uav.rules.rows import Constants, Drone, State, Station
from desim_uav.rules.words import OUT_OF_MEMORY
from desim_uav.sample_path import SamplePath, SamplePaths
from desim_uav.world import World

ROOM, REQUESTS_A_USER, CROSSINGS_A_USER = 256, 2, 2
"""How many rows there is memory for: of the log of a step (and more per user), and of a leg's
crossings per user. There is more as soon as an episode needs it."""

TABLES = (
    *("drones", "users", "seen", "records", "counts", "masks", "asked", "rewards"),
    "history",
)
QUEUES = ("events", "closed", "handovers", "crashed")
"""The tables and queues of the state that Python reads."""

DERIVED = ("arrays", "root", "constants", "drones", "state_at", "queues")
"""The attributes that name parts of an engine's memory, which a copy makes again."""


class BatchSimulation(RowEngine):
    """The compiled engine (see ``Engine``).

    Raises ScenarioError if a component of the scenario is not compiled.

    Copies and pickles are as ``Engine`` says, at the cost of copying the memory of the state. Only
    the code that wrote a pickle can read it, because other code may lay out the memory differently.
    """

    path: Words
    state: Words

    def __init__(self, world: World, settings: RunSettings) -> None:
        super().__init__(world, settings)
        self.fixed = pack(world, settings)
        users = len(world.homes)
        self.room = Room(ROOM + REQUESTS_A_USER * users, CROSSINGS_A_USER * users + 16)
        self.leg_room = legs_of_step(world)
        self._make_room()

    def __getstate__(self) -> dict[str, Any]:
        """The engine's value, and the code that knows what stands where in its memory."""
        value = {key: part for key, part in vars(self).items() if key not in DERIVED}
        return {**value, "code": kernels_digest()}

    def __setstate__(self, value: dict[str, Any]) -> None:
        """Take a value, in memory of its own. Raises UnpicklingError if other code wrote it."""
        if value["code"] != kernels_digest():
            raise UnpicklingError(
                "the compiled engine in this pickle was written by another version of desim-uav or "
                "of Python, which may lay out its memory differently; use the same versions"
            )
        vars(self).update({key: part for key, part in value.items() if key != "code"})
        if "path" in value:
            self.path = usable(self.path)
        self.state = owned(self.state)
        self._name_parts()

    def _make_room(self) -> None:
        self.state = pack_state(self.world, self.settings, self.room, self.leg_room)
        self._name_parts()

    def _name_parts(self) -> None:
        """Name the parts of the memory that Python reads and writes."""
        self.root = self.state[: State.words]
        fixed = self.fixed.block
        self.arrays = {name: array_of(self.state, State, name) for name in TABLES}
        self.arrays |= {name: room_of(self.state, State, name) for name in QUEUES}
        self.constants = {name: array_of(fixed, Constants, name) for name in ("plans", "hops")}
        first = int(self.state[State.places["drones"]]) // 8
        count = self.world.scenario.drones.count
        self.drones = [View(self.state, Drone, first + k * Drone.words) for k in range(count)]
        self.state_at = int(self.state.ctypes.data)
        first = int(self.state[State.places["stations"]]) // 8
        self.queues = [first + k * Station.words for k in range(len(self.world.stations))]

    def refuse_unseen(self) -> None:
        """Raise ScenarioError if the scenario's observation is not compiled."""
        if "observation" not in self.fixed.components:
            name = type(self.world.scenario.observation).__name__
            raise ScenarioError(f"observation: {name!r} is not compiled; engine='des' runs it")

    # ---- where the rows are

    def number(self, name: str) -> Any:
        """Return a number of the state."""
        kind, place = State.kinds[name], State.places[name]
        word = self.root[place : place + 1]
        return word.view(np.float64)[0].item() if kind is float else word[0].item()

    def numbers(self, name: str) -> list[Any]:
        """Return the numbers of a table or queue of the state."""
        array = self.arrays[name]
        if name in QUEUES:
            array = array[: self._count(name)]
        numbers: list[Any] = array.tolist()
        return numbers

    def rows(self, name: str) -> Sequence[Any]:
        """Return the rows of a table or queue of the state, to be read."""
        kind = State.kinds[name]
        if name == "stations":
            return [named(Station)._make([queue]) for queue in self._queued()]
        array = self.arrays[name]
        if name in QUEUES:
            array = array[: self._count(name)]
        return list(map(named(held_by(kind))._make, array.tolist()))

    def _count(self, name: str) -> int:
        return int(self.root[State.places[name] + 1])

    def drone(self, index: int) -> Any:
        """Return the row of a drone, to be written."""
        return self.drones[index]

    def plan(self, drone: int, place: int) -> Any:
        """Return the way back of a drone from a place, as a row."""
        plans = self.constants["plans"]
        row = plans[int(self.settings.ceilings[drone]) * (len(plans) // 2) + place]
        return named(held_by(Constants.kinds["plans"]))._make(row.tolist())

    def hops(self, first: int, end: int) -> list[tuple[int, int, int]]:
        """Return the hops of these numbers."""
        hops: list[tuple[int, int, int]] = self.constants["hops"][first:end].tolist()
        return hops

    def route(self, hops: Sequence[tuple[int, int, int]]) -> tuple[int, int]:
        """Return the numbers of hops, which are the end of some way back."""
        known = self.constants["hops"].view(np.int64).reshape(-1, 3)
        wanted = np.array(hops, np.int64)
        starts = np.flatnonzero((known[: len(known) - len(wanted) + 1] == wanted[0]).all(axis=1))
        for first in starts.tolist():
            if (known[first : first + len(wanted)] == wanted).all():
                return first, first + len(wanted)
        raise SimulationError(f"carry: {tuple(hops)} is no way back of this world")

    def queue_up(self, drone: int, station: int) -> None:
        """Put a drone last in a station's queue."""
        place = self.queues[station]
        first, count = int(self.state[place]) // 8, int(self.state[place + 1])
        self.state[place + first + count] = drone
        self.state[place + 1] = count + 1

    def _queued(self) -> list[list[int]]:
        """Return the drones at each station."""
        queued = []
        for place in self.queues:
            first, count = self.state[place : place + 2].tolist()
            queued.append(self.state[place + first // 8 :][:count].tolist())
        return queued

    def start_afresh(self) -> None:
        """Put the drones at their starts."""
        world, state = self._at()
        calls.run(world, state, state, START_AFRESH)

    def terms(self) -> tuple[dict[str, float], ...]:
        """Return the terms of the drones' rewards, by name."""
        return tuple(
            dict(zip(self.term_names, drone.terms.tolist(), strict=True)) for drone in self.drones
        )

    def features(self) -> list[tuple[float, ...]]:
        """Return what learners observe of the drones now."""
        if "observation" not in self.fixed.components:
            return [()] * len(self.drones)
        calls.describe(*self._at())
        return [tuple(drone.features.tolist()) for drone in self.drones]

    def measured(self) -> tuple[float, float, float]:
        """Return QoE1-3 so far; NaN if they do not exist yet."""
        return calls.measures(*self._at())

    def position_m(self, drone: int) -> Place:
        """Return where a drone is now."""
        return calls.position(*self._at(), drone)

    def doing(self, user: int) -> int:
        """Return what a user is doing now."""
        return calls.user_doing(self.state_at, user)

    def walks(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the users' walks in this episode."""
        return self._walking.drawn()

    def _at(self) -> tuple[int, int]:
        return self.fixed.at, self.state_at

    def addresses(self) -> tuple[int, int, int]:
        """Return where world, sample path and state are."""
        return self.fixed.at, self.path.ctypes.data, self.state_at

    # ---- episodes

    def reset(self, path: SamplePath) -> Snapshot:
        """Begin an episode and run up to its first decision epoch."""
        self.begin(path)
        return self.snapshot()

    def begin(self, path: SamplePath) -> None:
        """Begin an episode without a snapshot."""
        self.shown = None
        self.path, _ = self.prepare(SamplePaths.of(path))
        self._began = self._drones_words()
        calls.run(*self.addresses(), RESET)
        self.drain()

    def prepare(self, paths: SamplePaths) -> tuple[Words, NDArray[np.int64]]:
        """Put the drones where they begin; episodes on these packed paths are to follow."""
        self.take_up(paths.episodes[-1])
        self._walking = paths.walking[-1]
        return paths_of(paths)

    def check(self) -> None:
        """Check episodes that a kernel has run. Raises SimulationError if one had a fault."""
        self.log.crashed[:] = self.numbers("crashed")
        self.check_components()
        if self.number("faults") & OUT_OF_MEMORY:
            legs = f", or a step more than {self.leg_room} legs of users" if self.leg_room else ""
            raise SimulationError(
                f"a drone's leg has more than {self.room.crossings} crossings{legs}; "
                "--engine des has room"
            )

    def step(self, commands: Sequence[int]) -> Snapshot:
        """Give the commands and run to the next decision epoch, or to the episode's end."""
        self.hear(commands)
        calls.run(*self.addresses(), STEP)
        self.drain()
        return self.snapshot()

    def drain(self) -> None:
        """Move what has happened into the log; if it did not fit, make room and play again."""
        while self.number("faults") & OUT_OF_MEMORY:
            drones = len(self.drones)
            heard = self.arrays["history"].reshape(-1, drones)[: self.number("step")].tolist()
            self.room = Room(2 * self.room.log, 2 * self.room.crossings)
            self.leg_room *= 2
            self._make_room()
            self._restore_drones(*self._began)
            self.new_log(self.log.episode)
            calls.run(*self.addresses(), RESET)
            for commands in heard:  # before the last of them nothing can be short of memory
                self.drain_log()
                for drone, command in zip(self.drones, commands, strict=True):
                    drone.command = command
                calls.run(*self.addresses(), STEP)
        self.check_components()
        self.drain_log()

    def _drones_words(self) -> tuple[int, NDArray[Any], list[list[int]]]:
        """Return the time, the drones' rows, and the queues at the stations."""
        return self.number("now_us"), self.arrays["drones"].copy(), self._queued()

    def _restore_drones(self, now_us: int, drones: NDArray[Any], queues: list[list[int]]) -> None:
        """Put the drones where they were before the episode, in memory with more room."""
        self.root[State.places["now_us"]] = now_us
        for name, kind in Drone.kinds.items():
            if kind in (int, float):
                self.arrays["drones"][name] = drones[name]
        for station, queue in enumerate(queues):
            for drone in queue:
                self.queue_up(drone, station)


@cache
def kernels_digest() -> str:
    """Return what the kernels of a step are compiled from: it changes with the layout of rows."""
    run: Any = loop.run
    return code_digest(getattr(run, "py_func", run))
