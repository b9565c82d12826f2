"""Classes with interference that are sought for all transmitters together, and for each alone."""

from dataclasses import replace

import numpy as np
import pytest

from desim_uav.rowcode.rows import address
from desim_uav.sky.links import foresee_all
from tests.model.radio.airs import random_sky

ROOM, USERS = 600, 3


def together(sky, held, sought, room=ROOM, reach_m=0.0):
    """(the largest number of changes, that of each transmitter, their rows; -7: not written)."""
    return found_in(sky.air(room, reach_m), sky, held, sought)


def found_in(air, sky, held, sought):
    """The same of an air."""
    count, room = len(sky.legs), len(air.sky.changes) // len(sky.legs)
    air.sky.held[:] = held.ravel()
    air.sky.changes.array["user"] = -7
    for leg, wanted in zip(air.sky.legs, sought, strict=True):
        leg.sought = int(wanted)
    most = foresee_all(address(air.scene), address(air.sky), *air.walked, *sky.span_us)
    rows = np.array(air.sky.changes.array.tolist()).reshape(count, room, 3)
    return most, np.array([leg.changes for leg in air.sky.legs]), rows


def by_user(rows):
    """Rows whose last one is first, user by user in order of time."""
    rows = rows[::-1]
    return rows[np.argsort(rows[:, 1], kind="stable")]


def alone(sky, held, k):
    """The rows of one transmitter."""
    out = np.zeros((ROOM, 3), np.int64)
    count = sky.air().classes(k, sky.span_us, held[k], out)
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
        most, found, outs = together(sky, held, sought)
        assert most == found.max()
        for k in np.flatnonzero(sought):
            own, other = by_user(outs[k, : found[k]]), alone(sky, held, k)
            assert own[:, 1:].tolist() == other[:, 1:].tolist(), (number, k)
            gaps = np.abs(own[:, 0] - other[:, 0])
            assert gaps.max(initial=0) <= 1, (number, k)
            rows, late = rows + len(own), late + gaps.sum()
        # Nothing is written for the others.
        assert (outs[sought == 0, :, 1] == -7).all() and (found[sought == 0] == 0).all()
    assert rows > 10 * count and late <= 0.01 * rows


def test_the_changes_are_those_of_each_signal_alone():
    survey(12, 1)


@pytest.mark.thorough
def test_the_changes_are_those_of_each_signal_alone_in_many_skies():
    survey(300, 2)


def test_memory_that_is_too_short_is_said():
    sky, held = drawn(np.random.default_rng(3), 3)
    sky = replace(sky, serves=[1] * 3)
    most, whole, outs = together(sky, held, np.ones(3))
    assert most == whole.max() > 2
    many, found, _ = together(sky, held, np.ones(3), 2)
    assert many > 2
    for k in range(3):
        assert (found[k] > 2) == (whole[k] > 2)
        assert found[k] >= min(whole[k], 3)
    room = 2
    while many > room:
        room = int(many)
        many, found, enough = together(sky, held, np.ones(3), room)
    assert (found == whole).all()
    for k in range(3):
        assert enough[k, : whole[k]].tolist() == outs[k, : whole[k]].tolist()
