"""What a battery must hold at each place of a grid so that a drone surely reaches a station."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.motion.planner import Node, Planner
from desim_uav.model.rules import NEVER
from desim_uav.rowcode.kernels import rule


@rule
def drawn_uj(draws_uw: int, lasts_us: int) -> int:
    """Return at least what a processor takes of a battery in a time, in microjoules."""
    return ((draws_uw + 999) // 1000) * ((lasts_us + 999) // 1000)


def needs_of(
    planner: Planner, ceiling: bool, most: int, draws_uw: int, moves: Mapping[Node, int]
) -> NDArray[np.int64]:
    """Return what a drone needs at each place (levels, nx, ny), in units of its battery.

    With more than that it can reach a station: by the planned return, if this takes at most
    ``most``, or by moves to neighbours, each of which takes as much as ``moves`` says. It is NEVER
    where there is no way, and in buildings. A processor draws at most ``draws_uw`` besides.
    """
    blocked = planner.grid.blocked[: planner.grid.levels(ceiling)]
    needs = np.full(blocked.shape, NEVER, np.int64)
    for x, y in planner.stations:
        needs[0, x, y] = 0
    if most >= 0:
        for level, x, y in np.argwhere(~blocked).tolist():
            back = planner.search((x, y, level), ceiling)
            taken = NEVER if back is None else back.drain + drawn_uj(draws_uw, back.duration_us)
            if taken <= most:
                needs[level, x, y] = taken
    needs[blocked] = NEVER
    while True:
        before = needs.copy()
        for (dx, dy, dlevel), drain in moves.items():
            there = _shifted(_shifted(_shifted(before, 0, dlevel), 1, dx), 2, dy)
            needs[...] = np.where(blocked, NEVER, np.minimum(needs, there + drain))
        if np.array_equal(needs, before):
            return needs


def _shifted(values: NDArray[np.int64], axis: int, by: int) -> NDArray[np.int64]:
    """Return at each place what a neighbour has; NEVER at the edge."""
    if by == 0:
        return values
    shifted = np.roll(values, -by, axis)
    edge = [slice(None)] * values.ndim
    edge[axis] = slice(-1, None) if by > 0 else slice(0, 1)
    shifted[tuple(edge)] = NEVER
    return shifted
