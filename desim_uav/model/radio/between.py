"""When a user passes from one class of a link to another while the drone climbs or descends.

Between two neighbouring levels, each class holds within a circle whose squared radius is a
polynomial of the height in each of some slabs (``model.radio.fits``). The drone stays above one
place, so the squared distance of a user who walks straight is quadratic in time. The difference of
the two is therefore smooth. Bounds of its second derivative show where it has no zero, or where it
is monotone and has at most one; elsewhere, shorter and shorter times are looked at.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.coverage import (
    AT_X,
    AT_Y,
    FAR,
    LEG,
    MARGIN_M,
    NEAR,
    DroneLeg,
    Users,
    WalkLeg,
    Way,
    leg_near,
    walked,
)
from desim_uav.model.geometry.relative import Change, beyond, rounded_us
from desim_uav.model.radio.fits import CURVED, STEEP, TERMS
from desim_uav.model.radio.nested import bounds_of, sift, sifted
from desim_uav.model.radio.passages import Passage, begin_passages, passed
from desim_uav.rowcode.kernels import kernel, part
from desim_uav.rowcode.rows import Ints, Row, Table, row

SHORTEST_S = 1e-7
"""The shortest time that is looked at: what comes and goes in it lasts no microsecond."""

ROOT_S = 1e-10
"""How far a root may be from where Newton's method ends."""

Array = NDArray[np.float64]


@row
class Window(Row):
    """A time in which the drone stays in one slab and keeps its acceleration.

    It begins ``begin_s`` seconds after the start of the leg. The drone's place in the slab is a
    polynomial of the time since then (see ``fits.Fits``) with the coefficients ``place``, ``rise``
    and ``bend``. In the last window the drone rests at the end of its flight.
    """

    begin_s: float
    slab: int
    place: float
    rise: float
    bend: float


class Climb(NamedTuple):
    """What is known of a leg between two neighbouring levels.

    ``upwards`` is 1.0 if the drone climbs, and 0.0 if it descends. ``rings_m`` (2, groups, classes)
    are the radii on the level at the start and on that at the end (see ``nested.class_changes``),
    ``least_m`` and ``most_m`` (groups, classes) are bounds of the radii in between, and ``terms``
    and ``ranges`` the fits. ``windows`` is memory for ``window_rows`` rows.
    """

    upwards: float
    rings_m: tuple[Array, Array]
    least_m: Array
    most_m: Array
    terms: Array
    ranges: Array
    windows: Table[Window]


class Stretch(NamedTuple):
    """A time in which the user walks straight, and the drone is in one window.

    ``near``, ``slope`` and ``speed`` are the coefficients of the user's squared distance, and the
    others those of the drone's place in the slab.
    """

    near: float
    slope: float
    speed: float
    slab: int
    place: float
    rise: float
    bend: float


def window_rows(slabs: int, longest: int) -> int:
    """Return how many windows there are at most, if no profile has more rows than ``longest``."""
    return slabs + longest + 1


@kernel
def class_changes_between(
    leg: DroneLeg, climb: Climb, users: Users, groups: Ints, out: Table[Change]
) -> int:
    """Write all changes of class while a drone climbs or descends, and return their number.

    The drone begins its flight at the start of the leg. For the rest, see
    ``nested.class_changes``, which does the same while a drone keeps its level.
    """
    seen = users.seen
    windows = _begin_windows(leg, climb)
    x, y = leg.route[0], leg.route[1]
    stay = Way(x, y, x, y, 0.0, 1.0, MARGIN_M, -MARGIN_M)
    for user in range(len(users.offsets) - 1):  # a loop of its own, so that it can be vectorised
        seen[NEAR, user], seen[FAR, user] = bounds_of(stay, seen, user)
    total = 0
    for k in range(sift(users, climb.least_m, climb.most_m, groups, leg.fresh)):
        user, first, stop = sifted(seen, k)
        of = user, groups[user]
        total = _follow(leg, climb, users, of, (first, stop, windows), out, total)
    return total


