"""Classes with interference that are sought for all transmitters together, and for each alone."""

from dataclasses import replace

import numpy as np
import pytest

from desim_uav.model.radio.air import (
    FOUND,
    FOUND_AT,
    FOUND_COLUMNS,
    FOUND_ROOM,
    class_changes_in_air,
    class_changes_of_all,
)
from tests.model.radio.airs import random_sky

ROOM, USERS = 600, 3


def together(sky, held, sought, room=ROOM):
    """(what is returned, the table of what is found, the rows of each transmitter)."""
    outs = np.full((len(sky.legs), room, 3), -7)
    found = np.zeros((len(sky.legs), FOUND_COLUMNS), np.int64)
    for k in np.flatnonzero(sought):
        found[k, FOUND_AT], found[k, FOUND_ROOM] = outs[k].ctypes.data, room
    return class_changes_of_all(sky.air(), sky.span_us, held, found), found, outs


def alone(sky, held, k):
    """The rows of one transmitter."""
    out = np.zeros((ROOM, 3), np.int64)
    count = class_changes_in_air(sky.air(), k, sky.span_us, held[k], False, out)
    assert 0 <= count <= ROOM
    return out[:count]


def drawn(rng, drones):
    """A sky with 14 thresholds, in bands or not, whose first drone serves; and classes before."""
    sky = random_sky(rng, drones, USERS)
    serves = [1, *sky.serves[1:]]
    bands = [k % 3 for k in range(drones)] if rng.random() < 0.5 else [0] * drones
    sky = replace(sky, serves=serves, bands=bands)
    times = np.linspace(0.0, sky.span_s, 60)
    values = np.concatenate([sky.ratio_db(0, user, times) for user in range(USERS)])
    thresholds = np.sort(rng.uniform(values.min() - 0.5, values.max() + 0.5, 14))
    return replace(sky, thresholds=thresholds), rng.integers(0, 15, (drones, USERS))


def survey(count, seed):
    rng, rows, late = np.random.default_rng(seed), 0, 0
    for number in range(count):
        sky, held = drawn(rng, 1 + number % 4)
        sought = np.array(sky.serves) * (rng.random(len(sky.legs)) < 0.8)
        fault, found, outs = together(sky, held, sought)
        assert fault == 0
        for k in np.flatnonzero(sought):
            own, other = outs[k, : found[k, FOUND]], alone(sky, held, k)
            assert own[:, 1:].tolist() == other[:, 1:].tolist(), (number, k)
            gaps = np.abs(own[:, 0] - other[:, 0])
            assert gaps.max(initial=0) <= 1, (number, k)
            rows, late = rows + len(own), late + gaps.sum()
        # Nothing is written for the others.
        assert (outs[sought == 0] == -7).all() and (found[sought == 0, FOUND] == 0).all()
    assert rows > 10 * count and late <= 0.01 * rows


def test_the_changes_are_those_of_each_signal_alone():
    survey(12, 1)


@pytest.mark.thorough
def test_the_changes_are_those_of_each_signal_alone_in_many_skies():
    survey(300, 2)


def test_memory_that_is_too_short_is_said():
    sky, held = drawn(np.random.default_rng(3), 3)
    sky = replace(sky, serves=[1] * 3)
    _, whole, outs = together(sky, held, np.ones(3))
    most = int(whole[:, FOUND].max())
    assert most > 2
    fault, found, short = together(sky, held, np.ones(3), 2)
    assert fault == 0
    for k in range(3):
        assert (found[k, FOUND] > 2) == (whole[k, FOUND] > 2)
        assert found[k, FOUND] >= min(whole[k, FOUND], 3)
        if whole[k, FOUND] <= 2:
            rows = slice(whole[k, FOUND])
            assert short[k, rows].tolist() == outs[k, rows].tolist()
    room = 2
    while found[:, FOUND].max() > room:
        room = int(found[:, FOUND].max())
        _, found, enough = together(sky, held, np.ones(3), room)
    assert (found[:, FOUND] == whole[:, FOUND]).all()
    for k in range(3):
        rows = slice(whole[k, FOUND])
        assert enough[k, rows].tolist() == outs[k, rows].tolist()
    air = sky.air()
    few = air._replace(tracks=air.tracks[:3])
    assert class_changes_of_all(few, sky.span_us, held, whole) < 0
