"""Commands of drones that fly freely."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.commands.base import AlikeCommands, Arrays, Kept
from desim_uav.commands.given import Command, CommandError, index_of, naming, real_numbers
from desim_uav.drone_type import DroneType
from desim_uav.model.rules import Action
from desim_uav.rules.words import AIMS

if TYPE_CHECKING:
    from gymnasium.spaces import Box

NUMBERS = ("aim_x", "aim_y", "aim_z", "aim_cruise", "aim_share", "aim_charge")
"""The names of the AIMS numbers that a command of free flight can have, in their order: those of
the displacement, of the cruise speed, of the share of tasks that is offloaded, and of the wish to
charge."""

CHARGE = NUMBERS[-1]


class FreeCommands(AlikeCommands):
    """Commands of drones that fly freely: numbers of a displacement, or the index of an action.

    There are 2 or 3 numbers for the displacement, one each for the cruise speed and for the share
    of tasks that is offloaded if there is a choice, and one for the wish to charge if the battery
    is limited. A drone that does not have this last one ignores it. Attributes are as in
    ``CellCommands``.
    """

    off_grid, mask_key, output = 1, "allowed", "number of a command"

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of the numbers of the drone that has the most of them."""
        return max((self._names(own) for own in self.types if own.free), key=len)

    def _names(self, own: DroneType) -> tuple[str, ...]:
        beside = (own.chooses_cruise, bool(own.shares), own.limited)
        chosen = (name for name, has in zip(NUMBERS[3:], beside, strict=True) if has)
        return (*NUMBERS[: self.scenario.map.dimensions], *chosen)

    @cached_property
    def _columns(self) -> list[int]:
        """The places of ``names`` among the AIMS numbers."""
        return [NUMBERS.index(name) for name in self.names]

    @property
    def outputs(self) -> tuple[str, ...]:
        """The names of the numbers."""
        return self.names

    @cached_property
    def shape_of_each(self) -> tuple[int, ...]:
        """The numbers of each drone."""
        return (self.scenario.drone_count, len(self.names))

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """The numbers of all drones, one drone after the other."""
        return (math.prod(self.shape_of_each),)

    # ---- of one drone

    def numbers(self, drone: int) -> int:
        """Return how many numbers a command of a drone has."""
        return len(self._names(self.own(drone)))

    def allowed(self, drone: int) -> str:
        """Return in words what a drone can be commanded."""
        numbers = self.numbers(drone)
        return f"{numbers} finite numbers, or the index of an action: {self._in_words}"

    def read(self, drone: int, answer: object) -> Any:
        """Return the answer of a policy as numbers or an index, or None if it is no command."""
        try:
            return answer if self.aim(drone, answer) else index_of(self.actions, answer)
        except (TypeError, ValueError, RuntimeError):
            return None

    def scripted(self, drone: int, index: int, values: Mapping[str, float | None]) -> Command:
        """Return the command of an action in a script, with the numbers of a flight by name.

        Raises CommandError if some are missing, or if there are others.
        """
        if self.actions[index] is not Action.FLY:
            return index
        names = self._names(self.own(drone))
        needs = [name for name in names if name != CHARGE]
        for name, value in values.items():
            if name in needs and value is None:
                raise CommandError(f"{name}: missing; to fly takes {', '.join(needs)}")
            if name not in names and value:
                raise CommandError(f"{name}: {value:g}: to fly takes {', '.join(names)} only")
        return [0.0 if (value := values[name]) is None else value for name in names]

    def drawn(self, drone: int, stream: np.random.Generator, mask: Sequence[bool]) -> Command:
        """Draw numbers from -1 to 1, whatever the mask allows."""
        numbers: list[float] = stream.uniform(-1.0, 1.0, self.numbers(drone)).tolist()
        return numbers

    def give(self, drone: Any, command: Any) -> None:
        """Write numbers and the index of an action into the row of a drone; -1 if it is none.

        Raises CommandError for anything else.
        """
        aim, fly = self.aim(drone.index, command), self.actions.index(Action.FLY)
        drone.command = fly if aim is not None else self.index(drone.index, command)
        take_aim(drone, aim or (0.0,) * AIMS)

    def aim(self, drone: int, command: Any) -> tuple[float, ...] | None:
        """Return the AIMS numbers of a command of a drone; None if it is an index.

        Raises CommandError if it has another number of them, or if they are not finite.
        """
        if np.ndim(command) == 0:
            return None
        numbers = [float(one) for one in command]
        counts = {self.numbers(drone), len(self.names)}
        if len(numbers) not in counts or not all(map(math.isfinite, numbers)):
            raise CommandError(
                f"a command of free flight is {min(counts)} finite numbers, not {numbers}"
            )
        aim = [0.0] * AIMS
        for column, number in zip(self._columns, numbers, strict=False):
            aim[column] = number
        return tuple(aim)

    def space(self, drone: int) -> Box:
        """Return Gymnasium's space of a drone's commands: its numbers."""
        return _box(self.numbers(drone))

    def entries(self, drone: int) -> list[int]:
        """Return which entries of a mask are those of a drone's type."""
        return [self.actions.index(action) for action in self.own(drone).actions]

    def checked(self, drone: int, command: object) -> list[float]:
        """Return the numbers of a drone. Raises CommandError, with the drone."""
        with naming(drone):
            numbers: list[float] = real_numbers(command, (self.numbers(drone),)).tolist()
        return numbers

    # ---- of all drones

    def space_of(self, drones: int) -> Box:
        """Return Gymnasium's space of the commands of so many drones as one action."""
        return _box(drones * len(self.names))

    def space_of_each(self, count: int) -> Box:
        """Return the space of the commands of each drone in so many environments."""
        return _box(count, *self.shape_of_each)

    def joined(self, commands: Sequence[Any]) -> Any:
        """Return the numbers, one drone after the other, with 0 for what a drone does not have."""
        numbers = np.zeros(self.shape_of_each)
        for drone, one in enumerate(commands):
            numbers[drone, : self.numbers(drone)] = self.checked(drone, one)
        return numbers.reshape(-1)

    def split(self, action: object) -> list[Command]:
        """Return the numbers of each drone."""
        numbers = real_numbers(action, self.shape).reshape(self.shape_of_each)
        return [*numbers.tolist()]

    def arrays(self, action: object) -> Arrays:
        """Return the index of the first action, which is to fly, and the numbers of each drone."""
        return self._arrays(real_numbers(action, self.shape))

    def arrays_of(self, count: int, actions: object, by_drone: bool) -> Arrays:
        """Return the actions of so many environments as arrays, ``by_drone`` with an axis for it.

        Otherwise the numbers of the drones come one after the other.
        """
        shape = self.shape_of_each if by_drone else self.shape
        return self._arrays(real_numbers(actions, (count, *shape)))

    def _arrays(self, block: NDArray[np.float64]) -> Arrays:
        numbers = block.reshape(-1, *self.shape_of_each)
        aims = np.zeros((*numbers.shape[:2], AIMS))
        aims[:, :, self._columns] = numbers
        return np.zeros(numbers.shape[:2], np.int64), aims

    def best(self, scores: NDArray[Any], masks: object) -> list[Command]:
        """Return the numbers that a network says (drones, outputs), cut off at -1 and 1."""
        numbers: list[Command] = scores.clip(-1.0, 1.0).tolist()
        return numbers

    def kept(self, aims: Sequence[float]) -> Kept:
        """Return the numbers, which are 0 for a drone whose command was another action."""
        drones = self.scenario.drone_count
        return np.array(aims, float).reshape(-1, drones, AIMS)[:, :, self._columns]

    def played(self, indices: list[list[int]], numbers: Kept) -> list[list[Command]]:
        """Return numbers in the place of the indices of free flights."""
        if numbers is None:
            raise CommandError("the numbers of commands of free flight are missing")
        if numbers.shape[2] != len(self.names):
            raise CommandError(f"numbers of the shape {numbers.shape} do not fit")
        fly = self.actions.index(Action.FLY)
        return [
            [own if index == fly else index for index, own in zip(step, values, strict=True)]
            for step, values in zip(indices, numbers.tolist(), strict=True)
        ]


def take_aim(drone: Any, aim: Sequence[float]) -> None:
    """Write the AIMS numbers of a command into the row of a drone."""
    for name, number in zip(NUMBERS, aim, strict=True):
        setattr(drone.course, name, number)


def _box(*shape: int) -> Box:
    from gymnasium.spaces import Box  # which takes long to import

    return Box(-1.0, 1.0, shape, np.float32)
