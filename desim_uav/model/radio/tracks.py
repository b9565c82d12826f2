"""Tracks of drones and users in a span of time: pieces of constant acceleration in 3-D.

A track is some rows of a table. The last row is for the end of the span. The first and the last row
of a track hold the same numbers as the last row of the span before and the first row of the span
after, so that both spans decide alike at these times.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from desim_uav.model.geometry.coverage import WalkLeg, leg_at, walked
from desim_uav.rowcode.kernels import kernel, part
from desim_uav.rowcode.rows import Floats, Ints, Row, Table, row

HALF_US = 0.5e-6
"""The end of a flight is rounded to a microsecond: it may be this much before the arrival."""

Rows = tuple[int, int]
"""The first row of a track, and the row after its last one."""

Point = tuple[float, float, float]


@row
class TrackRow(Row):
    """The position, velocity and acceleration from ``begin_s`` on, in seconds since the span."""

    begin_s: float
    x_m: float
    y_m: float
    z_m: float
    vx_mps: float
    vy_mps: float
    vz_mps: float
    ax_mps2: float
    ay_mps2: float
    az_mps2: float


@row
class Turn(Row):
    """The time from which something is in another state."""

    t_us: int
    state: int


class Walkers(NamedTuple):
    """The walks of all users (see ``coverage.Users``), and their heights (users,) in metres."""

    legs: Table[WalkLeg]
    legs_at: Ints
    heights_m: Floats


class Flight(NamedTuple):
    """A straight flight in 3-D, after which the drone hovers.

    ``pieces`` are those of a transit, ``route`` the x, y and z of its start and of its destination,
    in metres, and ``begun_us`` the time of its start.
    """

    pieces: Table[Any]
    route: tuple[float, float, float, float, float, float]
    begun_us: int


@part
def _put(
    tracks: Table[TrackRow], row: int, begin_s: float, at: Point, speed: Point, pull: Point
) -> int:
    """Write a row if there is room for it, and return the number of the next one."""
    if row < len(tracks):
        one = tracks[row]
        one.begin_s = begin_s
        one.x_m, one.y_m, one.z_m = at
        one.vx_mps, one.vy_mps, one.vz_mps = speed
        one.ax_mps2, one.ay_mps2, one.az_mps2 = pull
    return row + 1


@part
def _scaled(direction: Point, by: float) -> Point:
    return direction[0] * by, direction[1] * by, direction[2] * by


@kernel
def fly(flight: Flight, span_us: tuple[int, int], tracks: Table[TrackRow], first: int) -> int:
    """Write the track of a drone from row ``first`` on, and return the row after it.

    It has at most one row more than the flight has pieces. Rows for which there is no room are
    counted only.
    """
    pieces, (x0, y0, z0, x1, y1, z1), begun_us = flight
    length = np.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2 + (z1 - z0) ** 2)
    ahead = (0.0, 0.0, 0.0)
    if length > 0.0:
        ahead = ((x1 - x0) / length, (y1 - y0) / length, (z1 - z0) / length)
    since, until = (span_us[0] - begun_us) * 1e-6, (span_us[1] - begun_us) * 1e-6
    phase = 0
    while phase + 1 < len(pieces) and pieces[phase + 1].start_s <= since + HALF_US:
        phase += 1
    at, begin, row = since, 0.0, first
    for _ in range(len(pieces) + 1):
        piece, arrived = pieces[phase], phase + 1 == len(pieces)
        rest = at - piece.start_s
        pull = 0.0 if arrived else piece.acceleration_mps2
        speed = 0.0 if arrived else piece.speed_mps + pull * rest
        along = piece.from_m + 0.5 * (piece.speed_mps + speed) * rest
        place = (x0 + ahead[0] * along, y0 + ahead[1] * along, z0 + ahead[2] * along)
        if arrived or at + HALF_US >= pieces[len(pieces) - 1].start_s:
            place = (x1, y1, z1)
        row = _put(tracks, row, begin, place, _scaled(ahead, speed), _scaled(ahead, pull))
        if at >= until:
            break
        at, begin = until, (span_us[1] - span_us[0]) * 1e-6
        if not arrived and pieces[phase + 1].start_s + HALF_US < until:
            at = pieces[phase + 1].start_s
            begin = at - since
            while phase + 1 < len(pieces) and pieces[phase + 1].start_s <= at:
                phase += 1
    return row


@kernel
def walk(
    legs: Table[WalkLeg],
    own: Rows,
    height_m: float,
    span_us: tuple[int, int],
    tracks: Table[TrackRow],
    first: int,
) -> int:
    """Write the track of a user from row ``first`` on, and return the row after it.

    ``legs`` are the walks of users (see ``model.geometry.coverage``), of which the user's are
    ``own``. The track has one row for each leg of the span, and one more.
    """
    start_us, end_us = span_us
    still = (0.0, 0.0, 0.0)
    leg = leg_at(legs, own[0], own[1], start_us)
    x, y = walked(legs[leg], start_us)
    speed = (legs[leg].vx_mps, legs[leg].vy_mps, 0.0)
    row = _put(tracks, first, 0.0, (x, y, height_m), speed, still)
    leg += 1
    while leg < own[1] and legs[leg].begin_us < end_us:
        one = legs[leg]
        x, y = walked(one, one.begin_us)
        begin, speed = (one.begin_us - start_us) * 1e-6, (one.vx_mps, one.vy_mps, 0.0)
        row = _put(tracks, row, begin, (x, y, height_m), speed, still)
        leg += 1
    if end_us > start_us:
        x, y = walked(legs[leg_at(legs, own[0], own[1], end_us)], end_us)
        row = _put(tracks, row, (end_us - start_us) * 1e-6, (x, y, height_m), still, still)
    return row


@part
def place(track: TrackRow, t: float) -> Point:
    """Return the position at a time, computed from a row of a track, in metres."""
    s = t - track.begin_s
    h = 0.5 * s
    return (
        track.x_m + s * (track.vx_mps + h * track.ax_mps2),
        track.y_m + s * (track.vy_mps + h * track.ay_mps2),
        track.z_m + s * (track.vz_mps + h * track.az_mps2),
    )


@part
def velocity(track: TrackRow, t: float) -> Point:
    """Return the velocity at a time, computed from a row of a track, in metres per second."""
    s = t - track.begin_s
    return (
        track.vx_mps + s * track.ax_mps2,
        track.vy_mps + s * track.ay_mps2,
        track.vz_mps + s * track.az_mps2,
    )


@part
def pulled(track: TrackRow) -> Point:
    """Return the acceleration in a row of a track, in m/s²."""
    return track.ax_mps2, track.ay_mps2, track.az_mps2


@part
def row_at(tracks: Table[TrackRow], first: int, last: int, t: float) -> int:
    """Return the last row in ``first`` … ``last`` - 1 that has begun at a time."""
    row = first
    while row + 1 < last and tracks[row + 1].begin_s <= t:
        row += 1
    return row


@part
def next_s(tracks: Table[TrackRow], row: int, last: int, end_s: float) -> float:
    """Return when the next row of a track begins, at most ``end_s``."""
    return min(end_s, tracks[row + 1].begin_s) if row + 1 < last else end_s


@part
def note(out: Table[Turn], rows: int, initial: int, t_us: int, state: int) -> int:
    """Write that a link is in another state from ``t_us`` on, and return the number of rows.

    ``initial`` is the state before the first row. Changes in one microsecond become one, or none if
    they cancel. Rows for which there is no room are counted only, some of them more than once.
    """
    before = initial
    if 0 < rows <= len(out):
        before = out[rows - 1].state
        if out[rows - 1].t_us == t_us:
            rows -= 1
            before = out[rows - 1].state if rows > 0 else initial
    if state == before:
        return rows
    if rows < len(out):
        out[rows].t_us, out[rows].state = t_us, state
    return rows + 1
