"""The simulation: drones, stations and users on one agenda, run from decision epoch to epoch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

from desim_uav.engine.base import IN_ORDER, EpisodeLog, RunSettings, Step
from desim_uav.engine.des.agenda import Agenda, Due
from desim_uav.engine.des.airlink import AirLink
from desim_uav.engine.des.drone import Drone
from desim_uav.engine.des.journal import Journal
from desim_uav.engine.des.station import Station
from desim_uav.engine.des.users import start_asking
from desim_uav.errors import SimulationError
from desim_uav.model.planner import Node
from desim_uav.model.rules import US, Action, Mode, Phase, mask, obeyed
from desim_uav.model.state import Observation, Snapshot
from desim_uav.sample_path import SamplePath
from desim_uav.world import World


class Simulation:
    """The SimPy engine (see ``Engine``).

    ``audit`` is called with the simulation after every event: the invariants the tests check.
    """

    path: SamplePath
    epoch = 0
    terminated = False
    truncated = False

    def __init__(
        self,
        world: World,
        settings: RunSettings,
        audit: Callable[[Simulation], None] | None = None,
    ) -> None:
        self.world = world
        self.settings = settings
        self.audit = audit
        self.steps = world.scenario.episode.steps
        self.shown: Snapshot | None = None
        self._masks = {
            (mode, may_return, may_charge): mask(world.actions, mode, may_return, may_charge)
            for mode, may_return, may_charge in product(Mode, (False, True), (False, True))
        }
        self._build()

    @property
    def log(self) -> EpisodeLog:
        """What is told of the episode under way."""
        return self.journal.log

    def _build(self) -> None:
        """Put everything where it is before the first episode."""
        world = self.world
        self.agenda = Agenda()
        self.journal = Journal(self.agenda)
        self.airlink = AirLink(world, self.journal)
        pads = world.scenario.stations.pads
        self.stations: dict[Node, Station] = {
            (*cell, 0): Station(self.agenda, index, cell, pads)
            for index, cell in enumerate(world.stations)
        }
        self.drones = [
            Drone(world, self.journal, self.airlink, self.stations, index, ceiling)
            for index, ceiling in enumerate(self.settings.ceilings)
        ]

    # ---- episodes

    def reset(self, path: SamplePath) -> Snapshot:
        """Begin an episode and run up to its first decision epoch.

        Drones are carried over from an episode that ran its time. One that was broken off, or that
        a crash has terminated, is followed by a fresh start.
        """
        if not (self.settings.carry_over and self.truncated and not self.terminated):
            self._build()
        self.path = path
        self.epoch = 0
        self.terminated = self.truncated = False
        self.journal.begin(EpisodeLog(path.episode, [] if self.settings.keep_events else None))
        self.airlink.begin(path)
        for drone in self.drones:
            drone.respawns = 0
            if drone.mode is Mode.FLYING:
                self.airlink.track(drone.radio, drone.leg, 0, Phase.ENTRY)
        self._orient()
        start_asking(self.agenda, self.airlink, path.requests, self.world.horizon_us)
        self.agenda.call(self._respawn, None, self.agenda.now, Phase.RESPAWN)
        return self._run()

    def step(self, commands: Sequence[int]) -> Snapshot:
        """Give the commands and run to the next decision epoch, or to the episode's end."""
        if self.shown is None or self.terminated or self.truncated:
            raise SimulationError("step: the episode is over, or none has begun; call reset first")
        self.commanded: list[tuple[Action | None, Action]] = []
        actions = self.world.actions
        for drone, command, legal in zip(self.drones, commands, self.shown.masks, strict=True):
            taken = obeyed(command, legal, actions)
            known = 0 <= command < len(actions)
            self.commanded.append((actions[command] if known else None, taken))
            if drone.command is not None:
                t_us = self.journal.now_us()
                self.journal.emit((t_us, Phase.COMMAND, "decide", drone.index, -1, -1, -1))
                drone.command.give(taken, Phase.COMMAND, drone.index)
                drone.command = None
        end_us = self.agenda.now + self.world.step_us
        self.agenda.call(self._record, None, end_us, Phase.RECORD)
        return self._run()

    def _run(self) -> Snapshot:
        """Let events happen until one of them shows a decision epoch."""
        self.shown = None
        next_event = self.agenda.step if self.audit is None else self._audited_event
        while self.shown is None:
            next_event()
        return self.shown

    def _audited_event(self) -> None:
        self.agenda.step()
        if self.audit is not None:
            self.audit(self)

    # ---- what happens at a decision epoch

    def _record(self, due: Due) -> None:
        """Phase 8: the step's record, and the end of the episode."""
        self.epoch += 1
        self._orient()
        t_us = self.journal.now_us()
        for drone, (action, taken) in zip(self.drones, self.commanded, strict=True):
            self.log.steps.append(
                Step(
                    self.epoch - 1,
                    t_us,
                    drone.index,
                    *drone.position_m(),
                    None if drone.energy is None else drone.battery_now_us(),
                    drone.mode,
                    action,
                    taken,
                    drone.radio.attached_users,
                    drone.radio.served_requests,
                    drone.radio.used_bps,
                    drone.return_us(),
                )
            )
        crashed = any(drone.mode is Mode.CRASHED for drone in self.drones)
        self.terminated = self.world.on_crash == "end_episode" and crashed
        self.truncated = self.epoch == self.steps
        if self.terminated or self.truncated:
            self._show()
            self._end_episode(t_us)
        else:
            self.agenda.call(self._respawn, None, self.agenda.now, Phase.RESPAWN)

    def _end_episode(self, t_us: int) -> None:
        self.airlink.end()
        for drone in self.drones:
            drone.count_distance()
            if drone.mode is Mode.QUEUED:
                drone.count_queueing()
        self.log.duration_us = t_us
        if self.log.events is not None:
            self.log.events.sort(key=IN_ORDER)

    def _respawn(self, due: Due) -> None:
        """Phase 9: crashed drones come back after their downtime; then commands are due."""
        if self.world.on_crash != "remove":
            for drone in self.drones:
                if drone.mode is Mode.CRASHED and drone.down_us() >= self.world.respawn_after_us:
                    drone.respawn(int(self.path.respawn[drone.index, drone.respawns]))
                    drone.respawns += 1
            self._orient()
        self.agenda.call(self._show, None, self.agenda.now, Phase.RESPAWN, len(self.drones))

    # ---- what policies are shown

    def _orient(self) -> None:
        """All drones take their bearings at a decision epoch."""
        error = self.path.position_error
        for drone in self.drones:
            drone.orient(None if error is None else error[drone.index, self.epoch])

    def _show(self, due: Due | None = None) -> None:
        """The state as policies see it; it ends the run to this decision epoch."""
        shown = [self._view(drone) for drone in self.drones]
        self.shown = Snapshot(
            self.epoch,
            self.journal.now_us(),
            self.terminated,
            self.truncated,
            tuple(observation for observation, _ in shown),
            tuple(legal for _, legal in shown),
        )

    def _view(self, drone: Drone) -> tuple[Observation, tuple[bool, ...]]:
        """What a drone knows, and what it may be told."""
        world, radio = self.world, drone.radio
        limited = drone.energy is not None
        battery_us = drone.battery_now_us()
        return_us = drone.return_us()
        ix, iy, level = drone.belief
        observation = Observation(
            drone.index,
            self.epoch,
            self.steps,
            (ix, iy),
            level,
            drone.mode,
            battery_us / US if limited else None,
            world.capacity_us / US if limited else None,
            None if return_us is None else return_us / US,
            radio.attached_users,
            radio.served_requests,
            radio.used_bps / 1000,
        )
        may_return = battery_us <= world.return_below_us
        may_charge = battery_us < world.capacity_us and drone.node in self.stations
        return observation, self._masks[drone.mode, may_return, may_charge]
