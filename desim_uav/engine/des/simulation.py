"""The simulation: drones, stations and users on one agenda, run from decision epoch to epoch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.base import (
    Carried,
    EpisodeLog,
    Measures,
    RunSettings,
    Step,
    UserState,
)
from desim_uav.engine.des.agenda import Agenda, key
from desim_uav.engine.des.airlink import LATE_KEY, AirLink
from desim_uav.engine.des.crossings import Crossings
from desim_uav.engine.des.drone import Drone
from desim_uav.engine.des.flights import Flights
from desim_uav.engine.des.journal import Journal
from desim_uav.engine.des.station import Station
from desim_uav.engine.des.users import Users
from desim_uav.errors import SimulationError
from desim_uav.model.coverage import all_walked
from desim_uav.model.planner import Node
from desim_uav.model.rules import Action, Mode, Phase, mask, obeyed
from desim_uav.model.state import Snapshot, shown
from desim_uav.model.sums import in_order
from desim_uav.sample_path import SamplePath
from desim_uav.world import World

# An enum member is looked up slowly in Python 3.11.
CRASHED = Mode.CRASHED
COMMAND = Phase.COMMAND

LARGEST_REWARD = 1e100
"""The largest magnitude of a drone's reward; sums of such rewards over a run stay finite."""
IDLE, ATTACHED, OPEN, SERVED = UserState
RECORD_KEY, RESPAWN_KEY = key(Phase.RECORD), key(Phase.RESPAWN)


