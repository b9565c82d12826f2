"""Lines of sight in cities against a ray caster that knows whole polygons, and over seams.

The ray caster shares no code with the package. It finds where a line crosses the walls of a
polygon, courts included, decides by the even-odd rule which stretches between are inside, and
looks whether they are below the roof; the kernels look at convex pieces.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from desim_uav.city.footprints import convex_pieces
from desim_uav.model.geometry.city import City
from desim_uav.model.radio.buildings import buffers_for, pieces_as_prisms
from desim_uav.model.radio.sight import BLOCKED, state_at
from desim_uav.model.radio.tracks import TrackRow
from desim_uav.rowcode.views import zeros
from tests.city.polygons import random_polygon

pytestmark = pytest.mark.thorough  # the kernel of lines of sight is long to compile

SIZE_M = (400.0, 300.0)
Lines = NDArray[np.float64]
"""Users and drones: (lines, 2, 3)."""


def deepest_m(polygon: Any, roof_m: float, lines: Lines) -> NDArray[np.float64]:
    """The longest stretch of each line inside a building, in metres; below 0: it is over it."""
    starts, stops = lines[:, 0, :2], lines[:, 1, :2]
    rings = [np.array(ring.coords) for ring in (polygon.exterior, *polygon.interiors)]
    walls = np.concatenate([np.stack([ring[:-1], ring[1:]], 1) for ring in rings])
    ways, edges = stops - starts, walls[:, 1] - walls[:, 0]
    turned = ways[:, None, 0] * edges[:, 1] - ways[:, None, 1] * edges[:, 0]
    off = walls[None, :, 0] - starts[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        at = (off[..., 0] * edges[:, 1] - off[..., 1] * edges[:, 0]) / turned
        on = (off[..., 0] * ways[:, None, 1] - off[..., 1] * ways[:, None, 0]) / turned
    hits = np.where((on >= 0.0) & (on <= 1.0) & (at > 0.0) & (at < 1.0), at, 0.0)
    times = np.sort(np.column_stack([np.zeros(len(lines)), hits, np.ones(len(lines))]), axis=1)
    since, until = times[:, :-1], times[:, 1:]
    middle = starts[:, None] + 0.5 * (since + until)[..., None] * ways[:, None]
    inside = np.zeros(since.shape, bool)
    for (x0, y0), (x1, y1) in walls:
        over = (y0 > middle[..., 1]) != (y1 > middle[..., 1])
        if y0 != y1:
            x = x0 + (middle[..., 1] - y0) * (x1 - x0) / (y1 - y0)
            inside ^= over & (middle[..., 0] < x)
    first, last = lines[:, 0, 2][:, None], lines[:, 1, 2][:, None]
    low = np.minimum(first + since * (last - first), first + until * (last - first))
    lengths = (until - since) * np.hypot(*ways.T)[:, None]
    depth = np.minimum(lengths, roof_m - low)
    return np.where(inside, depth, -1.0).max(axis=1)


def random_city(rng: np.random.Generator, most: int) -> tuple[City, list[tuple[Any, float]]]:
    """A city of this package, and its polygons with their roofs."""
    plain, pieces, roofs = [], [], []
    for _ in range(rng.integers(1, most + 1)):
        centre = rng.uniform((20.0, 20.0), np.array(SIZE_M) - 20.0)
        polygon, roof = random_polygon(rng, centre, rng.uniform(5.0, 40.0)), rng.uniform(4.0, 60.0)
        own = convex_pieces(polygon, "random")
        plain.append((polygon, roof))
        pieces += own
        roofs += [roof] * len(own)
    return City(tuple(pieces), np.array(roofs)), plain


def states(city: City, lines: Lines) -> NDArray[np.bool_]:
    """Return for each line whether the kernels find it blocked."""
    buildings = pieces_as_prisms(city.blocking_m, city.roofs_m, SIZE_M)
    buffers = buffers_for(buildings.offsets, 200)
    rows: Any = zeros(TrackRow, 2)
    blocked = np.zeros(len(lines), bool)
    for k, ends in enumerate(lines.tolist()):
        for row, end in zip((rows[0], rows[1]), ends, strict=True):
            row.x_m, row.y_m, row.z_m = end
        blocked[k] = state_at(rows[0], rows[1], 0.0, buildings, buffers) == BLOCKED
    return blocked


def random_lines(rng: np.random.Generator, count: int) -> Lines:
    low = [(0.0, 0.0, 0.0), (0.0, 0.0, 5.0)]
    high = [(*SIZE_M, 10.0), (*SIZE_M, 90.0)]
    return rng.uniform(low, high, (count, 2, 3))


def compare(seed: int, cities: int, count: int) -> tuple[int, int, int]:
    """Compare cities; return the numbers of lines, of blocked ones, and of those in doubt."""
    rng = np.random.default_rng(seed)
    total = shut = doubtful = 0
    for _ in range(cities):
        city, plain = random_city(rng, 25)
        lines = random_lines(rng, count)
        depth = np.max([deepest_m(polygon, roof, lines) for polygon, roof in plain], axis=0)
        sure = np.abs(depth) > 1e-4
        own = states(city, lines)
        assert (own[sure] == (depth > 0.0)[sure]).all(), lines[sure & (own != (depth > 0.0))]
        total += count
        shut += int(own.sum())
        doubtful += int((~sure).sum())
    return total, shut, doubtful


def test_the_ray_caster_agrees_in_random_cities() -> None:
    total, shut, doubtful = compare(7, 40, 200)
    assert 0.2 * total < shut < 0.8 * total
    assert doubtful < 1e-3 * total


@pytest.mark.slow
def test_the_ray_caster_agrees_on_a_hundred_thousand_lines_in_a_thousand_cities() -> None:
    total, shut, doubtful = compare(8, 1000, 100)
    assert total == 100_000
    assert 0.2 * total < shut < 0.8 * total
    assert doubtful < 1e-3 * total


def seam_of(pieces: tuple[Any, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The longest edge that two pieces share."""
    edges = [
        (tuple(one), tuple(other))
        for piece in pieces
        for one, other in zip(piece.tolist(), np.roll(piece, -1, axis=0).tolist(), strict=True)
    ]
    shared = [edge for edge in edges if edge[::-1] in edges]
    one, other = max(shared, key=lambda edge: np.hypot(*np.subtract(*edge)))
    return np.array(one), np.array(other)


