"""The rewards of the paper, R1 to R3, of which each drone receives one at the end of each step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Ge, Le

from desim_uav.model.rewards import RowReward
from desim_uav.model.rules import US
from desim_uav.registry import register
from desim_uav.rowcode.kernels import rule
from desim_uav.rules.battery import capacity_of, is_limited
from desim_uav.rules.flight import way_back
from desim_uav.rules.rows import Constants, Drone, ObservationRow, State
from desim_uav.rules.words import AIRBORNE, TOO_LARGE

LARGEST_REWARD = 1e100
"""The largest allowed magnitude of a drone's reward, at which sums over a run stay finite."""

RewardWeight = Annotated[float, Ge(0), Le(1e6)]
Sign = Annotated[float, Ge(-1), Le(1)]
Share = Annotated[float, Ge(0), Le(1)]


@register("reward", "coverage")
@dataclass(frozen=True)
class Coverage(RowReward):
    """R1: the drone's attached users, divided by its fair share of all users."""

    capped: bool = True
    """Whether the reward is at most 1. The paper writes no limit."""
    names = ("users",)

    def pay(self, world: Constants, state: State, drone: Drone) -> None:
        """Write the one term of the reward, which stays 0 for a drone on the ground."""
        observation = state.observations[drone.index]
        if is_in_the_air(observation):
            drone.terms[0] = fair_share(world, state, observation, self.capped)


@register("reward", "coverage_battery")
@dataclass(frozen=True)
class CoverageBattery(RowReward):
    """R2: the attached users, weighted against the cost of a return if the battery is low.

    ``low_battery`` is the share of the capacity (c1) at or below which the cost counts.
    ``cost_sign`` is -1 for a cost; the paper writes a plus.
    """

    cost_sign: Sign = -1.0
    """The sign of the cost of a return: -1 subtracts it, and 1 adds it, as the paper writes it."""
    low_battery: Share = 0.2
    """The share of the capacity (c1) at or below which the way to a station counts."""
    capped: bool = True
    """Whether the share of users (r_u) and the cost of the way to a station (r_c) are at most 1.
    The paper writes no limits.
    """
    names = ("users", "return")

    def pay(self, world: Constants, state: State, drone: Drone) -> None:
        """Write the terms ``users`` and ``return``, which stay 0 for a drone on the ground."""
        observation = state.observations[drone.index]
        if is_in_the_air(observation):
            service, cost, way_home = battery_weights(
                world, drone, observation, self.low_battery, self.capped
            )
            drone.terms[0] = service * fair_share(world, state, observation, self.capped)
            drone.terms[1] = self.cost_sign * cost * way_home


@register("reward", "multi_service")
@dataclass(frozen=True)
class MultiService(RowReward):
    """R3: as R2, with the share of each service's open requests that the drone serves.

    ``services`` holds the weight of each service by name. The cost of charging (the paper's r_cs)
    is 0.
    """

    cost_sign: Sign = -1.0
    """The sign of the cost of a return: -1 subtracts it, and 1 adds it, as the paper writes it."""
    low_battery: Share = 0.2
    """The share of the capacity (c1) at or below which the way to a station counts."""
    users: RewardWeight = 0.5
    """The weight of the attached users."""
    services: Mapping[str, RewardWeight] = field(
        default_factory=lambda: {"throughput": 0.2, "edge_computing": 0.2, "data_gathering": 0.1}
    )
    """The weight of each service, by name."""
    capped: bool = True
    """Whether the share of users (r_u) and the cost of the way to a station (r_c) are at most 1.
    The paper writes no limits.
    """
    served_only: bool = True
    """Whether only requests that the drone serves count. If not, all open requests of the users in
    its footprint do.
    """

    def term_names(self, services: tuple[str, ...]) -> tuple[str, ...]:
        """Return the names of the terms: users, each service, return and charging."""
        return ("users", *services, "return", "charging")

    def pay(self, world: Constants, state: State, drone: Drone) -> None:
        """Write the terms (see ``term_names``), which stay 0 for a drone on the ground."""
        observation, terms, services = state.observations[drone.index], drone.terms, world.services
        if is_in_the_air(observation):
            service, cost, way_home = battery_weights(
                world, drone, observation, self.low_battery, self.capped
            )
            terms[0] = service * self.users * fair_share(world, state, observation, self.capped)
            first = 2 * services * drone.index + (0 if self.served_only else services)
            for k in range(services):
                counted, requests = state.counts[first + k], state.asked[k]
                if counted and requests:
                    terms[1 + k] = service * self.services[k] * (counted / requests)  # type: ignore[index]
            signed = self.cost_sign * cost
            terms[services + 1] = signed * way_home if cost else signed * 0.0
            terms[services + 2] = signed * 0.0


