"""The stretches of a span, in which a user and the senders that it receives keep their motions.

They hold as long as all those who take part keep their accelerations, and no line of sight changes.
"""

from __future__ import annotations

import numpy as np

from desim_uav.model.radio.links import Air, Link
from desim_uav.model.radio.path_loss import MEAN
from desim_uav.model.radio.tracks import place, velocity
from desim_uav.rowcode.kernels import kernel, rule


@kernel
def take_first_rows(air: Air, users: int, user: int) -> None:
    """Begin with the first row of each track, and with the mark of each link to a user then."""
    for k in range(air.used):
        link = air.links[k]
        link.track, link.branch = link.first, MEAN
        link.mark = link.last_mark = -1
        if len(air.marks_at) > 0:
            at = link.sender * (users + 1) + user
            link.mark, link.last_mark = air.marks_at[at], air.marks_at[at + 1] - 1
            link.mark = mark_at(air, link, 0.0)
        take_mark(air, link)


@rule
def take_mark(air: Air, link: Link) -> None:
    """Take the branch and the level before the path loss from a link's present mark."""
    link.base_dbm = link.power_dbm
    if link.last_mark >= link.mark >= 0:
        mark = air.marks[link.mark]
        link.branch = mark.branch
        link.base_dbm -= mark.extra_db


@rule
def mark_at(air: Air, link: Link, t: float) -> int:
    """Return the mark of a link at a time, which is its present one or a later one."""
    mark = link.mark
    while mark < link.last_mark and begins_at(air, link, mark + 1) <= t:
        mark += 1
    return mark


@rule
def begins_at(air: Air, link: Link, mark: int) -> float:
    """Return when a mark of a link begins, in seconds since the start of the span."""
    return float((link.marked_us + np.rint(air.marks[mark].begin_s * 1e6)) * 1e-6)


@kernel
def take_rows(air: Air, t: float) -> tuple[float, bool]:
    """Take the rows of tracks and the marks that hold at a time.

    Returns when the next one begins, inf if there is none, and whether a mark is another one now.
    """
    tracks, until, marked = air.tracks, np.inf, False
    for k in range(air.used):
        link = air.links[k]
        row, mark = link.track, mark_at(air, link, t)
        while row + 1 < link.after and tracks[row + 1].begin_s <= t:
            row += 1
        if row + 1 < link.after:
            until = min(until, tracks[row + 1].begin_s)
        if mark < link.last_mark:
            until = min(until, begins_at(air, link, mark + 1))
        link.track = row
        if mark != link.mark:
            link.mark = mark
            take_mark(air, link)
            marked = True
    return until, marked


@kernel
def relate(air: Air, t: float, user: tuple[float, float, float], walk: tuple[float, float]) -> None:
    """Write the motions of senders relative to a user at a place, from a time on."""
    for k in range(air.used):
        link = air.links[k]
        track = air.tracks[link.track]
        x, y, z = place(track, t)
        vx, vy, vz = velocity(track, t)
        link.x_m, link.y_m, link.z_m = x - user[0], y - user[1], z - user[2]
        link.vx_mps, link.vy_mps, link.vz_mps = vx - walk[0], vy - walk[1], vz
        link.ax_mps2, link.ay_mps2, link.az_mps2 = track.ax_mps2, track.ay_mps2, track.az_mps2
