"""What flight takes and how a battery is charged, for the simulator with fixed time steps."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Rotor:
    """The power of a rotary wing over its speed, as Zeng, Xu and Zhang 2019 print it, in watts."""

    weight_n: float = 20.0
    density: float = 1.225
    radius_m: float = 0.4
    area_m2: float = 0.503
    omega: float = 300.0
    tip_mps: float = 120.0
    solidity: float = 0.05
    delta: float = 0.012
    d0: float = 0.6
    k: float = 0.1
    v0: float = 4.03
    climbs: bool = True
    electronics_w: float = 0.0

    def power_w(self, level_mps: float, up_mps: float) -> float:
        """The power at a horizontal and a vertical speed."""
        swept = self.density * self.solidity * self.area_m2
        p0 = self.delta / 8 * swept * self.omega**3 * self.radius_m**3
        pi = (1 + self.k) * self.weight_n**1.5 / math.sqrt(2 * self.density * self.area_m2)
        ratio = level_mps / self.v0
        blade = p0 * (1 + 3 * level_mps**2 / self.tip_mps**2)
        induced = pi * math.sqrt(math.sqrt(1 + ratio**4 / 4) - ratio**2 / 2)
        drag = 0.5 * self.d0 * swept * level_mps**3
        lift = self.weight_n * max(0.0, up_mps) if self.climbs else 0.0
        return blade + induced + drag + lift + self.electronics_w


@dataclass(frozen=True)
class Charger:
    """Charging by the rate of an empty battery, a share per second, that falls from a share on."""

    rate_per_s: float
    taper_from: float = 1.0
    full_at: float = 1.0

    def rate(self, share: float) -> float:
        """The share of the capacity that is gained per second."""
        if share <= self.taper_from:
            return self.rate_per_s
        return self.rate_per_s * (1 - share) / (1 - self.taper_from)
