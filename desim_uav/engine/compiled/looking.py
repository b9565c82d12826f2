"""The changes of class on a drone's leg in the compiled engine."""

from __future__ import annotations

from typing import Any

from desim_uav.engine.compiled.standing import recall, stand
from desim_uav.model.geometry.coverage import (
    LEG,
    SEEN_ROWS,
    Buckets,
    DroneLeg,
    Users,
    leg_near,
    look_around,
    sort_into_buckets,
    walked,
)
from desim_uav.model.geometry.crossings import crossings, crossings_near
from desim_uav.model.geometry.relative import TIME_US, USER
from desim_uav.model.mobility.walking import LEG_COLUMNS
from desim_uav.model.radio.between import WINDOW_COLUMNS, Climb, class_changes_between
from desim_uav.model.radio.fits import TERM_COLUMNS
from desim_uav.model.radio.nested import CHANGE, class_changes
from desim_uav.rowcode.compiled_rows import as_array, call, call_for_int, place_of, set_word
from desim_uav.rowcode.kernels import kernel, rule, stands_in_for
from desim_uav.rules import coverage as seam
from desim_uav.rules import spots
from desim_uav.rules.rows import Constants, Drone, Path, State
from desim_uav.rules.transits import began_us, flight_of, way_of
from desim_uav.rules.words import LOST

CHANGE_COLUMNS, PIECE_COLUMNS = 3, 4


@stands_in_for(seam.look_anew)
def _look_anew(world: Any, path: Any, state: Any) -> Any:
    def look_anew(world: Any, path: Any, state: Any) -> None:
        look = state.look
        look.from_us = look.to_us = look.walked_us = -1
        look.stand = stand(world, path)
        look.walking.begun = look.walking.lost = look.air.marks_lost = 0
        for k in range(len(look.air.marks_at)):
            look.air.marks_at[k] = 0

    return look_anew


@kernel
def foresee(world: Constants, path: Path, state: State, drone: Drone, span_us: int) -> None:
    """Foresee the changes of class on a drone's leg (see ``rules.coverage.track``)."""
    ahead = drone.ahead
    if state.look.stand and drone.serving and span_us == world.step_us:
        recall(world, state, drone)
        return
    count = _find(world, path, state, drone, span_us)
    if count > ahead.buffer:
        set_word(ahead, 3, 1)
        count = ahead.buffer
    set_word(ahead, 1, count)
    rows = as_array(ahead, (count, CHANGE_COLUMNS))
    if world.radios[drone.radio].classes == 1:
        sort_last_first(rows)
        return
    found = as_array(state.look.found, (count, CHANGE_COLUMNS))
    spread_last_first(found, as_array(state.look.order, (count,)), rows)


@rule
def know_walks(world: Constants, path: Path, state: State, start_us: int, end_us: int) -> None:
    """Draw the users' walks in a span, if they walk step by step and it is not known yet."""
    look, walking = state.look, state.look.walking
    if path.stepwise and not walking.lost and look.walked_us != end_us:
        look.walked_us = end_us
        homes, streams = place_of(world.homes), place_of(path.streams)
        model = world.mobility_values
        call(world.walk, (model, place_of(walking), homes, streams, start_us, end_us))


