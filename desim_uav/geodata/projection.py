"""Longitudes and latitudes as places on a map, by a projection about one point.

It is the transverse Mercator projection of the ellipsoid WGS 84 with its central meridian through
the point, as a series of the difference of longitudes (Bugayevskiy and Snyder, 1995). Within 10 km
of the point its places are wrong by less than a millimetre, and its distances by 2 parts in 10^6.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

MAJOR_M = 6_378_137.0
"""The semi-major axis of WGS 84."""
ECCENTRICITY_2 = 0.006_694_379_990_14
"""The square of its first eccentricity."""


class Projection(NamedTuple):
    """A projection about a point in degrees, which lies at (``x_m``, ``y_m``) on the map."""

    longitude: float
    latitude: float
    x_m: float = 0.0
    y_m: float = 0.0

    def places_m(self, degrees: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the places (n, 2) on the map of longitudes and latitudes (n, 2)."""
        turn = (degrees[:, 0] - self.longitude + 180.0) % 360.0 - 180.0
        east, north = np.radians(turn), np.radians(degrees[:, 1])
        sin, cos = np.sin(north), np.cos(north)
        across_m = MAJOR_M / np.sqrt(1.0 - ECCENTRICITY_2 * sin**2)
        bulge = ECCENTRICITY_2 / (1.0 - ECCENTRICITY_2) * cos**2
        bend = (cos**2 * (1.0 + bulge) - sin**2) / 6.0
        begin = np.radians(self.latitude)
        middle = 1.0 - ECCENTRICITY_2 * np.sin(0.5 * (begin + north)) ** 2
        along_m = MAJOR_M * (1.0 - ECCENTRICITY_2) / middle**1.5
        x = across_m * cos * east * (1.0 + bend * east**2)
        y = along_m * (north - begin) + 0.5 * across_m * sin * cos * east**2
        return np.column_stack([x + self.x_m, y + self.y_m])
