"""The radio of drones: the paper's disc, or classes of links that follow from path loss.

A class of a link says how many bits a hertz carries; class 0 is no link.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Protocol

from annotated_types import Ge, Le, MaxLen, MinLen

from desim_uav.model.radio.fading import Fading, NoFading
from desim_uav.model.radio.link import (
    LADDERS,
    MOST_CLASSES,
    LinkBudget,
    LinkClass,
    link_classes,
)
from desim_uav.model.radio.path_loss import AlHourani, RowPathLoss
from desim_uav.model.radio.rings import rings
from desim_uav.model.sharing import RowSharing
from desim_uav.registry import ComponentField, NameOr, register, resolve

MILLION = 1_000_000
MOST_REUSE = 100


class Radio(Protocol):
    """The radio of a drone, as the scenario's component ``drones.radio``.

    ``sharing`` says how requests for a volume share the bandwidth. Drones of the same index modulo
    ``reuse`` interfere; 0: none do.
    """

    marked: bool
    """Whether the line of sight, or shadowing, of a link changes."""
    sight: str
    """The line of sight of marked links: a kind of ``model.radio.marks``."""
    reuse: int
    sharing: Any
    graded: bool
    """Whether links have classes other than those of the paper's disc."""
    flat: bool
    """Whether the radii of classes are the same at all heights."""

    def bandwidth_hz(self, kbps: float | None) -> float:
        """Return a drone's bandwidth in Hz, a whole number or inf; ``kbps`` is that of a disc."""

    # A radio whose uploads have a band of their own has ``uplink_hz``, its bandwidth in whole Hz.

    def efficiencies(self) -> tuple[int, ...]:
        """Return the millionths of a bit/s that a hertz carries in each class from 1 on."""

    def radii_m(self, height_m: float, disc_m: float) -> tuple[float, ...]:
        """Return the radius of each class in metres, the widest first; -1 if it holds nowhere.

        ``height_m`` is the height of the drone above a user, and ``disc_m`` the radius of a disc.
        """


@register("radio", "disc")
@dataclass(frozen=True)
class Disc:
    """The paper's: a link of 1 bit/s/Hz within ``drones.footprint_radius_m`` at any altitude."""

    graded: ClassVar[bool] = False
    flat: ClassVar[bool] = True
    marked: ClassVar[bool] = False
    sight: ClassVar[str] = "mean"
    reuse: ClassVar[int] = 0

    @property
    def sharing(self) -> RowSharing:
        """How requests for a volume share the bandwidth: they hold a rate."""
        return _held_sharing()

    def bandwidth_hz(self, kbps: float | None) -> float:
        """Return the bandwidth in bit/s, which is that in Hz at 1 bit/s/Hz."""
        return float("inf") if kbps is None else round(kbps * 1000)

    def efficiencies(self) -> tuple[int, ...]:
        """Return 1 bit/s/Hz."""
        return (MILLION,)

    def radii_m(self, height_m: float, disc_m: float) -> tuple[float, ...]:
        """Return the radius of the disc."""
        return (disc_m,)


class Shadowing(NamedTuple):
    """The standard deviations of the shadowing, in dB, with and without line of sight."""

    los_db: Annotated[float, Ge(0), Le(30)]
    """The standard deviation of the loss with line of sight, in dB."""
    nlos_db: Annotated[float, Ge(0), Le(30)]
    """The standard deviation of the loss without line of sight, in dB."""


class Reuse(NamedTuple):
    """Interference among drones of the same index modulo ``reuse``, which share a band."""

    reuse: Annotated[int, Ge(1), Le(MOST_REUSE)]
    """The number of bands: drones of the same index modulo it share one."""


def _held_sharing() -> RowSharing:
    """Return the sharing ``held``."""
    sharing: RowSharing = resolve("sharing", "held")()
    return sharing


