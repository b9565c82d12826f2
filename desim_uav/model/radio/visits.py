"""The cells of the map in which a transmitter is in a span of time, and from when on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from desim_uav.model.geometry.grid import cell_index
from desim_uav.model.radio.sight import GAP_S
from desim_uav.model.radio.tracks import Rows, TrackRow, place
from desim_uav.rowcode.kernels import kernel, part
from desim_uav.rowcode.rows import Floats, Row, Table, row


@row
class Visit(Row):
    """A cell, and when the transmitter comes to it, in seconds since the start of the span."""

    since_s: float
    cell: int


class Cells(NamedTuple):
    """The cells of a map: their length and their number along x and y."""

    side_m: tuple[float, float]
    shape: tuple[int, int]


class Visits(NamedTuple):
    """The cells in which a transmitter is: at the start, in stretches, and at the end."""

    first: int
    stretches: int
    last: int


@kernel
def visit(
    tracks: Table[TrackRow],
    drone: Rows,
    cells: Cells,
    borders_s: Floats,
    visits: Table[Visit],
) -> Visits:
    """Write in which cells a transmitter is.

    ``borders_s`` is memory for the times at which it passes borders of cells in a row of its track.
    """
    first, count = cell_at(tracks[drone[0]], 0.0, cells), 0
    for at in range(drone[0], drone[1] - 1):
        track, begin = tracks[at], tracks[at].begin_s
        lasts, low = tracks[at + 1].begin_s - begin, 0.0
        x = track.x_m, track.vx_mps, track.ax_mps2
        y = track.y_m, track.vy_mps, track.ay_mps2
        borders = _pass(cells.side_m[0], cells.shape[0], x, lasts, borders_s, 0)
        borders = _pass(cells.side_m[1], cells.shape[1], y, lasts, borders_s, borders)
        for k in range(borders + 1):
            high = borders_s[k] if k < borders else lasts
            if high - low > GAP_S:
                cell = cell_at(track, begin + 0.5 * (low + high), cells)
                if count == 0 or visits[count - 1].cell != cell:
                    visits[count].since_s = begin + low if count > 0 else 0.0
                    visits[count].cell = cell
                    count += 1
            low = high
    last = tracks[drone[1] - 1]
    return Visits(first, count, cell_at(last, last.begin_s, cells))


@part
def cell_at(track: TrackRow, t: float, cells: Cells) -> int:
    """Return the number of the cell in which the transmitter is at a time."""
    x, y, _ = place(track, t)
    (dx, dy), (nx, ny) = cells
    return cell_index(x, dx, nx) * ny + cell_index(y, dy, ny)


@part
def _pass(
    side: float,
    cells: int,
    along: tuple[float, float, float],
    lasts: float,
    times: Floats,
    count: int,
) -> int:
    """Add the times, in order, at which a transmitter passes borders of cells along an axis.

    They are in seconds since the start of a row of its track, in which it does not turn back;
    ``along`` are its place, its speed and its acceleration along the axis then.
    """
    at, speed, pull = along
    to = at + lasts * (speed + 0.5 * lasts * pull)
    low, high = min(at, to), max(at, to)
    for k in range(max(cell_index(low, side, cells), 1), cell_index(high, side, cells) + 1):
        border = k * side
        if low < border < high:
            # The root of a polynomial of degree two: both terms below have the sign of the flight.
            root = np.sqrt(max(speed * speed + 2.0 * pull * (border - at), 0.0))
            t = min(max(2.0 * (border - at) / (speed + (root if to > at else -root)), 0.0), lasts)
            i = count
            while i > 0 and times[i - 1] > t:
                times[i] = times[i - 1]
                i -= 1
            times[i] = t
            count += 1
    return count
