"""Data gathering: sensors, and the services whose updates they send."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen
from numpy.typing import NDArray

from desim_uav.model.demand.demand import Demand
from desim_uav.model.rules import US
from desim_uav.model.services import (
    KEEPS,
    MICROBITS,
    MOST_BUFFERED,
    PREEMPTS,
    Collecting,
    Stage,
    scaled,
)
from desim_uav.model.updates import UpdatesAtWill
from desim_uav.registry import ComponentField, register


@register("service", "collect")
@dataclass(frozen=True)
class Collect:
    """Updates of sensors, which take them at times of their own and send them one after the other.

    Users whose demand is `sensing` send them. All sizes are equally likely.
    """

    updates: Annotated[Any, ComponentField("updates", "poisson", Demand)]
    """When a sensor takes updates: poisson, periodic, at_will, or trace."""
    size_mbit: Annotated[tuple[Annotated[float, Ge(1e-12), Le(1e6)], ...], MinLen(1)]
    """The sizes of an update, in Mbit, equally likely."""
    bandwidth_kbps: Annotated[tuple[Annotated[float, Ge(0.001)], ...], MinLen(1)] | None = None
    """The rates that an update can hold, in kbit/s, equally likely: for the sharing `held` only."""
    buffer: Annotated[int, Ge(1), Le(MOST_BUFFERED)] = 10
    """How many updates a sensor can hold, of which the first one is being sent or waits for it."""
    keeps: Literal["newest", "oldest", "last"] = "newest"
    """What a full buffer does with a new update: it drops the oldest one that waits (newest), or
    the new one (oldest). With `last`, a new one always replaces all that wait.
    """
    preempt: Literal[False, True, "all"] = False
    """Whether, with `keeps: last`, a new update replaces the one that is being sent, too. With
    `all`, it also replaces the updates of all other sensors that are attached to the same drone, if
    these have `all` as well: the drone is a server with preemption, which several sources share.
    """
    sends: Literal["first", "last"] = "first"
    """Which of the updates that wait in a sensor's buffer is sent next: the first or the last one
    that was taken. Sending is not interrupted.
    """
    delivered: Literal["drone", "ground"] = "drone"
    """When an update is delivered: when a drone has received its last bit (drone), or when it has
    passed over that drone's backhaul, or the drone has landed on a station (ground). An access
    point without a backhaul is at the ground.
    """
    age_limit_s: Annotated[float, Gt(0), Le(1e9)] | None = None
    """The age from which on time counts as violated, in seconds; null means it never does."""

    def __post_init__(self) -> None:
        """Raise ValueError for keys that contradict each other."""
        if self.delivered == "ground" and isinstance(self.updates, UpdatesAtWill):
            raise ValueError(
                "updates: at_will is for delivered: drone, because a sensor does not know when its "
                "update comes to the ground"
            )
        if self.preempt and self.keeps != "last":
            raise ValueError(
                f"preempt: {str(self.preempt).lower()} is for keeps: last, and not for keeps: "
                f"{self.keeps}"
            )

    def values(self) -> dict[str, NDArray[np.int64]]:
        """Return the sizes in millionths of a bit, and the rates in bit/s (0: none are held)."""
        return {
            "size_mbit": scaled(self.size_mbit, MICROBITS),
            "bandwidth_kbps": scaled(self.bandwidth_kbps or (0,), 1000),
        }

    def stages(self) -> tuple[Stage, ...]:
        """Return the one stage: the update is sent."""
        rate = "bandwidth_kbps" if self.bandwidth_kbps else None
        return (Stage("size_mbit", rate=rate, up=True),)

    def collecting(self) -> Collecting:
        """Return how updates are kept."""
        limit_us = None if self.age_limit_s is None else round(self.age_limit_s * US)
        ground, wait_us = self.delivered == "ground", getattr(self.updates, "wait_us", 0)
        keeps = KEEPS.index(self.keeps)
        preempts, sends_last = PREEMPTS.index(self.preempt), self.sends == "last"
        return Collecting(self.buffer, keeps, preempts, sends_last, limit_us, ground, wait_us)


@register("demand", "sensing")
@dataclass(frozen=True)
class Sensing:
    """Each user is a sensor: it sends the updates of a service of kind `collect`."""

    service: str
    """The name of a service of kind `collect`."""

    @property
    def mix(self) -> Mapping[str, float]:
        """The weight of the service, which is no key of the scenario."""
        return MappingProxyType({self.service: 1.0})

    def law(self, services: Mapping[str, Any]) -> Any:
        """Return the demand model that draws the updates."""
        return services[self.service].updates
