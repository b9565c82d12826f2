"""The reward ``qoe``: what a drone's step has added to the quality of experience."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Ge, Le

from desim_uav.model.rewards import RowReward
from desim_uav.model.rules import US
from desim_uav.registry import register
from desim_uav.rowcode.kernels import rule
from desim_uav.rules.battery import drain_per_s_of, is_limited
from desim_uav.rules.rewards import RewardWeight
from desim_uav.rules.rows import Constants, Drone, State
from desim_uav.rules.words import CRASHED


@register("reward", "qoe")
@dataclass(frozen=True)
class QoE(RowReward):
    """What a drone's step has added to QoE1 and QoE3, against the drone's not serving.

    Each is scaled so that 1 is the drone's fair share: that of QoE3 if the drone alone covers its
    fair share of the users all through the step, that of QoE1 if in each step it does its fair
    share of all that is expected to be asked for in the episode.
    """

    w1: RewardWeight = 1.0
    """The weight of QoE1."""
    w3: RewardWeight = 1.0
    """The weight of QoE3."""
    crash: Annotated[float, Ge(0), Le(1e6)] = 10.0
    """What a drone loses in the step in which it crashes."""
    difference: bool = True
    """Whether only what others would not have covered counts. If not, all that the drone does
    counts.
    """
    energy: RewardWeight = 0.0
    """What a drone loses for the charge that a step of hovering takes. 0: charge costs nothing, and
    there is no term for it.
    """
    deadline: RewardWeight = 0.0
    """The weight of tasks that are done by their deadline while their user is attached to the
    drone. It is scaled as that of QoE1: 1 if these are the drone's fair share of all that is
    expected to be asked for. 0: there is no term for them.
    """
    age: RewardWeight = 0.0
    """The weight of ages of sensors that fall because the drone delivers their updates. It is
    scaled so that 1 is the drone's fair share of what all ages rise by in a step. 0: there is no
    term for them.
    """
    names = ("qoe1", "qoe3", "crash")
    later: ClassVar = ("energy", "deadline", "age")
    keeps_credit = True

    def term_names(self, services: tuple[str, ...]) -> tuple[str, ...]:
        """Return the names of the terms; those that were added later only if they have a weight."""
        return (*self.names, *(name for name in self.later if getattr(self, name) > 0.0))

    def pay(self, world: Constants, state: State, drone: Drone) -> None:
        """Write the terms, which are those of all that the drone has done in the step."""
        credit, terms = drone.credit, drone.terms
        lasted_us, served = credit.step_held_us, credit.step_served
        if self.difference:
            lasted_us, served = credit.step_alone_us, credit.step_served_alone
        expected = world.expected_requests / world.steps
        terms[0] = self.w1 * (served * world.sharers / expected)
        terms[1] = self.w3 * fair_times(world, state, lasted_us)
        if has_crashed(world, state, drone):
            terms[2] = 0.0 - self.crash
        k = 3
        if self.energy > 0.0:
            if is_limited(world, drone):
                terms[k] = 0.0 - self.energy * steps_of_hovering(world, drone, credit.step_used)
            k += 1
        if self.deadline > 0.0:
            terms[k] = self.deadline * (credit.step_in_time * world.sharers / expected)
            k += 1
        if self.age > 0.0:
            risen_us = float(state.sensing) * float(world.step_us)
            terms[k] = self.age * (float(credit.step_fallen_us) * world.sharers / risen_us)


@rule
def fair_times(world: Constants, state: State, lasted_us: int) -> float:
    """Return a time of users, in their fair share for a drone over a step.

    The products are floats, because whole numbers of 64 bits would not suffice for many users.
    """
    step_us = float(len(state.users)) * float(world.step_us)
    return float(lasted_us) * float(world.sharers) / step_us


@rule
def steps_of_hovering(world: Constants, drone: Drone, charge: int) -> float:
    """Return for how many steps of hovering a charge lasts."""
    return float(charge) / float(drain_per_s_of(world, drone)) * (float(US) / float(world.step_us))


@rule
def has_crashed(world: Constants, state: State, drone: Drone) -> bool:
    """Return whether a drone has crashed in the step that ends now."""
    return drone.mode == CRASHED and drone.since_us > state.epoch_us