@kernel
def _begin_windows(leg: DroneLeg, climb: Climb) -> int:
    """Write the windows of a leg, and return their number."""
    profile, windows, slabs = leg.profile, climb.windows, climb.terms.shape[2]
    last, count = len(profile) - 1, 0
    scale = slabs / profile[last].from_m
    for phase in range(last):
        piece = profile[phase]
        begins = piece.start_s
        lasts, at = profile[phase + 1].start_s - begins, 0.0
        # The way so far in slabs, as a polynomial of the time since the phase began.
        way = piece.from_m * scale
        speed, bend = piece.speed_mps * scale, 0.5 * piece.acceleration_mps2 * scale
        slab_index = min(int(way + 1e-9), slabs - 1)
        while at < lasts:
            ahead = lasts
            if slab_index + 1 < slabs and way + lasts * (speed + lasts * bend) > slab_index + 1:
                ahead = min(max(_reaches(way - (slab_index + 1), speed, bend), at), lasts)
            here, rate = way + at * (speed + at * bend), speed + 2.0 * at * bend
            slab, sign = slab_index, 2.0
            if climb.upwards == 0.0:
                slab, sign = slabs - 1 - slab_index, -2.0
            window = windows[count]
            window.begin_s, window.slab = begins + at, slab
            window.place = sign * (here - slab_index - 0.5)
            window.rise, window.bend = sign * rate, sign * bend
            count += 1
            slab_index += 1
            at = ahead
            if ahead == lasts:
                break
    rest = windows[count]
    rest.begin_s, rest.slab = profile[last].start_s, int(climb.upwards) * (slabs - 1)
    rest.place, rest.rise, rest.bend = 2.0 * climb.upwards - 1, 0.0, 0.0
    return count + 1


@part
def _reaches(way: float, speed: float, bend: float) -> float:
    """Return when a way that begins below 0 reaches 0."""
    root = np.sqrt(max(speed * speed - 4.0 * bend * way, 0.0))
    return float(-2.0 * way / (speed + root))


@kernel
def _follow(
    leg: DroneLeg,
    climb: Climb,
    users: Users,
    of: tuple[int, int],
    span: tuple[int, int, int],
    out: Table[Change],
    total: int,
) -> int:
    """Write the changes of a user in a group (``of``), and return the new number of rows.

    ``span`` holds the circles that may be crossed (from the first one to the one before the
    second), and the number of windows.
    """
    user, group = of
    first, stop, count = span
    windows, legs = climb.windows, users.legs
    start_us, end_us = leg.span_us
    duration = (end_us - start_us) * 1e-6
    centre_x, centre_y = leg.route[0], leg.route[1]
    away = centre_x - users.seen[AT_X, user], centre_y - users.seen[AT_Y, user]
    begin, radii = (start_us, leg.fresh), climb.rings_m[0][group]
    one = begin_passages(user, away, radii, (first, stop), begin, out, total)
    end_walk = users.offsets[user + 1]
    walk = begin_walk = users.offsets[user] + int(users.seen[LEG, user])
    window, at = 0, 0.0
    while at < duration:
        while window + 1 < count and windows[window + 1].begin_s <= at:
            window += 1
        while walk + 1 < end_walk and (legs[walk + 1].begin_us - start_us) * 1e-6 <= at:
            walk += 1
        end = duration
        if window + 1 < count:
            end = min(end, windows[window + 1].begin_s)
        if walk + 1 < end_walk:
            end = min(end, (legs[walk + 1].begin_us - start_us) * 1e-6)
        stretch = _stretch_of(leg, windows[window], legs[walk], at)
        one = _pass(leg, climb, stretch, of, (first, stop), (at, end), one, out)
        at = end
    # The class at the end is that with which a leg on the level there begins.
    last = leg_near(legs, begin_walk, end_walk, end_us, walk)
    x, y = walked(legs[last], end_us)
    x, y = centre_x - x, centre_y - y
    link_class, after = one.now, climb.rings_m[1][group]
    while link_class < stop and beyond(x, y, after[link_class]) <= 0.0:
        link_class += 1
    while link_class > first and beyond(x, y, after[link_class - 1]) > 0.0:
        link_class -= 1
    if link_class != one.now:
        one = passed(one, link_class, end_us, user, out)
    return one.total


@part
def _stretch_of(leg: DroneLeg, window: Window, walk: WalkLeg, at: float) -> Stretch:
    """Return the user's distance and the drone's place in a window, from a time on."""
    vx, vy = walk.vx_mps, walk.vy_mps
    since_walk = at - (walk.begin_us - leg.span_us[0]) * 1e-6
    x = leg.route[0] - walk.x_m - vx * since_walk
    y = leg.route[1] - walk.y_m - vy * since_walk
    since, rise, bend = at - window.begin_s, window.rise, window.bend
    return Stretch(
        x * x + y * y,
        -(x * vx + y * vy),
        vx * vx + vy * vy,
        window.slab,
        window.place + since * (rise + since * bend),
        rise + 2.0 * since * bend,
        bend,
    )


