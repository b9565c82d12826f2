"""Backhauls: how drones and access points are connected to the network on the ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from desim_uav.registry import register

UNLIMITED_BPS = 2**62
"""The capacity of a sender without a backhaul: what requests hold is never as much together."""


class Backhaul:
    """A backhaul, as the scenario's component ``drones.backhaul``."""

    @property
    def capacity_bps(self) -> int:
        """The largest sum of the rates that a sender serves, in bit/s."""
        raise NotImplementedError


@register("backhaul", "capacity")
@dataclass(frozen=True)
class Capacity(Backhaul):
    """A backhaul of a fixed capacity, which the sum of the rates that are served never exceeds."""

    kbps: Annotated[float, Ge(0.001), Le(1e9)]
    """The capacity, in kbit/s, rounded to whole bit/s."""

    @property
    def capacity_bps(self) -> int:
        """The capacity, in bit/s."""
        return round(self.kbps * 1000)
