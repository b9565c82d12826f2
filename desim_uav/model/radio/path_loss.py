"""Path loss between a drone and a user, in dB, over distance, height difference and carrier.

All losses are over the distance in space, whereas ``distance_m`` is the horizontal distance.
Elevations are in degrees.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from annotated_types import Ge, Gt, Le

from desim_uav.model.radio.functions import elevation_deg, exp, log10, slant_range_m
from desim_uav.model.radio.slopes import logistic_rates
from desim_uav.registry import register
from desim_uav.rowcode.kernels import rule

SPEED_OF_LIGHT_MPS = 299_792_458.0

MEAN, LOS, NLOS = range(3)
"""The branches of a path loss: its mean, and the losses with and without line of sight."""

FORMULAS = {"los_db", "nlos_db", "p_los", "mean_db"}
"""The methods of a path loss for which a bound of its change holds."""


Rates = tuple[float, float, float, float]
"""The least and the most that a level changes, in dB for a metre of horizontal distance, and the
least and the most for a metre of height."""


class Use(NamedTuple):
    """What a scenario uses a path loss for.

    The levels of the transmitter are between two heights above the ground. ``farthest_m`` is the
    largest horizontal distance on the map, and ``tallest_user_m`` the greatest height of a user.
    """

    flies: bool
    lowest_m: float
    highest_m: float
    farthest_m: float
    tallest_user_m: float
    line_of_sight: str


class RowPathLoss:
    """A path loss that Python runs as it stands, and that can be compiled.

    A subclass is a frozen dataclass with ``los_db`` and, if sight may be blocked, ``nlos_db`` and
    ``p_los``; without ``nlos_db`` the loss is the same with and without line of sight. These
    methods use fields that are numbers, + - * /, ``math.sqrt``, ``min``, ``max`` and the functions
    of ``model.radio.functions``, so that both engines get the same bits. Losses must rise with
    the distance, and ``p_los`` must rise with the elevation: each class of a link is then a disc.

    Where classes are no discs, because there is interference or a drone climbs, and for association
    by levels, a search needs to know how fast a level can change: ``slope`` says so. Without it,
    bounds are computed from samples (``model.radio.sampled``), which is slower and no proof. What a
    class inherits of ``slope`` holds for the losses that it inherits only.
    """

    plain: ClassVar = ()

    def __init_subclass__(cls) -> None:
        """Take ``los_db`` without line of sight too, if a subclass defines nothing else."""
        if "los_db" in vars(cls) and cls.nlos_db is RowPathLoss.nlos_db:
            cls.nlos_db = cls.los_db  # type: ignore[method-assign]
        if "slope" not in vars(cls) and not vars(cls).keys().isdisjoint(FORMULAS):
            cls.slope = RowPathLoss.slope  # type: ignore[method-assign]
        if "rates" not in vars(cls) and not vars(cls).keys().isdisjoint({*FORMULAS, "slope"}):
            cls.rates = RowPathLoss.rates  # type: ignore[method-assign]

    def los_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        """Return the loss with line of sight, in dB."""
        raise NotImplementedError

    def nlos_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        """Return the loss without line of sight, in dB."""
        raise NotImplementedError

    def p_los(self, elevation: float) -> float:
        """Return the probability of line of sight at an elevation in degrees, by default 1."""
        return 1.0

    def mean_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        """Return the mean of both losses in dB, weighted with the probability of line of sight."""
        return mean_of(
            self.p_los(elevation_deg(distance_m, height_m)),
            self.los_db(distance_m, height_m, carrier_ghz),
            self.nlos_db(distance_m, height_m, carrier_ghz),
        )

    def problems(self, use: Use) -> Iterator[str]:
        """Yield why the loss is not defined for what a scenario uses it for, by default nothing."""
        yield from ()

    def slope(self, distance_m: float, height_m: float, within_m: float) -> tuple[float, float]:
        """Return the most that a level changes near a place, in dB for a metre.

        The first number is for a metre of horizontal distance, and the second for one of height.
        The bounds must hold for all losses (``los_db``, ``nlos_db``, ``mean_db``) at all places at
        most ``within_m`` away, inf where there is none. Losses may have kinks, but must not jump.
        """
        raise NotImplementedError

    def rates(self, branch: int, distance_m: float, height_m: float, within_m: float) -> Rates:
        """Return the least and the most that a level changes near a place (see ``Rates``).

        With them, a search is faster than with ``slope``, from which they are taken by default.
        ``branch`` is MEAN, LOS or NLOS.
        """
        away_db, over_db = self.slope(distance_m, height_m, within_m)
        return -away_db, 0.0, -over_db, over_db

    @classmethod
    def mixes(cls) -> bool:
        """Return whether the mean loss is one over links with and without line of sight."""
        return not (cls.p_los is RowPathLoss.p_los and cls.mean_db is RowPathLoss.mean_db)

    @classmethod
    def is_bounded(cls) -> bool:
        """Return whether the class says how fast levels can change."""
        return cls.slope is not RowPathLoss.slope or cls.rates is not RowPathLoss.rates

    @classmethod
    def is_built_in(cls) -> bool:
        """Return whether a scenario names the class by a word, as ``register`` gives one."""
        return ":" not in vars(cls).get("kind", ":")


@rule
def mean_of(p_los: float, los_db: float, nlos_db: float) -> float:
    """Return the mean loss in dB (Al-Hourani et al. 2014)."""
    return p_los * los_db + (1.0 - p_los) * nlos_db


@rule
def free_space_db(distance_m: float, height_m: float, carrier_ghz: float) -> float:
    """Return the loss in free space, 20 log10(4 pi f d / c), in dB (Friis 1946)."""
    per_m = carrier_ghz * (4e9 * math.pi / SPEED_OF_LIGHT_MPS)
    return 20.0 * log10(per_m * slant_range_m(distance_m, height_m))


@register("path_loss", "free_space")
@dataclass(frozen=True)
class FreeSpace(RowPathLoss):
    """Has the loss of free space, with line of sight everywhere (Friis 1946)."""

    def los_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        """Return the loss in free space."""
        return free_space_db(distance_m, height_m, carrier_ghz)

    def rates(self, branch: int, distance_m: float, height_m: float, within_m: float) -> Rates:
        """Return the bounds for the change of a level over 20 log10(d)."""
        return logistic_rates(2.0, 0.0, 1.0, 1.0, distance_m, height_m, within_m)


@register("path_loss", "log_distance")
@dataclass(frozen=True)
class LogDistance(RowPathLoss):
    """Loses 10 ``exponent`` dB each time the distance grows tenfold, whatever the carrier."""

    exponent: Annotated[float, Gt(0), Le(10)]
    """The path-loss exponent: 2 in free space, 3 to 4 in a town."""
    at_1m_db: Annotated[float, Ge(-100), Le(200)]
    """The loss over 1 m, in dB."""

    def los_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        """Return the loss over 1 m, and 10 ``exponent`` dB more a decade."""
        slant_m = slant_range_m(distance_m, height_m)
        return self.at_1m_db + 10.0 * self.exponent * log10(slant_m)

    def rates(self, branch: int, distance_m: float, height_m: float, within_m: float) -> Rates:
        """Return the bounds for the change of a level over 10 ``exponent`` log10(d)."""
        exponent = float(self.exponent)
        return logistic_rates(exponent, 0.0, 1.0, 1.0, distance_m, height_m, within_m)


class Environment(NamedTuple):
    """The parameters of Al-Hourani's model for a kind of town (see ``AlHourani``)."""

    a: float
    b: float
    eta_los_db: float
    eta_nlos_db: float


