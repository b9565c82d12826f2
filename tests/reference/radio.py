"""Radio links of the fixed-step simulator: levels, ratios, and classes of a link at a place.

Losses: Friis 1946 in free space, and Al-Hourani, Kandeepan and Lardner 2014 for the mean over links
with and without line of sight. Efficiencies: 3GPP TS 38.214, table 5.2.2.1-2 (``CQI``) and entries
3, 5, 7, …, 19 and 20 to 28 of table 5.1.3.1-1 (``MCS``). Their thresholds are those of the Vienna
LTE simulators, and those of the block error tables of Sionna 2.2.

A class is looked up from the ratio where the user is; nothing here knows that it holds in a disc.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

Loss = Callable[[np.ndarray, np.ndarray, float], np.ndarray]
"""The loss in dB over a horizontal distance in m and a height difference in m, at a carrier in
GHz."""

MICRO = 1_000_000
"""Efficiencies are whole millionths of a bit/s/Hz."""


@dataclass(frozen=True)
class Disc:
    """A transmitter that covers a disc on the ground, with 1 bit/s/Hz in it."""

    radius_m: float
    bandwidth_hz: float
    sharing: str = "held"
    backhaul_bps: float = math.inf
    uplink_hz: int | None = None

    @property
    def efficiencies(self) -> tuple[int, ...]:
        """Return the efficiencies of classes 0 and 1."""
        return 0, MICRO


@dataclass(frozen=True)
class Radio:
    """A transmitter whose links have classes.

    ``ladder``: (ratio in dB, millionths of a bit/s/Hz) of each class, rising. ``reuse``: 0 without
    interference, else the number of bands, of which a transmitter has that of its index modulo it.
    """

    power_dbm: float
    bandwidth_hz: int
    noise_figure_db: float
    noise_dbm_per_hz: float
    carrier_ghz: float
    loss_db: Loss
    ladder: tuple[tuple[float, int], ...]
    sharing: str = "held"
    reuse: int = 0
    backhaul_bps: float = math.inf
    uplink_hz: int | None = None

    @property
    def efficiencies(self) -> tuple[int, ...]:
        """Return the efficiencies of classes 0, 1, …"""
        return 0, *(efficiency for _, efficiency in self.ladder)

    @property
    def noise_dbm(self) -> float:
        """Return the noise in the band."""
        return self.noise_dbm_per_hz + self.noise_figure_db + 10 * np.log10(self.bandwidth_hz)


@dataclass(frozen=True)
class AccessPoint:
    """A transmitter at a place on the map, which always serves."""

    position_m: tuple[float, float, float]
    link: Radio


def free_space(distance_m: np.ndarray, height_m: np.ndarray, carrier_ghz: float) -> np.ndarray:
    """Return 20 log10(4 pi f d / c)."""
    wavelength_m = 299_792_458.0 / (carrier_ghz * 1e9)
    return 20 * np.log10(4 * np.pi * np.hypot(distance_m, height_m) / wavelength_m)


def log_distance(exponent: float, at_1m_db: float) -> Loss:
    """Return the loss ``at_1m_db`` + 10 ``exponent`` log10(d / 1 m)."""

    def loss_db(distance_m: np.ndarray, height_m: np.ndarray, carrier_ghz: float) -> np.ndarray:
        return at_1m_db + 5 * exponent * np.log10(distance_m**2 + height_m**2)

    return loss_db


TOWNS = {
    "suburban": (4.88, 0.43, 0.1, 21.0),
    "urban": (9.61, 0.16, 1.0, 20.0),
    "dense_urban": (12.08, 0.11, 1.6, 23.0),
    "high_rise": (27.23, 0.08, 2.3, 34.0),
}
"""a, b, and the excess losses with and without line of sight in dB."""


def al_hourani(a: float, b: float, eta_los_db: float, eta_nlos_db: float) -> Loss:
    """Return the loss in free space plus the mean of both excess losses."""

    def loss_db(distance_m: np.ndarray, height_m: np.ndarray, carrier_ghz: float) -> np.ndarray:
        elevation = np.degrees(np.arctan2(height_m, distance_m))
        p_los = 1 / (1 + a * np.exp(-b * (elevation - a)))
        excess_db = eta_nlos_db + (eta_los_db - eta_nlos_db) * p_los
        return free_space(distance_m, height_m, carrier_ghz) + excess_db

    return loss_db


def ladder(thresholds_db: str, bit_s_hz: str) -> tuple[tuple[float, int], ...]:
    """Return a ladder from two columns of a table."""
    steps = zip(thresholds_db.split(), bit_s_hz.split(), strict=True)
    return tuple((float(snr_db), round(float(value) * MICRO)) for snr_db, value in steps)


CQI = ladder(
    "-6.94 -5.15 -3.18 -1.25 .76 2.70 4.69 6.53 8.57 10.37 12.29 14.17 15.89 17.81 19.83",
    ".1523 .2344 .3770 .6016 .8770 1.1758 1.4766 1.9141 2.4063 2.7305 3.3223 3.9023 4.5234 5.1152"
    " 5.5547",
)
MCS = ladder(
    "-2.92 -1.13 .65 2.44 4.15 5.95 7.78 8.73 10.03 11.57 12.24 13.37 14.30 14.94 16.49 17.02"
    " 18.35 18.97",
    ".4902 .7402 1.0273 1.3262 1.4766 1.9141 2.4063 2.5664 3.0293 3.3223 3.6094 3.9023 4.2129"
    " 4.5234 4.8164 5.1152 5.3320 5.5547",
)


def look(
    links: Sequence[Disc | Radio],
    position_m: np.ndarray,
    serving: np.ndarray,
    user_xy: np.ndarray,
    user_height_m: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return classes and levels in dBm of all links, each (transmitters, users).

    ``position_m`` is (transmitters, 3), ``user_xy`` (2, users). A transmitter that does not serve
    has class 0 and level -inf everywhere; so has the level of a disc.
    """
    shape = (len(links), user_xy.shape[1])
    classes, level_dbm = np.zeros(shape, int), np.full(shape, -np.inf)
    radios = []
    for d in np.flatnonzero(serving).tolist():
        link, (x, y, z) = links[d], position_m[d].tolist()
        squared_m2 = (user_xy[0] - x) ** 2 + (user_xy[1] - y) ** 2
        if isinstance(link, Disc):
            classes[d] = squared_m2 <= link.radius_m**2
        else:
            loss_db = link.loss_db(np.sqrt(squared_m2), z - user_height_m, link.carrier_ghz)
            level_dbm[d] = link.power_dbm - loss_db
            radios.append(d)
    for d in radios:
        ratio_db = level_dbm[d] - noise_and_interference_dbm(links, level_dbm, d)
        thresholds_db = [snr_db for snr_db, _ in links[d].ladder]
        classes[d] = np.searchsorted(thresholds_db, ratio_db, side="right")
    return classes, level_dbm


def noise_and_interference_dbm(
    links: Sequence[Disc | Radio], level_dbm: np.ndarray, d: int
) -> np.ndarray:
    """Return what disturbs the links of a transmitter, in dBm, for each user."""
    link = links[d]
    disturbing_mw = np.full(level_dbm.shape[1], 10 ** (link.noise_dbm / 10))
    if link.reuse > 0:
        for other in range(d % link.reuse, len(links), link.reuse):
            if other != d:
                disturbing_mw += 10 ** (level_dbm[other] / 10)
    return 10 * np.log10(disturbing_mw)
