"""Changes of links in a span of time: classes with interference, and which of two is stronger.

The kernels here are for all path losses, lines of sight and motions: drones climb, fly at an angle
and accelerate, and users walk. They need more time than rings (``model.radio.nested``), which hold
where a drone keeps its altitude and nothing interferes. Wherever a class is not the true one, the
ratio is within ``TOLERANCE_DB`` of a threshold.
"""

from __future__ import annotations

import numpy as np

from desim_uav.model.geometry.coverage import leg_at, walked
from desim_uav.model.geometry.polynomial import Coefficients, sign_changes, square_of, value_at
from desim_uav.model.geometry.relative import rounded_us
from desim_uav.model.radio.links import (
    OTHER,
    SIGNAL,
    Air,
    Link,
    are_a_pair,
    are_clear,
    begin_again,
    class_at,
    compare,
    look,
    note,
    ratio_db,
    sign,
)
from desim_uav.model.radio.passing import SOON_S
from desim_uav.model.radio.quick import bound_quickly, search_quickly
from desim_uav.model.radio.search import search
from desim_uav.model.radio.spans import (
    bound_high,
    bound_span,
    bound_steepness,
    is_too_weak,
    look_from,
    stays_apart,
    stays_in,
)
from desim_uav.model.radio.stretches import relate, take_first_rows, take_rows
from desim_uav.model.radio.tracks import Walkers
from desim_uav.rowcode.kernels import kernel, rule

GRAZE = 1e-14
"""How close to zero a difference of squared distances, relative to them, is taken to be zero; an
extremum that is so close touches zero without a change of sign."""


@kernel
def find_classes(air: Air, users: Walkers, span_us: tuple[int, int], user: int) -> None:
    """Write all changes of a user's classes in a span.

    The class of a link is how many of the radio's thresholds the ratio of the signal to noise and
    interference has reached. All links that are ``used`` interfere, from the start of the span to
    its end. Classes at both ends of the span depend on the places there only, and changes in one
    microsecond are one, or cancel. For where they are written see ``note``.
    """
    look_from(air, users, span_us, user)
    sought = -1
    if air.links[SIGNAL].curve_count > 0 and span_us[1] > span_us[0]:
        sought = bound_quickly(air, span_us[0])
    if sought < 0:
        sought = _bound(air, span_us)
    elif sought > 0 and _follow(air, users, span_us, user, False, True):
        sought = 0
    else:
        for k in range(air.used):
            if air.links[k].sought:
                begin_again(air.links[k])
    if sought > 0:
        _follow(air, users, span_us, user, False, False)
    for k in range(air.used):
        if air.links[k].out != 0:
            sign(air.links[k], user)


@rule
def _bound(air: Air, span_us: tuple[int, int]) -> int:
    """Note which signals keep their class in a span, and return how many others are sought."""
    sought = 0
    for k in range(air.used):
        air.links[k].sought = int(air.links[k].out != 0)
        bound_high(air, k)
        sought += _seeks(air, k, is_too_weak(air, k) - 1, span_us)
    if sought > 0:
        bound_span(air)
        sought = 0
        for k in range(air.used):
            if air.links[k].sought:
                sought += _seeks(air, k, stays_in(air, k), span_us)
    return sought


@rule
def _seeks(air: Air, k: int, state: int, span_us: tuple[int, int]) -> int:
    """Write the class of a signal if it stays the same; return 1 if its changes are still sought.

    The class is below 0 if bounds do not show that it stays.
    """
    link = air.links[k]
    if link.sought and state >= 0:
        note(link, span_us[0], state)
        link.sought = 0
    return link.sought


@kernel
def find_better(
    air: Air, users: Walkers, span_us: tuple[int, int], user: int, threshold_db: float
) -> None:
    """Write when a user receives the first of two links stronger than the other by a threshold.

    The class of the first one is 1 where its level exceeds that of the other by ``threshold_db`` or
    more, and else 0; noise and interference do not matter. If it is not known before the span (-1),
    a change at the start of the span says what it is then. It is not said if the class is as before
    a microsecond later, because times are rounded.

    If levels are equal where distances are, the times are roots of polynomials, and exact. Else,
    levels that rounding may have made different are equal (``EQUAL_DB``): where two drones part
    from one place, the class changes there if it does at all.
    """
    if threshold_db == 0.0 and _are_alike(air, users, user):
        _follow(air, users, span_us, user, True, False)
        return
    look_from(air, users, span_us, user)
    for k in range(air.used):
        bound_high(air, k)
    state = stays_apart(air, threshold_db)
    if state >= 0:
        note(air.links[SIGNAL], span_us[0], state)
    else:
        _follow(air, users, span_us, user, False, False)


