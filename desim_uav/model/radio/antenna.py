"""Antennas of drones and access points, which point straight down.

The gain depends on the angle from straight down alone, and does not rise with it. At a fixed height
a level therefore still falls with the horizontal distance, and each class of a link holds in a
disc. The gain is subtracted from the path loss (``received``), so that all that works with path
losses works with antennas too.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Gt, Le

from desim_uav.model.radio.functions import elevation_deg
from desim_uav.model.radio.levels import mean_db_of, rates_of_class
from desim_uav.model.radio.path_loss import MEAN, Rates, RowPathLoss
from desim_uav.model.radio.slopes import DEGREES
from desim_uav.registry import kind_name, register
from desim_uav.rowcode.components import ruled
from desim_uav.rowcode.kernels import rule

Gain = Annotated[float, Ge(-200), Le(100)]


class RowAntenna:
    """An antenna that points straight down, whose methods can be compiled.

    A subclass is a frozen dataclass with ``gain_at``, which uses what the methods of a path loss
    may use. The gain must not rise with the angle, and must not jump.
    """

    plain: ClassVar = ()
    jumps: ClassVar[bool] = False
    """Whether the gain is that of a cone, inside which it is another one than outside."""

    def gain_at(self, angle: float) -> float:
        """Return the gain in dBi at an angle from straight down, in degrees."""
        raise NotImplementedError

    def steepest_db(self, low: float, high: float) -> float:
        """Return the most that the gain falls per degree, between two angles.

        Without this method, bounds of the change of levels are sampled (``model.radio.sampled``).
        """
        raise NotImplementedError


@register("antenna", "isotropic")
@dataclass(frozen=True)
class Isotropic(RowAntenna):
    """Radiates alike in all directions, with a gain of 0 dBi."""


@register("antenna", "element")
@dataclass(frozen=True)
class Element(RowAntenna):
    """Has the pattern of an antenna element of 3GPP TR 38.901, turned to the ground.

    The gain falls by 12 (angle / beamwidth)² dB, up to ``front_to_back_db`` (table 7.3-1). The
    table has this formula for the vertical and for the horizontal cut; here it holds all around.
    """

    gain_dbi: Gain = 8.0
    """The gain straight down, in dBi."""
    beamwidth_deg: Annotated[float, Ge(1), Le(360)] = 65.0
    """The width of the beam in degrees: half of it from straight down, the gain is 3 dB less."""
    front_to_back_db: Annotated[float, Ge(0), Le(200)] = 30.0
    """The largest difference in dB between the gain straight down and that at another angle."""

    def gain_at(self, angle: float) -> float:
        """Return the gain of table 7.3-1."""
        share = angle / float(self.beamwidth_deg)
        return float(self.gain_dbi) - min(12.0 * share * share, float(self.front_to_back_db))

    def steepest_db(self, low: float, high: float) -> float:
        """Return how fast the gain falls at the larger angle, or where it is least."""
        width = float(self.beamwidth_deg)
        if 12.0 * low * low >= float(self.front_to_back_db) * width * width:
            return 0.0
        return 24.0 * high / (width * width)


@register("antenna", "cone")
@dataclass(frozen=True)
class Cone(RowAntenna):
    """Has one gain within a cone below it, and another one outside of it.

    At a height h the cone covers a disc with the radius h tan(``half_angle_deg``), as in Mozaffari
    et al. 2016. A link changes exactly when the user passes the cone, as a drawn line of sight
    does, so this antenna needs `line_of_sight: mean` and no shadowing.
    """

    half_angle_deg: Annotated[float, Gt(0), Le(89)]
    """The angle between straight down and the edge of the cone, in degrees."""
    gain_dbi: Gain
    """The gain within the cone, its edge included, in dBi."""
    side_dbi: Gain
    """The gain outside of the cone, in dBi, at most that within it."""

    jumps: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Raise ValueError if the gain is larger outside."""
        if self.side_dbi > self.gain_dbi:
            raise ValueError(
                f"side_dbi must not be above gain_dbi: {self.side_dbi:g} > {self.gain_dbi:g}"
            )


def received(path_loss: RowPathLoss, antenna: RowAntenna) -> RowPathLoss:
    """Return a path loss from which the gain of an antenna is subtracted.

    That of a cone has "line of sight" within it, and none outside. Raises ValueError if both have a
    parameter of the same name.
    """
    if isinstance(antenna, Isotropic):
        return path_loss
    values: dict[str, Any] = {}
    for part in (path_loss, antenna):
        own: Any = dataclasses.fields(part) if dataclasses.is_dataclass(part) else ()
        for one in own:
            if one.name in values:
                raise ValueError(
                    f"{kind_name(antenna)} and {kind_name(path_loss)} must not both have a "
                    f"parameter {one.name}"
                )
            values[one.name] = getattr(part, one.name)
    kinds: Any = type(path_loss), type(antenna)
    made: RowPathLoss = _class_of(*kinds, tuple(values))(**values)
    return made


