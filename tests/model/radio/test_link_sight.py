"""Sight lines against buildings: worked by hand, and a ray caster that shares no code."""

import numpy as np
import pytest

from desim_uav.model.motion.motion import BangCoastBang
from desim_uav.model.radio.buildings import (
    Buildings,
    Corner,
    bucketed,
    buffers_for,
    cells_as_prisms,
)
from desim_uav.model.radio.sight import BLOCKED, CLEAR, sight_changes
from desim_uav.model.radio.tracks import Turn
from desim_uav.rowcode.views import records, zeros
from tests.model.radio.looking import Seen, claimed, finer, grid, moving
from tests.model.radio.making import START_US, Leg, absolute, flying, hovering, rows_of
from tests.model.sampler import Walk

pytestmark = pytest.mark.thorough  # it is long to compile; test_marks.py runs it too

# ---- the ray caster


def prisms(footprints_m, roofs_m, shape, side_m):
    """Buildings with these footprints, convex and counterclockwise, on a map of buckets."""
    return Buildings(
        records(Corner, np.concatenate([np.zeros((0, 2)), *footprints_m])),
        np.cumsum([0, *map(len, footprints_m)]),
        np.array(roofs_m, float),
        shape,
        side_m,
        *bucketed(footprints_m, shape, side_m),
        max(roofs_m, default=0.0),
    )


def overlap(user, drone, footprint, roof):
    """The share of each line that a prism contains; negative by how much it misses it."""
    following = np.roll(footprint, -1, axis=0)
    into = np.column_stack([footprint[:, 1] - following[:, 1], following[:, 0] - footprint[:, 0]])
    near = (user[:, None, :2] - footprint) * into
    far = (drone[:, None, :2] - footprint) * into
    near = np.column_stack([near.sum(axis=2), roof - user[:, 2]])
    far = np.column_stack([far.sum(axis=2), roof - drone[:, 2]])
    with np.errstate(divide="ignore", invalid="ignore"):
        at = near / (near - far)
    enters = np.where(far > near, at, -np.inf).max(axis=1).clip(0.0)
    leaves = np.where(far < near, at, np.inf).min(axis=1).clip(max=1.0)
    never = ((far == near) & (near <= 0.0)).any(axis=1)
    return np.where(never, -np.inf, leaves - enters)


class Caster:
    def __init__(self, walk, height_m, trip, buildings):
        self.walk, self.height_m, self.trip, self.buildings = walk, height_m, trip, buildings

    def __call__(self, t):
        """The share of the line within the building that contains most of it, at times ``t``."""
        user = np.column_stack([self.walk.at(t), np.full(len(t), self.height_m)])
        drone = self.trip.at(t)
        shares = [overlap(user, drone, *one) for one in self.buildings]
        return np.max([np.full(len(t), -1.0), *shares], axis=0)


def hold_states(share, rows, span_us):
    """(times at which claimed states are wrong, rows in doubt)."""
    start_us, span_s = span_us[0], (span_us[1] - span_us[0]) * 1e-6
    t = grid(span_s)
    for _ in range(2):
        t = np.unique(np.concatenate([t, finer(t, np.abs(share(t)))]))
    times = np.array([(t_us - start_us) * 1e-6 for t_us, _ in rows])
    t = t[np.abs(t[:, None] - times).min(axis=1) > 1.1e-6]
    true = share(t)
    own = claimed(rows, start_us, t) == BLOCKED
    wrong, unclear = list(t[(own != (true > 0.0)) & (np.abs(true) > 1e-12)]), 0
    for k, at in enumerate(times[1:], 1):
        alone = at - times[k - 1] > 2.5e-6 and (k + 1 == len(times) or times[k + 1] - at > 2.5e-6)
        before, after = share(np.array([at - 1e-6, at + 1e-6]))
        if not alone or at > span_s - 1e-6 or at < 1e-6 or min(abs(before), abs(after)) < 1e-13:
            unclear += 1
        elif ((before > 0.0), (after > 0.0)) != (rows[k][1] == CLEAR, rows[k][1] == BLOCKED):
            wrong.append(at)
    return wrong, unclear


# ---- maps at random


def random_cells(rng):
    """(buildings of the package, [(footprint, roof)])."""
    nx, ny = rng.integers(3, 11, 2)
    dx, dy = rng.uniform(10.0, 60.0, 2)
    heights = rng.uniform(3.0, 60.0, (nx, ny)) * (rng.random((nx, ny)) < rng.uniform(0.1, 0.5))
    corner = np.array([(0.0, 0.0), (dx, 0.0), (dx, dy), (0.0, dy)])
    plain = [
        (corner + np.array((ix * dx, iy * dy)), heights[ix, iy])
        for ix in range(nx)
        for iy in range(ny)
        if heights[ix, iy] > 0.0
    ]
    return cells_as_prisms(heights, (dx, dy)), plain, (nx * dx, ny * dy)


