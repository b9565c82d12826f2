"""The times at which buildings begin and cease to block the line between a user and a drone.

A building (``model.radio.buildings``) blocks the line if it contains a stretch of it; a line that
only touches a wall, an edge or a roof is clear.

Whether a building blocks the line can only change when, in plan, the line passes a corner of the
footprint, when it passes over a wall at just the height of the roof, or when the user or the drone
passes a wall or the level of the roof (``model.radio.shadows``).
"""

from __future__ import annotations

from desim_uav.model.geometry.relative import rounded_us
from desim_uav.model.radio.buildings import Buffers, Buildings, Stretch
from desim_uav.model.radio.shadows import add_stretch, stretches_of
from desim_uav.model.radio.sweeps import (
    BESIDE_M,
    Line,
    Window,
    bucket_of,
    keeps_blocking,
    line_at,
    may_block,
    range_at,
    rows_of,
    share_below,
    shares,
    sweep_of,
    window_of,
)
from desim_uav.model.radio.tracks import (
    Rows,
    TrackRow,
    Turn,
    next_s,
    note,
    pulled,
    row_at,
    velocity,
)
from desim_uav.rowcode.kernels import kernel, part
from desim_uav.rowcode.rows import Table

BLOCKED, CLEAR = 0, 1
"""The states of a line of sight."""

GAP_S = 1e-7
"""Stretches of time shorter than this, clear or blocked, are neglected, because they come from the
rounding of two equal times, as where a line passes from one building to the next."""

FEW = 2
"""If no more buildings than this may block a line in a window of time, it is not halved."""

WIDELY, NARROWLY, EXACTLY = range(3)
"""How buildings are looked for in a window: see ``_look_in``."""

HALVINGS = 4
"""How often a window of time is halved at most."""


@kernel
def sight_changes(
    tracks: Table[TrackRow],
    user: Rows,
    drone: Rows,
    buildings: Buildings,
    buffers: Buffers,
    span_us: tuple[int, int],
    initial: int,
    out: Table[Turn],
) -> int:
    """Write when the line between a user and a drone becomes blocked or clear.

    ``user`` and ``drone`` are their tracks in ``tracks`` (not relative), of the same span; between
    two rows the drone flies straight on and does not turn back. Turns go into ``out``.
    ``initial`` is the state before the span: a row at its start says if it is another one there.
    States at both ends of the span depend on the places there only, and changes in one microsecond
    cancel.

    Returns the number of rows; if ``out`` is too short, it is larger than its length, and with that
    many rows it is long enough. If ``buffers.blocked`` is too short, returns minus the number of
    rows that it needs.
    """
    i, j = user[0], drone[0]
    rows = note(
        out, 0, initial, span_us[0], state_at(tracks[i], tracks[j], 0.0, buildings, buffers)
    )
    if _is_still(tracks, user) and _is_still(tracks, drone):
        return rows
    end = tracks[user[1] - 1].begin_s
    at, stretches = 0.0, 0
    while at < end:
        i = row_at(tracks, i, user[1], at)
        j = row_at(tracks, j, drone[1], at)
        until = next_s(tracks, j, drone[1], next_s(tracks, i, user[1], end))
        stretches = _look(
            line_at(tracks[i], tracks[j], at), at, until, buildings, buffers, stretches
        )
        at = until
    if stretches > len(buffers.blocked):
        return -stretches
    blocked = buffers.blocked
    _sort(blocked, stretches)
    k, clear = 0, 0.0
    while k < stretches:
        since, until = blocked[k].since_s, blocked[k].until_s
        k += 1
        while k < stretches and blocked[k].since_s <= until + GAP_S:
            until = max(until, blocked[k].until_s)
            k += 1
        if until - since > GAP_S:
            if since - clear > GAP_S:
                rows = note(out, rows, initial, rounded_us(span_us[0], clear), CLEAR)
            rows = note(out, rows, initial, rounded_us(span_us[0], since), BLOCKED)
            clear = until
    if clear < end:
        rows = note(out, rows, initial, rounded_us(span_us[0], clear), CLEAR)
    last = state_at(tracks[user[1] - 1], tracks[drone[1] - 1], end, buildings, buffers)
    return note(out, rows, initial, span_us[1], last)


@part
def _is_still(tracks: Table[TrackRow], rows: Rows) -> bool:
    """Return whether a track keeps one place, of which no row differs by a rounding error."""
    first = tracks[rows[0]]
    for k in range(rows[0], rows[1]):
        one = tracks[k]
        if one.x_m != first.x_m or one.y_m != first.y_m or one.z_m != first.z_m:
            return False
        if velocity(one, one.begin_s) != (0.0, 0.0, 0.0) or pulled(one) != (0.0, 0.0, 0.0):
            return False
    return True


@kernel
def state_at(
    user: TrackRow, drone: TrackRow, t: float, buildings: Buildings, buffers: Buffers
) -> int:
    """Return the state of a line at a time, from rows of the tracks of the user and the drone."""
    line = line_at(user, drone, t)
    return BLOCKED if _look(line, t, t, buildings, buffers, 0) > 0 else CLEAR