@rule
def is_in_the_air(observation: ObservationRow) -> bool:
    """Return whether a drone flies or returns; one that has landed or crashed is paid nothing."""
    return observation.mode in AIRBORNE


@rule
def fair_share(world: Constants, state: State, observation: ObservationRow, capped: bool) -> float:
    """Return r_u: the drone's users divided by the mean number of users per drone.

    Access points that count in rewards are drones here.

    If it is ``capped``, it is at most 1.
    """
    share = observation.attached_users * world.sharers / len(state.users)
    return 1.0 if capped and share > 1.0 else share


@rule
def battery_weights(
    world: Constants, drone: Drone, observation: ObservationRow, low_battery: float, capped: bool
) -> tuple[float, float, float]:
    """Return w_s and w_c, the weights of service and of the way to a station, and r_c, its cost.

    w_s and w_c sum to 1: the fuller the battery, the more service counts. c1 is ``low_battery``
    times the capacity, and each of c2 to c4 is the previous one divided by 1.5. The battery is
    compared with them in whole microseconds, rounded half to even, as in the masks. If the battery
    does not exceed n_B, only the way to a station counts.

    r_c is n_B divided by the battery; if it is ``capped``, it is at most 1. It is 1 if the battery
    is empty or if there is no way to a station, and 0 without a battery.
    """
    if not is_limited(world, drone):
        return 1.0, 0.0, 0.0
    charge, plan = observation.charge, way_back(world, drone, observation.believed)
    battery_s, return_s, no_way = charge / US, plan.drain / US, plan.station < 0
    cost = 1.0
    if charge > 0 and not no_way:
        cost = return_s / battery_s
        if capped and cost > 1.0:
            cost = 1.0
    c1_us = low_battery * capacity_of(world, drone)
    c2_us = c1_us / 1.5
    c3_us = c2_us / 1.5
    if charge > round(c1_us):
        return 1.0, 0.0, cost
    if not no_way and battery_s > return_s:
        if charge > round(c2_us):
            return 0.8, 0.2, cost
        if charge > round(c3_us):
            return 0.5, 0.5, cost
        if charge > round(c3_us / 1.5):
            return 0.2, 0.8, cost
    return 0.0, 1.0, cost


# ---- payment


@rule
def clear_terms(drone: Drone) -> None:
    """Set all terms of a drone's reward to 0."""
    terms = drone.terms
    for k in range(len(terms)):
        terms[k] = 0.0


@rule
def add_up(state: State, drone: Drone) -> None:
    """Give a drone the sum of its terms, added in their order, as its reward.

    A reward for a whole step is weighed by the share of a step between two decision epochs. One
    that counts what has been added meanwhile (``keeps_credit``) is exact as it is.
    """
    terms, total = drone.terms, 0.0
    if state.share != 1.0 and not state.keeps_credit:
        for k in range(len(terms)):
            terms[k] *= state.share
    for k in range(len(terms)):
        total += terms[k]
    give(state, drone, total)


@rule
def give(state: State, drone: Drone, reward: float) -> None:
    """Write a drone's reward; one that is not a number or too large sets the fault TOO_LARGE."""
    state.rewards[drone.index] = reward
    if not -LARGEST_REWARD <= reward <= LARGEST_REWARD:
        state.faults |= TOO_LARGE
