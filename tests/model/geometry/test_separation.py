"""Two drones that come too near: times by hand, and a sampler that shares no code."""

import numpy as np
import pytest

from desim_uav.model.geometry.separation import CLEAR, NEAR, approach, conflicts
from desim_uav.model.motion.motion import BangCoastBang
from desim_uav.model.radio.tracks import TrackRow, Turn, fly
from desim_uav.rowcode.views import zeros
from tests.model.radio.looking import Seen, hold_classes
from tests.model.radio.making import START_US, Leg, flight_of, flying, hovering
from tests.model.sampler import Flight as Flown


def tracked(legs, span_us):
    """(table of tracks, the rows of both drones)."""
    tracks, rows, row = zeros(TrackRow, 20), [], 0
    for leg in legs:
        after = fly(flight_of(leg), span_us, tracks, row)
        rows.append((row, after))
        row = after
    return tracks, rows


def rows_of(legs, least_m, span_s, held=-1, room=30):
    span = (START_US, START_US + round(span_s * 1e6))
    tracks, (one, other) = tracked(legs, span)
    out = zeros(Turn, room)
    count = conflicts(tracks, one, other, least_m, span, held, out)
    return out[:count].tolist() if count <= room else count


def seconds(rows):
    return [((t - START_US) * 1e-6, state) for t, state in rows]


def apart(legs):
    """The distance of two drones by the sampler."""

    def distance(t):
        t = np.atleast_1d(np.asarray(t, float))
        return np.linalg.norm(legs[0].trip.at(t) - legs[1].trip.at(t), axis=1)

    return distance


def fast(start, stop):
    metres = float(np.linalg.norm(np.subtract(stop, start)))
    transit = BangCoastBang().fastest_transit(metres)
    return Leg(start, stop, transit, Flown.minimum_time(metres, 8.3, 4.0))


class TestByHand:
    PAST = (fast((0, 0, 50), (240, 0, 50)), hovering((120, 0, 50)))
    MIDDLE_S = 240 / 8.3 / 2 + 8.3 / 8

    def test_a_drone_flies_past_another(self):
        half = 20.0 / 8.3
        expected = [(0.0, CLEAR), (self.MIDDLE_S - half, NEAR), (self.MIDDLE_S + half, CLEAR)]
        for legs in (self.PAST, self.PAST[::-1]):
            found = seconds(rows_of(legs, 20.0, 40.0))
            assert [state for _, state in found] == [state for _, state in expected]
            assert [t for t, _ in found] == pytest.approx([t for t, _ in expected], abs=1e-6)

    def test_at_another_height_and_to_the_side(self):
        legs = [self.PAST[0], hovering((120, 12, 66))]  # 20 m away at the least
        assert rows_of(legs, 20.0, 40.0, held=CLEAR) == []
        half = (25.0**2 - 20.0**2) ** 0.5 / 8.3
        found = seconds(rows_of(legs, 25.0, 40.0, held=CLEAR))
        assert found[0] == (pytest.approx(self.MIDDLE_S - half, abs=1e-6), NEAR)
        assert found[1] == (pytest.approx(self.MIDDLE_S + half, abs=1e-6), CLEAR)

    def test_two_that_approach_each_other(self):
        legs = [fast((0, 0, 50), (240, 0, 50)), fast((240, 0, 50), (0, 0, 50))]
        found = seconds(rows_of(legs, 16.6, 40.0))
        assert found[1] == (pytest.approx(self.MIDDLE_S - 1.0, abs=1e-6), NEAR)

    def test_at_just_the_least_distance_they_are_clear(self):
        legs = [hovering((0, 0, 50)), hovering((20, 0, 50))]
        assert seconds(rows_of(legs, 20.0, 5.0)) == [(0.0, CLEAR)]
        assert seconds(rows_of(legs, 20.001, 5.0)) == [(0.0, NEAR)]
        assert rows_of(legs, 20.001, 5.0, held=NEAR) == []

    def test_a_drone_that_stops_too_near(self):
        legs = [fast((0, 0, 50), (240, 0, 50)), hovering((245, 0, 50))]
        found = seconds(rows_of(legs, 20.0, 60.0))
        # 15 m before the end it still coasts: 8.61125 m are for the ramp.
        t = 8.3 / 4.0 + (225 - 8.61125) / 8.3
        assert found == [(0.0, CLEAR), (pytest.approx(t, abs=1e-6), NEAR)]

    def test_the_least_distance(self):
        span = (START_US, START_US + 40_000_000)
        tracks, rows = tracked([self.PAST[0], hovering((120, 12, 66))], span)
        found = approach(tracks, *rows, 0.0, 40.0)
        assert found == (pytest.approx(20.0), pytest.approx(self.MIDDLE_S))
        early = approach(tracks, *rows, 0.0, 10.0)
        assert early.at_s == 10.0 and early.distance_m > 20.0
        assert approach(tracks, *rows, 10.0, 10.0) == early

    def test_room_that_is_too_short_is_said(self):
        whole = rows_of(self.PAST, 20.0, 40.0)
        for room in range(3):
            assert rows_of(self.PAST, 20.0, 40.0, room=room) > room
        assert rows_of(self.PAST, 20.0, 40.0, room=3) == whole

    def test_spans_that_meet_agree(self):
        tracks, (one, other) = tracked(self.PAST, (START_US, START_US + 15_000_000))
        out = zeros(Turn, 9)
        span = (START_US, START_US + 15_000_000)
        count = conflicts(tracks, one, other, 20.0, span, CLEAR, out)
        state = out["state"][count - 1]
        span = (span[1], START_US + 40_000_000)
        tracks, (one, other) = tracked(self.PAST, span)
        count += conflicts(tracks, one, other, 20.0, span, state, out[count:])
        assert out[:count].tolist() == rows_of(self.PAST, 20.0, 40.0)[1:]


