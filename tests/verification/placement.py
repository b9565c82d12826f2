"""Users' homes: normal around a centroid, truncated by the cluster's disc and by the map."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from desim_uav.scenario.load import loads
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World, build_world
from tests.verification.figure import Estimate, Exact, Figure

RADIUS_M, SIGMA_M = 300.0, 150.0
CUT = 1 - math.exp(-2)
"""Of a normal law in the plane, what is within two standard deviations."""


def figures(quick: bool = False) -> Iterator[Figure]:
    """A replication a user; axes by themselves."""
    offset = offsets(8000)
    outside = int((np.hypot(*offset.T) > RADIUS_M).sum())
    yield Exact("users outside their disc", outside, 0, cases=len(offset))
    variance = SIGMA_M**2 * (1 - 2 * math.exp(-2) / CUT)
    yield from _moments("disc", offset, (variance, variance))
    narrow, theory = cut_by_the_map(6000)
    yield from _moments("disc and map", narrow, theory)


def _moments(cut: str, offset: np.ndarray, variances: tuple[float, float]) -> Iterator[Figure]:
    for axis, variance in zip("xy", variances, strict=True):
        values = offset[:, "xy".index(axis)]
        yield Estimate.of(f"cut by {cut}: mean of {axis}, m", values, 0.0)
        yield Estimate.of(f"cut by {cut}: variance of {axis}, m²", values**2, variance)


def offsets(users: int) -> np.ndarray:
    """From their centroids, of users of two clusters of one radius."""
    options = {"users__clusters": "{count: 2, radius_m: [300, 300]}"}
    drawn = world(3, map__dimensions=2, users__count=users, **options)
    return drawn.homes[:, :2] - drawn.clusters[np.arange(users) % 2, :2]


def cut_by_the_map(users: int) -> tuple[np.ndarray, tuple[float, float]]:
    """Offsets on a map narrower than the disc, and variances by integration over what is left."""
    half_m = 100.0
    drawn = world(
        4,
        map__size_m="[200, 2400]",
        map__cells="[1, 10]",
        map__dimensions=2,
        users__count=users,
        users__clusters="{count: 1, radius_m: [300, 300]}",
        drones__battery="null",
        stations__count=0,
    )
    cx, cy, _ = drawn.clusters[0]
    assert cx == half_m
    assert RADIUS_M <= cy <= 2400.0 - RADIUS_M
    middles = (np.arange(-400, 400) + 0.5) / 400
    x, y = np.meshgrid(middles * half_m, middles * RADIUS_M)
    weight = np.exp(-(x**2 + y**2) / (2 * SIGMA_M**2)) * (x**2 + y**2 <= RADIUS_M**2)
    of_x, of_y = (float((weight * axis**2).sum() / weight.sum()) for axis in (x, y))
    return drawn.homes[:, :2] - (cx, cy), (of_x, of_y)


# ---- worlds


def scenario(**changes: Any) -> Scenario:
    """The defaults with changes; ``__`` in a name is a dot in its key."""
    overrides = [f"{key.replace('__', '.')}={value}" for key, value in changes.items()]
    return loads("name: world", overrides=overrides)


def world(seed: int = 0, **changes: Any) -> World:
    """Its world."""
    return build_world(scenario(**changes), seed)
