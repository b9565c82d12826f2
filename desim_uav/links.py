"""The links of each type of drones and of each access point: their bandwidth and their rings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.drone_type import DroneType
from desim_uav.model.radio.link import thresholds_db
from desim_uav.scenario.schema import Scenario


class Links(NamedTuple):
    """The links of a radio: its bandwidth in Hz (a whole number or inf), and its rings.

    ``rings_m`` (levels, groups, classes) has the radii of classes in metres, the widest first: by
    the levels at which its antenna can be, and by the groups of users (see ``World.groups``). If
    links are sought ``in_air``, changes of their classes or levels are not always those of rings.
    ``free``: whether the drones that have it fly freely, at any altitude between the levels.
    """

    radio: Any
    bandwidth_hz: float
    rings_m: NDArray[np.float64]
    in_air: bool
    free: bool = False

    @property
    def uplink_hz(self) -> int | None:
        """The bandwidth in Hz that uploads have for themselves; None: they share the other one.

        They always share one that is unlimited.
        """
        return None if math.isinf(self.bandwidth_hz) else getattr(self.radio, "uplink_hz", None)

    @property
    def both_hz(self) -> float:
        """The bandwidth in Hz of downloads and uploads together, a whole number or inf."""
        return self.bandwidth_hz + (self.uplink_hz or 0)

    @property
    def efficiencies(self) -> tuple[int, ...]:
        """The millionths of a bit/s per Hz of each class, class 0 (none) first."""
        return (0, *self.radio.efficiencies())

    @property
    def reach_m(self) -> float:
        """The radius of the widest class in metres; a micrometre if none holds anywhere."""
        return max(float(self.rings_m.max()), 1e-6)

    @property
    def thresholds_db(self) -> list[float]:
        """The least signal-to-noise ratio of each class from 1 on in dB; none of a disc."""
        return thresholds_db(self.radio.ladder).tolist() if self.radio.graded else []


def links_of(
    scenario: Scenario,
    types: Sequence[DroneType],
    levels_m: tuple[float, ...],
    heights_m: Sequence[float],
) -> tuple[Links, ...]:
    """Return the links of each type of drones, and then those of each access point.

    ``levels_m`` are the altitudes of the drones' levels, and ``heights_m`` the heights of the
    groups of users, in metres.
    """
    by_level = bool(scenario.association.by_level)
    antennas = [
        (own.drones.radio, own.drones.bandwidth_kbps, own.drones.footprint_radius_m, levels_m)
        for own in types
    ]
    points = scenario.access_points
    antennas += [(point.radio, None, 0.0, (point.height_m,)) for point in points]
    free = [own.free for own in types] + [False] * len(points)
    links = []
    for (radio, kbps, disc_m, antennas_m), is_free in zip(antennas, free, strict=True):
        radii_m = [
            [radio.radii_m(antenna_m - user_m, disc_m) for user_m in heights_m]
            for antenna_m in antennas_m
        ]
        changes = len(antennas_m) > 1 or radio.reuse > 0 or by_level or radio.marked
        in_air = bool(radio.graded and changes)
        hz = radio.bandwidth_hz(kbps)
        links.append(Links(radio, hz, np.array(radii_m), in_air, is_free))
    return tuple(links)
