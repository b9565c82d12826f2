"""Users who walk at random: their walks are drawn step by step, as they are walked.

The numbers are those of ``RandomWalks``, which draws whole episodes; these would take more memory
than everything else of an environment.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from desim_uav.engine.batch.kernels import inner, part
from desim_uav.engine.batch.memory import (
    AT_HOMES,
    AT_LEG_OFFSETS,
    AT_STREAMS,
    AT_WALKED,
    AT_WALKED_OFFSETS,
    AT_WALKERS,
    AT_WALKING,
    DEPTH_M,
    FULL,
    HORIZON_US,
    MOST_LEGS,
    USERS,
    W_T0_US,
    W_VX,
    W_VY,
    W_X,
    W_X0,
    W_Y,
    W_Y0,
    WALK_LEG_US,
    WALK_SPEED_MPS,
    WALKING_COLUMNS,
    WIDTH_M,
    Fixed,
    Path,
    State,
)
from desim_uav.engine.batch.pointers import moved, table
from desim_uav.model.coverage import T0_US, VX, VY, X0, Y0
from desim_uav.model.mobility import RandomWalk, next_leg
from desim_uav.model.sums import in_order
from desim_uav.world import World


def legs_of_step(world: World) -> int:
    """How many legs users walk in a step, about: the one under way, those begun, and walls met."""
    walk = world.scenario.users.mobility
    if not isinstance(walk, RandomWalk):
        return 0
    step_s = world.scenario.episode.step_s
    walls = walk.speed_mps * step_s * in_order(1.0 / side for side in world.area)
    return len(world.homes) * (2 + int(step_s / walk.leg_s) + int(walls)) + 16


@inner
def begin_walks(w: Fixed, p: Path, s: State) -> None:
    """Users are at home, and will turn at once."""
    for user in range(w.i[USERS]):
        home, walking = w.i[AT_HOMES] + 2 * user, s.i[AT_WALKING] + user * WALKING_COLUMNS
        for word in range(4):
            s.i[s.i[AT_STREAMS] + 4 * user + word] = p.i[p.i[AT_LEG_OFFSETS] + 4 * user + word]
        s.i[s.i[AT_WALKERS] + 2 * user] = s.i[s.i[AT_WALKERS] + 2 * user + 1] = 0
        s.f[walking + W_X], s.f[walking + W_Y] = w.f[home], w.f[home + 1]
        s.f[walking + W_VX] = s.f[walking + W_VY] = 0.0


@part
def walk(w: Fixed, s: State, start_us: int, end_us: int) -> None:
    """Write the legs of a span to ``walked``, from the one under way at its start.

    Spans follow one another.
    """
    law = (w.f[WALK_SPEED_MPS], w.i[WALK_LEG_US], w.i[HORIZON_US], w.f[WIDTH_M], w.f[DEPTH_M])
    count, most = 0, s.i[MOST_LEGS]
    one, own, times = s.i[AT_WALKING], s.i[AT_STREAMS], s.i[AT_WALKERS]
    written, ends = s.i[AT_WALKED], s.i[AT_WALKED_OFFSETS] + 1
    for user in range(w.i[USERS]):
        x, y, vx, vy = s.f[one + W_X], s.f[one + W_Y], s.f[one + W_VX], s.f[one + W_VY]
        t0_us, x0, y0 = s.f[one + W_T0_US], s.f[one + W_X0], s.f[one + W_Y0]
        walker = (x, y, vx, vy, s.i[times], s.i[times + 1])
        stream = (
            np.uint64(s.i[own]),
            np.uint64(s.i[own + 1]),
            np.uint64(s.i[own + 2]),
            np.uint64(s.i[own + 3]),
        )
        while True:
            t_us = walker[4]
            if t_us > start_us or t_us == law[2]:
                if count < most:
                    leg = written + count * 5
                    s.f[leg + T0_US], s.f[leg + X0], s.f[leg + Y0] = t0_us, x0, y0
                    s.f[leg + VX], s.f[leg + VY] = walker[2], walker[3]
                count += 1
                if t_us > end_us or t_us == law[2]:
                    break
            t0_us, x0, y0 = float(t_us), walker[0], walker[1]
            walker, stream = next_leg(walker, stream, law)
        s.f[one + W_X], s.f[one + W_Y], s.f[one + W_VX], s.f[one + W_VY] = (
            walker[0],
            walker[1],
            walker[2],
            walker[3],
        )
        s.f[one + W_T0_US], s.f[one + W_X0], s.f[one + W_Y0] = t0_us, x0, y0
        s.i[times], s.i[times + 1] = walker[4], walker[5]
        for word in range(4):
            s.i[own + word] = np.int64(stream[word])
        s.i[ends + user] = min(count, most)
        one, own, times = one + WALKING_COLUMNS, own + 4, times + 2
    if count > most:
        s.i[FULL] = 1


@part
def walked(w: Fixed, s: State) -> tuple[Any, Any]:
    """The legs of the span, and where each user's begin: arrays (legs, 5) and (users + 1,)."""
    legs = table(moved(s.f, s.i[AT_WALKED]), s.i[MOST_LEGS], 5)
    return legs, table(moved(s.i, s.i[AT_WALKED_OFFSETS]), 1, w.i[USERS] + 1)[0]