def random_polygons(rng):
    """The same with convex polygons, which may overlap, at random places."""
    nx, ny = rng.integers(1, 9, 2)
    dx, dy = rng.uniform(20.0, 60.0, 2)
    plain = []
    for _ in range(rng.integers(1, 31)):
        sizes = rng.uniform(0.03, 0.15, 2) * (nx * dx, ny * dy)
        turns = np.sort(rng.uniform(0.0, 2 * np.pi, rng.integers(3, 9)))
        centre = rng.uniform(sizes, np.array([nx * dx, ny * dy]) - sizes)
        corners = centre + np.column_stack([np.cos(turns), np.sin(turns)]) * sizes
        if np.diff(turns).min() > 0.05:
            plain.append((corners, rng.uniform(3.0, 60.0)))
    found = prisms([one for one, _ in plain], [roof for _, roof in plain], (nx, ny), (dx, dy))
    return found, plain, (nx * dx, ny * dy)


def sight_of(leg, walk, height_m, buildings, span, held=-1, stretches=500):
    tracks, (drone,), user = absolute([leg], walk, height_m, span)
    out = zeros(Turn, 200)
    buffers = buffers_for(buildings.offsets, stretches)
    count = sight_changes(tracks, user, drone, buildings, buffers, span, held, out)
    return rows_of(out, count) if count >= 0 else count


def survey(maps, seed, oblique=False):
    rng, seen = np.random.default_rng(seed), Seen()
    for number in range(maps):
        make = random_cells if number % 2 else random_polygons
        buildings, plain, size = make(rng)
        span_s = round(rng.uniform(5.0, 60.0), 6)
        span = (START_US, START_US + round(span_s * 1e6))
        top = max([roof for _, roof in plain], default=10.0)
        start, stop = rng.uniform(-0.5, 1.5, (2, 3)) * (*size, 0.0)
        start[2], stop[2] = rng.uniform(0.2 * top, 1.2 * top, 2)
        if rng.random() < 0.5:
            stop[2] = start[2] = top * rng.uniform(1.0, 1.3)
        rests = rng.random() < 0.25 and not oblique
        leg = hovering(start) if rests else flying(rng, start, stop, span_s)
        walk = moving(rng, span_s, 5, speed=20.0)
        scale, middle = np.array(size) / 750.0, np.array(size) / 2.0
        walk = Walk(walk.times, walk.points * scale + middle, walk.velocities * scale)
        height = rng.choice([0.0, 1.5, 1.5, 20.0])
        rows = sight_of(leg, walk, height, buildings, span)
        share = Caster(walk, height, leg.trip, plain)
        seen.add(rows[1:], *hold_states(share, rows, span), (number, plain))
    return seen


def check(seen):
    assert seen.wrong == []
    assert seen.rows > 0.8 * seen.legs and seen.unclear <= 0.01 * seen.rows


def test_a_ray_caster_sees_the_same():
    check(survey(60, 1))


@pytest.mark.slow
def test_a_ray_caster_sees_the_same_on_two_thousand_maps():
    check(survey(2000, 2))


# ---- by hand

HOUSE = cells_as_prisms(20.0 * np.eye(9)[4].reshape(3, 3), (10.0, 10.0))
"""A house of 10 m by 10 m, 20 m high, from (10, 10) to (20, 20)."""


def stroll(x, y, vx, vy):
    return Walk(np.zeros(1), np.array([(x, y)], float), np.array([(vx, vy)], float))


def times_of(leg, walk, span_s, buildings=HOUSE, height_m=0.0, **options):
    span = (START_US, START_US + round(span_s * 1e6))
    rows = sight_of(leg, walk, height_m, buildings, span, **options)
    return [((t - START_US) * 1e-6, state) for t, state in rows]


