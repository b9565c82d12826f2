"""The extent of places, and tests of whether they are in degrees instead of metres."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.mobility.walks import Area

DEGREES_MAP_M = 100.0
"""On a map with a side shorter than this, in metres, an extent of a metre may be intended."""


class Extent(NamedTuple):
    """The least and the largest x and y of places, in metres."""

    least_x_m: float
    most_x_m: float
    least_y_m: float
    most_y_m: float

    def __str__(self) -> str:
        """Return the extent in words."""
        return (
            f"x {self.least_x_m:g} to {self.most_x_m:g} m, y {self.least_y_m:g} to "
            f"{self.most_y_m:g} m"
        )


def extent_of(places: NDArray[np.float64]) -> Extent:
    """Return the extent of places (places, 2), in metres."""
    (least_x, least_y), (most_x, most_y) = places.min(axis=0), places.max(axis=0)
    return Extent(float(least_x), float(most_x), float(least_y), float(most_y))


def like_degrees(extent: Extent, area: Area) -> bool:
    """Return whether places are probably longitudes and latitudes in degrees.

    They are if they differ, but all lie within a metre, on a map of ``DEGREES_MAP_M`` or more.
    """
    x_m, y_m = extent.most_x_m - extent.least_x_m, extent.most_y_m - extent.least_y_m
    return 0.0 < max(x_m, y_m) < 1.0 and are_angles(extent, area)


def are_angles(extent: Extent, area: Area) -> bool:
    """Return whether places may be longitudes and latitudes: -180 to 180 and -90 to 90."""
    x_m, y_m = extent[:2], extent[2:]
    angles = max(map(abs, x_m)) <= 180.0 and max(map(abs, y_m)) <= 90.0
    return angles and min(area) >= DEGREES_MAP_M
