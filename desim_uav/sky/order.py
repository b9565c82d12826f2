"""Changes of class in the order in which they are taken: the latest first."""

from __future__ import annotations

from desim_uav.rowcode.kernels import rule
from desim_uav.rowcode.rows import Table
from desim_uav.sky.rows import Change

MANY = 256
"""So many changes are sorted by Shellsort even if they have been spread, for they may be uneven."""

GAPS = (1750, 701, 301, 132, 57, 23, 10, 4, 1)
"""The distances between entries that Shellsort compares, from pass to pass (Ciura, 2001)."""


@rule
def spread_last_first(
    rows: Table[Change], count: int, places: Table[int], out: Table[Change]
) -> None:
    """Write the first rows with the latest first. They should be in the order of their users.

    They are spread over as many stretches of time as there are rows, and then sorted. ``places``
    (rows,) is memory: the number of rows in each stretch, and then where its next row is written.
    """
    if count == 0:
        return
    earliest = latest = rows[0].t_us
    for k in range(count):
        earliest, latest = min(earliest, rows[k].t_us), max(latest, rows[k].t_us)
        places[k] = 0
    scale = (count - 1) / (latest - earliest + 1)
    for k in range(count):
        places[int((latest - rows[k].t_us) * scale)] += 1
    begins = 0
    for k in range(count):
        begins, places[k] = begins + places[k], begins
    for k in range(count - 1, -1, -1):
        at = int((latest - rows[k].t_us) * scale)
        _copy(rows[k], out[places[at]])
        places[at] += 1
    if count > MANY:
        sort_last_first(out, count)
    else:
        _sort_by_gap(out, count, 1)


@rule
def sort_last_first(rows: Table[Change], count: int) -> None:
    """Sort the first rows with the latest first, by Shellsort."""
    for gap in GAPS:
        _sort_by_gap(rows, count, gap)


@rule
def _sort_by_gap(rows: Table[Change], count: int, gap: int) -> None:
    """Sort all changes that are so far apart in a table with the latest first, by insertion."""
    for k in range(gap, count):
        at, t_us, user, change = k, rows[k].t_us, rows[k].user, rows[k].change
        while at >= gap and _is_later(t_us, user, change, rows[at - gap]):
            _copy(rows[at - gap], rows[at])
            at -= gap
        rows[at].t_us, rows[at].user, rows[at].change = t_us, user, change


@rule
def _copy(one: Change, other: Change) -> None:
    other.t_us, other.user, other.change = one.t_us, one.user, one.change


@rule
def _is_later(t_us: int, user: int, change: int, other: Change) -> bool:
    """Return whether a change comes after another: by time, rises after falls, by user."""
    if t_us != other.t_us:
        return t_us > other.t_us
    rises = change > 0
    if rises != (other.change > 0):
        return rises
    return user > other.user