@cache
def _class_of(loss: Any, antenna: Any, names: tuple[str, ...]) -> Any:
    """Return the class of path losses from which gains are subtracted, with fields of both."""
    methods = _of_cone(loss) if antenna.jumps else _of_pattern(loss, antenna)
    own = next((each for each in (loss, antenna) if ":" in _kind(each)), loss)
    name = f"{loss.__name__}_{antenna.__name__}"
    return dataclasses.make_dataclass(
        name,
        [(each, Any) for each in names],
        bases=(RowPathLoss,),
        namespace={
            **methods,
            "kind": _kind(own),
            "__qualname__": name,
            "__module__": own.__module__,
        },
        frozen=True,
    )


def _kind(cls: Any) -> str:
    return str(vars(cls).get("kind", ":"))


def _of_cone(loss: Any) -> dict[str, Any]:
    """Return the methods of a path loss with a cone."""
    mean_db, rates_of = mean_db_of(loss), rates_of_class(loss)

    def los_db(self: Any, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        return float(mean_db(self, distance_m, height_m, carrier_ghz) - float(self.gain_dbi))

    def nlos_db(self: Any, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        return float(mean_db(self, distance_m, height_m, carrier_ghz) - float(self.side_dbi))

    def p_los(self: Any, elevation: float) -> float:
        return 1.0 if elevation >= 90.0 - float(self.half_angle_deg) else 0.0

    def rates(self: Any, branch: int, distance_m: float, height_m: float, within_m: float) -> Rates:
        bounds: Rates = rates_of(self, 1.0, MEAN, distance_m, height_m, within_m)
        return bounds

    methods = {"los_db": los_db, "nlos_db": nlos_db, "p_los": p_los}
    return methods | ({"rates": rates} if loss.is_bounded() else {})


def _of_pattern(loss: Any, antenna: Any) -> dict[str, Any]:
    """Return the methods of a path loss with an antenna whose gain does not jump."""
    of_los, of_nlos, of_mean = ruled(loss.los_db), ruled(loss.nlos_db), mean_db_of(loss)
    gain_at, steepest = ruled(antenna.gain_at), ruled(antenna.steepest_db)
    rates_of = rates_of_class(loss)

    @rule
    def gain_dbi(own: Any, distance_m: float, height_m: float) -> float:
        return float(gain_at(own, 90.0 - elevation_deg(distance_m, height_m)))

    def los_db(self: Any, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        gain = gain_dbi(self, distance_m, height_m)
        return float(of_los(self, distance_m, height_m, carrier_ghz) - gain)

    def nlos_db(self: Any, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        gain = gain_dbi(self, distance_m, height_m)
        return float(of_nlos(self, distance_m, height_m, carrier_ghz) - gain)

    def mean_db(self: Any, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        gain = gain_dbi(self, distance_m, height_m)
        return float(of_mean(self, distance_m, height_m, carrier_ghz) - gain)

    def rates(self: Any, branch: int, distance_m: float, height_m: float, within_m: float) -> Rates:
        away, most_away, up, most_up = rates_of(self, 1.0, branch, distance_m, height_m, within_m)
        range_m = math.sqrt(distance_m * distance_m + height_m * height_m)
        if range_m <= within_m:
            return -math.inf, math.inf, -math.inf, math.inf
        near_m, share = range_m - within_m, within_m / range_m
        turn = DEGREES * share * (1.0 + 0.571 * share * share)  # no less than asin(share)
        angle = 90.0 - elevation_deg(distance_m, height_m)
        fall_db = steepest(self, max(angle - turn, 0.0), angle + turn) * DEGREES / near_m
        leans, stands = (distance_m + within_m) / near_m, (height_m + within_m) / near_m
        return away - fall_db * min(stands, 1.0), most_away, up, most_up + fall_db * min(leans, 1.0)

    methods = {"los_db": los_db, "nlos_db": nlos_db, "mean_db": mean_db, "p_los": loss.p_los}
    bounded = loss.is_bounded() and antenna.steepest_db is not RowAntenna.steepest_db
    return methods | ({"rates": rates} if bounded else {})
