"""Drones that fly freely beside drones that fly from cell to cell, by fixed time steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tests.reference.fixed_step import FixedStep
from tests.reference.flight import Drone
from tests.reference.free import Freely, Point, Space
from tests.reference.inputs import US, Inputs, Result


class Mixed(Freely):
    """One episode, tick by tick; ``free`` says of each drone whether it flies freely.

    ``commands[step][drone]`` are the numbers of ``Freely``, or the index of ``FixedStep``.
    """

    def __init__(self, inputs: Inputs, space: Space, free: Sequence[bool], dt_us: int) -> None:
        super().__init__(inputs, space, dt_us)
        self.free = free
        for drone in self.drones:
            if not free[drone.index]:
                drone.node = (*inputs.starts[drone.index], 0)

    def _of(self, drone: Drone) -> type[FixedStep]:
        return Freely if self.free[drone.index] else FixedStep

    def _arrive(self, drone: Drone, t_us: int) -> None:
        self._of(drone)._arrive(self, drone, t_us)

    def _fly_on(self, drone: Drone, since_us: int) -> None:
        self._of(drone)._fly_on(self, drone, since_us)

    def _position(self, drone: Drone, t_us: int) -> Point:
        return self._of(drone)._position(self, drone, t_us)

    def _return(self, drone: Drone, epoch: int) -> float | None:
        return self._of(drone)._return(self, drone, epoch)

    def _allowed(self, drone: Drone, epoch: int, charge: float) -> set[str]:
        return self._of(drone)._allowed(self, drone, epoch, charge)

    def _taken(self, command: Any, allowed: set[str]) -> str:
        kind = FixedStep if isinstance(command, int) else Freely
        return kind._taken(self, command, allowed)

    def _obey(self, drone: Drone, t_us: int, epoch: int, command: Any) -> None:
        self._of(drone)._obey(self, drone, t_us, epoch, command)


def simulate(
    inputs: Inputs,
    space: Space,
    free: Sequence[bool],
    commands: Sequence[Sequence[Any]],
    dt_s: float,
) -> Result:
    """Run one episode in steps of ``dt_s``."""
    return Mixed(inputs, space, free, round(dt_s * US)).run(commands)
