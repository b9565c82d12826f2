"""The reward ``age``: how old what sensors have measured is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Ge, Gt, Le

from desim_uav.model.rewards import RowReward
from desim_uav.registry import register
from desim_uav.rules.qoe_reward import has_crashed
from desim_uav.rules.rows import Constants, Drone, State


@register("reward", "age")
@dataclass(frozen=True)
class Age(RowReward):
    """Minus the mean age of the sensors over the step, which is the same for each drone.

    If drones are asked by event, the age counts for the time since the epoch before, as a share of
    a step.
    """

    scale_s: Annotated[float, Gt(0), Le(1e9)] = 60.0
    """The mean age, in seconds, over a step for which a drone gets -1."""
    crash: Annotated[float, Ge(0), Le(1e6)] = 0.0
    """What a drone loses in the step in which it crashes."""
    names = ("age", "crash")
    needs_sensors: ClassVar = True

    def pay(self, world: Constants, state: State, drone: Drone) -> None:
        """Write the terms ``age`` and ``crash``."""
        mean_us = state.aged / (2.0 * float(state.sensing) * float(world.step_us))
        drone.terms[0] = -mean_us / (1e6 * self.scale_s)
        if has_crashed(world, state, drone):
            drone.terms[1] = -self.crash