@register("radio", "link_classes")
@dataclass(frozen=True)
class LinkClasses:
    """Links whose classes follow from path loss, power, noise and, if so, interference.

    Class k holds where the signal-to-noise ratio is at least that of the k-th of the ``classes``.
    """

    carrier_ghz: Annotated[float, Ge(0.001), Le(1000)] = 2.0
    """The carrier frequency, in GHz."""
    power_dbm: Annotated[float, Ge(-100), Le(100)] = 30.0
    """The transmitted power, in dBm."""
    bandwidth_mhz: Annotated[float, Ge(1e-6), Le(10_000)] = 5.0
    """The bandwidth of a drone, which its users share, in MHz. It is rounded to whole Hz."""
    noise_figure_db: Annotated[float, Ge(0), Le(50)] = 7.0
    """The noise of the receiver beyond thermal noise, in dB."""
    noise_dbm_per_hz: Annotated[float, Ge(-300), Le(0)] = -174.0
    """The density of the thermal noise, in dBm/Hz."""
    path_loss: Annotated[RowPathLoss, ComponentField("path_loss", "al_hourani", RowPathLoss)] = (
        field(default_factory=lambda: AlHourani("urban"))
    )
    """The loss of power between drone and user."""
    line_of_sight: Literal["mean", "drawn", "buildings"] = "mean"
    """`mean`: the mean loss over links with and without line of sight. `drawn`: a draw for each
    user, drone and cell of the drone says which it is. `buildings`: the buildings of the map do.
    """
    shadowing: Annotated[Shadowing, NameOr((), Shadowing, "{los_db, nlos_db}")] | None = None
    """The random loss of each user, drone and cell of the drone; null means none."""
    classes: Annotated[
        str | tuple[LinkClass, ...],
        NameOr(
            tuple(LADDERS),
            Annotated[tuple[LinkClass, ...], MinLen(1), MaxLen(MOST_CLASSES)],
            "a list of {snr_db, bit_s_hz}",
            link_classes,
        ),
    ] = "cqi"
    """The least signal-to-noise ratio of each class, in dB, and what it carries, in bit/s/Hz:
    those of 3GPP's CQI or MCS table, or one's own, rising.
    """
    fading: Annotated[Fading, ComponentField("fading", "none", Fading, by_name=True)] = field(
        default_factory=NoFading
    )
    """Small-scale fading, which raises the thresholds of all classes. It needs
    `interference: none`.
    """
    interference: Annotated[str | Reuse, NameOr(("none", "co_channel"), Reuse, "{reuse: n}")] = (
        "none"
    )
    """`co_channel`: all drones share a band. `{reuse: n}`: those of the same index modulo n do."""
    sharing: Annotated[RowSharing, ComponentField("sharing", "held", RowSharing, by_name=True)] = (
        field(default_factory=_held_sharing)
    )
    """How transfers share the bandwidth that other requests leave."""
    uplink_mhz: Annotated[float, Ge(1e-6), Le(10_000)] | None = None
    """The bandwidth that uploads have for themselves, beside the other one, in MHz; null means that
    they share it with all else. Uploads are inputs of tasks, and updates of sensors.
    """

    later: ClassVar = ("uplink_mhz", "fading")
    graded: ClassVar[bool] = True
    flat: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Check classes and interference, which may be plain data. Raises ValueError."""
        ladder = link_classes(self.classes)
        if not isinstance(self.classes, str):
            object.__setattr__(self, "classes", ladder)
        if isinstance(self.interference, Mapping):
            object.__setattr__(self, "interference", Reuse(**self.interference))
        if self.interference not in ("none", "co_channel") and not isinstance(
            self.interference, Reuse
        ):
            raise ValueError(
                f"interference must be none, co_channel or {{reuse: n}}, not {self.interference!r}"
            )
        if self.interference != "none" and self.fading.margin_db() != 0.0:
            raise ValueError(
                "fading needs interference: none, because the outage that it states is that of the "
                "SNR; interferers fade too, which changes that of the SINR"
            )

    @cached_property
    def ladder(self) -> tuple[LinkClass, ...]:
        """The classes of a link, which rise, with the mean ratios at which they hold."""
        margin_db = self.fading.margin_db()
        classes = link_classes(self.classes)
        if margin_db == 0.0:
            return classes
        return tuple(LinkClass(one.snr_db + margin_db, one.bit_s_hz) for one in classes)

    @property
    def reuse(self) -> int:
        """Drones of the same index modulo this number interfere; 0: none do."""
        if isinstance(self.interference, Reuse):
            return self.interference.reuse
        return int(self.interference == "co_channel")

    @property
    def marked(self) -> bool:
        """Whether the line of sight, or shadowing, of a link changes."""
        return self.line_of_sight != "mean" or self.shadowing is not None

    @property
    def sight(self) -> str:
        """The line of sight of marked links.

        With ``mean``, shadowing is for a path loss with which users always see drones.
        """
        return "drawn" if self.marked and self.line_of_sight == "mean" else self.line_of_sight

    @property
    def budget(self) -> LinkBudget:
        """The link budget."""
        return LinkBudget(
            self.power_dbm, self.bandwidth_mhz, self.noise_figure_db, self.noise_dbm_per_hz
        )

    def bandwidth_hz(self, kbps: float | None) -> float:
        """Return the bandwidth of a drone in whole Hz."""
        return round(self.bandwidth_mhz * MILLION)

    @property
    def uplink_hz(self) -> int | None:
        """The bandwidth of uploads in whole Hz, or None."""
        return None if self.uplink_mhz is None else round(self.uplink_mhz * MILLION)

    def efficiencies(self) -> tuple[int, ...]:
        """Return the efficiencies of the classes."""
        return tuple(round(one.bit_s_hz * MILLION) for one in self.ladder)

    def radii_m(self, height_m: float, disc_m: float) -> tuple[float, ...]:
        """Return the radii within which the mean level reaches the thresholds of the classes."""
        means_m = rings(self.path_loss, self.carrier_ghz, height_m, self.budget, self.ladder).mean_m
        return tuple(radius_m if radius_m > 0.0 else -1.0 for radius_m in means_m)