class Simulation:
    """The SimPy engine (see ``Engine``).

    ``audit`` is called with the simulation after every event: the invariants the tests check.

    SimPy's processes can be neither copied nor pickled, so a copy plays the present episode again:
    the same sample path, drones and commands lead to the same state. A copy takes as long as the
    episode has taken so far.
    """

    def __init__(
        self,
        world: World,
        settings: RunSettings,
        audit: Callable[[Simulation], None] | None = None,
    ) -> None:
        self.world = world
        self.settings = settings
        self.audit = audit
        self.step_us = world.step_us
        self.actions, self.facts = world.actions, world.facts
        self._terms_of = world.scenario.reward.terms
        self.agenda = Agenda()
        self.shown: Snapshot | None = None
        self.terminated = self.truncated = False
        self._carried: Carried | None = None
        self._began: tuple[SamplePath, Carried | None] | None = None
        self._commands: list[tuple[int, ...]] = []
        self._users = Users(world.horizon_us)
        self._flights = Flights(world)
        self._crossings = Crossings(world.scenario.drones.footprint_radius_m, world.area)
        self._mask_of = {
            (mode, may_return, may_charge): mask(world.actions, mode, may_return, may_charge)
            for mode, may_return, may_charge in product(Mode, (False, True), (False, True))
        }

    def __reduce__(self) -> tuple[Any, ...]:
        """What makes an equal engine, by playing the present episode again."""
        made_of = (self.world, self.settings, self.audit)
        episode = (self._began, self._commands)
        return _played_again, (made_of, episode, self.shown is None, self._carried)

    # ---- episodes

    def reset(self, path: SamplePath) -> Snapshot:
        """Begin an episode and run up to its first decision epoch.

        Each episode is a simulation of its own, of drones as the one before has left them.
        """
        carried = self.carried()
        self._began, self._commands = (path, carried), []
        self._build(path, carried)
        for drone in self.drones:
            if drone.mode is Mode.FLYING:
                self.airlink.track(drone.radio, drone.leg, 0, Phase.ENTRY)
        self._orient(self.drones)
        self._users.start(self.agenda, self.airlink, path.requests)
        self.agenda.call(self._respawn, None, 0, RESPAWN_KEY)
        return self._run()

    def carried(self) -> Carried | None:
        """What the next episode's drones begin with; None where they start afresh."""
        if self.truncated and not self.terminated and self.settings.carry_over:
            return tuple(drone.carried() for drone in self.drones)
        return self._carried

    def carry(self, drones: Carried | None) -> None:
        """Let the next episode begin with these drones."""
        self.terminated = self.truncated = False
        self.shown = None
        self._carried = drones

    def _build(self, path: SamplePath, carried: Carried | None) -> None:
        """Put everything where it is before an episode."""
        world = self.world
        self.agenda.abandon()
        self.path = path
        self.epoch = 0
        self.terminated = self.truncated = False
        self._carried = None
        self._terms: tuple[dict[str, float], ...] = ()
        self._rewards: tuple[float, ...] = ()
        self._last_states: list[UserState] = []
        self.agenda = Agenda()
        self.log = EpisodeLog(path.episode, [] if self.settings.keep_events else None)
        journal = Journal(self.agenda, self.log)
        self.airlink = AirLink(world, journal, path, self._crossings)
        pads = world.scenario.stations.pads
        self.stations: dict[Node, Station] = {
            (*cell, 0): Station(self.agenda, index, cell, pads)
            for index, cell in enumerate(world.stations)
        }
        count = len(self.settings.ceilings)
        before = carried or (None,) * count
        self.drones = [
            Drone(
                world,
                journal,
                self.airlink,
                self.stations,
                index,
                ceiling,
                self._flights,
                before[index],
            )
            for index, ceiling in enumerate(self.settings.ceilings)
        ]
        self._respawns = [0] * count
        places = [0 if drone is None else drone.place for drone in before]
        for index in sorted(range(count), key=places.__getitem__):
            self.drones[index].start()

    def step(self, commands: Sequence[int]) -> Snapshot:
        """Give the commands and run to the next decision epoch, or to the episode's end."""
        if self.shown is None or self.terminated or self.truncated:
            raise SimulationError("step: the episode is over, or none has begun; call reset first")
        if len(commands) != len(self.drones):
            raise ValueError(f"{len(commands)} commands for {len(self.drones)} drones")
        self.commanded: list[tuple[int, Action]] = []
        told = []
        actions, masks = self.actions, self.shown.masks
        for index, drone in enumerate(self.drones):
            command = commands[index]
            taken = obeyed(command, masks[index], actions)
            self.commanded.append((command, taken))
            if drone.command is not None:
                if drone.events is not None:
                    drone.emit(COMMAND, "decide")
                told.append((drone, taken))
        # Commands are all that is left to happen in this instant before coverage changes. They
        # come in the order of drones, each with what SimPy makes of it (a pad that is handed on),
        # so no queue need sort them.
        for drone, taken in told:
            drone.be_told(taken)
            self.agenda.run_before(LATE_KEY)
        self.airlink.settle_commanded()
        if self.audit is not None:
            self.audit(self)
        end_us = self.agenda._now + self.step_us
        self.agenda.call(self._record, None, end_us, RECORD_KEY)
        shown = self._run()
        self._commands.append(tuple(commands))
        return shown

    def _run(self) -> Snapshot:
        """Let events happen until one of them shows a decision epoch."""
        self.shown = None
        while self.shown is None:
            if self.audit is None:
                self.agenda.run_on()
            else:
                self.agenda.step()
                self.audit(self)
        return self.shown

    # ---- what happens at a decision epoch

    def _record(self, _: None) -> None:
        """Phase 8: the step's record, its reward, and the end of the episode."""
        self.epoch += 1
        self._orient(self.drones)
        self._observe()
        self._reward()
        if self.settings.keep_steps:
            self._log_steps()
        crashed = False
        for drone in self.drones:
            crashed = crashed or drone.mode is CRASHED
        self.terminated = crashed and self.world.on_crash == "end_episode"
        self.truncated = self.epoch == self.facts.steps
        if self.terminated or self.truncated:
            self._show()
            self._end_episode()
        elif crashed:
            self.agenda.call(self._respawn, None, self.agenda._now, RESPAWN_KEY)
        else:
            self._show()

    def _reward(self) -> None:
        """Note what each drone is rewarded for."""
        asked = tuple(self.airlink.open_requests)
        terms_of, facts = self._terms_of, self.facts
        all_terms, rewards, bounded = [], [], True
        for seen in self.observations:
            terms = terms_of(seen, asked, facts)
            reward = in_order(terms.values())
            bounded = bounded and -LARGEST_REWARD <= reward <= LARGEST_REWARD
            all_terms.append(terms)
            rewards.append(reward)
        self._terms, self._rewards = tuple(all_terms), tuple(rewards)
        if not bounded:
            kind = type(self.world.scenario.reward).__name__
            raise SimulationError(
                f"reward {kind!r} gave the drones {rewards} of the terms {self._terms}; a reward "
                f"must be a number between -{LARGEST_REWARD:g} and {LARGEST_REWARD:g}"
            )

    def _log_steps(self) -> None:
        """One record a drone."""
        t_us, step, keep = self.agenda._now, self.epoch - 1, self.log.steps.append
        limited = self.facts.capacity_s is not None
        rows = zip(self.drones, self.commanded, self.observations, self._rewards, strict=True)
        for drone, (command, taken), seen, reward in rows:
            known = 0 <= command < len(self.actions)
            x_m, y_m, z_m = drone.position_m()
            keep(
                Step(
                    step,
                    t_us,
                    drone.index,
                    x_m,
                    y_m,
                    z_m,
                    drone.battery_seen_us if limited else None,
                    drone.mode,
                    self.actions[command] if known else None,
                    taken,
                    seen.attached_users,
                    seen.served_requests,
                    drone.radio.used_bps,
                    drone.return_us,
                    reward,
                )
            )

    def _end_episode(self) -> None:
        self._last_states = self.user_states()
        self.airlink.end()
        for drone in self.drones:
            drone.count_distance()
            if drone.mode is Mode.QUEUED:
                drone.count_queueing()
        self.log.duration_us = self.agenda._now
        self.log.put_in_order()

    def _respawn(self, _: None) -> None:
        """Phase 9: crashed drones come back after their downtime; then commands are due."""
        if self.epoch == 0:
            self._observe()
        if self.world.on_crash != "remove":
            back = [drone for drone in self.drones if self._is_due(drone)]
            for drone in back:
                drone.respawn(int(self.path.respawn[drone.index, self._respawns[drone.index]]))
                self._respawns[drone.index] += 1
            if back:
                self._orient(back)
                self._observe()
        after = key(Phase.RESPAWN, len(self.drones))
        self.agenda.call(self._show, None, self.agenda._now, after)

    def _is_due(self, drone: Drone) -> bool:
        return drone.mode is CRASHED and drone.down_us() >= self.world.respawn_after_us

    # ---- what policies are shown

    def _orient(self, drones: Sequence[Drone]) -> None:
        """Drones take their bearings at a decision epoch."""
        error = self.path.position_error
        for drone in drones:
            drone.orient(None if error is None else error[drone.index, self.epoch])

    def _observe(self) -> None:
        """Note what each drone knows, and may be told."""
        observations, masks = [], []
        for drone in self.drones:
            observations.append(drone.observe(self.epoch))
            masks.append(self._mask_of[drone.may()])
        self.observations, self.masks = tuple(observations), tuple(masks)

    def _show(self, _: None = None) -> None:
        """The state as policies see it; it ends the run to this decision epoch."""
        self.agenda.paused = True
        self.shown = shown(
            (
                self.epoch,
                self.agenda._now,
                self.terminated,
                self.truncated,
                self.observations,
                self.masks,
                tuple(self.airlink.open_requests),
                self._rewards,
                self._terms,
            )
        )

    # ---- what can be asked in between

    def measures(self) -> Measures:
        """The quality of experience so far, open requests by what they have had so far."""
        return self.airlink.measures()

    def requests_made(self) -> int:
        """How many requests have been made in the episode so far, open ones among them."""
        return self.airlink.opened

    def positions_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where drones and users truly are: (drones, 3) and (users, 3)."""
        users = self.world.homes.copy()
        users[:, :2] = all_walked(*self.path.walks, self.agenda._now)
        return np.array([drone.position_m() for drone in self.drones]), users

    def user_states(self) -> list[UserState]:
        """What each user is doing; after an episode, what it did at its end."""
        if self._last_states:
            return self._last_states
        states = []
        for request, radio in zip(self.airlink.open, self.airlink.attached, strict=True):
            if request is not None:
                states.append(SERVED if request.serving >= 0 else OPEN)
            else:
                states.append(IDLE if radio is None else ATTACHED)
        return states


def _played_again(
    made_of: tuple[Any, ...],
    episode: tuple[tuple[SamplePath, Carried | None] | None, list[tuple[int, ...]]],
    idle: bool,
    carried: Carried | None,
) -> Simulation:
    """An engine in the state of another one; ``idle``: it waits for the next episode."""
    engine = Simulation(*made_of)
    began, commands = episode
    if began is not None:
        path, before = began
        engine.carry(before)
        engine.reset(path)
        for command in commands:
            engine.step(command)
    if idle:
        engine.carry(carried)
    return engine
