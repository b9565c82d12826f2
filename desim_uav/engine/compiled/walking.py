"""Users who walk at random: their walks are drawn step by step, as they are walked.

The numbers are those of ``RandomWalks``, which draws whole episodes; these would take more memory
than everything else of an environment.
"""

from __future__ import annotations

import numpy as np

from desim_uav.model.coverage import T0_US, VX, VY, X0, Y0
from desim_uav.model.kernels import rule
from desim_uav.model.mobility import RandomWalk, next_leg
from desim_uav.model.sums import in_order
from desim_uav.rules.rows import Constants, Look, Path
from desim_uav.world import World

W_X, W_Y, W_VX, W_VY, W_T0_US, W_X0, W_Y0 = range(7)
WALKING_COLUMNS = 7
"""Numbers of a user in ``Look.walking``: where its leg leads, its velocity, when and where it
began. ``Look.turns`` has when the user gets there, and when it turns."""


def legs_of_step(world: World) -> int:
    """Return about how many legs users walk in a step: under way, begun, and to walls."""
    walk = world.scenario.users.mobility
    if not isinstance(walk, RandomWalk):
        return 0
    step_s = world.scenario.episode.step_s
    walls = walk.speed_mps * step_s * in_order(1.0 / side for side in world.area)
    return len(world.homes) * (2 + int(step_s / walk.leg_s) + int(walls)) + 16


@rule
def begin_walks(world: Constants, path: Path, look: Look) -> None:
    """Put all users at their homes, where they take a heading at once."""
    for k in range(len(path.streams)):
        look.streams[k] = path.streams[k]
    for user in range(len(world.homes)):
        home, one = world.homes[user], user * WALKING_COLUMNS
        look.turns[2 * user] = look.turns[2 * user + 1] = 0
        look.walking[one + W_X], look.walking[one + W_Y] = home.x_m, home.y_m
        look.walking[one + W_VX] = look.walking[one + W_VY] = 0.0


@rule
def walk(world: Constants, look: Look, start_us: int, end_us: int) -> None:
    """Write the legs of a span to ``walked``, from the one under way at its start.

    Spans follow one another.
    """
    law = (
        world.walk_speed_mps,
        world.walk_leg_us,
        world.horizon_us,
        world.width_m,
        world.depth_m,
    )
    walked, walking, turns, streams = look.walked, look.walking, look.turns, look.streams
    walked_at, count, most = look.walked_at, 0, len(look.walked) // 5
    for user in range(len(world.homes)):
        one, own, times = WALKING_COLUMNS * user, 4 * user, 2 * user
        x, y, vx, vy = (
            walking[one + W_X],
            walking[one + W_Y],
            walking[one + W_VX],
            walking[one + W_VY],
        )
        t0_us, x0, y0 = walking[one + W_T0_US], walking[one + W_X0], walking[one + W_Y0]
        walker = (x, y, vx, vy, turns[times], turns[times + 1])
        stream = (
            np.uint64(streams[own]),
            np.uint64(streams[own + 1]),
            np.uint64(streams[own + 2]),
            np.uint64(streams[own + 3]),
        )
        while True:
            t_us = walker[4]
            if t_us > start_us or t_us == law[2]:
                if count < most:
                    leg = 5 * count
                    walked[leg + T0_US], walked[leg + X0], walked[leg + Y0] = t0_us, x0, y0
                    walked[leg + VX], walked[leg + VY] = walker[2], walker[3]
                count += 1
                if t_us > end_us or t_us == law[2]:
                    break
            t0_us, x0, y0 = float(t_us), walker[0], walker[1]
            walker, stream = next_leg(walker, stream, law)
        walking[one + W_X], walking[one + W_Y] = walker[0], walker[1]
        walking[one + W_VX], walking[one + W_VY] = walker[2], walker[3]
        walking[one + W_T0_US], walking[one + W_X0], walking[one + W_Y0] = t0_us, x0, y0
        turns[times], turns[times + 1] = walker[4], walker[5]
        for k in range(4):
            streams[own + k] = np.int64(stream[k])  # type: ignore[call-overload]
        walked_at[user + 1] = min(count, most)
    if count > most:
        look.overrun = 1
