"""Which users a drone will cover from each place at each coming step, as far as can be known now."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.kernels import maker

Floats = NDArray[np.float64]
SURE = 4.0
"""The standard deviations beyond which a user is, or is not, in a footprint for sure."""


@maker
def covered_shares(
    users_m: Floats,
    homes_m: Floats,
    spread_m: Floats,
    left: int,
    steps: int,
    centres_m: Floats,
    radii_m: Floats,
) -> Floats:
    """Return the probability that each user is in a footprint: (steps + 1, rings, cells, users).

    Users are at ``users_m`` now. The distance between a user and a place in k steps has a normal
    error of ``spread_m[k]``. From step ``left`` on, the next episode has begun, in which users walk
    from ``homes_m`` anew. ``radii_m`` (rings, users) are the radii of footprints.
    """
    rings, users = radii_m.shape
    cells = len(centres_m)
    shares = np.empty((steps + 1, rings, cells, users))
    far_m = np.empty((2, cells, users))
    for cell in range(cells):
        x_m, y_m = centres_m[cell]
        for user in range(users):
            far_m[0, cell, user] = math.hypot(users_m[user, 0] - x_m, users_m[user, 1] - y_m)
            far_m[1, cell, user] = math.hypot(homes_m[user, 0] - x_m, homes_m[user, 1] - y_m)
    for k in range(steps + 1):
        anew = int(k >= left)
        after = min(k - left * anew, len(spread_m) - 1)
        scale = 1.0 / max(spread_m[after], 1e-3)
        for ring in range(rings):
            for cell in range(cells):
                for user in range(users):
                    z = (radii_m[ring, user] - far_m[anew, cell, user]) * scale
                    share = 1.0 if z > 0.0 else 0.0
                    if -SURE < z < SURE:
                        share = 0.5 * math.erfc(-z * 0.7071067811865476)
                    shares[k, ring, cell, user] = share
    return shares


@maker
def gains(shares: Floats, worth: Floats) -> Floats:
    """Return what a drone gains in a step by its start and by its end: (2, steps, rings, cells).

    ``worth`` (steps, users) is what the cover of each user is worth in each step.
    """
    last, rings, cells, users = shares.shape
    gained = np.empty((2, last - 1, rings, cells))
    for step in range(last - 1):
        for end in range(2):
            for ring in range(rings):
                for cell in range(cells):
                    total = 0.0
                    for user in range(users):
                        total += worth[step, user] * shares[step + end, ring, cell, user]
                    gained[end, step, ring, cell] = 0.5 * total
    return gained
