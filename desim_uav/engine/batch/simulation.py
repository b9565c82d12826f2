"""The compiled engine as an ``Engine``: the same snapshots and logs as the SimPy engine's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pickle import UnpicklingError
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.copies import Independent, owned, usable
from desim_uav.engine.base import (
    Carried,
    CarriedDrone,
    EpisodeLog,
    FlownLeg,
    Measures,
    Place,
    RunSettings,
    Step,
    UserState,
)
from desim_uav.engine.batch import calls
from desim_uav.engine.batch.memory import (
    AT_BLOCKED,
    AT_HOP_TRANSITS,
    AT_HOPS,
    AT_PLANS,
    ATTACHED_US,
    BANDWIDTH_US_BPS,
    BATTERY_US,
    BUCKETS_X,
    BUCKETS_Y,
    CHARGES,
    CLOSED,
    COUNTED_M,
    COUNTERS,
    CRASHES,
    DISTANCE_M,
    EPOCH,
    EVENTS,
    FALLEN,
    FALLEN_X_M,
    FALLEN_Y_M,
    FULL,
    HANDOVERS,
    HOPPING,
    K_LEG,
    KINDS,
    LEVEL,
    MODE,
    NOW,
    OBSERVATION,
    OBSERVATION_NONE,
    OPENED,
    QUEUEING_US,
    ROUTE,
    ROUTE_END,
    SEEN_X_M,
    SEEN_Y_M,
    SEEN_Z_M,
    SINCE_US,
    SUPPRESSED,
    TAKEN,
    TERMINATED,
    TO_LEVEL,
    TO_X,
    TO_Y,
    TOLD,
    TRANSIT,
    TRUNCATED,
    Fixed,
    Ints,
    Path,
    State,
    X,
    Y,
    state_of,
    views,
)
from desim_uav.engine.batch.pack import pack, term_names
from desim_uav.engine.batch.paths import paths_of
from desim_uav.engine.batch.walking import legs_of_step
from desim_uav.errors import ScenarioError, SimulationError
from desim_uav.model.code_digest import code_digest
from desim_uav.model.coverage import all_walked
from desim_uav.model.rules import US, Mode, Outcome, Phase
from desim_uav.model.state import Observation, Snapshot
from desim_uav.sample_path import SamplePath, SamplePaths
from desim_uav.world import World

MODES = tuple(Mode)
PHASES = (None, *Phase)
STATES = tuple(UserState)
ROOM, REQUESTS_A_USER, CROSSINGS_A_USER = 256, 2, 2
"""Rows for what is kept of a step, and for a leg's crossings; there is more where needed."""


@dataclass(slots=True)
class ClosedRequest:
    """A request that has ended (see ``engine.base.ClosedRequest``)."""

    request_id: int
    user: int
    service: int
    bandwidth_bps: int
    required_us: int
    served_us: int
    attached_us: int
    t_request_us: int
    t_first_us: int | None
    t_end_us: int
    interruptions: int
    drones: list[int]
    outcome: Outcome


DERIVED = ("views", "_hops", "_plans")
"""What an engine has besides its value: names for parts of its arrays."""


