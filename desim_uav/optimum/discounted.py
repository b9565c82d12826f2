"""The largest discounted return of one drone without a battery, and the return of a given policy.

At every decision such a drone rests in a cell at a level, and the reward of a step depends on the
cell it leads to. A policy is therefore a table of commands, and Howard's policy iteration finds the
best one. The value of a table is computed exactly, by summing its rewards over 1, 2, 4, … steps
until the discount of the rest is 0. Then each state takes the command with the best value, until no
command is better.

A table is indexed like the paper's state: [cell x, cell y], in 3D [cell x, cell y, level], under
the ceiling. If the drone cannot be in a state, its value is NaN and its command -1.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from desim_uav.errors import UsageError
from desim_uav.model.rules import Action, kind_of
from desim_uav.optimum.footprints import flown_to
from desim_uav.optimum.process import DroneProcess
from desim_uav.world import World

Array = NDArray[np.float64]
CommandTable = NDArray[np.int64]
T = TypeVar("T", np.float64, np.int64)

ROUNDING = 16.0 * float(np.finfo(float).eps)
"""Differences of values below this share of the largest possible value count as none."""

ROUNDS = 10_000
"""The most improvements of a policy; about as many are needed as there are steps across the map."""


def optimal_return(world: World, gamma: float) -> tuple[Array, CommandTable]:
    """Return the value of each place and the best command there, as tables (see the module).

    ``gamma`` in [0, 1) discounts each step except the first. A command is an index into
    ``world.actions``; among equally good commands it is hover or else the first. Raises UsageError
    if the scenario cannot be solved exactly.
    """
    if not 0.0 <= gamma < 1.0:
        raise ValueError(f"gamma must be in [0, 1), not {gamma:g}")
    process = _Places(world)
    policy = np.zeros(len(process.nodes), np.int64)
    tolerance = ROUNDING * process.scale(gamma)
    for _ in range(ROUNDS):
        values = process.values(policy, gamma)
        ahead = process.reward[process.leads] + gamma * values[process.leads]
        stays = ahead[process.rows, policy] >= ahead.max(axis=1) - tolerance
        if stays.all():
            break
        policy = np.where(stays, policy, ahead.argmax(axis=1))
    good = ahead >= ahead.max(axis=1)[:, None] - tolerance
    hover = world.actions.index(Action.HOVER)
    commands = np.where(good[:, hover], hover, good.argmax(axis=1))
    return process.table(values, np.nan), process.table(commands, -1)


def policy_return(world: World, gamma: float, policy: CommandTable) -> Array:
    """Return the value of each place under a table of commands, such as a learned policy."""
    process = _Places(world)
    commands = np.array([policy[index] for index in process.indices], np.int64)
    return process.table(process.values(commands, gamma), np.nan)


class _Places:
    """The places of a drone (``nodes``), the reward of reaching each, and where commands lead."""

    def __init__(self, world: World) -> None:
        if world.scenario.limited_battery:
            raise UsageError("drones.battery: discounted returns need unlimited batteries (null)")
        drone = DroneProcess(world)
        self.nodes = flown_to(world)
        self.rows = np.arange(len(self.nodes))
        number = {node: k for k, node in enumerate(self.nodes)}
        self.reward = np.array([drone.arrival((node, 0)) for node in self.nodes])
        self.leads = np.array(
            [
                [number[drone.neighbour(node, kind_of(a))] for a in world.actions]
                for node in self.nodes
            ]
        )
        nx, ny = world.grid.cells
        three_d = world.scenario.three_d
        self.shape = (nx, ny, world.grid.levels_under_ceiling) if three_d else (nx, ny)
        self.indices = [node if three_d else node[:2] for node in self.nodes]

    def scale(self, gamma: float) -> float:
        """Return the discounted return of earning the largest reward forever."""
        return float(np.abs(self.reward).max()) / (1.0 - gamma)

    def values(self, policy: CommandTable, gamma: float) -> Array:
        """Return the discounted return from each node."""
        follows = self.leads[self.rows, policy]
        values: Array = self.reward[follows]
        discount = gamma
        while discount > 0.0:
            values = values + discount * values[follows]
            follows = follows[follows]
            discount *= discount
        return values

    def table(self, values: NDArray[T], nowhere: float) -> NDArray[T]:
        """Return values by node as a table."""
        table = np.full(self.shape, nowhere, values.dtype)
        for index, value in zip(self.indices, values, strict=True):
            table[index] = value
        return table