@part
def _pass(
    leg: DroneLeg,
    climb: Climb,
    stretch: Stretch,
    of: tuple[int, int],
    circles: tuple[int, int],
    times: tuple[float, float],
    one: Passage,
    out: Table[Change],
) -> Passage:
    """Write the changes of a user in a stretch, by shorter and shorter times where need be."""
    (user, group), (first, stop), (at, end) = of, circles, times
    begin, width = 0.0, end - at
    while begin < end - at:
        until = min(begin + width, end - at)
        low, high = _candidates(climb, stretch, group, (first, one.now, stop), begin, until)
        if low == high:
            begin = until
            continue
        if until - begin > SHORTEST_S and not _settles(
            climb, stretch, group, (low, high), begin, until
        ):
            width = 0.5 * (until - begin)
            continue
        entered = left = False
        while True:
            # A circle that has just been passed is not passed back.
            now = one.now
            enters = (
                not left and now < high and _excess(climb, stretch, group, now, until)[0] <= 0.0
            )
            if not enters and (
                entered or now == low or _excess(climb, stretch, group, now - 1, until)[0] <= 0.0
            ):
                break
            entered, left = enters, not enters
            ring = now if enters else now - 1
            root = _root(climb, stretch, (group, ring), begin, until, enters)
            t_us = rounded_us(leg.span_us[0], at + root)
            one = passed(one, ring + 1 if enters else ring, t_us, user, out)
        width, begin = 2.0 * (until - begin), until
    return one


@part
def _candidates(
    climb: Climb,
    stretch: Stretch,
    group: int,
    circles: tuple[int, int, int],
    begin: float,
    until: float,
) -> tuple[int, int]:
    """Return the first circle that may be crossed in a time, and the one after the last one.

    ``circles`` are the first one in the whole leg, how many surround the user now, and the one
    after the last one.
    """
    first, low, stop = circles
    high = low
    near, slope, speed, slab = stretch.near, stretch.slope, stretch.speed, stretch.slab
    one = near + begin * (2.0 * slope + begin * speed)
    other = near + until * (2.0 * slope + until * speed)
    least, most = min(one, other), max(one, other)
    if speed > 0.0 and begin * speed < -slope < until * speed:
        least = near - slope * slope / speed
    slack = 1e-9 + 1e-12 * most
    least, most = least - slack, most + slack
    inner, outer = climb.ranges[group, slab, 0], climb.ranges[group, slab, 1]
    while low > first and most >= inner[low - 1]:
        low -= 1
    while high < stop and least <= outer[high]:
        high += 1
    return low, high


@part
def _excess(climb: Climb, stretch: Stretch, group: int, ring: int, t: float) -> tuple[float, float]:
    """Return the squared distance minus the squared radius at a time, and its derivative."""
    near, slope, speed, slab, place, rise, bend = stretch
    square, rate = near + t * (2.0 * slope + t * speed), 2.0 * (slope + t * speed)
    u, du = place + t * (rise + t * bend), rise + 2.0 * t * bend
    terms = climb.terms[group, ring, slab]
    value = slant = 0.0
    for k in range(TERMS - 1, -1, -1):
        slant = slant * u + value
        value = value * u + terms[k]
    return square - value, rate - slant * du


@part
def _settles(
    climb: Climb,
    stretch: Stretch,
    group: int,
    circles: tuple[int, int],
    begin: float,
    until: float,
) -> bool:
    """Return whether the user crosses each of some circles at most once in a time."""
    half = 0.5 * (until - begin)
    for ring in range(circles[0], circles[1]):
        value, rate = _excess(climb, stretch, group, ring, begin + half)
        bent = _bent(climb, stretch, group, ring, begin, until)
        turns = bent * half
        if abs(rate) <= turns and abs(value) <= (abs(rate) + turns) * half:
            return False
    return True


@part
def _bent(
    climb: Climb, stretch: Stretch, group: int, ring: int, begin: float, until: float
) -> float:
    """Return a bound of the second derivative of ``_excess`` in a time."""
    terms = climb.terms[group, ring, stretch.slab]
    one = abs(stretch.rise + 2.0 * begin * stretch.bend)
    du = max(one, abs(stretch.rise + 2.0 * until * stretch.bend))
    return float(
        2.0 * stretch.speed + terms[CURVED] * du * du + 2.0 * terms[STEEP] * abs(stretch.bend)
    )


@part
def _root(
    climb: Climb,
    stretch: Stretch,
    of: tuple[int, int],
    begin: float,
    until: float,
    enters: bool,
) -> float:
    """Return when the user crosses a circle, by Newton's method that bisection safeguards."""
    low, high = begin, until
    bent = _bent(climb, stretch, of[0], of[1], begin, until)
    t = 0.5 * (low + high)
    for _ in range(80):
        value, rate = _excess(climb, stretch, of[0], of[1], t)
        if (value <= 0.0) != enters:
            low = t
        else:
            high = t
        step = t - value / rate if rate != 0.0 else low
        if not low < step < high:
            step = 0.5 * (low + high)
        elif bent * (step - t) * (step - t) <= ROOT_S * abs(rate):
            return step
        if abs(step - t) <= ROOT_S or step <= low or step >= high:
            return step
        t = step
    return t