@kernel
def _follow(
    air: Air, users: Walkers, span_us: tuple[int, int], user: int, exact: bool, quick: bool
) -> bool:
    """Write the changes of a user's classes in a span, of those signals that are sought.

    If ``exact``, the ratio is that of two levels, and passes 0 dB where distances are equal. If
    ``quick``, curves decide, and False is returned if they cannot.
    """
    legs = users.legs
    start_us, end_us = span_us
    end = (end_us - start_us) * 1e-6
    after = users.legs_at[user + 1]
    leg = leg_at(legs, users.legs_at[user], after, start_us)
    t, now_us, is_begun = 0.0, float(start_us), False
    take_first_rows(air, len(users.heights_m), user)
    while True:
        begins, marked = take_rows(air, t)
        if is_begun and t >= end and not marked and not exact and (quick or are_clear(air)):
            return True
        turn = np.inf if leg + 1 == after else (legs[leg + 1].begin_us - start_us) * 1e-6
        x, y = walked(legs[leg], now_us)
        relate(air, t, (x, y, users.heights_m[user]), (legs[leg].vx_mps, legs[leg].vy_mps))
        if not quick:
            _begin_stretch(air, t, end, marked, is_begun, exact)
        is_begun = True
        if t >= end:
            return True
        until = min(end, begins, turn)
        if until > t and not _search_stretch(air, t, until - t, exact, quick):
            return False
        t, now_us = until, float(end_us) if until == end else start_us + until * 1e6
        if turn <= t:
            leg += 1
            if until != end:
                now_us = legs[leg].begin_us


@rule
def _begin_stretch(
    air: Air, t: float, end: float, marked: bool, is_begun: bool, exact: bool
) -> None:
    """Look at the start of a stretch if it is the first one, the end, or one where marks are."""
    if not is_begun and not exact:
        bound_steepness(air)
    if marked or not is_begun or t >= end:
        _note_classes(air, t, exact, are_a_pair(air) and end > SOON_S)


@rule
def _search_stretch(air: Air, t: float, lasts: float, exact: bool, quick: bool) -> bool:
    """Write the changes within a stretch; return False if curves were to decide and cannot."""
    if exact:
        _pass(air, (t, lasts))
        return True
    if quick:
        return search_quickly(air, t, lasts)
    search(air, t, lasts)
    return True


@kernel
def _note_classes(air: Air, t: float, exact: bool, soon: bool) -> None:
    """Look at the start of a stretch, and write the classes that have changed.

    If ``soon``, those at the start of the span count as changed if they are so soon after it, too.
    """
    if not exact:
        look(air, 0, 0.0)
    for k in range(air.used):
        link = air.links[k]
        if link.sought:
            value = _closer(air, 0.0) if exact else compare(air, 0, k)
            state = class_at(air, k, value)
            if t == 0.0 and soon and state != link.held and link.out != 0:
                value = _closer(air, SOON_S) if exact else ratio_db(air, k, SOON_S)
                if class_at(air, k, value) == link.held:
                    state = link.held
            if state != link.state:
                note(link, rounded_us(air.start_us, t), state)
            link.state = state


# ---- pairs whose levels are equal where their distances are


@rule
def _are_alike(air: Air, users: Walkers, user: int) -> bool:
    """Return whether two links have the same power and loss, and both drones keep one height."""
    take_first_rows(air, len(users.heights_m), user)
    one, other = air.links[SIGNAL], air.links[OTHER]
    alike = one.radio == other.radio
    alike &= one.branch == other.branch and one.base_dbm == other.base_dbm
    for k in range(2):
        link = air.links[k]
        alike &= link.mark >= link.last_mark
        for row in range(link.first, link.after):
            alike &= air.tracks[row].z_m == air.tracks[one.first].z_m
            alike &= air.tracks[row].vz_mps == 0.0
    return bool(alike)


@rule
def _closer(air: Air, t: float) -> float:
    """Return by how much the first of two transmitters is closer, in square metres.

    It is 0 if rounding may be what makes it another number.
    """
    near, far = value_at(_square(air.links[SIGNAL]), t), value_at(_square(air.links[OTHER]), t)
    return far - near if abs(far - near) > GRAZE * (near + far) else 0.0


@rule
def _square(link: Link) -> Coefficients:
    """Return the squared distance as a polynomial of the time since the start of the stretch."""
    at, speed = (link.x_m, link.y_m, link.z_m), (link.vx_mps, link.vy_mps, link.vz_mps)
    return square_of(at, speed, (link.ax_mps2, link.ay_mps2, link.az_mps2))


@rule
def _stay_level(air: Air, lasts: float) -> bool:
    """Return whether two transmitters are equally close from the start of a stretch on."""
    return bool(_closer(air, 0.0) == 0.0 and _closer(air, 0.5 * lasts) == 0.0)


@kernel
def _pass(air: Air, stretch: tuple[float, float]) -> None:
    """Write when the first of two transmitters becomes or ceases to be the closer one.

    It becomes so as well where the two meet in one place, and stay there.
    """
    begin, lasts = stretch
    link = air.links[SIGNAL]
    near, far = _square(link), _square(air.links[OTHER])
    c = (
        near[0] - far[0],
        near[1] - far[1],
        near[2] - far[2],
        near[3] - far[3],
        near[4] - far[4],
    )
    if link.state == 0 and _stay_level(air, lasts):
        note(link, rounded_us(air.start_us, begin), 1)
        link.state = 1
    state = link.state
    count, roots = sign_changes(c, state == 0, lasts, GRAZE * (near[0] + far[0]))
    for i in range(count):
        state = 1 - state
        note(link, rounded_us(air.start_us, begin + roots[i]), state)
    link.state = state