class TestByHand:
    def test_a_user_walks_behind_a_house(self):
        # The drone is at (15, 40), the user at y = 0: the corners (10, 20) and (20, 20) cast
        # shadows to x = 15 - 5 * 40 / 20 and x = 15 + 5 * 40 / 20. The roof is high enough.
        rows = times_of(hovering((15, 40, 10)), stroll(0, 0, 1, 0), 30.0)
        assert rows == [(0.0, CLEAR), (5.0, BLOCKED), (25.0, CLEAR)]

    def test_a_user_walks_out_of_the_shadow_of_a_roof(self):
        # From (15, 40, 40) over the edge at y = 10, 20 m: the ground is reached at y = -20.
        rows = times_of(hovering((15, 40, 40)), stroll(15, 5, 0, -1), 60.0)
        assert rows == [(0.0, BLOCKED), (25.0, CLEAR)]

    def test_a_user_walks_through_a_house(self):
        rows = times_of(hovering((15, 0, 30)), stroll(15, 5, 0, 1), 25.0)
        # Behind the house, the line is below the roof's edge at y = 20 until y = 60.
        assert rows == [(0.0, CLEAR), (5.0, BLOCKED)]
        rows = times_of(hovering((15, 15, 30)), stroll(15, 5, 0, 1), 26.0)
        # The drone is 10 m above the roof: it is seen from 10 m behind the wall on.
        assert [state for _, state in rows] == [BLOCKED, CLEAR]
        assert rows[1][0] == pytest.approx(25.0, abs=1e-6)

    def test_a_drone_climbs_until_it_is_seen(self):
        # A user 10 m before the wall sees above it at twice the height, 10 m behind the wall. Of
        # 40 m the drone then has flown 20: it takes half the time.
        transit = BangCoastBang().fastest_transit(40.0)
        for start, stop, state in ((20, 60, CLEAR), (60, 20, BLOCKED)):
            leg = Leg((15, 20, start), (15, 20, stop), transit, None)
            (_, first), (t, last) = times_of(leg, stroll(15, 0, 0, 0), 60.0)
            assert (first, last) == (1 - state, state)
            assert t == pytest.approx((40.0 / 8.3 + 8.3 / 4.0) / 2.0, abs=1e-6)

    def test_houses_side_by_side_are_one(self):
        row = np.zeros((3, 3))
        row[:, 1] = 20.0
        rows = times_of(
            hovering((15, 40, 10)), stroll(-40, 0, 1, 0), 110.0, cells_as_prisms(row, (10.0, 10.0))
        )
        assert rows == [(0.0, CLEAR), (25.0, BLOCKED), (85.0, CLEAR)]

    def test_a_line_along_a_wall_is_clear(self):
        assert times_of(hovering((10, 40, 10)), stroll(10, 0, 0, 0), 9.0) == [(0.0, CLEAR)]
        assert times_of(hovering((10, 40, 10)), stroll(10, 0, 0, 1), 9.0) == [(0.0, CLEAR)]
        assert times_of(hovering((10.001, 40, 10)), stroll(10.001, 0, 0, 1), 9.0) == [
            (0.0, BLOCKED)
        ]

    def test_a_line_over_the_roof_is_clear(self):
        rows = times_of(hovering((15, 40, 20)), stroll(0, 0, 1, 0), 30.0, height_m=20.0)
        assert rows == [(0.0, CLEAR)]

    def test_the_state_before_is_no_row(self):
        leg, walk = hovering((15, 40, 40)), stroll(15, 5, 0, -1)
        assert times_of(leg, walk, 10.0, held=BLOCKED) == []
        assert times_of(leg, walk, 10.0, held=CLEAR) == [(0.0, BLOCKED)]
        assert times_of(leg, walk, 60.0, held=BLOCKED) == [(25.0, CLEAR)]

    def test_without_buildings_all_is_clear(self):
        flat = cells_as_prisms(np.zeros((2, 2)), (10.0, 10.0))
        assert times_of(hovering((15, 40, 10)), stroll(0, 0, 1, 0), 9.0, flat) == [(0.0, CLEAR)]

    def test_room_that_is_too_short_is_said(self):
        span = (START_US, START_US + 30_000_000)
        leg, walk = hovering((15, 40, 10)), stroll(0, 0, 1, 0)
        assert sight_of(leg, walk, 0.0, HOUSE, span, stretches=0) == -1
        assert len(sight_of(leg, walk, 0.0, HOUSE, span, stretches=1)) == 3


class TestPrisms:
    SQUARE = np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)])

    def test_cells_are_polygons(self):
        heights = np.random.default_rng(1).uniform(-5.0, 5.0, (6, 4)).clip(0.0)
        cells = cells_as_prisms(heights, (10.0, 20.0))
        built = np.argwhere(heights > 0.0)
        shapes = [(self.SQUARE + np.array((10 * x, 10 * y))) * (1, 2) for x, y in built]
        same = prisms(shapes, heights[heights > 0.0], (6, 4), (10.0, 20.0))
        for one, other in zip(cells, same, strict=True):
            assert np.array_equal(one, other)
