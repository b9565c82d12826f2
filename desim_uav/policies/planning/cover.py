"""Which users a drone will cover from each place at each coming step, as far as can be known."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from desim_uav.rowcode.kernels import maker

Floats = NDArray[np.float64]
SURE = 4.0
"""The standard deviations beyond which a user is, or is not, in a footprint for sure."""


@maker
def covered_shares(
    places_m: Floats, spread_m: Floats, centres_m: Floats, radii_m: Floats
) -> Floats:
    """Return the probability that each user is in a footprint: (steps + 1, rings, cells, users).

    In k steps users are at ``places_m[k]`` (users, 2), if they do not walk elsewhere: the distance
    between a user and a place then has a normal error of ``spread_m[k]``. ``radii_m`` (rings,
    users) are the radii of footprints.
    """
    times, users, _ = places_m.shape
    rings, cells = len(radii_m), len(centres_m)
    shares = np.empty((times, rings, cells, users))
    for k in range(times):
        scale = 1.0 / max(spread_m[k], 1e-3)
        for cell in range(cells):
            for user in range(users):
                x_m = places_m[k, user, 0] - centres_m[cell, 0]
                y_m = places_m[k, user, 1] - centres_m[cell, 1]
                far_m = math.sqrt(x_m * x_m + y_m * y_m)
                for ring in range(rings):
                    z = (radii_m[ring, user] - far_m) * scale
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
