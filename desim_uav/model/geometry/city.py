"""The buildings of a city as convex prisms on the ground, which need not fit the cells of a map."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from desim_uav.copies import Unchanging
from desim_uav.model.geometry.polygons import Polygon

SEAM_M = 1e-6
"""How far a piece of a building reaches over an edge that it shares with one at least as tall."""


@dataclass(frozen=True, eq=False)
class City(Unchanging):
    """Convex pieces of buildings, each with the height of its flat roof.

    ``pieces_m`` are the footprints, counterclockwise (corners, 2); those of one building share no
    area. ``roofs_m`` (pieces,) are their heights. ``attribution`` says whose data they are.
    """

    pieces_m: tuple[Polygon, ...]
    roofs_m: NDArray[np.float64]
    attribution: str = ""
    notices: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Return the number of pieces."""
        return len(self.pieces_m)

    @property
    def tallest_m(self) -> float:
        """The height of the tallest building in metres; 0 without any."""
        return float(self.roofs_m.max(initial=0.0))

    @cached_property
    def boxes_m(self) -> NDArray[np.float64]:
        """The least x and y and the largest x and y of each piece: (pieces, 4)."""
        boxes = [np.concatenate([one.min(axis=0), one.max(axis=0)]) for one in self.pieces_m]
        return np.array(boxes, np.float64).reshape(-1, 4)

    def roof_at(self, x_m: float, y_m: float) -> float:
        """Return the height of the tallest building over a place, walls included; 0 without any."""
        west, south, east, north = self.boxes_m.T
        near = (west <= x_m) & (x_m <= east) & (south <= y_m) & (y_m <= north)
        inside = [k for k in np.flatnonzero(near) if _contains(self.pieces_m[k], x_m, y_m)]
        return float(self.roofs_m[inside].max(initial=0.0))

    @cached_property
    def inner(self) -> tuple[NDArray[np.bool_], ...]:
        """For each edge of each piece, whether a piece at least as tall is on its other side."""
        tallest: dict[tuple[tuple[float, ...], ...], float] = {}
        edges = [_edges(corners) for corners in self.pieces_m]
        for own, roof_m in zip(edges, self.roofs_m.tolist(), strict=True):
            for edge in own:
                tallest[edge] = max(roof_m, tallest.get(edge, 0.0))
        return tuple(
            np.array([tallest.get((stop, start), 0.0) >= roof_m for start, stop in own], np.bool_)
            for own, roof_m in zip(edges, self.roofs_m.tolist(), strict=True)
        )

    @cached_property
    def blocking_m(self) -> tuple[Polygon, ...]:
        """The pieces as lines of sight meet them: no line passes between two that share an edge.

        They reach ``SEAM_M`` over their ``inner`` edges.
        """
        return tuple(map(_over_seams, self.pieces_m, self.inner))


NO_CITY = City((), np.zeros(0))
"""The city of a map whose buildings are cells, or that has none."""


def _contains(corners: Polygon, x_m: float, y_m: float) -> bool:
    ahead = np.roll(corners, -1, axis=0) - corners
    turned = ahead[:, 0] * (y_m - corners[:, 1]) - ahead[:, 1] * (x_m - corners[:, 0])
    return bool((turned >= 0.0).all())


def _edges(corners: Polygon) -> list[tuple[tuple[float, ...], ...]]:
    places = [tuple(place) for place in corners.tolist()]
    return list(zip(places, [*places[1:], places[0]], strict=True))


def _over_seams(corners: Polygon, inner: NDArray[np.bool_]) -> Polygon:
    """Return a piece whose inner edges are moved outwards by ``SEAM_M``."""
    if not inner.any():
        return corners
    ahead = np.roll(corners, -1, axis=0) - corners
    outwards = np.column_stack([ahead[:, 1], -ahead[:, 0]]) / np.hypot(*ahead.T)[:, None]
    outwards *= SEAM_M * inner[:, None]
    moved: Polygon = corners + outwards + np.roll(outwards, 1, axis=0)
    return moved