def along(one: NDArray[np.float64], other: NDArray[np.float64], height_m: float) -> Lines:
    """A level line over two places and 50 m on, both ways."""
    ahead = (other - one) / np.hypot(*(other - one)) * 50.0
    start, stop = [*(one - ahead), height_m], [*(other + ahead), height_m]
    return np.array([[start, stop], [stop, start]])


def test_no_line_passes_between_two_pieces_of_a_building() -> None:
    rng, seams = np.random.default_rng(2), 0
    for _ in range(200):
        polygon = random_polygon(rng, (200.0, 150.0), 40.0)
        pieces = tuple(convex_pieces(polygon, "one"))
        if len(pieces) < 2:
            continue
        city = City(pieces, np.full(len(pieces), 20.0))
        assert states(city, along(*seam_of(pieces), 10.0)).all()
        assert not states(city, along(*seam_of(pieces), 20.5)).any()
        seams += 1
    assert seams > 50
    upright = [
        np.array([(x, 100.0), (x + 10, 100.0), (x + 10, 120.0), (x, 120.0)]) for x in (90, 100)
    ]
    both = City(tuple(upright), np.array([20.0, 20.0]))
    line = along(np.array([100.0, 100.0]), np.array([100.0, 120.0]), 10.0)
    assert states(both, line).all()
    alone = pieces_as_prisms(both.pieces_m, both.roofs_m, SIZE_M)
    assert len(alone.roofs_m) == 2
    apart = City((upright[0], upright[1] + (1e-3, 0.0)), both.roofs_m)
    assert not states(apart, line + np.array((5e-4, 0.0, 0.0))).any()


def test_a_line_along_a_wall_only_touches_it() -> None:
    """A lower house beside a taller one: above its roof, the line along the party wall is clear."""
    pieces = tuple(
        np.array([(x, 100.0), (x + 10, 100.0), (x + 10, 120.0), (x, 120.0)]) for x in (90, 100)
    )
    city = City(pieces, np.array([10.0, 20.0]))
    one, other = np.array([100.0, 100.0]), np.array([100.0, 120.0])
    assert states(city, along(one, other, 9.0)).all()
    assert not states(city, along(one, other, 15.0)).any()
    wall = along(np.array([90.0, 100.0]), np.array([90.0, 120.0]), 5.0)
    assert not states(city, wall).any()


def test_pieces_reach_over_seams_by_a_micrometre() -> None:
    rng = np.random.default_rng(4)
    for _ in range(50):
        polygon = random_polygon(rng, (200.0, 150.0), 40.0)
        pieces = tuple(convex_pieces(polygon, "one"))
        city = City(pieces, np.full(len(pieces), 20.0))
        for piece, moved in zip(pieces, city.blocking_m, strict=True):
            assert np.hypot(*(moved - piece).T).max() <= 2.1e-6
            assert shapely.Polygon(moved).is_valid
