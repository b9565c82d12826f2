"""The simulation: drones, stations and users on one agenda, run from decision epoch to epoch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from operator import itemgetter
from typing import TYPE_CHECKING

from desim_uav.engine.base import EpisodeLog, Event, RunSettings, Step
from desim_uav.engine.des.agenda import Agenda
from desim_uav.engine.des.airlink import AirLink
from desim_uav.engine.des.drone import Drone
from desim_uav.engine.des.station import Station
from desim_uav.engine.des.users import start_asking
from desim_uav.errors import SimulationError
from desim_uav.model.rules import US, Action, Mode, Phase, mask, obeyed
from desim_uav.model.state import Observation, Snapshot

if TYPE_CHECKING:
    from desim_uav.engine.des.agenda import Due
    from desim_uav.model.planner import Node
    from desim_uav.sample_path import SamplePath
    from desim_uav.world import World


class Simulation:
    """The SimPy engine (see ``Engine``).

    ``audit`` is called with the simulation after every event: the invariants the tests check.
    """

    agenda: Agenda
    airlink: AirLink
    log: EpisodeLog
    path: SamplePath
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
        self.capacity_us = world.capacity_us
        battery = world.scenario.drones.battery
        self.on_crash = "remove" if battery is None else battery.on_crash
        self.return_below_us = self.respawn_after_us = 0
        if battery is not None:
            self.return_below_us = round(battery.return_below * self.capacity_us)
            self.respawn_after_us = round(battery.respawn_after_min * 60 * US)
        self.full_charge_us = round(world.scenario.stations.full_charge_min * 60 * US)
        self.steps = world.scenario.episode.steps
        self._masks = {
            (mode, may_return, may_charge): mask(world.actions, mode, may_return, may_charge)
            for mode, may_return, may_charge in product(Mode, (False, True), (False, True))
        }
        self.drones: list[Drone] = []
        self.shown: Snapshot | None = None

    # ---- episodes

    def reset(self, path: SamplePath) -> Snapshot:
        """Begin an episode and run up to its first decision epoch.

        An episode that a crash has terminated is followed by a fresh start, carry-over or not.
        """
        if not self.drones or not self.settings.carry_over or self.terminated:
            self._build()
        self.path = path
        self.log = EpisodeLog(path.episode, [] if self.settings.keep_events else None)
        self.emit: Callable[[Event], None] = (
            self.log.events.append if self.log.events is not None else _forget
        )
        self.origin_us = self.agenda.now
        self.epoch = 0
        self.terminated = self.truncated = False
        self.airlink.begin(path, self.log, self.origin_us, self.emit)
        for drone in self.drones:
            drone.respawns = 0
            if drone.mode is Mode.FLYING:
                self.airlink.track(drone, drone.flight, 0, Phase.ENTRY)
        self._orient()
        start_asking(self.agenda, self.airlink, path.requests, self.world.horizon_us)
        self.agenda.call(self._respawn, None, self.origin_us, Phase.RESPAWN)
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
                t_us = self.agenda.now - self.origin_us
                self.emit((t_us, Phase.COMMAND, "decide", drone.index, -1, -1, -1))
                drone.command.give(taken, Phase.COMMAND, drone.index)
                drone.command = None
        end_us = self.agenda.now + self.world.step_us
        self.agenda.call(self._record, None, end_us, Phase.RECORD)
        return self._run()

    def _build(self) -> None:
        world = self.world
        self.agenda = Agenda()
        self.origin_us = 0
        pads = world.scenario.stations.pads
        self.stations = [Station(self.agenda, k, c, pads) for k, c in enumerate(world.stations)]
        self.station_at: dict[Node, Station] = {(*s.cell, 0): s for s in self.stations}
        self.drones = [
            Drone(self, k, cell, ceiling)
            for k, (cell, ceiling) in enumerate(
                zip(world.starts, self.settings.ceilings, strict=True)
            )
        ]
        self.airlink = AirLink(world, self.agenda, self.drones)

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
        t_us = self.agenda.now - self.origin_us
        for drone, (action, taken) in zip(self.drones, self.commanded, strict=True):
            self.log.steps.append(
                Step(
                    self.epoch - 1,
                    t_us,
                    drone.index,
                    *drone.position_m(),
                    drone.battery_now_us() if self.capacity_us else None,
                    drone.mode,
                    action,
                    taken,
                    drone.attached_users,
                    drone.served_requests,
                    drone.used_bps,
                    drone.return_us(),
                )
            )
        crashed = any(drone.mode is Mode.CRASHED for drone in self.drones)
        self.terminated = self.on_crash == "end_episode" and crashed
        self.truncated = self.epoch == self.steps
        if self.terminated or self.truncated:
            self._show()
            self._end_episode(t_us)
        else:
            self.agenda.call(self._respawn, None, self.agenda.now, Phase.RESPAWN)

    def _end_episode(self, t_us: int) -> None:
        self.airlink.end()
        for drone in self.drones:
            if drone.mode is Mode.QUEUED:
                self.count_queueing(drone)
        self.log.duration_us = t_us
        if self.log.events is not None:
            self.log.events.sort(key=itemgetter(0, 1, 3, 4))

    def count_queueing(self, drone: Drone) -> None:
        """Count what a drone has waited for a pad in this episode."""
        self.log.queueing_us += self.agenda.now - max(drone.landed_us, self.origin_us)

    def _respawn(self, due: Due) -> None:
        """Phase 9: crashed drones come back after their downtime; then commands are due."""
        if self.on_crash != "remove":
            for drone in self.drones:
                if drone.mode is Mode.CRASHED:
                    down_us = self.agenda.now - drone.crashed_us
                    if down_us >= self.respawn_after_us:
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
            self.agenda.now - self.origin_us,
            self.terminated,
            self.truncated,
            tuple(observation for observation, _ in shown),
            tuple(legal for _, legal in shown),
        )

    def _view(self, drone: Drone) -> tuple[Observation, tuple[bool, ...]]:
        """What a drone knows, and what it may be told."""
        battery_us = drone.battery_now_us()
        limited = self.capacity_us > 0
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
            self.capacity_us / US if limited else None,
            None if return_us is None else return_us / US,
            drone.attached_users,
            drone.served_requests,
            drone.used_bps / 1000,
        )
        may_return = battery_us <= self.return_below_us
        may_charge = battery_us < self.capacity_us and drone.node in self.station_at
        return observation, self._masks[drone.mode, may_return, may_charge]


def _forget(event: Event) -> None:
    """Where events are not kept."""