@stands_in_for(spots.find_users)
def _find_users(world: Any, path: Any, state: Any) -> Any:
    def find_users(world: Any, path: Any, state: Any) -> None:
        look, now_us, count = state.look, state.now_us, len(state.users)
        if look.stand and state.step > 0:
            return  # all users still are where they were
        know_walks(world, path, state, now_us, now_us)
        if path.stepwise:
            if look.walking.lost:
                state.faults |= LOST
                return
            rows, begins = look.walking.legs, look.walking.legs_at
        else:
            rows, begins = path.legs, path.legs_at
        legs = as_array(rows, (len(rows) // LEG_COLUMNS, LEG_COLUMNS))
        for user in range(count):
            begin, stop = begins[user], begins[user + 1]
            if stop > begin:  # else there was no memory for the user's legs
                guess = stop - 1 if path.stepwise else begin + int(look.users[LEG * count + user])
                leg = leg_near(legs, begin, stop, now_us, guess)
                state.spots[user].x_m, state.spots[user].y_m = walked(legs, leg, now_us)

    return find_users


@rule
def _find(world: Constants, path: Path, state: State, drone: Drone, span_us: int) -> int:
    """Find the changes on a drone's leg; return their number, which may exceed the buffer.

    They are written to ``drone.ahead``, or to ``state.look.found`` if links have several classes.
    """
    look = state.look
    start_us, end_us = began_us(state, drone), state.now_us + span_us
    know_walks(world, path, state, state.now_us, end_us)
    if path.stepwise and look.walking.lost:
        state.faults |= LOST
        return 0
    users, buckets = _users_of(path, state), _buckets_of(world, state)
    in_buckets = len(look.heads) > 0
    if look.from_us != start_us or look.to_us != end_us:
        look_around(users, start_us, end_us)
        look.from_us, look.to_us = start_us, end_us
        if in_buckets:
            look.far_m = sort_into_buckets(users.seen, buckets)
    radio, ahead = world.radios[drone.radio], drone.ahead
    groups = len(radio.rings) // (radio.levels * radio.classes)
    rings = as_array(radio.rings, (radio.levels, groups, radio.classes))[drone.level]
    if (drone.level != drone.to_level and len(radio.terms) > 0) or not _is_disc(rings):
        return call_for_int(world.find_in_classes, (world, path, state, drone, span_us))
    leg = _leg_of(world, state, drone, span_us, rings[0, 0])
    found = as_array(ahead, (ahead.buffer, CHANGE_COLUMNS))
    if in_buckets:
        return crossings_near(leg, users, buckets, look.far_m, found)
    return crossings(leg, users, found)


@kernel
def find_in_classes(world: Constants, path: Path, state: State, drone: Drone, span_us: int) -> int:
    """Find what ``_find`` returns where links have classes, or are those of one height only."""
    users, count = _users_of(path, state), len(state.users)
    radio, ahead, look = world.radios[drone.radio], drone.ahead, state.look
    groups = len(radio.rings) // (radio.levels * radio.classes)
    levels = as_array(radio.rings, (radio.levels, groups, radio.classes))
    rings = levels[drone.level]
    leg = _leg_of(world, state, drone, span_us, rings[0, 0])
    found = as_array(ahead, (ahead.buffer, CHANGE_COLUMNS))
    if radio.classes > 1:
        found = as_array(look.found, (ahead.buffer, CHANGE_COLUMNS))
    if drone.level != drone.to_level and len(radio.terms) > 0:
        shape = (groups, radio.classes, radio.slabs, TERM_COLUMNS)
        lower = min(drone.level, drone.to_level)
        bounds_m = as_array(radio.bounds_m, (radio.levels - 1, 2, groups, radio.classes))[lower]
        climb = Climb(
            1.0 if drone.to_level > drone.level else 0.0,
            (rings, levels[drone.to_level]),
            bounds_m[0],
            bounds_m[1],
            as_array(radio.terms, (radio.levels - 1, *shape))[lower],
            as_array(radio.ranges, (radio.levels - 1, groups, radio.slabs, 2, radio.classes))[
                lower
            ],
            as_array(look.windows, (len(look.windows) // WINDOW_COLUMNS, WINDOW_COLUMNS)),
        )
        return class_changes_between(leg, climb, users, as_array(world.groups, (count,)), found)
    return class_changes(leg, users, rings, as_array(world.groups, (count,)), found)


@rule
def _users_of(path: Path, state: State) -> Any:
    """Return the users' walks, and what is known of them in the present span."""
    rows, begins = path.legs, path.legs_at
    if path.stepwise:
        rows, begins = state.look.walking.legs, state.look.walking.legs_at
    count = len(state.users)
    return Users(
        as_array(rows, (len(rows) // LEG_COLUMNS, LEG_COLUMNS)),
        as_array(begins, (count + 1,)),
        as_array(state.look.users, (SEEN_ROWS, count)),
    )


@rule
def _buckets_of(world: Constants, state: State) -> Any:
    """Return the buckets into which users are sorted by their places, if there are any."""
    heads, following = state.look.heads, state.look.following
    return Buckets(
        (world.buckets_x, world.buckets_y),
        (world.bucket_x_m, world.bucket_y_m),
        as_array(heads, (len(heads),)),
        as_array(following, (len(following),)),
    )


@rule
def _is_disc(rings: Any) -> bool:
    """Return whether one circle is the same for all users: at one height a footprint is."""
    return bool(rings.size == 1 and rings[0, 0] >= 0.0)


@rule
def _leg_of(world: Constants, state: State, drone: Drone, span_us: int, radius_m: float) -> Any:
    """Return a drone's leg until this span is over, with the radius of its footprint."""
    pieces = flight_of(world, drone).pieces
    return DroneLeg(
        as_array(pieces, (len(pieces), PIECE_COLUMNS)),
        way_of(world, drone),
        (began_us(state, drone), state.now_us + span_us),
        radius_m,
        drone.serving == 0,
        drone.course.z1_m - drone.course.z0_m,
    )


@rule
def spread_last_first(rows: Any, places: Any, out: Any) -> None:
    """Write changes with the latest first. Rows should be in the order of their users.

    They are spread over as many stretches of time as there are rows, and then sorted. ``places``
    (rows,) is memory: the number of rows in each stretch, and then where its next row is written.
    """
    count = len(rows)
    if count == 0:
        return
    earliest = latest = rows[0, TIME_US]
    for k in range(count):
        earliest, latest = min(earliest, rows[k, TIME_US]), max(latest, rows[k, TIME_US])
        places[k] = 0
    scale = (count - 1) / (latest - earliest + 1)
    for k in range(count):
        places[int((latest - rows[k, TIME_US]) * scale)] += 1
    begins = 0
    for k in range(count):
        begins, places[k] = begins + places[k], begins
    for k in range(count - 1, -1, -1):
        at = int((latest - rows[k, TIME_US]) * scale)
        for column in range(CHANGE_COLUMNS):
            out[places[at], column] = rows[k, column]
        places[at] += 1
    if count > MANY:
        sort_last_first(out)
    else:
        _sort_by_gap(out, 1)


MANY = 256
"""So many changes are sorted by Shellsort even if they have been spread, for they may be uneven."""


GAPS = (1750, 701, 301, 132, 57, 23, 10, 4, 1)
"""The distances between entries that Shellsort compares, from pass to pass (Ciura, 2001)."""


@rule
def sort_last_first(rows: Any) -> None:
    """Sort changes with the latest first, by Shellsort."""
    for gap in GAPS:
        _sort_by_gap(rows, gap)


@rule
def _sort_by_gap(rows: Any, gap: int) -> None:
    """Sort all changes that are so far apart in a table with the latest first, by insertion."""
    for k in range(gap, len(rows)):
        at = k
        t_us, user, change = rows[k, TIME_US], rows[k, USER], rows[k, CHANGE]
        while at >= gap and _is_later(t_us, user, change, rows, at - gap):
            for column in range(CHANGE_COLUMNS):
                rows[at, column] = rows[at - gap, column]
            at -= gap
        rows[at, TIME_US], rows[at, USER], rows[at, CHANGE] = t_us, user, change


@rule
def _is_later(t_us: int, user: int, change: int, rows: Any, other: int) -> Any:
    """Return whether a change comes after another: by time, rises after falls, by user."""
    if t_us != rows[other, TIME_US]:
        return t_us > rows[other, TIME_US]
    rises = change > 0
    if rises != (rows[other, CHANGE] > 0):
        return rises
    return user > rows[other, USER]