def random_pair(rng):
    """Two drones on legs of any direction, or at rest, the ways of which often meet."""
    span_s = round(rng.uniform(5.0, 70.0), 6)
    meet = rng.uniform(-100.0, 100.0, 3)
    legs = []
    for _ in range(2):
        start = meet + rng.uniform(-200.0, 200.0, 3) * (1.0, 1.0, rng.choice([0.0, 0.3]))
        stop = meet + rng.uniform(-1.5, 0.5) * (start - meet) + rng.normal(size=3) * 20.0
        legs.append(hovering(start) if rng.random() < 0.15 else flying(rng, start, stop, span_s))
    return legs, span_s


def survey(count, seed):
    """Random pairs, held against the sampler: (times and states, least distances)."""
    rng, seen = np.random.default_rng(seed), Seen()
    for number in range(count):
        legs, span_s = random_pair(rng)
        span, distance = (START_US, START_US + round(span_s * 1e6)), apart(legs)
        values = distance(np.linspace(0.0, span_s, 400))
        low, high = values.min(), values.max()
        least_m = rng.uniform(low, low + 0.5 * (high - low)) if rng.random() < 0.9 else low + 1e-3
        rows = rows_of(legs, least_m, span_s)

        def value(t, distance=distance):
            return -distance(t)

        wrong, unclear = hold_classes(value, np.array([-least_m]), rows, span, 1e-9)
        tracks, pair = tracked(legs, span)
        found = approach(tracks, *pair, 0.0, span_s)
        near = np.clip(found.at_s + np.linspace(-0.01, 0.01, 21), 0.0, span_s)
        if found.distance_m > low + 1e-9 or found.distance_m > distance(near).min() + 1e-9:
            wrong.append(("nearer", found))
        if abs(distance(found.at_s)[0] - found.distance_m) > 1e-9:
            wrong.append(("elsewhere", found))
        seen.add(rows[1:], wrong, unclear, number)
    return seen


def check(seen):
    assert seen.wrong == []
    assert seen.rows > seen.legs and seen.unclear <= 0.01 * seen.rows


def test_a_sampler_sees_the_same():
    check(survey(60, 1))


@pytest.mark.thorough
def test_a_sampler_sees_the_same_on_two_thousand_pairs():
    check(survey(2000, 2))
