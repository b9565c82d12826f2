"""What has been noted of a user who passes from one ring around a drone to another.

A change is the number of circles around the user if it rises, and minus this number if it falls.
Passages in the same microsecond are one change, or cancel.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.relative import Change, beyond, write
from desim_uav.rowcode.kernels import part
from desim_uav.rowcode.rows import Table


class Passage(NamedTuple):
    """The number of circles around a user ``now``, and what was noted last.

    There were ``held`` circles before the microsecond ``latest``. If the row before number
    ``total`` of the table is of that microsecond, ``noted`` is 1.
    """

    now: int
    held: int
    latest: int
    noted: int
    total: int


@part
def begin_passages(
    user: int,
    away: tuple[float, float],
    radii: NDArray[np.float64],
    circles: tuple[int, int],
    begin: tuple[int, bool],
    out: Table[Change],
    total: int,
) -> Passage:
    """Return in which ring a user is at the start of a leg, at a time.

    The user is ``away`` along x and y, and may cross the ``circles`` from the first one to the one
    before the second. ``begin`` is the time, and whether the drone begins to serve: the user then
    enters the circles now.
    """
    (now, stop), (start_us, fresh) = circles, begin
    while now < stop and beyond(away[0], away[1], radii[now]) <= 0.0:
        now += 1
    if not fresh:
        return Passage(now, now, start_us - 1, 0, total)
    noted = int(now > 0)
    total = write(out, total, start_us, user, now) if noted else total
    return Passage(now, 0, start_us, noted, total)


@part
def passed(one: Passage, now: int, t_us: int, user: int, out: Table[Change]) -> Passage:
    """Note that there are another number of circles around a user from a time on."""
    held, latest, noted = one.held, one.latest, one.noted
    if t_us > latest:
        held, latest, noted = one.now, t_us, 0
    total = one.total - noted
    noted = int(now != held)
    if noted:
        total = write(out, total, latest, user, now if now > held else -now)
    return Passage(now, held, latest, noted, total)
