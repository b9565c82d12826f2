"""The fixed-step simulator for drones that are asked when they are free.

A drone is free when it has arrived, when it is charged, when it has hovered for the patience, and
when it replaces a crashed one. Motion has its closed form: a drone that arrives between two ticks
begins its next leg at that very time, although this is noticed at the next tick. The end of a
charge and a crash are found at ticks, so that what follows from them is late by less than ``dt``.

R1 is paid at each decision epoch, in proportion to the time since the epoch before.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tests.reference.fixed_step import FixedStep
from tests.reference.flight import Drone
from tests.reference.inputs import NEVER, US, Decision, Inputs, Result


class ByEvent(FixedStep):
    """One episode, tick by tick; ``commands[drone]`` are those at its decisions, in order."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.result.decisions = [[] for _ in self.drones]
        self.epoch_us = 0
        self.drained = np.zeros(len(self.drones))

    def run(self, commands: Sequence[Any]) -> Result:
        ticks_us = np.arange(0, self.horizon_us + 1, self.dt_us)
        for some_us in np.array_split(ticks_us, self.inputs.steps):
            for t_us, xy in zip(some_us.tolist(), self._users_at(some_us), strict=True):
                self._tick(t_us, xy, commands)
        self._pay(self.horizon_us)
        self.result.rest = [drone.gained for drone in self.drones]
        for user in np.flatnonzero(self.services.open):
            self.services.close(user, self.horizon_us, False)
        self._measure()
        return self.result

    def _tick(self, t_us: int, xy: np.ndarray, commands: Sequence[Any]) -> None:
        if t_us > 0:
            self._elapse(t_us)
        self._happen(t_us, xy)
        if t_us < self.horizon_us and self._ask(t_us, commands):
            self._serve(t_us, xy)

    def _elapse(self, t_us: int) -> None:
        before = [drone.charge for drone in self.drones]
        super()._elapse(t_us)
        after = [drone.charge for drone in self.drones]
        self.drained = np.maximum(np.array(before) - np.array(after), 0.0) / self.dt_us

    # ---- decision epochs

    def _ask(self, t_us: int, commands: Sequence[Any]) -> bool:
        """Ask the drones that have become free since the last tick, in the order of these times.

        Return whether there are any.
        """
        free = [(self._free_us(drone, t_us), drone.index) for drone in self.drones]
        due = sorted((since_us, d) for since_us, d in free if since_us <= t_us)
        for since_us, d in due:
            self._pay(since_us)
            self._respawn(since_us)
            asked = len(self.result.decisions[d])
            self._decide(self.drones[d], since_us, t_us, commands[d][asked])
        return bool(due)

    def _free_us(self, drone: Drone, t_us: int) -> int:
        """When a drone has become free or will: NEVER if nobody knows yet."""
        if drone.mode == "flying":
            return drone.free_us
        if drone.mode == "crashed":
            return self._replaced_us(drone)
        return t_us if drone.mode == "charged" else NEVER

    def _decide(self, drone: Drone, since_us: int, t_us: int, command: Any) -> None:
        """Let a drone act that has been free since ``since_us``, with its battery of that time."""
        limited, epoch = self.inputs.capacity is not None, since_us // self.inputs.step_us
        charge = drone.charge + self.drained[drone.index] * (t_us - since_us)
        allowed = self._allowed(drone, epoch, charge)
        if limited and charge >= self._full():
            allowed.discard("goto_charging_station")
        drone.action = self._taken(command, allowed)
        decision = Decision(
            since_us,
            drone.action,
            self._position(drone, since_us),
            charge if limited else None,
            tuple(np.flatnonzero(self.attachments.holder == drone.index).tolist()),
            self._return(drone, epoch),
            drone.gained,
        )
        self.result.decisions[drone.index].append(decision)
        drone.asked_us, drone.gained = since_us, 0.0
        self._obey(drone, since_us, epoch, command)
        drone.free_us = self._over_us(drone, since_us)

    def _over_us(self, drone: Drone, since_us: int) -> int:
        """When what a drone does since its decision is over."""
        return since_us + self.inputs.patience_us if drone.hop is None else drone.until_us

    def _pay(self, t_us: int) -> None:
        """Pay each drone for the time since the last epoch, by the users that it has now."""
        step_us, share = self.inputs.step_us, (t_us - self.epoch_us) / self.inputs.step_us
        fair = len(self.inputs.legs) / len(self.drones)
        for drone in self.drones:
            users = int((self.attachments.holder == drone.index).sum())
            discount = self.inputs.gamma ** ((self.epoch_us - drone.asked_us) / step_us)
            drone.gained += discount * share * min(1.0, users / fair)
        self.epoch_us = t_us


def simulate(inputs: Inputs, commands: Sequence[Sequence[int]], dt_s: float) -> Result:
    """Run one episode in steps of ``dt_s``; ``commands[drone][which]`` index actions."""
    return ByEvent(inputs, round(dt_s * US)).run(commands)