Town = Literal["suburban", "urban", "dense_urban", "high_rise"]

ENVIRONMENTS: dict[Town, Environment] = {
    "suburban": Environment(4.88, 0.43, 0.1, 21.0),
    "urban": Environment(9.61, 0.16, 1.0, 20.0),
    "dense_urban": Environment(12.08, 0.11, 1.6, 23.0),
    "high_rise": Environment(27.23, 0.08, 2.3, 34.0),
}
"""The parameters of Al-Hourani, Kandeepan and Lardner 2014, at 2 GHz."""


FITTED_GHZ = (1.0, 4.0)
"""The carriers for which these parameters are used without a warning."""


@register("path_loss", "al_hourani")
@dataclass(frozen=True)
class AlHourani(RowPathLoss):
    """Loses free-space loss and an excess that depends on whether the user sees the drone.

    The probability of line of sight depends on the elevation alone (Al-Hourani, Kandeepan and
    Lardner, Optimal LAP altitude for maximum coverage, IEEE Wireless Communications Letters 2014).
    Give an environment, or all of ``a``, ``b``, ``eta_los_db`` and ``eta_nlos_db``.
    """

    environment: Town | None = None
    """The kind of town, which sets the four numbers below."""
    a: Annotated[float, Gt(0), Le(100)] | None = None
    """The first parameter of the probability of line of sight, in degrees."""
    b: Annotated[float, Gt(0), Le(10)] | None = None
    """The second parameter of the probability of line of sight, per degree."""
    eta_los_db: Annotated[float, Ge(0), Le(100)] | None = None
    """The loss beyond that of free space with line of sight, in dB."""
    eta_nlos_db: Annotated[float, Ge(0), Le(100)] | None = None
    """The loss beyond that of free space without line of sight, in dB."""

    def __post_init__(self) -> None:
        """Set the numbers of the environment. Raises ValueError if they are not all known."""
        own = Environment(self.a, self.b, self.eta_los_db, self.eta_nlos_db)  # type: ignore[arg-type]
        if self.environment is None:
            missing = [name for name, value in own._asdict().items() if value is None]
            if missing:
                raise ValueError(f"give an environment, or also {' and '.join(missing)}")
        else:
            if self.environment not in ENVIRONMENTS:
                raise ValueError(
                    f"unknown environment {self.environment!r}; allowed: {', '.join(ENVIRONMENTS)}"
                )
            for name, value in ENVIRONMENTS[self.environment]._asdict().items():
                if getattr(self, name) not in (None, value):
                    raise ValueError(
                        f"{name} is {value:g} in the environment {self.environment!r}, not "
                        f"{getattr(self, name):g}; give the environment or own numbers, not both"
                    )
                object.__setattr__(self, name, value)
        if self.eta_nlos_db < self.eta_los_db:  # type: ignore[operator]
            raise ValueError("eta_nlos_db must not be below eta_los_db: excess loss is a loss")

    def doubts(self, carrier_ghz: float) -> Iterator[str]:
        """Yield whether a kind of town was fitted at a carrier far from this one."""
        low_ghz, high_ghz = FITTED_GHZ
        if self.environment is not None and not low_ghz <= carrier_ghz <= high_ghz:
            yield (
                f"the numbers of {self.environment!r} are for 2 GHz, and carrier_ghz is "
                f"{carrier_ghz:g}: the loss of free space follows the carrier, but eta_los_db: "
                f"{self.eta_los_db:g} and eta_nlos_db: {self.eta_nlos_db:g} do not; give a, b, "
                "eta_los_db and eta_nlos_db for this carrier"
            )

    def los_db(self: Any, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        """Return the loss in free space and ``eta_los_db`` more."""
        return free_space_db(distance_m, height_m, carrier_ghz) + float(self.eta_los_db)

    def nlos_db(self: Any, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        """Return the loss in free space and ``eta_nlos_db`` more."""
        return free_space_db(distance_m, height_m, carrier_ghz) + float(self.eta_nlos_db)

    def p_los(self: Any, elevation: float) -> float:
        """Return 1 / (1 + a exp(-b (elevation - a))), with the elevation in degrees."""
        return 1.0 / (1.0 + float(self.a) * exp(-float(self.b) * (elevation - float(self.a))))

    def rates(self: Any, branch: int, distance_m: float, height_m: float, within_m: float) -> Rates:
        """Return the bounds for the change of a level; on the mean, sight is lost gradually."""
        fall_db = float(self.eta_nlos_db) - float(self.eta_los_db) if branch == MEAN else 0.0
        a, b = float(self.a), float(self.b)
        return logistic_rates(2.0, fall_db, a, b, distance_m, height_m, within_m)
