"""Path losses, a sharing and services of a user's own, for the tests of radio keys."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.radio.functions import log10, slant_range_m
from desim_uav.model.radio.path_loss import RowPathLoss
from desim_uav.model.radio.radio import Disc
from desim_uav.model.services import Stage
from desim_uav.model.sharing import RowSharing
from desim_uav.rules.sharing import Equal


@dataclass(frozen=True)
class Flat(RowPathLoss):
    """A path loss without a slope."""

    exponent: float = 3.0

    def los_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        return 40.0 + 10.0 * self.exponent * log10(slant_range_m(distance_m, height_m))


@dataclass(frozen=True)
class Wrong(Flat):
    """A path loss with a slope that is half of what it must be."""

    def slope(self, distance_m: float, height_m: float, within_m: float) -> tuple[float, float]:
        nearest_m = slant_range_m(distance_m, height_m) - within_m
        steepest = 2.1715 * self.exponent / nearest_m if nearest_m > 0.0 else np.inf
        return steepest, steepest


@dataclass(frozen=True)
class Falling(Flat):
    """A loss that falls with the distance up to 200 m."""

    def los_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        return 100.0 + 0.05 * abs(distance_m - 200.0)

    def slope(self, distance_m: float, height_m: float, within_m: float) -> tuple[float, float]:
        return 0.05, 0.0


@dataclass(frozen=True)
class Sinking(Flat):
    """A probability of line of sight that falls with the elevation."""

    def p_los(self, elevation: float) -> float:
        return 1.0 - elevation / 90.0

    def slope(self, distance_m: float, height_m: float, within_m: float) -> tuple[float, float]:
        return 10.0, 10.0


@dataclass(frozen=True)
class Uncompiled(Flat):
    """A loss that only Python can compute."""

    town: str = "small"

    def los_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        at_1m_db = 40.0 if self.town == "small" else 60.0
        return at_1m_db + 30.0 * log10(slant_range_m(distance_m, height_m))


@dataclass(frozen=True)
class Broken(Flat):
    """A loss that raises an error."""

    def los_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        return 1.0 / 0.0 * distance_m


class Loss:
    """A class that is no path loss."""

    def los_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        return 1.0


@dataclass(frozen=True)
class SharedDisc(Disc):
    """A disc whose bandwidth transfers share."""

    @property
    def sharing(self) -> RowSharing:
        return Equal()


@dataclass(frozen=True)
class Uploads:
    """A service whose volumes are what the test says."""

    ubit: int
    bps: int = 1000
    kind: ClassVar = "radio_plug_ins:Uploads"

    def values(self) -> dict[str, NDArray[np.int64]]:
        return {"ubit": np.array([self.ubit]), "bps": np.array([self.bps])}

    def stages(self) -> tuple[Stage, ...]:
        return (Stage("ubit", rate="bps"),)
