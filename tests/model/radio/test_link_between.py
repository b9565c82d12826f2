"""Classes of a link while a drone climbs or descends: the general search, and a sampler."""

import numpy as np
import pytest

from desim_uav.model.geometry.coverage import SEEN_ROWS, DroneLeg, Users, look_around
from desim_uav.model.geometry.relative import Change
from desim_uav.model.radio.between import (
    Climb,
    Window,
    class_changes_between,
    window_rows,
)
from desim_uav.model.radio.fits import NONE, _fits
from desim_uav.model.radio.rings import ring_m
from desim_uav.rowcode.views import zeros
from tests.model.radio.airs import (
    RADIOS,
    USER_M,
    class_rows,
    offsets,
    sky_of,
)
from tests.model.radio.looking import Seen, hold_classes, moving
from tests.model.radio.making import START_US, flying, walks

POWER_DBM, NOISE_DBM = 30.0, -90.0


def largest_db(sky):
    """The largest loss of each class."""
    return tuple(float(POWER_DBM - sky.noise_dbm - one) for one in sky.thresholds)


def levels_of(sky):
    """The lower level and the upper level of the only drone's leg."""
    return tuple(sorted(sky.legs[0].route[2::3]))


def fits_for(sky):
    return _fits(sky.radios[0].path_loss, 2.0, largest_db(sky), levels_of(sky), (USER_M,))


def rings_at(sky, z):
    """The radii of all classes on a level, as a world has them."""
    loss = sky.radios[0].path_loss
    radii = [ring_m(lambda r: loss.mean_db(r, z - USER_M, 2.0), one) for one in largest_db(sky)]
    return np.array([[radius if radius > 0.0 else -1.0 for radius in radii]])


def rows_between(sky, fresh=True, room=3000):
    """The rows of ``class_changes_between`` of all users, as those of ``class_rows``."""
    (leg,), fits = sky.legs, fits_for(sky)
    assert fits.terms.shape[0] == 1
    own = [walks(walk, START_US) for walk in sky.walks]
    users = Users(np.concatenate(own), offsets(own), np.zeros((SEEN_ROWS, len(own))))
    look_around(users, *sky.span_us)
    route = (*leg.route[:2], *leg.route[3:5])
    ends = rings_at(sky, leg.route[2]), rings_at(sky, leg.route[5])
    slabs = fits.terms.shape[3]
    climb = Climb(
        float(leg.route[5] > leg.route[2]),
        ends,
        *fits.bounds_m[0],
        fits.terms[0],
        fits.ranges[0],
        zeros(Window, window_rows(slabs, len(leg.profile))),
    )
    drone = DroneLeg(leg.profile, route, sky.span_us, 0.0, fresh)
    out = zeros(Change, room)
    count = class_changes_between(drone, climb, users, np.zeros(len(own), np.int64), out)
    if count > room:
        return count
    rows = [[] for _ in own]
    for t_us, user, change in out[:count].tolist():
        if rows[user]:
            assert t_us > rows[user][-1][0]
            assert (change > rows[user][-1][1]) if change > 0 else (-change < rows[user][-1][1])
        rows[user].append((t_us, abs(change)))
    assert out["user"][:count].tolist() == sorted(out["user"][:count])
    return rows


def random_climb(rng, users, classes=14):
    """A drone that climbs or descends, in minimum time or in a span, above users who walk."""
    while True:
        span_s = round(rng.uniform(5.0, 70.0), 6)
        x, y, z = *rng.uniform(-300.0, 300.0, 2), rng.uniform(15.0, 150.0)
        step = rng.uniform(5.0, 60.0) * rng.choice([-1.0, 1.0])
        if z + step < 15.0:
            continue
        leg = flying(rng, (x, y, z), (x, y, z + step), span_s)
        if leg.before_us:
            continue
        span_s = max(span_s, round(leg.profile["start_s"][-1], 6))
        walking = [moving(rng, span_s, 4) for _ in range(users)]
        sky = sky_of([leg], walking, RADIOS[rng.integers(len(RADIOS))], span_s=span_s)
        levels = [sky.ratio_db(0, user, np.linspace(0, span_s, 30)) for user in range(users)]
        low, high = np.min(levels), np.max(levels)
        ratios = np.sort(rng.uniform(low - 1.0, high, classes))
        sky = sky_of([leg], walking, sky.radios[0], ratios, span_s=span_s)
        if fits_for(sky) is not NONE:
            return sky


def compare(sky):
    """(rows of the leg, those that differ by a microsecond), against the general search."""
    found, known = rows_between(sky), class_rows(sky, 0)
    rows = late = 0
    for own, other in zip(found, known, strict=True):
        theirs = other if other[0][1] else other[1:]
        assert [state for _, state in own] == [state for _, state in theirs]
        gaps = [abs(one[0] - two[0]) for one, two in zip(own, theirs, strict=True)]
        assert max(gaps, default=0) <= 1
        rows, late = rows + len(own), late + sum(gaps)
    return rows, late


def survey(legs, users, seed):
    rng, rows, late = np.random.default_rng(seed), 0, 0
    for _ in range(legs):
        more, later = compare(random_climb(rng, users))
        rows, late = rows + more, late + later
    assert rows > 3 * legs * users and late <= 0.01 * rows


def sampled(legs, seed):
    rng, seen = np.random.default_rng(seed), Seen()
    for number in range(legs):
        sky = random_climb(rng, 1)
        (own,) = rows_between(sky)
        if not own or own[0][0] > START_US:
            own.insert(0, (START_US, 0))
        truth = lambda t, sky=sky: sky.ratio_db(0, 0, t)  # noqa: E731
        wrong, unclear = hold_classes(truth, sky.thresholds, own, sky.span_us, 1e-7)
        seen.add(own[1:], wrong, unclear, (number, sky))
    assert seen.wrong == []
    assert seen.rows > 3 * seen.legs and seen.unclear <= 0.01 * seen.rows


def test_the_general_search_finds_the_same():
    survey(15, 6, 1)


def test_a_drone_that_served_before_has_the_changes_alone():
    rng, rows = np.random.default_rng(6), 0
    for _ in range(5):
        sky = random_climb(rng, 4)
        for own, fresh in zip(rows_between(sky, fresh=False), rows_between(sky), strict=True):
            assert own == [row for row in fresh if row[0] > START_US]
            rows += len(own)
    assert rows > 20


def test_room_that_is_too_short_is_said():
    sky = random_climb(np.random.default_rng(7), 4)
    whole = rows_between(sky)
    count = sum(map(len, whole))
    assert count > 8
    for room in (0, 1, count - 1):
        needed = rows_between(sky, room=room)
        assert needed > room
        assert rows_between(sky, room=needed) == whole


def test_the_general_search_finds_the_same_on_more_legs():
    survey(300, 10, 2)


def test_a_sampler_sees_the_same():
    sampled(60, 3)


@pytest.mark.slow
def test_the_general_search_finds_the_same_on_two_thousand_legs():
    survey(2000, 10, 4)


@pytest.mark.slow
def test_a_sampler_sees_the_same_on_two_thousand_legs():
    sampled(2000, 5)