@kernel
def _look(
    line: Line, at: float, until: float, buildings: Buildings, buffers: Buffers, count: int
) -> int:
    """Add the stretches of time in which buildings block a line; return how many there are then.

    Only the times that matter are computed: those of buildings that may block the line in a window
    of time in which no single building blocks it throughout. Windows with more than ``FEW`` such
    buildings are halved, ``HALVINGS`` times at most. A building that blocks the line throughout a
    window is followed for as long as it does, and what a stretch covers is not looked at again.
    Rows that the buffers cannot hold are counted only.
    """
    end = until - at
    if not end > 0.0:
        instant = window_of(line, 0.0, 0.0)
        after, keeper = _look_in(line, at, until, instant, EXACTLY, buildings, buffers, count)
        return after if keeper < 0 else add_stretch(buffers, after, at, at)
    since, width, least = 0.0, end, end * 0.5**HALVINGS
    while since < end:
        stop = since + width if since + width < end - 0.5 * least else end
        window, how = window_of(line, since, stop), WIDELY if width > least else NARROWLY
        after, keeper = _look_in(line, at, until, window, how, buildings, buffers, count)
        if after < 0 and how == NARROWLY:
            after, keeper = _look_in(line, at, until, window, EXACTLY, buildings, buffers, count)
        if after < 0:
            width *= 0.5
        elif keeper >= 0:
            since = _follow(line, window, end, least, buildings, keeper)
            count = add_stretch(buffers, after, at + window.since_s, at + since)
        else:
            since, width = _covered(buffers, count, after, at, stop, end), 2.0 * width
            count = after
    return count


@part
def _follow(
    line: Line, window: Window, end: float, least: float, buildings: Buildings, b: int
) -> float:
    """Return until when it is certain that a building blocks a line, from a window on."""
    since = window.until_s
    width = since - window.since_s
    while since < end and width >= least:
        stop = since + width if since + width < end - 0.5 * least else end
        if keeps_blocking(window_of(line, since, stop), buildings, b):
            since, width = stop, 2.0 * width
        else:
            width *= 0.5
    return since


@part
def _covered(
    buffers: Buffers, begun: int, count: int, at: float, since: float, end: float
) -> float:
    """Return until when the stretches from row ``begun`` on block a line, from a time on."""
    for k in range(begun, min(count, len(buffers.blocked))):
        stretch = buffers.blocked[k]
        if stretch.since_s <= at + since < stretch.until_s:
            since = stretch.until_s - at if stretch.until_s < at + end else end
    return since


@kernel
def _look_in(
    line: Line,
    at: float,
    until: float,
    window: Window,
    how: int,
    buildings: Buildings,
    buffers: Buffers,
    count: int,
) -> tuple[int, int]:
    """Add the stretches of buildings that matter in a window; return how many there are then.

    Also returns a building that blocks the line throughout the window, of which none are added, or
    else -1. Both numbers are -1 if more than ``FEW`` others may block it, unless the search is done
    EXACTLY; if it is done WIDELY, it ends as soon as this is known. Looked at are the buildings in
    the buckets that the line sweeps, those near the user first. Only the part of the line below the
    tallest roof counts, and in each row of buckets only the buildings that are higher than the line
    is there.
    """
    (ux, uy, uz), (tx, ty, tz), (px, py, pz), (qx, qy, qz) = (
        window.one,
        window.other,
        window.start,
        window.stop,
    )
    low, high = min(uz, tz), min(pz, qz)
    share = share_below(low, high, buildings.tallest_m)
    if share < 0.0:
        return count, -1
    begun, partly, others = count, 0, (-1, -1)
    stamp = buffers.visited[len(buffers.visited) - 1] + 1
    buffers.visited[len(buffers.visited) - 1] = stamp
    along, across = sweep_of(ux, tx, px, qx, share), sweep_of(uy, ty, py, qy, share)
    (count_along, count_across), (side, side_across) = buildings.shape, buildings.side_m
    stride, stride_across = count_across, 1
    if abs(across.goes) > abs(along.goes):
        along, across = across, along
        count_along, count_across = count_across, count_along
        side, side_across = side_across, side
        stride, stride_across = 1, stride
    first, last, step = rows_of(along, side, count_along)
    for i in range(first, last + step, step):
        begin, end = shares(along, i, side, count_along)
        if begin > end:
            continue
        over_m = low + (high - low) * share * (begin if high > low else end) - BESIDE_M
        (one, other), (width, far) = range_at(across, begin), range_at(across, end)
        south = bucket_of(min(one, width), side_across, count_across)
        north = bucket_of(max(other, far), side_across, count_across)
        for j in range(south, north + 1):
            bucket = i * stride + j * stride_across
            for k in range(buildings.heads[bucket], buildings.heads[bucket + 1]):
                b = buildings.members[k]
                if buildings.roofs_m[b] > over_m and buffers.visited[b] != stamp:
                    buffers.visited[b] = stamp
                    if may_block(window, buildings, b):
                        if keeps_blocking(window, buildings, b):
                            return begun, b
                        if how == EXACTLY:
                            count = stretches_of(line, at, until, buildings, b, buffers, count)
                        elif partly == FEW and how == WIDELY:
                            return -1, -1
                        else:
                            others = (b, others[0])
                            partly += 1
    if partly > FEW:
        return -1, -1
    for k in range(partly):
        count = stretches_of(line, at, until, buildings, others[k], buffers, count)
    return count, -1


@part
def _sort(stretches: Table[Stretch], count: int) -> None:
    """Sort the first stretches of a table by their beginnings."""
    for k in range(1, count):
        since, until, i = stretches[k].since_s, stretches[k].until_s, k
        while i > 0 and stretches[i - 1].since_s > since:
            before = stretches[i - 1]
            stretches[i].since_s, stretches[i].until_s = before.since_s, before.until_s
            i -= 1
        stretches[i].since_s, stretches[i].until_s = since, until
