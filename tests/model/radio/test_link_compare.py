"""Which of two drones is nearer by a factor: circles of Apollonius, and a sampler."""

import numpy as np
import pytest

from desim_uav.model.radio.compare import distance_ratio, nearer_changes
from tests.model.radio.looking import Loss, Scene, Seen, hold_classes, moving
from tests.model.radio.making import (
    START_US,
    flying,
    hovering,
    links_of,
    rows_of,
    sinr_changes,
)
from tests.model.sampler import Walk

pytestmark = pytest.mark.thorough  # it is long to compile, and no engine uses it yet

OUT = np.zeros((60, 2), np.int64)


def losses(exponent, gain_db=0.0):
    return [Loss(power, 30.0, exponent, 0.0, 1.0, 1.0) for power in (20.0 + gain_db, 20.0)]


def nearer(links, ratio, span, held=-1, out=OUT):
    one, other = (0, links.offsets[1]), (links.offsets[1], links.offsets[2])
    return nearer_changes(links.tracks, one, other, ratio, span, held, out)


def stroll(x, y, vx, vy):
    return Walk(np.zeros(1), np.array([(x, y)], float), np.array([(vx, vy)], float))


def times_of(drones, ratio, walk, span_s, **options):
    span = (START_US, START_US + round(span_s * 1e6))
    links = links_of(drones, walk, 0.0, losses(2.0), -np.inf, span)
    rows = rows_of(OUT, nearer(links, ratio, span, **options))
    return [((t - START_US) * 1e-6, state) for t, state in rows]


@pytest.mark.parametrize(
    ("gain_db", "exponent", "metres"),
    [(3.0, 3.76, 272.9002), (3.0, 2.0, 292.7493), (2.0, 2.0, 278.6558)],
)
def test_circles_of_apollonius(gain_db, exponent, metres):
    drones = [hovering((500, 0, 0)), hovering((0, 0, 0))]
    rows = times_of(drones, 1.0 / distance_ratio(gain_db, exponent), stroll(0, 0, 1, 0), 500.0)
    # The circle around the drone at 500 m is left again only behind it.
    assert [state for _, state in rows] == [0, 1]
    assert rows[1][0] == pytest.approx(metres, abs=5e-5)
    radius = 500.0 * (own := 1 / distance_ratio(gain_db, exponent)) / (1 - own**2)
    rows = times_of(drones, own, stroll(0, 0, 1, 0), 5000.0)
    assert rows[2][0] - rows[1][0] == pytest.approx(2 * radius, abs=2e-6)


class TestEqualDistances:
    PAIR = (hovering((500, 0, 100)), hovering((-500, 0, 100)))

    def test_the_bisector(self):
        assert times_of(self.PAIR, 1.0, stroll(-50, 30, 2, 1), 60.0) == [(0.0, 0), (25.0, 1)]

    def test_on_the_bisector_the_first_is_as_near(self):
        assert times_of(self.PAIR, 1.0, stroll(0, 30, 0, 1), 60.0) == [(0.0, 1)]
        assert times_of(self.PAIR[::-1], 1.0, stroll(0, 30, 0, 1), 60.0) == [(0.0, 1)]

    def test_the_state_before_is_no_row(self):
        walk = stroll(-50, 30, 2, 1)
        assert times_of(self.PAIR, 1.0, walk, 60.0, held=0) == [(25.0, 1)]
        assert times_of(self.PAIR, 1.0, walk, 20.0, held=1) == [(0.0, 0)]

    def test_a_user_who_turns_at_the_bisector_does_not_pass_it(self):
        walk = Walk(
            np.array([0.0, 25.0]), np.array([(-50.0, 0), (0, 0)]), np.array([(2.0, 0), (-2.0, 0)])
        )
        rows = times_of(self.PAIR, 1.0, walk, 60.0)
        assert [state for _, state in rows] == [0]

    def test_room_that_is_too_short_is_said(self):
        span = (START_US, START_US + 60_000_000)
        links = links_of(self.PAIR, stroll(-50, 30, 2, 1), 0.0, losses(2.0), -np.inf, span)
        assert nearer(links, 1.0, span, out=OUT[:1]) > 1


def survey(count, seed):
    """Random pairs of drones, held against the sampler and the search for thresholds."""
    rng, seen, out = np.random.default_rng(seed), Seen(), np.zeros((60, 2), np.int64)
    for number in range(count):
        span_s = round(rng.uniform(5.0, 70.0), 6)
        span = (START_US, START_US + round(span_s * 1e6))
        legs = []
        for _ in range(2):
            start, stop = rng.uniform(-400.0, 400.0, (2, 3))
            start[2], stop[2] = rng.uniform(20.0, 200.0, 2)
            stop[:2] = start[:2] if rng.random() < 0.2 else stop[:2]
            legs.append(hovering(start) if rng.random() < 0.2 else flying(rng, start, stop, span_s))
        exponent = rng.uniform(1.8, 4.0)
        pair = losses(exponent, rng.uniform(-3.0, 3.0))
        walk = moving(rng, span_s, 5)
        scene = Scene(walk, 1.5, [leg.trip for leg in legs], pair, -np.inf, span_s)
        at = rng.uniform(0.0, span_s - 0.1)
        passes, soon = scene.ratio_db([at, at + 0.1])
        offset = float(passes) + (abs(soon - passes) < 1e-6)  # then hardly anything moves
        gain = pair[0].power_dbm - pair[1].power_dbm - offset
        links = links_of(legs, walk, 1.5, pair, -np.inf, span)
        rows = rows_of(OUT, nearer(links, distance_ratio(gain, exponent), span))
        wrong, unclear = hold_classes(scene.ratio_db, np.array([offset]), rows, span, 1e-9)
        searched, _ = sinr_changes(links, np.array([offset]), 1e-6, span, -1, out)
        same = rows_of(out, searched)
        alike = [s for _, s in rows] == [s for _, s in same]
        if not alike or max(abs(a - b) for (a, _), (b, _) in zip(rows, same, strict=True)) > 1:
            wrong.append(("searched", same))
        seen.add(rows[1:], wrong, unclear, (number, scene))
    return seen


def check(seen):
    assert seen.wrong == []
    assert seen.rows > 0.5 * seen.legs and seen.unclear <= 0.01 * seen.rows
    assert set(seen.by_rows) >= {0, 1, 2}


def test_a_sampler_and_the_search_see_the_same():
    check(survey(100, 1))


@pytest.mark.thorough
def test_a_sampler_and_the_search_see_the_same_on_two_thousand_legs():
    check(survey(2000, 2))
