"""Commands of drones that fly from cell to cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.commands.base import AlikeCommands, Arrays, Kept
from desim_uav.commands.given import (
    Command,
    CommandError,
    index_of,
    naming,
    out_of_range,
    whole_numbers,
)

if TYPE_CHECKING:
    from gymnasium.spaces import Discrete, MultiDiscrete


class CellCommands(AlikeCommands):
    """Commands of drones that fly from cell to cell: indices of actions.

    ``shape`` is that of the action of one environment for all of its drones, and ``shape_of_each``
    that of the same with an axis of drones. A network has one ``output`` for each of ``outputs``.
    """

    off_grid, mask_key, output = 0, "action_mask", "action"
    names: tuple[str, ...] = ()

    @property
    def outputs(self) -> tuple[str, ...]:
        """The names of the actions."""
        return tuple(action.name.lower() for action in self.actions)

    @property
    def shape_of_each(self) -> tuple[int, ...]:
        """One index for each drone."""
        return (self.scenario.drone_count,)

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """The same; none for a single drone, whose action is a number."""
        return () if self.scenario.drone_count == 1 else self.shape_of_each

    @cached_property
    def _differ(self) -> bool:
        """Whether types of drones differ."""
        return bool(self.scenario.differing)

    # ---- of one drone

    def numbers(self, drone: int) -> int:
        """Return how many numbers a command of free flight has: none."""
        return 0

    def allowed(self, drone: int) -> str:
        """Return in words what a drone can be commanded."""
        return f"the index of an action, a whole number: {self._in_words}"

    def read(self, drone: int, answer: object) -> Any:
        """Return the answer of a policy as an index, which may be that of no action, or None."""
        return index_of(self.actions, answer)

    def scripted(self, drone: int, index: int, values: Mapping[str, float | None]) -> Command:
        """Return the command of an action in a script, which ignores the numbers beside it."""
        return index

    def drawn(self, drone: int, stream: np.random.Generator, mask: Sequence[bool]) -> Command:
        """Draw one of the allowed actions."""
        allowed = [action for action, legal in enumerate(mask) if legal]
        return allowed[int(stream.random() * len(allowed))]

    def give(self, drone: Any, command: Any) -> None:
        """Write an index into the row of a drone; -1 if it is that of no action.

        Raises CommandError for anything else.
        """
        drone.command = self.index(drone.index, command)

    def space(self, drone: int) -> Discrete:
        """Return Gymnasium's space of a drone's commands: the actions of its type."""
        from gymnasium.spaces import Discrete  # which takes long to import

        return Discrete(len(self.own(drone).actions))

    def entries(self, drone: int) -> slice:
        """Return which entries of a mask are those of a drone's type: the first ones."""
        return slice(len(self.own(drone).actions))

    def checked(self, drone: int, index: object) -> int:
        """Return the index of an action of a drone's type. Raises CommandError, with the drone."""
        last = len(self.own(drone).actions) - 1
        with naming(drone):
            command = int(whole_numbers(index, ()))
            if not 0 <= command <= last:
                raise CommandError(f"actions must be from 0 to {last}, not {command}")
        return command

    # ---- of all drones

    def space_of(self, drones: int) -> Discrete | MultiDiscrete:
        """Return Gymnasium's space of the commands of so many drones as one action."""
        from gymnasium.spaces import Discrete, MultiDiscrete

        actions = len(self.actions)
        return Discrete(actions) if drones == 1 else MultiDiscrete([actions] * drones)

    def space_of_each(self, count: int) -> MultiDiscrete:
        """Return the space of the commands of each drone in so many environments."""
        from gymnasium.spaces import MultiDiscrete

        return MultiDiscrete(np.full((count, *self.shape_of_each), len(self.actions)))

    def joined(self, commands: Sequence[Any]) -> Any:
        """Return the indices; that of a single drone alone."""
        if self._differ:
            commands = [self.checked(drone, one) for drone, one in enumerate(commands)]
        return commands if len(commands) != 1 else commands[0]

    def split(self, action: object) -> list[Command]:
        """Return the index of each drone."""
        commands: list[int] = whole_numbers(action, self.shape).reshape(-1).tolist()
        if min(commands) < 0 or max(commands) >= len(self.actions):
            raise out_of_range(commands, self.actions)
        return [*commands]

    def arrays(self, action: object) -> Arrays:
        """Return the index of each drone (1, drones)."""
        return whole_numbers(action, self.shape).reshape(1, -1), None

    def arrays_of(self, count: int, actions: object, by_drone: bool) -> Arrays:
        """Return the actions of so many environments as arrays, which have an axis of drones.

        That of a single drone may be missing unless they must be ``by_drone``.
        """
        shapes = [(count, *self.shape_of_each)]
        if not (by_drone or self.shape):
            shapes.insert(0, (count,))
        return whole_numbers(actions, *shapes).reshape(shapes[-1]), None

    def best(self, scores: NDArray[Any], masks: Any) -> list[Command]:
        """Return the best allowed action of each drone by a network (drones, outputs).

        Of equally good ones it is the first.
        """
        best: list[Command] = np.where(masks, scores, -np.inf).argmax(axis=1).tolist()
        return best

    def kept(self, aims: Sequence[float]) -> Kept:
        """Return None."""
        return None

    def played(self, indices: list[list[int]], numbers: Kept) -> list[list[Command]]:
        """Return the indices."""
        if numbers is not None:
            raise CommandError(f"numbers of the shape {numbers.shape} do not fit")
        return [[*step] for step in indices]
