"""Tracks of drones and users in a span of time: pieces of constant acceleration in 3-D.

A track is some rows of a table. Each row has the position, the velocity and the acceleration from
BEGIN on, in seconds since the start of the span. The last row is for the end of the span. The first
and the last row of a track hold the same numbers as the last row of the span before and the first
row of the span after, so that both spans decide alike at these times.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.coverage import T0_US, VX, VY, leg_at, walked
from desim_uav.model.motion.motion import ACCELERATION, DISTANCE, SPEED, START
from desim_uav.rowcode.kernels import kernel, part

BEGIN, AT = 0, 1
SPEED_AT, PULL_AT = 4, 7
TRACK_COLUMNS = 10
"""The columns of a table of tracks, and their number: BEGIN, then x, y and z of the position (m),
the velocity (m/s) and the acceleration (m/s²)."""

HALF_US = 0.5e-6
"""The end of a flight is rounded to a microsecond: it may be this much before the arrival."""

Rows = tuple[int, int]
"""The first row of a track, and the row after its last one."""

Point = tuple[float, float, float]


class Flight(NamedTuple):
    """A straight flight in 3-D, after which the drone hovers.

    ``profile`` (pieces, 4) is that of a transit (see ``model.motion.motion``), ``route`` the x, y
    and z of its start and of its destination, in metres, and ``begun_us`` the time of its start.
    """

    profile: NDArray[np.float64]
    route: tuple[float, float, float, float, float, float]
    begun_us: int


@part
def _put(
    tracks: NDArray[np.float64], row: int, begin: float, at: Point, speed: Point, pull: Point
) -> int:
    """Write a row if there is room for it, and return the number of the next one."""
    if row < len(tracks):
        tracks[row, BEGIN] = begin
        for k in range(3):
            tracks[row, AT + k] = at[k]
            tracks[row, SPEED_AT + k] = speed[k]
            tracks[row, PULL_AT + k] = pull[k]
    return row + 1


@part
def _scaled(direction: Point, by: float) -> Point:
    return direction[0] * by, direction[1] * by, direction[2] * by


@kernel
def fly(flight: Flight, span_us: tuple[int, int], tracks: NDArray[np.float64], first: int) -> int:
    """Write the track of a drone from row ``first`` on, and return the row after it.

    It has at most one row more than the profile. Rows for which there is no room are counted only.
    """
    profile, (x0, y0, z0, x1, y1, z1), begun_us = flight
    length = np.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2 + (z1 - z0) ** 2)
    ahead = (0.0, 0.0, 0.0)
    if length > 0.0:
        ahead = ((x1 - x0) / length, (y1 - y0) / length, (z1 - z0) / length)
    since, until = (span_us[0] - begun_us) * 1e-6, (span_us[1] - begun_us) * 1e-6
    phase = 0
    while phase + 1 < len(profile) and profile[phase + 1, START] <= since + HALF_US:
        phase += 1
    at, begin, row = since, 0.0, first
    for _ in range(len(profile) + 1):
        arrived = phase + 1 == len(profile)
        rest = at - profile[phase, START]
        pull = 0.0 if arrived else profile[phase, ACCELERATION]
        speed = 0.0 if arrived else profile[phase, SPEED] + pull * rest
        along = profile[phase, DISTANCE] + 0.5 * (profile[phase, SPEED] + speed) * rest
        place = (x0 + ahead[0] * along, y0 + ahead[1] * along, z0 + ahead[2] * along)
        if arrived or at + HALF_US >= profile[len(profile) - 1, START]:
            place = (x1, y1, z1)
        row = _put(tracks, row, begin, place, _scaled(ahead, speed), _scaled(ahead, pull))
        if at >= until:
            break
        at, begin = until, (span_us[1] - span_us[0]) * 1e-6
        if not arrived and profile[phase + 1, START] + HALF_US < until:
            at = profile[phase + 1, START]
            begin = at - since
            while phase + 1 < len(profile) and profile[phase + 1, START] <= at:
                phase += 1
    return row


@kernel
def walk(
    legs: NDArray[np.float64],
    own: Rows,
    height_m: float,
    span_us: tuple[int, int],
    tracks: NDArray[np.float64],
    first: int,
) -> int:
    """Write the track of a user from row ``first`` on, and return the row after it.

    ``legs`` are the walks of users (see ``model.geometry.coverage``), of which the user's are
    ``own``. The track has one row for each leg of the span, and one more.
    """
    start_us, end_us = span_us
    still = (0.0, 0.0, 0.0)
    leg = leg_at(legs, own[0], own[1], start_us)
    x, y = walked(legs, leg, start_us)
    row = _put(tracks, first, 0.0, (x, y, height_m), (legs[leg, VX], legs[leg, VY], 0.0), still)
    leg += 1
    while leg < own[1] and legs[leg, T0_US] < end_us:
        begin = (legs[leg, T0_US] - start_us) * 1e-6
        x, y = walked(legs, leg, legs[leg, T0_US])
        speed = (legs[leg, VX], legs[leg, VY], 0.0)
        row = _put(tracks, row, begin, (x, y, height_m), speed, still)
        leg += 1
    if end_us > start_us:
        x, y = walked(legs, leg_at(legs, own[0], own[1], end_us), end_us)
        row = _put(tracks, row, (end_us - start_us) * 1e-6, (x, y, height_m), still, still)
    return row


@part
def place(tracks: NDArray[np.float64], row: int, t: float) -> Point:
    """Return the position at a time, computed from a row of a track, in metres."""
    s = t - tracks[row, BEGIN]
    h = 0.5 * s
    return (
        tracks[row, AT] + s * (tracks[row, SPEED_AT] + h * tracks[row, PULL_AT]),
        tracks[row, AT + 1] + s * (tracks[row, SPEED_AT + 1] + h * tracks[row, PULL_AT + 1]),
        tracks[row, AT + 2] + s * (tracks[row, SPEED_AT + 2] + h * tracks[row, PULL_AT + 2]),
    )


@part
def velocity(tracks: NDArray[np.float64], row: int, t: float) -> Point:
    """Return the velocity at a time, computed from a row of a track, in metres per second."""
    s = t - tracks[row, BEGIN]
    return (
        tracks[row, SPEED_AT] + s * tracks[row, PULL_AT],
        tracks[row, SPEED_AT + 1] + s * tracks[row, PULL_AT + 1],
        tracks[row, SPEED_AT + 2] + s * tracks[row, PULL_AT + 2],
    )


@part
def row_at(tracks: NDArray[np.float64], first: int, last: int, t: float) -> int:
    """Return the last row in ``first`` … ``last`` - 1 that has begun at a time."""
    row = first
    while row + 1 < last and tracks[row + 1, BEGIN] <= t:
        row += 1
    return row


@part
def note(out: NDArray[np.int64], rows: int, held: int, t_us: int, state: int) -> int:
    """Write that a link is in another state from ``t_us`` on, and return the number of rows.

    ``held`` is the state before the first row. Changes in one microsecond become one, or none if
    they cancel. Rows (time, state) for which there is no room are counted only, some of them more
    than once.
    """
    before = held
    if 0 < rows <= len(out):
        before = out[rows - 1, 1]
        if out[rows - 1, 0] == t_us:
            rows -= 1
            before = out[rows - 1, 1] if rows > 0 else held
    if state == before:
        return rows
    if rows < len(out):
        out[rows, 0], out[rows, 1] = t_us, state
    return rows + 1
