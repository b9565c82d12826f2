"""Path loss between aerial users and base stations on the ground, after 3GPP TR 36.777.

Annex B of the report (V15.0.0), tables B-1 to B-3. Distances are in metres, carriers in GHz; the
height is that of the aerial user above the ground, and the base station has a height of its own in
each scenario. At lower heights, the report refers to TR 38.901, which is not here. The model says
nothing about links between a drone and users in the street: ``AlHourani`` does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, inf, log10, pi, sqrt

from desim_uav.model.radio.path_loss import free_space_db

HIGHEST_M = 300.0
"""The largest height of an aerial user in the report, in metres."""


@dataclass(frozen=True)
class AerialScenario:
    """A scenario of TR 36.777: its formulas, and the heights and distances at which they hold."""

    name: str
    station_m: float
    """The height of the base station."""
    above_m: float
    """The formulas hold above this height."""
    farthest_m: float
    """The largest horizontal distance of the path loss."""
    always_above_m: float
    """Above this height there is always line of sight."""
    blocked_up_to_m: float
    """The largest height at which the loss without line of sight is defined."""
    sight: Callable[[float], tuple[float, float]]
    """p1 and d1 of table B-1, by height."""
    los: Callable[[float, float, float], float]
    """The loss with line of sight of table B-2, by height, distance in space and carrier."""
    nlos: Callable[[float, float, float], float]
    """The loss without line of sight of table B-2, by height, distance in space and carrier."""
    sigma_los: Callable[[float], float]
    """The standard deviation of shadowing with line of sight, of table B-3, by height."""
    sigma_nlos: float
    """The standard deviation of shadowing without line of sight, of table B-3."""
    sigma_nlos_up_to_m: float
    """The largest height for which table B-3 has the one without line of sight."""

    def p_los(self, distance_m: float, height_m: float) -> float:
        """Return the probability of line of sight. Raises ValueError where it is not defined."""
        self._check(distance_m, height_m, HIGHEST_M, farthest_m=inf)
        if height_m > self.always_above_m:
            return 1.0
        p1_m, d1_m = self.sight(height_m)
        if distance_m <= d1_m:
            return 1.0
        near = d1_m / distance_m
        return near + exp(-distance_m / p1_m) * (1.0 - near)

    def los_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        """Return the loss with line of sight. Raises ValueError where it is not defined."""
        self._check(distance_m, height_m, HIGHEST_M, self.farthest_m)
        return self.los(height_m, self.slant_m(distance_m, height_m), carrier_ghz)

    def nlos_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        """Return the loss without line of sight. Raises ValueError where it is not defined."""
        self._check(distance_m, height_m, self.blocked_up_to_m, self.farthest_m)
        return self.nlos(height_m, self.slant_m(distance_m, height_m), carrier_ghz)

    def sigma_los_db(self, height_m: float) -> float:
        """Return the standard deviation of shadowing with line of sight, in dB."""
        self._check(0.0, height_m, HIGHEST_M, self.farthest_m)
        return self.sigma_los(height_m)

    def sigma_nlos_db(self, height_m: float) -> float:
        """Return the standard deviation of shadowing without line of sight, in dB."""
        self._check(0.0, height_m, self.sigma_nlos_up_to_m, self.farthest_m)
        return self.sigma_nlos

    def slant_m(self, distance_m: float, height_m: float) -> float:
        """Return the distance in space between the aerial user and the base station's antenna.

        Raises ValueError if it is 0.
        """
        slant_m = sqrt(distance_m**2 + (height_m - self.station_m) ** 2)
        if slant_m == 0.0:
            raise ValueError(f"{self.name}: there is no loss at the station's own antenna")
        return slant_m

    def _check(
        self, distance_m: float, height_m: float, highest_m: float, farthest_m: float
    ) -> None:
        if not self.above_m < height_m <= highest_m:
            below = height_m <= self.above_m
            raise ValueError(
                f"{self.name}: the height must be above {self.above_m:g} m and at most "
                f"{highest_m:g} m, not {height_m:g} m"
                + ("; below, TR 36.777 refers to TR 38.901" if below else "")
            )
        if not 0.0 <= distance_m <= farthest_m:
            raise ValueError(
                f"{self.name}: the horizontal distance must be at most {farthest_m:g} m and not "
                f"negative, not {distance_m:g} m"
            )


def _wave_db(carrier_ghz: float) -> float:
    """Return 20 log10(40 pi f / 3), the loss in free space over 1 m with c = 3e8 m/s."""
    return 20.0 * log10(40.0 * pi * carrier_ghz / 3.0)


def _rma_los(height_m: float, slant_m: float, carrier_ghz: float) -> float:
    slope = max(23.9 - 1.8 * log10(height_m), 20.0)
    return slope * log10(slant_m) + _wave_db(carrier_ghz)


def _rma_nlos(height_m: float, slant_m: float, carrier_ghz: float) -> float:
    slope = 35.0 - 5.3 * log10(height_m)
    blocked = -12.0 + slope * log10(slant_m) + _wave_db(carrier_ghz)
    return max(_rma_los(height_m, slant_m, carrier_ghz), blocked)


def _uma_los(height_m: float, slant_m: float, carrier_ghz: float) -> float:
    return 28.0 + 22.0 * log10(slant_m) + 20.0 * log10(carrier_ghz)


def _uma_nlos(height_m: float, slant_m: float, carrier_ghz: float) -> float:
    slope = 46.0 - 7.0 * log10(height_m)
    return -17.5 + slope * log10(slant_m) + _wave_db(carrier_ghz)


def _umi_los(height_m: float, slant_m: float, carrier_ghz: float) -> float:
    slope = 22.25 - 0.5 * log10(height_m)
    above = 30.9 + slope * log10(slant_m) + 20.0 * log10(carrier_ghz)
    return max(free_space_db(slant_m, 0.0, carrier_ghz), above)


def _umi_nlos(height_m: float, slant_m: float, carrier_ghz: float) -> float:
    slope = 43.2 - 7.6 * log10(height_m)
    blocked = 32.4 + slope * log10(slant_m) + 20.0 * log10(carrier_ghz)
    return max(_umi_los(height_m, slant_m, carrier_ghz), blocked)


RMA_AV = AerialScenario(
    name="RMa-AV",
    station_m=35.0,
    above_m=10.0,
    farthest_m=10_000.0,
    always_above_m=40.0,
    blocked_up_to_m=HIGHEST_M,
    sight=lambda h: (
        max(15021.0 * log10(h) - 16053.0, 1000.0),
        max(1350.8 * log10(h) - 1602.0, 18.0),
    ),
    los=_rma_los,
    nlos=_rma_nlos,
    sigma_los=lambda h: 4.2 * exp(-0.0046 * h),
    sigma_nlos=6.0,
    sigma_nlos_up_to_m=40.0,
)
"""Villages and fields: stations of 35 m."""

UMA_AV = AerialScenario(
    name="UMa-AV",
    station_m=25.0,
    above_m=22.5,
    farthest_m=4_000.0,
    always_above_m=100.0,
    blocked_up_to_m=100.0,
    sight=lambda h: (4300.0 * log10(h) - 3800.0, max(460.0 * log10(h) - 700.0, 18.0)),
    los=_uma_los,
    nlos=_uma_nlos,
    sigma_los=lambda h: 4.64 * exp(-0.0066 * h),
    sigma_nlos=6.0,
    sigma_nlos_up_to_m=100.0,
)
"""Towns: stations of 25 m, above the roofs. Table B-2 lets the loss without line of sight begin at
10 m; TR 38.901 applies up to 22.5 m, so it begins there here."""

UMI_AV = AerialScenario(
    name="UMi-AV",
    station_m=10.0,
    above_m=22.5,
    farthest_m=4_000.0,
    always_above_m=HIGHEST_M,
    blocked_up_to_m=HIGHEST_M,
    sight=lambda h: (233.98 * log10(h) - 0.95, max(294.05 * log10(h) - 432.94, 18.0)),
    los=_umi_los,
    nlos=_umi_nlos,
    sigma_los=lambda h: max(5.0 * exp(-0.01 * h), 2.0),
    sigma_nlos=8.0,
    sigma_nlos_up_to_m=HIGHEST_M,
)
"""Streets: stations of 10 m, below the roofs."""

SCENARIOS = {one.name: one for one in (RMA_AV, UMA_AV, UMI_AV)}
"""The scenarios by name."""
