"""Commands of drones of which some fly freely and others from cell to cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from desim_uav.commands.aims import FreeCommands
from desim_uav.commands.base import Arrays, Kept
from desim_uav.commands.cells import CellCommands
from desim_uav.commands.given import Command
from desim_uav.copies import Unchanging
from desim_uav.model.rules import Action, Choice
from desim_uav.rules.words import AIMS


@dataclass(frozen=True, eq=False)
class EachCommands(Unchanging):
    """Commands of drones of which some fly freely and others from cell to cell.

    One action for all of them is the list of their commands.
    """

    cells: CellCommands
    free: FreeCommands

    @property
    def actions(self) -> tuple[Choice, ...]:
        """The actions of both kinds."""
        return self.free.actions

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the numbers of those that fly freely."""
        return self.free.names

    @cached_property
    def _of(self) -> list[CellCommands | FreeCommands]:
        drones = range(self.free.scenario.drone_count)
        return [self.free if self.free.own(drone).free else self.cells for drone in drones]

    def of(self, drone: int) -> CellCommands | FreeCommands:
        """Return the commands of drones that move as this one does."""
        return self._of[drone]

    def of_all(self, what: str) -> CellCommands | FreeCommands:
        """Raise ScenarioError: there are no commands that all drones have."""
        self.free.scenario.require_one_space(what)
        return self.free

    def whose(self, drone: int) -> str:
        """Return that the actions are those of this drone."""
        return f"drone {drone}"

    def joined(self, commands: Sequence[Any]) -> list[Any]:
        """Return the list of commands, each checked for its drone."""
        return [self._of[drone].checked(drone, one) for drone, one in enumerate(commands)]

    def split(self, action: Any) -> Sequence[Command]:
        """Return the commands, which ``joined`` has checked."""
        commands: Sequence[Command] = action
        return commands

    def arrays(self, action: Any) -> Arrays:
        """Return the commands as indices (1, drones), and the numbers of those that have some."""
        indices, aims = np.zeros((1, len(action)), np.int64), np.zeros((1, len(action), AIMS))
        fly = self.actions.index(Action.FLY)
        for drone, command in enumerate(action):
            aim = self.free.aim(drone, command)
            indices[0, drone] = command if aim is None else fly
            aims[0, drone] = aim or 0.0
        return indices, aims

    def kept(self, aims: Sequence[float]) -> Kept:
        """Return the numbers, which are 0 for drones that have none."""
        return self.free.kept(aims)

    def played(self, indices: list[list[int]], numbers: Kept) -> list[list[Command]]:
        """Return numbers in the place of the indices of free flights of those that have them."""
        flies = [own is self.free for own in self._of]
        return [
            [one if free else index for free, index, one in zip(flies, step, own, strict=True)]
            for step, own in zip(indices, self.free.played(indices, numbers), strict=True)
        ]