class BatchSimulation(Independent):
    """The compiled engine (see ``Engine``).

    Raises ScenarioError where a component of the scenario has no kernel.

    Copies and pickles are as ``Engine`` says, at the cost of copying the arrays of the state. Only
    the code that wrote a pickle can read it, because other code may lay out the arrays differently.
    """

    packed: Path
    state: State

    def __init__(self, world: World, settings: RunSettings) -> None:
        self.world = world
        self.settings = settings
        self.fixed = pack(world, settings)
        self._name_plans()
        self.shown: Snapshot | None = None
        self.log = EpisodeLog(0)
        self.room = ROOM + REQUESTS_A_USER * len(world.homes)
        self.crossing_room = CROSSINGS_A_USER * len(world.homes) + 16
        self.leg_room = legs_of_step(world)
        self._make_room()
        self._carried: Carried | None = None
        self._under_way = False
        self.term_names = term_names(world)

    def __getstate__(self) -> dict[str, Any]:
        """The engine's value, and the code that knows what stands where in its arrays."""
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
        self.fixed = Fixed(usable(self.fixed.i), usable(self.fixed.f))
        self._name_plans()
        if "packed" in value:
            self.packed = Path(usable(self.packed.i), usable(self.packed.f))
        self.state = State(owned(self.state.i), owned(self.state.f))
        self.views = views(self.state)

    def _name_plans(self) -> None:
        self._hops = self._section(AT_HOPS, AT_BLOCKED).reshape(-1, 3)
        self._plans = self._section(AT_PLANS, AT_HOPS).reshape(2, -1, 5)

    def _section(self, first: int, after: int) -> Ints:
        fixed = self.fixed.i
        return fixed[fixed[first] : fixed[after]]

    def _make_room(self) -> None:
        world = self.world
        self.state = state_of(
            world.scenario.drones.count,
            len(world.homes),
            len(world.stations),
            len(world.services.names),
            world.scenario.episode.steps,
            len(world.actions),
            events=self.room if self.settings.keep_events else 0,
            requests=self.room if self.settings.keep_steps else 0,
            crossings=self.crossing_room,
            buckets=int(self.fixed.i[BUCKETS_X] * self.fixed.i[BUCKETS_Y]),
            legs=self.leg_room,
        )
        self.views = views(self.state)

    def refuse_unseen(self) -> None:
        """Raises ScenarioError where the scenario's observation has no kernel."""
        observation = self.world.scenario.observation
        if self.fixed.i[OBSERVATION] == OBSERVATION_NONE:
            raise ScenarioError(
                f"observation: {type(observation).__name__!r} is not compiled; engine='des' runs it"
            )

    # ---- episodes

    @property
    def terminated(self) -> bool:
        """Has a crash ended the episode?"""
        return self._under_way and bool(self.state.i[TERMINATED])

    @property
    def truncated(self) -> bool:
        """Is the episode's time up?"""
        return self._under_way and bool(self.state.i[TRUNCATED])

    def reset(self, path: SamplePath) -> Snapshot:
        """Begin an episode and run up to its first decision epoch."""
        self.begin(path)
        return self.snapshot()

    def begin(self, path: SamplePath) -> None:
        """The same without looking."""
        self.shown = None
        self.packed, _ = self.prepare(SamplePaths.of(path))
        self._drones_began = tuple(
            part.copy() for part in (self.state.i[:COUNTERS], *self._drone_views())
        )
        calls.reset(self.fixed, self.packed, self.state)
        self.drain()

    def prepare(self, paths: SamplePaths) -> tuple[Path, Ints]:
        """Put the drones where they begin; episodes on these packed paths are to follow."""
        goes_on = self.truncated and not self.terminated and self.settings.carry_over
        if not goes_on:
            self._load(self._carried)
        self._carried = None
        self._under_way = True
        self._episode, self._walking = paths.episodes[-1], paths.walking[-1]
        self._new_log()
        return paths_of(paths)

    def check(self) -> None:
        """After episodes without Python. Raises SimulationError where it ran out of room."""
        self.log.crashed[:] = self.views.crashed[: self.state.i[CRASHES]].tolist()
        if self.state.i[FULL]:
            legs = f", or a step more than {self.leg_room} legs of users" if self.leg_room else ""
            raise SimulationError(
                f"a drone's leg has more than {self.crossing_room} crossings{legs}; "
                "--engine des has room"
            )

    def _drone_views(self) -> tuple[NDArray[Any], ...]:
        return self.views.drone, self.views.place, self.views.station

    def _new_log(self) -> None:
        self._served_by: dict[int, list[int]] = {}
        self.log = EpisodeLog(self._episode, [] if self.settings.keep_events else None)

    def step(self, commands: Sequence[int]) -> Snapshot:
        """Give the commands and run to the next decision epoch, or to the episode's end."""
        if self.shown is None or self.shown.terminated or self.shown.truncated:
            raise SimulationError("step: the episode is over, or none has begun; call reset first")
        count = len(self.world.actions)
        told = np.array([c if 0 <= c < count else -1 for c in commands], np.int64)
        if len(told) != len(self.views.drone):
            raise ValueError(f"{len(told)} commands for {len(self.views.drone)} drones")
        calls.step(self.fixed, self.packed, self.state, told)
        self.drain()
        return self.snapshot()

    def drain(self) -> None:
        """Move what has happened into the log; where it did not fit, make room and play again."""
        while self.state.i[FULL]:
            told_so_far = self.views.history[: self.state.i[EPOCH]].copy()
            self.room *= 2
            self.crossing_room *= 2
            self.leg_room *= 2
            self._make_room()
            counters, *parts = self._drones_began
            self.state.i[:COUNTERS] = counters
            for view, part in zip(self._drone_views(), parts, strict=True):
                view[:] = part
            self._new_log()
            calls.reset(self.fixed, self.packed, self.state)
            for told in told_so_far:  # before the last of them nothing can be short of room
                self._drain_log()
                calls.step(self.fixed, self.packed, self.state, told)
        self._drain_log()

    def _drain_log(self) -> None:
        state, log = self.state, self.log
        whole = state.i
        if whole[CRASHES] > len(log.crashed):
            log.crashed[:] = self.views.crashed[: whole[CRASHES]].tolist()
        if self.settings.keep_steps:
            self._log_requests()
            if whole[EPOCH]:
                self._log_steps()
        if log.events is not None:
            for t_us, phase, kind, d, *rest in self.views.events[: whole[EVENTS]].tolist():
                if kind == K_LEG:
                    log.legs.append(self._leg(t_us, d, MODES[phase], *rest))
                else:
                    log.events.append((t_us, PHASES[phase], KINDS[kind], d, *rest))
        if whole[TERMINATED] or whole[TRUNCATED]:
            self._end_log()

    def _leg(
        self, t_us: int, d: int, mode: Mode, start: int, end: int, duration_us: int
    ) -> FlownLeg:
        """A leg between two numbered places; a crashed drone lies where its state says."""
        if mode is Mode.CRASHED:
            x_m, y_m = self.views.place[d, [FALLEN_X_M, FALLEN_Y_M]].tolist()
            return FlownLeg(t_us, d, 0, mode, (x_m, y_m, 0.0), (x_m, y_m, 0.0))
        return FlownLeg(t_us, d, duration_us, mode, self._place_m(start), self._place_m(end))

    def _place_m(self, node: int) -> Place:
        grid = self.world.grid
        column, y = divmod(node, grid.cells[1])
        level, x = divmod(column, grid.cells[0])
        return *grid.centre(x, y), grid.levels_m[level]

    def _end_log(self) -> None:
        whole, log = self.state.i, self.log
        log.duration_us = int(whole[NOW])
        log.attached_us = int(whole[ATTACHED_US])
        log.bandwidth_us_bps = int(whole[BANDWIDTH_US_BPS])
        log.queueing_us = int(whole[QUEUEING_US])
        log.distance_m = float(self.state.f[DISTANCE_M])
        log.charges = int(whole[CHARGES])
        log.suppressed = int(whole[SUPPRESSED])
        log.requests.sort(key=lambda request: request.request_id)
        log.put_in_order()

    def _log_requests(self) -> None:
        whole, state = self.state.i, self.views
        for request, d in state.handovers[: whole[HANDOVERS]].tolist():
            self._served_by.setdefault(request, []).append(d)
        for row in state.closed[: whole[CLOSED]].tolist():
            request_id, user, service, bps, required, served, attached, asked, *rest = row
            t_first, t_end, interruptions = rest
            outcome = Outcome.UNFINISHED if served else Outcome.NEVER_SERVED
            self.log.requests.append(
                ClosedRequest(
                    request_id,
                    user,
                    service,
                    bps,
                    required,
                    served,
                    attached,
                    asked,
                    None if t_first < 0 else t_first,
                    t_end,
                    interruptions,
                    self._served_by.pop(request_id, []),
                    Outcome.COMPLETED if served == required else outcome,
                )
            )

    def _log_steps(self) -> None:
        state, actions = self.views, self.world.actions
        whole = self.state.i
        limited = self.world.facts.capacity_s is not None
        rows = zip(
            state.record.tolist(),
            state.place.tolist(),
            state.drone[:, [TOLD, TAKEN]].tolist(),
            state.rewards.tolist(),
            strict=True,
        )
        for d, (record, place, (told, taken), reward) in enumerate(rows):
            battery_us, mode, attached, served, used_bps, back = record
            self.log.steps.append(
                Step(
                    int(whole[EPOCH]) - 1,
                    int(whole[NOW]),
                    d,
                    place[SEEN_X_M],
                    place[SEEN_Y_M],
                    place[SEEN_Z_M],
                    battery_us if limited else None,
                    MODES[mode],
                    None if told < 0 else actions[told],
                    actions[taken],
                    attached,
                    served,
                    used_bps,
                    self._plan(d, back)[2],
                    reward,
                )
            )

    def _plan(self, d: int, node: int) -> tuple[int | None, float | None, float | None]:
        """(station, duration in s, n_B in µs) of the way back from a node."""
        if self.world.facts.capacity_s is None:
            return None, None, None
        ceiling = int(self.settings.ceilings[d])
        station, duration_us, drained_us, _, _ = self._plans[ceiling, node].tolist()
        if station < 0:
            return None, None, math.inf
        return station, duration_us / US, drained_us

    def addresses(self) -> tuple[int, ...]:
        """Where the arrays of world, sample path and state are (see ``calls.step_all``)."""
        arrays = (*self.fixed, *self.packed, *self.state)
        return tuple(array.ctypes.data for array in arrays)

    # ---- from one episode to the next

    def carried(self) -> Carried | None:
        """What the next episode's drones begin with; None where they start afresh."""
        if self.truncated and not self.terminated and self.settings.carry_over:
            return self._drones_now()
        return self._carried

    def carry(self, drones: Carried | None) -> None:
        """Let the next episode begin with these drones."""
        self.shown = None
        self._under_way = False
        self._carried = drones

    def _drones_now(self) -> Carried:
        state = self.views
        now_us = int(self.state.i[NOW])
        order = [row[1 : 1 + row[0]] for row in state.station.tolist()]
        places = {d: place for there in order for place, d in enumerate(there)}
        found = []
        for d, (row, real) in enumerate(
            zip(state.drone.tolist(), state.place.tolist(), strict=True)
        ):
            x, y, level = row[X], row[Y], row[LEVEL]
            hop = (row[TO_X] - x, row[TO_Y] - y, row[TO_LEVEL] - level)
            route = self._hops[row[ROUTE] : row[ROUTE_END]].tolist()
            fallen = (real[FALLEN_X_M], real[FALLEN_Y_M])
            found.append(
                CarriedDrone(
                    MODES[row[MODE]],
                    (x, y, level),
                    row[BATTERY_US],
                    now_us - row[SINCE_US],
                    hop if row[HOPPING] else None,
                    tuple((dx, dy, dz) for dx, dy, dz in route),
                    real[COUNTED_M],
                    places.get(d, 0),
                    fallen if row[FALLEN] else None,
                )
            )
        return tuple(found)

    def _load(self, carried: Carried | None) -> None:
        """Put the drones where they are before an episode."""
        calls.start_afresh(self.fixed, self.state)
        state = self.views
        for d, one in enumerate(carried or ()):
            row = state.drone[d]
            x, y, level = one.node
            row[[MODE, BATTERY_US, SINCE_US]] = one.mode, one.battery_us, -one.age_us
            row[[X, Y, LEVEL]] = row[[TO_X, TO_Y, TO_LEVEL]] = x, y, level
            row[[ROUTE, ROUTE_END]] = self._route(one.route)
            state.place[d, COUNTED_M] = one.counted_m
            if one.hop is not None:
                row[[TO_X, TO_Y, TO_LEVEL]] = np.add(one.node, one.hop)
                axis = next(k for k in range(3) if one.hop[k])
                row[TRANSIT], row[HOPPING] = self.fixed.i[self.fixed.i[AT_HOP_TRANSITS] + axis], 1
            if one.fallen_m is not None:
                row[FALLEN] = 1
                state.place[d, [FALLEN_X_M, FALLEN_Y_M]] = one.fallen_m
        landed = [
            (one.place, d, self.world.stations.index(one.node[:2]))
            for d, one in enumerate(carried or ())
            if one.mode in (Mode.QUEUED, Mode.CHARGING)
        ]
        for _, d, station in sorted(landed):
            calls.queue_up(self.state, d, station)

    def _route(self, route: tuple[tuple[int, int, int], ...]) -> tuple[int, int]:
        """Where the hops of a route stand: it is the end of some way back."""
        if not route:
            return 0, 0
        wanted, hops = np.array(route, np.int64), self._hops
        starts = np.flatnonzero((hops[: len(hops) - len(wanted) + 1] == wanted[0]).all(axis=1))
        for first in starts.tolist():
            if (hops[first : first + len(wanted)] == wanted).all():
                return first, first + len(wanted)
        raise SimulationError(f"carry: {route} is no way back of this world")

    # ---- what policies are shown

    def snapshot(self) -> Snapshot:
        """The state at the present decision epoch."""
        state, whole, facts = self.views, self.state.i, self.world.facts
        epoch, now_us = int(whole[EPOCH]), int(whole[NOW])
        services, capacity_s = len(facts.services), facts.capacity_s
        seen = []
        for d, row in enumerate(state.seen.tolist()):
            mode, x, y, level, battery_us, back, attached, used_bps, *counts = row
            station, duration_s, drained_us = self._plan(d, back)
            served = tuple(counts[:services])
            seen.append(
                Observation(
                    d,
                    epoch,
                    facts.steps,
                    (x, y),
                    level,
                    MODES[mode],
                    None if capacity_s is None else battery_us / US,
                    capacity_s,
                    None if drained_us is None else drained_us / US,
                    attached,
                    sum(served),
                    used_bps / 1000,
                    station,
                    duration_s,
                    served,
                    tuple(counts[services:]),
                )
            )
        rewards: tuple[float, ...] = ()
        terms: tuple[dict[str, float], ...] = ()
        if epoch:
            rewards = tuple(state.rewards.tolist())
            names = self.term_names
            terms = tuple(dict(zip(names, row, strict=False)) for row in state.terms.tolist())
        self.shown = Snapshot(
            epoch,
            now_us,
            bool(whole[TERMINATED]),
            bool(whole[TRUNCATED]),
            tuple(seen),
            tuple(tuple(map(bool, row)) for row in state.masks.tolist()),
            tuple(state.asked.tolist()),
            rewards,
            terms,
        )
        return self.shown

    # ---- what can be asked in between

    def measures(self) -> Measures:
        """The quality of experience so far, open requests by what they have had so far."""
        found = calls.measures(self.fixed, self.state)
        return Measures(*(None if math.isnan(value) else value for value in found))

    def requests_made(self) -> int:
        """How many requests have been made in the episode so far, open ones among them."""
        return int(self.state.i[OPENED])

    def positions_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where drones and users truly are: (drones, 3) and (users, 3)."""
        users = self.world.homes.copy()
        users[:, :2] = all_walked(*self._walking.drawn(), int(self.state.i[NOW]))
        count = len(self.views.drone)
        drones = [calls.position(self.fixed, self.state, d) for d in range(count)]
        return np.array(drones), users

    def user_states(self) -> list[UserState]:
        """What each user is doing; after an episode, what it did at its end."""
        state = self.state
        if state.i[TERMINATED] or state.i[TRUNCATED]:
            return [STATES[kind] for kind in self.views.states.tolist()]
        users = range(len(self.views.user))
        return [STATES[calls.user_state(state, user)] for user in users]


@cache
def kernels_digest() -> str:
    """What the kernels of a step are compiled from: it changes with the layout of their arrays."""
    step: Any = calls.step
    return code_digest(getattr(step, "py_func", step))
