"""What a drone believes of its actions before it has tried any."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from desim_uav.errors import UsageError
from desim_uav.model.observations import Feature, table_sizes
from desim_uav.model.rules import MOVES, Action
from desim_uav.model.state import Facts

MAX_REWARD = 1.0
"""No step of R1, R2 or R3 is worth more."""


def initial_q(
    kind: str | float,
    features: tuple[Feature, ...],
    actions: tuple[Action, ...],
    facts: Facts,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """A table (states, actions) of one number, or random in [0, 1), or of prior knowledge.

    ``kind`` is that number, ``zero`` or ``max_reward``. A number above what a drone comes to earn
    is optimistic: what it has not tried looks better than what it has, so it tries everything
    (Sutton and Barto, 2018, section 2.6). Raises UsageError where there is nothing to know
    beforehand.
    """
    sizes = table_sizes(features)
    shape = (math.prod(sizes), len(actions))
    if kind == "random":
        return rng.random(shape, np.float32)
    if kind == "prior":
        return _prior(features, sizes, actions, facts)
    if isinstance(kind, str):
        kind = MAX_REWARD if kind == "max_reward" else 0.0
    return np.full(shape, kind, np.float32)


def _prior(
    features: tuple[Feature, ...],
    sizes: tuple[int, ...],
    actions: tuple[Action, ...],
    facts: Facts,
) -> NDArray[np.float32]:
    """1 - distance from the next cell to the nearest cluster's cell, over the map's diagonal."""
    names = [feature.name for feature in features]
    if not {"cell_x", "cell_y"} <= set(names) or len(facts.clusters) == 0:
        raise UsageError(
            "learning.initial_q: prior knowledge is of clusters of users (users.clusters), and of "
            "states that have a cell_x and a cell_y"
        )
    places = np.indices(sizes).reshape(len(sizes), -1)
    x, y = places[names.index("cell_x")], places[names.index("cell_y")]
    grid = facts.grid
    nx, ny = grid.cells
    clusters = np.array([grid.cell_of(cx, cy) for cx, cy, _ in facts.clusters])
    table = np.empty((math.prod(sizes), len(actions)), np.float32)
    for column, action in enumerate(actions):
        dx, dy, _ = MOVES.get(action, (0, 0, 0))
        there = np.stack([np.clip(x + dx, 0, nx - 1), np.clip(y + dy, 0, ny - 1)], axis=1)
        apart = (there[:, None, :] - clusters[None, :, :]) * np.array(grid.cell_m)
        nearest = np.sqrt((apart**2).sum(axis=2)).min(axis=1)
        table[:, column] = 1.0 - nearest / math.hypot(grid.width_m, grid.depth_m)
    return table
