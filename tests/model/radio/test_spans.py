"""Bounds of levels for a whole span, and classes with and without what they leave out."""

from dataclasses import replace

import numpy as np
import pytest

from desim_uav.model.radio.air import _follow
from desim_uav.model.radio.links import SIGNAL, begin_user, sign
from desim_uav.model.radio.spans import bound_high, bound_span, look_from
from desim_uav.rowcode.kernels import kernel
from desim_uav.rowcode.rows import address, place
from desim_uav.rowcode.views import zeros
from desim_uav.sky.links import _begin_links, _walkers_of, scene_at, sky_at
from desim_uav.sky.rows import Change
from tests.model.radio.airs import random_sky


@kernel
def begin(scene, sky, span_us):
    """Begin the links to all senders, in their order."""
    own = sky_at(sky)
    own.air.used = len(own.legs)
    for k in range(own.air.used):
        own.air.links[k].sender = k
    _begin_links(scene_at(scene), own, span_us)


@kernel
def bound_all(scene, sky, walks, legs, begins, span_us, user):
    """Write the bounds of all levels at a user in a span."""
    air = sky_at(sky).air
    begin(scene, sky, span_us)
    look_from(air, _walkers_of(scene_at(scene), walks, legs, begins), span_us, user)
    for k in range(air.used):
        bound_high(air, k)
    bound_span(air)


@kernel
def search_all(scene, sky, out, room, walks, legs, begins, span_us):
    """Write the changes of the first sender, as if no bound showed that a class stays the same."""
    air, users = sky_at(sky).air, _walkers_of(scene_at(scene), walks, legs, begins)
    begin(scene, sky, span_us)
    signal = air.links[SIGNAL]
    signal.out, signal.room = out, room
    for user in range(len(users.heights_m)):
        begin_user(signal, 0)
        for k in range(1, air.used):
            air.links[k].sought = 0
        look_from(air, users, span_us, user)
        _follow(air, users, span_us, user, False, False)
        sign(signal, user)
    return signal.rows


def random_skies(seed, count, users):
    """Skies of up to four senders that all serve in one band."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        sky = random_sky(rng, 1 + number % 4, users)
        senders = len(sky.legs)
        yield rng, replace(sky, bands=[0] * senders, serves=[1] * senders)


def test_levels_stay_between_their_bounds():
    tight = 0
    for rng, sky in random_skies(5, 24, 1):
        air = sky.air()
        bound_all(address(air.scene), address(air.sky), *air.walked, sky.span_us, 0)
        t = np.append(rng.uniform(0.0, sky.span_s, 300), (0.0, sky.span_s))
        for k in range(len(sky.legs)):
            link, level = air.sky.air.links[k], sky.level(k, 0, t)
            assert link.low_dbm - 1e-9 <= level.min() and level.max() <= link.high_dbm + 1e-9
            tight += level.max() - level.min() > 0.5 * (link.high_dbm - link.low_dbm)
    assert tight > 10


def hold_changes(seed, count):
    """Compare the changes in random skies with those of a search that leaves nothing out."""
    changes = 0
    for rng, plain in random_skies(seed, count, 6):
        middle = rng.uniform(-5.0, 30.0)
        sky = replace(plain, thresholds=np.sort(rng.uniform(middle - 6.0, middle + 6.0, 5)))
        air, out, rows = sky.air(), np.zeros((500, 3), np.int64), zeros(Change, 500)
        found = air.classes(0, sky.span_us, 0, out)
        own = address(air.scene), address(air.sky), place(rows), len(rows)
        assert search_all(*own, *air.walked, sky.span_us) == found <= len(out)
        assert np.array_equal(out[:found], np.array(rows[:found].tolist()).reshape(-1, 3))
        changes += found
    assert changes > 2 * count


def test_what_is_left_out_changes_nothing():
    hold_changes(6, 16)


@pytest.mark.thorough
def test_what_is_left_out_changes_nothing_in_many_skies():
    hold_changes(7, 1000)
