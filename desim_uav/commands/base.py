"""What all commands have in common, and those of drones that all move alike."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from desim_uav.commands.given import Command, CommandError, by_name
from desim_uav.copies import Unchanging
from desim_uav.drone_type import DroneType
from desim_uav.model.rules import Choice
from desim_uav.rules.decide import can_take
from desim_uav.scenario.schema import Scenario

if TYPE_CHECKING:
    from desim_uav.commands.aims import FreeCommands
    from desim_uav.commands.cells import CellCommands

Kept = NDArray[np.float64] | None
"""The numbers of commands of free flight in a saved state (steps, drones, numbers)."""

Arrays = tuple[NDArray[np.int64], NDArray[np.float64] | None]
"""Commands of n environments: indices of actions (n, drones), and the AIMS numbers of free flight
(n, drones, AIMS), 0 where there are none; None if no drone flies freely."""


class Commands(Protocol):
    """The commands that the drones of a world can be given."""

    @property
    def actions(self) -> tuple[Choice, ...]:
        """The actions of all drones. A command that is an index is one into this tuple."""

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the numbers of the longest command of free flight; none without it."""

    def of(self, drone: int) -> CellCommands | FreeCommands:
        """Return the commands of drones that move as this one does."""

    def whose(self, drone: int) -> str:
        """Return in words whose actions those of a drone are: of all drones, or of this one."""

    def of_all(self, what: str) -> CellCommands | FreeCommands:
        """Return the commands of drones that all move alike.

        Raises ScenarioError, which says that ``what`` needs it, if they do not.
        """

    def joined(self, commands: Sequence[Any]) -> Any:
        """Return a command of each drone as one action. Raises CommandError, with the drone."""

    def split(self, action: object) -> Sequence[Command]:
        """Return the action of an environment as a command of each drone. Raises CommandError."""

    def arrays(self, action: object) -> Arrays:
        """Return the action of an environment as arrays. Raises CommandError.

        Whether indices are those of actions is not checked.
        """

    def kept(self, aims: Sequence[float]) -> Kept:
        """Return what a saved state has of the AIMS numbers of all commands."""

    def played(self, indices: list[list[int]], numbers: Kept) -> list[list[Command]]:
        """Return the commands of each step, from their indices and the ``numbers`` of a state.

        Raises CommandError if that does not fit.
        """


@dataclass(frozen=True, eq=False)
class AlikeCommands(Unchanging):
    """Commands of drones that all move alike; there may be others in the same world."""

    scenario: Scenario
    types: tuple[DroneType, ...]
    actions: tuple[Choice, ...]

    off_grid: ClassVar[int]

    @cached_property
    def named(self) -> dict[str, int]:
        """The indices of the actions that drones which move so can take, by name."""
        items = by_name(self.actions).items()
        return {name: k for name, k in items if can_take(int(self.actions[k]), self.off_grid)}

    @property
    def _in_words(self) -> str:
        indices = sorted(set(self.named.values()))
        return ", ".join(f"{k} ({self.actions[k].name.lower()})" for k in indices)

    def of(self, drone: int) -> Self:
        """Return these commands, which are those of all drones."""
        return self

    def of_all(self, what: str) -> Self:
        """Return these commands."""
        return self

    def whose(self, drone: int) -> str:
        """Return that the actions are those of all drones."""
        return "this scenario"

    @abstractmethod
    def allowed(self, drone: int) -> str:
        """Return in words what a drone can be commanded."""

    def index(self, drone: int, command: Any) -> int:
        """Return a command as an index; -1 if it is that of no action. Raises CommandError."""
        try:
            return int(command) if 0 <= command < len(self.actions) else -1
        except (TypeError, ValueError) as problem:
            raise CommandError(
                f"a command of drone {drone} is {self.allowed(drone)}; not {command!r}"
            ) from problem

    def own(self, drone: int) -> DroneType:
        """Return the type of a drone."""
        return self.types[self.scenario.type_numbers[drone]]
