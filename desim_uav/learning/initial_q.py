"""Initial Q-values: a constant, random numbers, or prior knowledge of the users' clusters."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from desim_uav.errors import UsageError
from desim_uav.model.observations import Feature, table_sizes
from desim_uav.model.rules import Choice, move_of
from desim_uav.model.state import Facts

MAX_REWARD = 1.0
"""The largest reward of a step under R1, R2 or R3."""


def initial_q(
    kind: str | float,
    features: tuple[Feature, ...],
    actions: tuple[Choice, ...],
    facts: Facts,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """Return an initial table (states, actions): a constant, random numbers or prior values.

    ``kind`` is a number, ``zero``, ``max_reward``, random (in [0, 1)) or prior knowledge. A number
    above the values that a drone can reach is optimistic: actions that it has not tried look better
    than those it has tried, so it tries all of them (Sutton and Barto, 2018, section 2.6). Raises
    UsageError if prior knowledge is asked for and the scenario has none.
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
    actions: tuple[Choice, ...],
    facts: Facts,
) -> NDArray[np.float32]:
    """Return 1 minus the distance from the next cell to the nearest cluster over the diagonal."""
    names = [feature.name for feature in features]
    if not {"cell_x", "cell_y"} <= set(names) or len(facts.clusters) == 0:
        raise UsageError(
            "learning.initial_q: prior knowledge needs clusters of users (users.clusters), and "
            "states with a cell_x and a cell_y"
        )
    places = np.indices(sizes).reshape(len(sizes), -1)
    x, y = places[names.index("cell_x")], places[names.index("cell_y")]
    grid = facts.grid
    nx, ny = grid.cells
    clusters = np.array([grid.cell_of(cx, cy) for cx, cy, _ in facts.clusters])
    table = np.empty((math.prod(sizes), len(actions)), np.float32)
    for column, action in enumerate(actions):
        dx, dy, _ = move_of(action)
        there = np.stack([np.clip(x + dx, 0, nx - 1), np.clip(y + dy, 0, ny - 1)], axis=1)
        apart = (there[:, None, :] - clusters[None, :, :]) * np.array(grid.cell_m)
        nearest = np.sqrt((apart**2).sum(axis=2)).min(axis=1)
        table[:, column] = 1.0 - nearest / math.hypot(grid.width_m, grid.depth_m)
    return table
