"""Levels on vertical legs above users who stand still: stationary heights, and a sampler."""

import numpy as np
import pytest

from desim_uav.model.motion import BangCoastBang
from desim_uav.model.radio.vertical import stationary_elevations
from tests.model.radio.looking import Loss, Scene, Seen, hold_classes
from tests.model.radio.making import (
    START_US,
    Leg,
    climb_changes,
    flying,
    hovering,
    links_of,
    rows_of,
    sinr_changes,
)
from tests.model.sampler import Flight, Walk

pytestmark = pytest.mark.thorough  # it is long to compile, and no engine uses it yet

TOWNS = {
    "suburban": (20.9, 4.88, 0.43),
    "urban": (19.0, 9.61, 0.16),
    "dense_urban": (21.4, 12.08, 0.11),
    "high_rise": (31.7, 27.23, 0.08),
}


def turning(town):
    out = np.zeros(8)
    return out[: stationary_elevations(*town, out)].copy()


class TestStationaryElevations:
    @pytest.mark.parametrize(
        ("town", "degrees"),
        [
            ("suburban", [20.338708]),
            ("urban", [42.438557]),
            ("dense_urban", [54.619150]),
            ("high_rise", [6.669199, 23.731943, 75.518762]),
        ],
    )
    def test_al_hourani(self, town, degrees):
        assert turning(TOWNS[town]) == pytest.approx(degrees, abs=5e-7)

    def test_none_is_missed_of_a_thousand_towns(self):
        rng, counts = np.random.default_rng(1), []
        grid = np.linspace(0.0, 90.0, 90_001)[1:-1]
        for _ in range(1000):
            town = (rng.uniform(0.0, 40.0), rng.uniform(1.0, 45.0), 10 ** rng.uniform(-2.0, -0.3))
            fall, a, b = town
            sees = 1.0 / (1.0 + a * np.exp(-b * (grid - a)))
            slope = np.pi / 9 / np.log(10) * np.tan(np.radians(grid)) - fall * b * sees * (1 - sees)
            passed = np.flatnonzero((slope[1:] > 0.0) != (slope[:-1] > 0.0))
            found = turning(town)
            found = found[found > grid[0]]
            assert len(found) == len(passed), town
            assert np.abs(found - grid[passed]).max(initial=0.0) <= 1.1e-3
            counts.append(len(found))
        assert {1, 3} <= set(counts)

    def test_room_that_is_too_short_is_said(self):
        out = np.zeros(1)
        assert stationary_elevations(*TOWNS["high_rise"], out) == 3
        assert out[0] == pytest.approx(6.669199, abs=5e-7)


def standing(x, y):
    return Walk(np.zeros(1), np.array([(x, y)], float), np.zeros((1, 2)))


def climbed(leg, walk, town, thresholds, span_s, out, held=-1):
    """(rows, links, scene) of a user 1.5 m above the ground."""
    losses, span = [Loss(30.0, 38.468383, 2.0, *town)], (START_US, START_US + round(span_s * 1e6))
    links = links_of([leg], walk, 1.5, losses, 0.0, span)
    apart = float(np.hypot(*(leg.trip.start[:2] - walk.points[0])))
    heights = apart * np.tan(np.radians(turning(town)))
    count = climb_changes(links, heights, thresholds, span, held, out)
    return rows_of(out, count), links, Scene(walk, 1.5, [leg.trip], losses, 0.0, span_s)


def test_a_climb_through_all_three_elevations_of_the_high_rise():
    # At 100 m, the level falls, rises, falls and rises, seen from where it is stationary.
    town, out = TOWNS["high_rise"], np.zeros((60, 2), np.int64)
    transit = BangCoastBang().fastest_transit(600.0)
    flight = Flight.minimum_time(600.0, 8.3, 4.0)
    leg = Leg((100, 0, 2.0), (100, 0, 602.0), transit, flight)
    turns = 100.0 * np.tan(np.radians(turning(town)))
    scene = Scene(standing(0, 0), 1.5, [leg.trip], [Loss(30, 38.468383, 2, *town)], 0, 75.0)
    at = np.interp(turns + 1.5, leg.trip.at(t := np.linspace(0, 75, 100_000))[:, 2], t)
    levels = scene.ratio_db(at)
    assert levels[1] < levels[0] < levels[2]
    # Just below the first turn, between both, just above the second one.
    thresholds = np.sort([levels[0] - 1e-4, (levels[0] + levels[1]) / 2, levels[1] + 1e-4])
    rows, _, _ = climbed(leg, standing(0, 0), town, thresholds, 75.0, out)
    assert [state for _, state in rows[:8]] == [2, 3, 2, 1, 0, 1, 2, 3]
    assert hold_classes(scene.ratio_db, thresholds, rows, (START_US, START_US + 75_000_000), 0) == (
        [],
        0,
    )
    # A threshold at the very turn is touched.
    rows, _, _ = climbed(leg, standing(0, 0), town, levels[1:2], 75.0, out)
    assert len(rows) in (1, 3)


def survey(count, seed):
    """Random climbs and descents, held against the sampler and the search for thresholds."""
    rng, seen = np.random.default_rng(seed), Seen()
    out, other = np.zeros((99, 2), np.int64), np.zeros((99, 2), np.int64)
    for number in range(count):
        town = list(TOWNS.values())[number % 4]
        span_s = round(rng.uniform(10.0, 70.0), 6)
        span = (START_US, START_US + round(span_s * 1e6))
        x, y = rng.uniform(-300.0, 300.0, 2) * rng.random()
        low, high = rng.uniform(3.0, 600.0, 2)
        leg = flying(rng, (x, y, low), (x, y, high), span_s)
        walk = standing(*rng.uniform(-100.0, 100.0, 2))
        _, _, scene = climbed(leg, walk, town, np.zeros(1), span_s, out)
        values = scene.ratio_db(np.linspace(0.0, span_s, 300))
        thresholds = np.sort(rng.uniform(values.min() - 0.2, values.max() + 0.2, 14))
        rows, links, _ = climbed(leg, walk, town, thresholds, span_s, out)
        wrong, unclear = hold_classes(scene.ratio_db, thresholds, rows, span, 1e-9)
        searched, _ = sinr_changes(links, thresholds, 1e-6, span, -1, other)
        same = rows_of(other, searched)
        alike = [s for _, s in rows] == [s for _, s in same]
        if not alike or max(abs(a - b) for (a, _), (b, _) in zip(rows, same, strict=True)) > 1:
            wrong.append(("searched", same))
        seen.add(rows[1:], wrong, unclear, (number, scene))
    return seen


def check(seen):
    assert seen.wrong == []
    assert seen.rows > 5 * seen.legs and seen.unclear <= 0.01 * seen.rows


def test_a_sampler_and_the_search_see_the_same():
    check(survey(100, 1))


@pytest.mark.thorough
def test_a_sampler_and_the_search_see_the_same_on_two_thousand_legs():
    check(survey(2000, 2))


def test_the_class_before_is_no_row():
    out, town = np.zeros((9, 2), np.int64), TOWNS["urban"]
    leg, thresholds = hovering((100, 0, 100)), np.array([-200.0, 0.0])
    assert climbed(leg, standing(0, 0), town, thresholds, 60.0, out)[0] == [(START_US, 1)]
    assert climbed(leg, standing(0, 0), town, thresholds, 60.0, out, held=1)[0] == []
