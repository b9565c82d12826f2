"""Link budgets, and the classes of a link: its efficiency by signal-to-noise ratio."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from desim_uav.errors import did_you_mean
from desim_uav.model.radio.functions import log10

MOST_CLASSES = 64
DECIMALS = 6
"""Efficiencies are whole millionths of a bit/s/Hz."""

LOWEST_SNR_DB, HIGHEST_SNR_DB, MOST_BIT_S_HZ = -50.0, 100.0, 100.0


@dataclass(frozen=True)
class LinkBudget:
    """The budget of a link: the transmitted power, and the bandwidth and noise of the receiver."""

    power_dbm: Annotated[float, Ge(-100), Le(100)]
    """The transmitted power, in dBm."""
    bandwidth_mhz: Annotated[float, Gt(0), Le(100_000)]
    """The bandwidth over which noise is received, in MHz."""
    noise_figure_db: Annotated[float, Ge(0), Le(50)] = 7.0
    """The noise of the receiver beyond thermal noise, in dB."""
    noise_dbm_per_hz: Annotated[float, Ge(-300), Le(0)] = -174.0
    """The density of the thermal noise, in dBm/Hz."""

    @property
    def noise_dbm(self) -> float:
        """The noise in the band, in dBm."""
        density = self.noise_dbm_per_hz + self.noise_figure_db
        return density + 10.0 * log10(self.bandwidth_mhz * 1e6)

    def snr_db(self, loss_db: float) -> float:
        """Return the signal-to-noise ratio after a loss, in dB."""
        return self.power_dbm - loss_db - self.noise_dbm

    def largest_loss_db(self, snr_db: float) -> float:
        """Return the loss in dB after which the signal-to-noise ratio is just ``snr_db``."""
        return self.power_dbm - self.noise_dbm - snr_db


class LinkClass(NamedTuple):
    """A class of a link, which carries ``bit_s_hz`` from the ratio ``snr_db`` on."""

    snr_db: Annotated[float, Ge(LOWEST_SNR_DB), Le(HIGHEST_SNR_DB)]
    """The least signal-to-noise ratio at which the class holds, in dB."""
    bit_s_hz: Annotated[float, Gt(0), Le(MOST_BIT_S_HZ)]
    """What a link of the class carries, in bit/s for each Hz, with at most 6 decimals."""


def _ladder(*steps: tuple[float, float]) -> tuple[LinkClass, ...]:
    return tuple(LinkClass(snr_db, bit_s_hz) for snr_db, bit_s_hz in steps)


LADDERS = {
    "cqi": _ladder(
        *((-6.94, 0.1523), (-5.15, 0.2344), (-3.18, 0.3770), (-1.25, 0.6016), (0.76, 0.8770)),
        *((2.70, 1.1758), (4.69, 1.4766), (6.53, 1.9141), (8.57, 2.4063), (10.37, 2.7305)),
        *((12.29, 3.3223), (14.17, 3.9023), (15.89, 4.5234), (17.81, 5.1152), (19.83, 5.5547)),
    ),
    "mcs": _ladder(
        *((-2.92, 0.4902), (-1.13, 0.7402), (0.65, 1.0273), (2.44, 1.3262), (4.15, 1.4766)),
        *((5.95, 1.9141), (7.78, 2.4063), (8.73, 2.5664), (10.03, 3.0293), (11.57, 3.3223)),
        *((12.24, 3.6094), (13.37, 3.9023), (14.30, 4.2129), (14.94, 4.5234), (16.49, 4.8164)),
        *((17.02, 5.1152), (18.35, 5.3320), (18.97, 5.5547)),
    ),
}
"""``cqi``: the efficiencies of the 4-bit CQI table (3GPP TS 38.214, table 5.2.2.1-2) at the
signal-to-noise ratios at which the Vienna LTE simulators have 10 % block errors in white noise.

``mcs``: entries 3, 5, 7, ..., 19 and 20 to 28 of MCS table 1 (TS 38.214, table 5.1.3.1-1). Each
threshold is where the block error tables of Sionna 2.2 (PDSCH, table 1, code blocks of 2,000 bits)
pass 10 %, interpolated in the logarithm of the error rate, floored at 1e-6. The tables have an
entry each 1.8 dB, so a threshold may be off by about 1 dB. Of 16 (2.5703 bit/s/Hz) and 17 (2.5664),
which are out of order in the standard, only 17 is here."""


def link_classes(
    ladder: str | Sequence[Mapping[str, Any] | LinkClass],
) -> tuple[LinkClass, ...]:
    """Return the classes of a link: a ladder by its name, or one's own ``snr_db`` and ``bit_s_hz``.

    Raises ValueError for an unknown name, for anything but numbers within their bounds, for
    efficiencies of more than 6 decimals, and for classes that do not rise in both.
    """
    if isinstance(ladder, str):
        if ladder not in LADDERS:
            hint = did_you_mean(ladder, LADDERS)
            raise ValueError(f"unknown classes {ladder!r}{hint}; allowed: cqi, mcs, or a list")
        return LADDERS[ladder]
    if not 1 <= len(ladder) <= MOST_CLASSES:
        raise ValueError(f"there must be 1 to {MOST_CLASSES} classes, not {len(ladder)}")
    classes = tuple(_link_class(number, one) for number, one in enumerate(ladder, 1))
    for number, (low, high) in enumerate(pairwise(classes), 2):
        for key in LinkClass._fields:
            below, above = getattr(low, key), getattr(high, key)
            if not above > below:
                raise ValueError(f"class {number}: {key} must rise: {above:g} follows {below:g}")
    return classes


def _link_class(number: int, entry: Mapping[str, Any] | LinkClass) -> LinkClass:
    """Return a class that a user has given. Raises ValueError."""
    entry = entry._asdict() if isinstance(entry, LinkClass) else entry
    if not isinstance(entry, Mapping) or set(entry) != set(LinkClass._fields):
        raise ValueError(f"class {number}: must have snr_db and bit_s_hz, and nothing else")
    for key, low, high in (
        ("snr_db", LOWEST_SNR_DB, HIGHEST_SNR_DB),
        ("bit_s_hz", 0.0, MOST_BIT_S_HZ),
    ):
        value = entry[key]
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not math.isfinite(value)
        ):
            raise ValueError(f"class {number}: {key} must be a number, not {value!r}")
        if not low <= value <= high:
            raise ValueError(f"class {number}: {key} must be from {low:g} to {high:g}, not {value}")
    if entry["bit_s_hz"] == 0:
        raise ValueError(f"class {number}: bit_s_hz must be above 0; no link is class 0")
    if round(entry["bit_s_hz"], DECIMALS) != entry["bit_s_hz"]:
        raise ValueError(
            f"class {number}: bit_s_hz must have at most {DECIMALS} decimals, not "
            f"{entry['bit_s_hz']!r}"
        )
    return LinkClass(float(entry["snr_db"]), float(entry["bit_s_hz"]))


def thresholds_db(classes: Sequence[LinkClass]) -> NDArray[np.float64]:
    """Return the thresholds of classes, which rise (see ``search.class_of``)."""
    return np.array([one.snr_db for one in classes])
