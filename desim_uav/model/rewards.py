"""The rewards of a drone at the end of each step: R1, R2 and R3 of the paper."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Protocol

from annotated_types import Ge, Le

from desim_uav.errors import SimulationError
from desim_uav.model.rules import US, Mode
from desim_uav.model.state import Facts, Observation
from desim_uav.registry import register

LANDED_OR_DOWN = frozenset({Mode.QUEUED, Mode.CHARGING, Mode.CHARGED, Mode.CRASHED})

Weight = Annotated[float, Ge(0), Le(1e6)]
Sign = Annotated[float, Ge(-1), Le(1)]
Share = Annotated[float, Ge(0), Le(1)]

LOW_WEIGHTS = ((0.8, 0.2), (0.5, 0.5), (0.2, 0.8))
"""(w_s, w_c) above c2, c3 and c4 of R2 and R3."""


class Reward(Protocol):
    """Computes the reward of a drone for the step that ends now."""

    def terms(
        self, drone: Observation, open_requests: tuple[int, ...], facts: Facts
    ) -> dict[str, float]:
        """Return the terms of the reward by name; the reward is their sum. Names never change.

        ``open_requests`` counts all open requests by service, in the order of ``facts.services``.
        """


class RowReward:
    """A reward over rows, which is compiled: both engines run it, and training at full speed.

    A subclass is a frozen dataclass whose fields are numbers. ``names`` are the terms; the reward
    is their sum.
    """

    names: ClassVar[tuple[str, ...]] = ()

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        """Write what a drone gets for the step that ends now: ``drone.terms``, which are 0.

        ``world``, ``state`` and ``drone`` are rows (see ``rules.rows``: Constants, State, Drone).
        ``state.seen[drone.index]`` is what the drone knows, and ``state.asked`` counts the open
        requests by service. Compiled code knows no objects besides rows and numbers.
        """
        raise NotImplementedError

    def terms(
        self, drone: Observation, open_requests: tuple[int, ...], facts: Facts
    ) -> dict[str, float]:
        """Refuse: this reward is computed from rows, not from an observation."""
        raise SimulationError(
            f"reward {type(self).__name__!r} is computed from rows, and cannot be computed from an "
            "observation alone"
        )


@register("reward", "coverage")
@dataclass(frozen=True)
class Coverage:
    """R1: the drone's attached users, divided by its fair share of all users; at most 1."""

    def terms(
        self, drone: Observation, open_requests: tuple[int, ...], facts: Facts
    ) -> dict[str, float]:
        """Return one term: users."""
        idle = drone.mode in LANDED_OR_DOWN
        return {"users": 0.0 if idle else fair_share(drone, facts)}


@register("reward", "coverage_battery")
@dataclass(frozen=True)
class CoverageBattery:
    """R2: attached users, weighed against the cost of a return as the battery runs low.

    ``low_battery`` is the share of the capacity (c1) at or below which the cost counts.
    ``cost_sign`` is -1 for a cost; the paper writes a plus.
    """

    cost_sign: Sign = -1.0
    """-1: danger is a cost. 1: it is paid, as the paper writes it."""
    low_battery: Share = 0.2
    """The share of the capacity (c1) at or below which the way to a station counts."""

    def terms(
        self, drone: Observation, open_requests: tuple[int, ...], facts: Facts
    ) -> dict[str, float]:
        """Return two terms: users and return."""
        if drone.mode in LANDED_OR_DOWN:
            return {"users": 0.0, "return": 0.0}
        service, cost = battery_weights(drone, self.low_battery)
        return {
            "users": service * fair_share(drone, facts),
            "return": self.cost_sign * cost * return_cost(drone),
        }


@register("reward", "multi_service")
@dataclass(frozen=True)
class MultiService:
    """R3: as R2, with the share of each service's open requests that the drone serves.

    ``services`` holds the weight of each service by name. The cost of charging (the paper's r_cs)
    is 0; a subclass can override ``charging_cost``.
    """

    cost_sign: Sign = -1.0
    """-1: danger is a cost. 1: it is paid, as the paper writes it."""
    low_battery: Share = 0.2
    """The share of the capacity (c1) at or below which the way to a station counts."""
    users: Weight = 0.5
    """The weight of the attached users."""
    services: Mapping[str, Weight] = field(
        default_factory=lambda: {"throughput": 0.2, "edge_computing": 0.2, "data_gathering": 0.1}
    )
    """The weight of each service, by name."""

    def terms(
        self, drone: Observation, open_requests: tuple[int, ...], facts: Facts
    ) -> dict[str, float]:
        """Return the terms: users, each service, return and charging."""
        if drone.mode in LANDED_OR_DOWN:
            return dict.fromkeys(("users", *facts.services, "return", "charging"), 0.0)
        service, cost = battery_weights(drone, self.low_battery)
        terms = {"users": service * self.users * fair_share(drone, facts)}
        weights = self.services
        for name, served, asked in zip(facts.services, drone.served, open_requests, strict=True):
            if served and asked:
                terms[name] = service * weights.get(name, 0.0) * (served / asked)
            else:
                terms[name] = 0.0
        signed = self.cost_sign * cost
        terms["return"] = signed * return_cost(drone) if cost else signed * 0.0
        terms["charging"] = signed * self.charging_cost(drone, facts)
        return terms

    def charging_cost(self, drone: Observation, facts: Facts) -> float:
        """Return the paper's r_cs, the cost of charging."""
        return 0.0


def fair_share(drone: Observation, facts: Facts) -> float:
    """Return r_u: the drone's users divided by the mean number of users per drone, at most 1."""
    share = drone.attached_users * facts.drones / facts.users
    return share if share < 1.0 else 1.0


def return_cost(drone: Observation) -> float:
    """Return r_c: n_B divided by the battery, at most 1.

    It is 1 if the battery is empty or if there is no way to a station.
    """
    battery_s, return_s = drone.battery_s, drone.return_s
    if battery_s is None or return_s is None:
        return 0.0
    if battery_s <= 0.0 or math.isinf(return_s):
        return 1.0
    return min(1.0, return_s / battery_s)


def battery_weights(drone: Observation, low_battery: float) -> tuple[float, float]:
    """Return (w_s, w_c), which sum to 1: the fuller the battery, the more service counts.

    The battery is compared with ``thresholds_us`` in whole microseconds, as masks compare it. If
    it only just suffices for the return, or does not, only the return counts.
    """
    battery_s, capacity_s, return_s = drone.battery_s, drone.capacity_s, drone.return_s
    if battery_s is None or capacity_s is None or return_s is None:
        return 1.0, 0.0
    battery_us = round(battery_s * US)
    c1_us, *lower_us = thresholds_us(low_battery, round(capacity_s * US))
    if battery_us > c1_us:
        return 1.0, 0.0
    if battery_s > return_s:
        for threshold_us, weights in zip(lower_us, LOW_WEIGHTS, strict=True):
            if battery_us > threshold_us:
                return weights
    return 0.0, 1.0


def thresholds_us(low_battery: float, capacity_us: int) -> tuple[int, int, int, int]:
    """Return c1 to c4 in whole microseconds, rounded half to even as masks round the level.

    c1 is ``low_battery`` times the capacity; each of the others is the one before divided by 1.5.
    """
    c1_us = low_battery * capacity_us
    c2_us = c1_us / 1.5
    c3_us = c2_us / 1.5
    return round(c1_us), round(c2_us), round(c3_us), round(c3_us / 1.5)
