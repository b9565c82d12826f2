"""The base of both engines, which makes snapshots, logs and carried states of drones from rows."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import cached_property
from operator import attrgetter, itemgetter
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from desim_uav.commands.given import Command
from desim_uav.engine import base
from desim_uav.engine.carry import MODES, CarryOver
from desim_uav.engine.constants import term_names
from desim_uav.engine.courses import flown_leg
from desim_uav.errors import SimulationError
from desim_uav.model.geometry.coverage import all_walked
from desim_uav.model.rules import US, Mode, Outcome, Phase
from desim_uav.model.services import COMPUTING
from desim_uav.model.state import Observation, Snapshot, observation_of, snapshot_of
from desim_uav.rules import requests, wide
from desim_uav.rules.flight import position
from desim_uav.rules.rewards import LARGEST_REWARD
from desim_uav.rules.rows import Closed, EventRow
from desim_uav.rules.whole_state import names_of, write_state
from desim_uav.rules.words import (
    EVENT_KINDS,
    NEVER,
    NO_SHARE,
    OF_PAIRS,
    OF_UPDATES,
    ON_COMPLETE,
    ON_DROP,
    ON_LATE,
    ON_LEG,
    ON_STAGE,
    OVERBOOKED,
    STRANDED,
    TOO_LARGE,
)
from desim_uav.sample_path import SamplePath
from desim_uav.world import World

PHASES = (None, *Phase)
ENDED = {
    ON_COMPLETE: Outcome.COMPLETED,
    ON_LATE: Outcome.LATE,
    ON_DROP: Outcome.DROPPED,
}
"""The outcomes of requests by the kind of event that closes them, if that says it."""
AS_LOGGED, AS_CLOSED = attrgetter(*base.Step._fields), attrgetter(*Closed.kinds)
AS_AT_POINT = attrgetter(*base.PointStep._fields)
AS_UPDATE = attrgetter(*base.LoggedUpdate._fields)


class Engine(CarryOver):
    """An engine, which runs episodes step by step.

    An engine can be copied and pickled between any two of its calls. The copy shares only the
    world with the original, and continues, in this process or another, as the original would.

    ``state`` and ``constants`` are rows (see ``rules.rows``), which each engine stores in its own
    way, and ``drones`` those of the drones. Tables and queues are read by ``entries``.
    """

    name: ClassVar[str]
    """The name by which users choose it."""
    state: Any
    constants: Any
    drones: Sequence[Any]

    def __init__(self, world: World, settings: base.RunSettings) -> None:
        self.world = world
        self.settings = settings
        self.term_names = term_names(world)
        self.latest: Snapshot | None = None
        self.log = base.EpisodeLog(0)
        """The log of the present episode."""
        self._carried: base.Carried | None = None
        self._under_way = False
        self._served_by: dict[int, list[int]] = {}

    @abstractmethod
    def reset(self, path: SamplePath) -> Snapshot:
        """Begin an episode on a sample path and return the snapshot of its first decision epoch.

        With carry-over, each drone keeps its exact state if the previous episode was truncated.
        If that was abandoned, or terminated by a crash, the drones start afresh.
        """

    @abstractmethod
    def step(self, commands: Sequence[Command]) -> Snapshot:
        """Give each drone its command, an index into the world's actions, and run one step.

        A command that the mask forbids is replaced by the only allowed action, or by hover if
        several are allowed. Raises SimulationError if the episode is over or none has begun, and
        ValueError if there is not one command per drone.
        """

    # ---- what depends on how an engine stores rows

    @abstractmethod
    def plan(self, number: int) -> Any:
        """Return the planned return with this number (see ``Constants.plans``), as a row."""

    @abstractmethod
    def features(self) -> Sequence[tuple[float, ...]]:
        """Return each drone's features, as far as an observation over rows has written them."""

    # ---- commands and snapshots

    def hear(self, commands: Sequence[Command]) -> None:
        """Write a step's commands into the drones' rows. Raises the errors of ``step``."""
        if self.latest is None or self.latest.terminated or self.latest.truncated:
            raise SimulationError("step: the episode is over, or none has begun; call reset first")
        if len(commands) != len(self.drones):
            raise ValueError(f"{len(commands)} commands for {len(self.drones)} drones")
        self.latest = None  # which it stays if the step fails
        of_world = self.world.commands
        for d, (drone, command) in enumerate(zip(self.drones, commands, strict=True)):
            of_world.of(d).give(drone, command)

    def check_components(self) -> None:
        """Raise SimulationError if the reward or the admission rule has broken its contract."""
        faults, scenario = self.state.faults, self.world.scenario
        if faults & TOO_LARGE:
            raise SimulationError(
                f"reward {type(scenario.reward).__name__!r} gave the drones "
                f"{list(self.entries('rewards'))} of the terms {self.terms()}; a reward must be a "
                f"number between -{LARGEST_REWARD:g} and {LARGEST_REWARD:g}"
            )
        if faults & NO_SHARE:
            name = type(scenario.offloading).__name__
            raise SimulationError(f"offloading {name!r} gave a share that is not from 0 to 1")
        if faults & STRANDED:
            raise SimulationError(
                "drones.shielded: a drone cannot reach a charging station any more from where it "
                "began the episode; let it begin nearer to one, or with a larger battery"
            )
        if faults & OVERBOOKED:
            rules = {type(drones.admission).__name__ for drones in scenario.fleet}
            name = "' or '".join(sorted(rules))
            limits = "bandwidth"
            if any(backhaul is not None for backhaul in self.world.backhauls):
                limits = "bandwidth, or more than its backhaul"
            raise SimulationError(f"admission {name!r} served more than a drone's {limits}")

    def terms(self) -> tuple[dict[str, float], ...]:
        """Return the terms of the drones' rewards, by name."""
        names = self.term_names
        return tuple(dict(zip(names, map(float, one.terms), strict=True)) for one in self.drones)

    @cached_property
    def _facts(self) -> list[tuple[int, float | None, int, bool, int]]:
        """What observations contain or need of each drone that does not change.

        It is the number of steps, the capacity in seconds of hovering and the charge that one of
        them takes, whether it flies freely, and the number of its first plan.
        """
        world, numbers, facts = self.world, self.world.type_numbers, []
        places = math.prod(world.grid.blocked.shape)
        for number, ceiling in zip(numbers, self.settings.ceilings, strict=True):
            seen, own = world.facts_of_types[number], world.types[number]
            first = self.constants.types[number].first_plan + ceiling * places
            facts.append((seen.steps, seen.capacity_s, own.drain_per_s, own.free, first))
        return facts

    def observations(self) -> tuple[Observation, ...]:
        """Return the drones' observations at the present decision epoch."""
        counts, services = self.entries("counts"), len(self.world.services.names)
        step = int(self.state.now_us) // self.world.step_us
        observations, first, index = [], 0, 0
        for (steps, capacity_s, drain_per_s, free, first_plan), row, features in zip(
            self._facts, self.entries("observations"), self.features(), strict=True
        ):
            station = duration_s = drained_s = charge_s = None
            if capacity_s is not None:
                charge_s, drained_s = row.charge / drain_per_s, math.inf
                if free:
                    plan = self.drones[index].course.home
                else:
                    plan = self.plan(first_plan + row.believed)
                if plan.station >= 0:
                    station, duration_s = plan.station, plan.duration_us / US
                    drained_s = plan.drain / drain_per_s
            after = first + services
            observations.append(
                observation_of(
                    (
                        index,
                        step,
                        steps,
                        (row.x, row.y),
                        row.level,
                        MODES[row.mode],
                        charge_s,
                        capacity_s,
                        drained_s,
                        row.attached_users,
                        row.served_requests,
                        row.used_hz / 1000,
                        station,
                        duration_s,
                        tuple(counts[first:after]),
                        tuple(counts[after : after + services]),
                        features,
                    )
                )
            )
            first, index = after + services, index + 1
        return tuple(observations)

    def snapshot(self) -> Snapshot:
        """Return the snapshot of the present decision epoch."""
        state, step, actions = self.state, int(self.state.step), len(self.world.actions)
        masks = tuple(map(bool, self.entries("masks")))
        self.latest = snapshot_of(
            (
                step,
                int(state.now_us),
                bool(state.terminated),
                bool(state.truncated),
                self.observations(),
                tuple([masks[at : at + actions] for at in range(0, len(masks), actions)]),
                tuple(self.entries("asked")),
                tuple(self.entries("rewards")) if step else (),
                self.terms() if step else (),
            )
        )
        return self.latest

    # ---- the log

    def new_log(self, episode: int) -> None:
        """Begin the log of an episode, by its number."""
        self._served_by = {}
        events: list[base.Event] | None = [] if self.settings.keep_events else None
        self.log = base.EpisodeLog(episode, events, engine=self.name)

    def drain_log(self) -> None:
        """Add the events, requests and records of the step that has ended to the log."""
        log, state = self.log, self.state
        keeps_apart = self.world.scenario.separation_m is not None
        keeps_stages = self.world.services.several_stages
        if state.crashes > len(log.crashed):
            log.crashed[:] = self.entries("crashed")
        if state.keeps_requests:
            self._log_requests()
            for update in self.entries("updates"):
                log.updates.append(base.LoggedUpdate(*AS_UPDATE(update)))
            if state.step:
                self._log_steps()
        if log.events is not None:
            for event in self.entries("events"):
                if event.kind == ON_LEG:
                    log.legs.append(self._leg(event))
                else:
                    phase, kind = PHASES[event.phase], EVENT_KINDS[event.kind]
                    of_pair = event.kind in OF_PAIRS
                    user, other = (-1, event.user) if of_pair else (event.user, -1)
                    station = stage = update = -1
                    if event.kind == ON_STAGE:
                        stage = event.station
                    elif event.kind in OF_UPDATES:
                        update = event.station
                    else:
                        station = event.station
                    rest = (event.drone, user, event.request, station)
                    link_class = (event.link_class,) if state.keeps_links else ()
                    others = (other,) if keeps_apart else ()
                    stages = (stage,) if keeps_stages else ()
                    updates = (update,) if state.keeps_sensors else ()
                    more = (*link_class, *others, *stages, *updates)
                    log.events.append((event.t_us, phase, kind, *rest, *more))
            log.legs.extend(map(flown_leg, self.entries("flown")))
        if state.terminated or state.truncated:
            self._end_log()

    def _leg(self, event: EventRow) -> base.FlownLeg:
        """Return the leg that an event of kind ON_LEG describes."""
        mode, drone = MODES[event.phase], event.drone
        if mode is Mode.CRASHED:
            fallen = self.drones[drone]
            place_m = (fallen.fallen_x_m, fallen.fallen_y_m, 0.0)
            return base.FlownLeg(event.t_us, drone, 0, mode, place_m, place_m)
        ends_m = self._place_m(event.user), self._place_m(event.request)
        return base.FlownLeg(event.t_us, drone, event.station, mode, *ends_m)

    def _place_m(self, place: int) -> base.Position:
        """Return the position of a place, by its number."""
        grid = self.world.grid
        column, y = divmod(place, grid.cells[1])
        level, x = divmod(column, grid.cells[0])
        return *grid.centre(x, y), grid.levels_m[level]

    def _log_requests(self) -> None:
        """Add the closed requests of a step to the log."""
        for handover in self.entries("handovers"):
            self._served_by.setdefault(handover.number, []).append(handover.drone)
        for closed in self.entries("closed"):
            outcome = Outcome.UNFINISHED if closed.served_us else Outcome.NEVER_SERVED
            outcome = ENDED.get(closed.kind, outcome)
            drones = self._served_by.pop(closed.request_id, [])
            request = base.ClosedRequest(*AS_CLOSED(closed), drones, outcome)
            served = closed.t_first_us >= 0
            self.log.requests.append(request if served else request._replace(t_first_us=None))

    def _log_steps(self) -> None:
        """Log the records, with drones' modes and actions in the place of their numbers."""
        actions, world = self.world.actions, self.world
        for record in self.entries("records"):
            return_drain = math.inf if record.return_drain == NEVER else record.return_drain
            limited = world.type_of(record.drone).limited
            step = base.Step(*AS_LOGGED(record))
            self.log.steps.append(
                step._replace(
                    mode=MODES[record.mode],
                    action=None if record.action < 0 else actions[record.action],
                    action_taken=actions[record.action_taken],
                    charge=record.charge if limited else None,
                    return_drain=return_drain if limited else None,
                )
            )
        for record in self.entries("point_records"):
            self.log.point_steps.append(base.PointStep(*AS_AT_POINT(record)))

    def _end_log(self) -> None:
        """Complete the log at the end of an episode: its totals, and the order of its entries."""
        log, state = self.log, self.state
        log.duration_us = int(state.now_us)
        log.attached_us = int(state.attached_us)
        log.bandwidth_us_hz = wide.value_of(state.bandwidth_us_hz)
        log.queueing_us = int(state.queueing_us)
        log.distance_m = float(state.distance_m)
        log.charges = int(state.charges)
        log.used, log.gained = self.energy_uj()
        log.suppressed = int(state.suppressed)
        if state.keeps_links:
            counts = (state.handed_over, state.ping_pongs, state.outages, state.outage_us)
            log.links = base.LinkCounts(*map(int, counts))
        if self.world.scenario.separation_m is not None:
            nearest_m = float(state.nearest_m) if len(self.drones) > 1 else math.inf
            log.apart = base.Conflicts(int(state.conflicts), int(state.conflict_us), nearest_m)
        log.requests.sort(key=lambda request: request.request_id)
        log.updates.sort(key=lambda update: update.number)
        if state.keeps_sensors:
            log.sensors = list(self._sensors())
        log.legs.sort(key=itemgetter(0, 1))
        if log.events is not None:
            log.events.sort(key=itemgetter(0, 1, 3, 4))

    def _sensors(self) -> Iterator[base.SensorTotals]:
        """Yield the totals of the sensors at the end of an episode."""
        sensors = enumerate(zip(self.state.sensors, self.world.senses, strict=True))
        for user, (sensor, service) in sensors:
            if service >= 0:
                yield base.SensorTotals(
                    user,
                    service,
                    wide.value_of(sensor.area_us2),
                    wide.value_of(sensor.peaks_us),
                    int(sensor.falls),
                    int(sensor.over_us),
                    int(self.state.now_us - sensor.fresh_us),
                    int(sensor.generated),
                    int(sensor.delivered),
                    int(sensor.dropped),
                    int(sensor.lost),
                )

    def energy_uj(self) -> tuple[int, int]:
        """Return what all drones have used and gained in the episode, as far as it is counted.

        These are microjoules, of the drones whose batteries are measured in them.
        """
        in_joules = [one for one in self.drones if self.world.type_of(one.index).in_joules]
        used = sum(int(drone.used) for drone in in_joules)
        return used, sum(int(drone.gained) for drone in in_joules)

    # ---- measures and positions at any decision epoch

    def measures(self) -> base.Measures:
        """Return the quality of experience so far, to which open requests contribute."""
        values = requests.measures(self.constants, self.state)
        return base.Measures(*(None if math.isnan(value) else value for value in values))

    def requests_made(self) -> int:
        """Return the number of requests made in the episode so far, including open ones."""
        return int(self.state.opened)

    def position_m(self, drone: int) -> base.Position:
        """Return the true position of a drone now, in metres."""
        return position(self.constants, self.state, self.drones[drone])

    def positions_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the true positions in metres of drones (drones, 3) and users (users, 3)."""
        users = self.world.homes.copy()
        users[:, :2] = all_walked(*self.drawn.walks, int(self.state.now_us))
        return np.array(list(map(self.position_m, range(len(self.drones))))), users

    def whole_state(self) -> NDArray[np.float64]:
        """Return the whole state now, as numbers (see ``rules.whole_state``)."""
        scenario, cells = self.world.scenario, self.world.grid.cells
        names = names_of(scenario.drone_count, self.world.services.names, cells)
        out, places = (
            np.zeros(len(names)),
            all_walked(*self.drawn.walks, int(self.state.now_us)),
        )
        write_state(self.constants, self.state, places, out)
        return out

    def queues(self) -> list[base.TaskQueue]:
        """Return the queue at the processor of each drone and access point; [] without tasks."""
        if not self.state.keeps_tasks:
            return []
        senders = len(self.drones) + len(self.world.scenario.access_points)
        at_work, waiting = Counter[int](), Counter[int]()
        for user, task in zip(self.state.users, self.state.tasks, strict=True):
            if user.request.number >= 0 and user.request.line == COMPUTING and task.site >= 0:
                (at_work if user.request.server >= 0 else waiting)[int(task.site)] += 1
        return [base.TaskQueue(at_work[one], waiting[one]) for one in range(senders)]

    def user_states(self) -> list[base.UserState]:
        """Return the state of each user now, or at the end of the episode if it is over."""
        users, ended = self.state.users, self.state.terminated or self.state.truncated
        return [base.UserState(user.doing if ended else requests.doing(user)) for user in users]
