"""A synthetic city after Recommendation ITU-R P.1410."""

from __future__ import annotations

import math

import numpy as np

from desim_uav.model.geometry.city import City

TALLEST = 4.0
"""The tallest building in units of gamma: taller ones, 0.03 % of all, are drawn again."""


def itu_city(
    size_m: tuple[float, float],
    alpha: float,
    beta: float,
    gamma: float,
    rng: np.random.Generator,
) -> City:
    """Draw a city of square buildings between streets of one width in two directions.

    ``alpha`` is the built share of the ground, ``beta`` the number of buildings per km², and
    ``gamma`` the scale in metres of their heights, which follow a Rayleigh distribution. A row of
    buildings that the eastern or northern edge of the map would cut is left out; what remains is in
    the middle of the map.
    """
    pitch_m = 1000.0 / math.sqrt(beta)
    side_m = pitch_m * math.sqrt(alpha)
    counts = [int((size + pitch_m - side_m) // pitch_m) for size in size_m]
    first = [
        0.5 * (size - count * pitch_m + pitch_m - side_m)
        for size, count in zip(size_m, counts, strict=True)
    ]
    places = np.indices(counts).reshape(2, -1).T * pitch_m + first
    square = np.array([(0.0, 0.0), (side_m, 0.0), (side_m, side_m), (0.0, side_m)])
    pieces = tuple(places[:, None, :] + square)
    roofs_m = rng.rayleigh(gamma, len(pieces))
    while (tall := roofs_m > TALLEST * gamma).any():
        roofs_m[tall] = rng.rayleigh(gamma, int(tall.sum()))
    return City(pieces, roofs_m)
