"""Random polygons, of which some are not convex and some have a court."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely


def random_polygon(rng: np.random.Generator, centre: tuple[float, float], size_m: float) -> Any:
    """Return a star-shaped polygon of 3 to 12 corners, a third of them with a court."""
    while True:
        turns = np.sort(rng.uniform(0.0, 2 * np.pi, rng.integers(3, 13)))
        gaps = np.diff(np.append(turns, turns[0] + 2 * np.pi))
        if gaps.min() > 0.1 and gaps.max() < 3.0:
            break
    far = size_m * rng.uniform(0.45, 1.0, len(turns))
    corners = np.column_stack([np.cos(turns), np.sin(turns)])
    court = [0.4 * far[:, None] * corners + centre] if rng.random() < 1 / 3 else []
    polygon = shapely.Polygon(far[:, None] * corners + centre, court)
    return shapely.set_precision(polygon, 0.001)
