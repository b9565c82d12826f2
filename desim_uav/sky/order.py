"""Changes of class in the order in which they are taken: the latest first."""

from __future__ import annotations

from typing import Any

from desim_uav.model.geometry.relative import TIME_US, USER
from desim_uav.model.radio.nested import CHANGE
from desim_uav.rowcode.kernels import rule

CHANGE_COLUMNS = 3
"""The number of columns of a table of changes."""


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
