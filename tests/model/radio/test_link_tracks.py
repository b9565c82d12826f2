"""Tracks: the same places as the sampler's, and the very same numbers where two spans meet."""

from itertools import pairwise

import numpy as np
import pytest

from desim_uav.model.geometry.coverage import leg_at, walked
from desim_uav.model.radio.tracks import (
    TrackRow,
    Turn,
    fly,
    note,
    place,
    row_at,
    walk,
)
from desim_uav.rowcode.views import zeros
from tests.model.radio.looking import moving
from tests.model.radio.making import START_US, absolute, flight_of, flying, walks


def test_places_are_those_of_the_sampler():
    rng = np.random.default_rng(1)
    for _ in range(200):
        span_s = round(rng.uniform(5.0, 70.0), 6)
        span = (START_US, START_US + round(span_s * 1e6))
        leg = flying(rng, *rng.uniform(-400.0, 400.0, (2, 3)), span_s)
        stroll = moving(rng, span_s, 5)
        tracks, (drone,), user = absolute([leg], stroll, 1.5, span)
        times = rng.uniform(0.0, span_s, 50)
        walked_to = np.column_stack([stroll.at(times), np.full(50, 1.5)])
        for own, places in ((drone, leg.trip.at(times)), (user, walked_to)):
            assert (np.diff(tracks["begin_s"][slice(*own)]) >= 0.0).all()
            assert tracks["begin_s"][own[1] - 1] == (span[1] - span[0]) * 1e-6
            for t, expected in zip(times, places, strict=True):
                found = place(tracks[row_at(tracks, *own, t)], t)
                assert found == pytest.approx(expected, abs=1e-9)


def test_two_spans_meet_at_the_same_numbers():
    rng = np.random.default_rng(2)
    for _ in range(200):
        leg = flying(rng, *rng.uniform(-400.0, 400.0, (2, 3)), 60.0)
        own = walks(moving(rng, 60.0, 5))
        cuts = [START_US, *np.sort(START_US + rng.integers(1, 60_000_000, 3)).tolist()]
        cuts.append(int(START_US - leg.before_us + round(leg.profile["start_s"][-1] * 1e6)))
        ends = []
        for span in pairwise(cuts):
            if span[1] <= span[0]:
                continue
            tracks = zeros(TrackRow, 40)
            after = fly(flight_of(leg), span, tracks, 0)
            last = walk(own, (0, len(own)), 1.5, span, tracks, after)
            at = tracks[["x_m", "y_m", "z_m"]].tolist()
            ends.append((*at[0], *at[after]))
            ends.append((*at[after - 1], *at[last - 1]))
            assert ends[-1][3:5] == walked(own[leg_at(own, 0, len(own), span[1])], span[1])
        assert ends[1:-1:2] == ends[2::2]
        assert ends[-1][:3] == leg.route[3:]


def test_rows_without_room_are_counted():
    leg = flying(np.random.default_rng(4), (0, 0, 50), (300, 0, 90), 60.0)
    leg.before_us = 0
    flight = flight_of(leg)
    span = (START_US, START_US + 60_000_000)
    tracks = zeros(TrackRow, 9)
    rows = fly(flight, span, tracks, 0)
    short = zeros(TrackRow, 2)
    assert fly(flight, span, short, 0) == rows
    assert np.array_equal(short, tracks[:2])


def test_changes_in_one_microsecond_are_one_or_none():
    out = zeros(Turn, 9)
    rows = note(out, 0, 0, 5, 1)
    assert note(out, rows, 0, 5, 0) == 0
    rows = note(out, 0, 0, 5, 1)
    rows = note(out, rows, 0, 7, 2)
    rows = note(out, rows, 0, 7, 3)
    assert out[:rows].tolist() == [(5, 1), (7, 3)]
    assert note(out, rows, 0, 7, 1) == 1
    assert note(out, 1, 0, 9, 1) == 1
