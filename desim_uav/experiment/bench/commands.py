"""The commands of a run as a submission keeps them: one format for every kind of flight.

An episode has as many decision epochs as it takes: a step each, or one for each time at which a
drone is free. At each epoch every drone has an action, or flies freely by the numbers of a command.
A drone with a single allowed action takes this one whatever it hears, so this one is kept.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.array_file import Form
from desim_uav.commands.aims import NUMBERS
from desim_uav.commands.given import Command
from desim_uav.world import World

FREELY = -1
"""What stands for an action where a drone flies by the numbers of its command."""


ARRAYS = {"epochs": "<i4", "actions": "<i2", "numbers": "<f8"}
"""The arrays of several runs in a file (``joined``), and their types."""


@dataclass(frozen=True, eq=False)
class Commands:
    """What drones were commanded in a run.

    ``epochs`` (episodes,) are the numbers of decision epochs of episodes, those of warm-up first.
    ``actions`` (epochs, drones) has an index into ``World.actions`` for each epoch of each episode
    and each drone, or FREELY. ``numbers`` (flights, numbers) has a row for each FREELY, in their
    order, with 0 for numbers that the command of a drone does not have.
    """

    epochs: NDArray[np.int32]
    actions: NDArray[np.int16]
    numbers: NDArray[np.float64]

    @property
    def flights(self) -> int:
        """The number of commands of free flight."""
        return int((self.actions == FREELY).sum())

    def episodes(self) -> Iterator[list[list[list[float] | int]]]:
        """Yield the commands of each episode: of each epoch those of all drones."""
        flights, at = iter(self.numbers.tolist()), 0
        for count in self.epochs.tolist():
            rows = self.actions[at : at + count].tolist()
            at += count
            yield [[next(flights) if k == FREELY else k for k in row] for row in rows]

    def first_unlike(self, other: Commands) -> tuple[int, int, int] | None:
        """Return the first episode, epoch and drone that differ; None if there are none."""
        for number, (mine, theirs) in enumerate(
            zip(self.episodes(), other.episodes(), strict=True)
        ):
            for epoch in range(max(len(mine), len(theirs))):
                both = [each[epoch] if epoch < len(each) else [] for each in (mine, theirs)]
                if both[0] != both[1]:
                    pairs = enumerate(zip(*both, strict=False))
                    return number, epoch, next((d for d, (a, b) in pairs if a != b), 0)
        return None


def noted(episodes: Sequence[Sequence[Sequence[Command]]], world: World) -> Commands:
    """Return what was commanded in the episodes of a run: of each epoch the commands of drones."""
    width, drones = len(world.commands.names), world.scenario.drone_count
    actions: list[list[int]] = []
    numbers: list[list[float]] = []
    for row in (row for rows in episodes for row in rows):
        actions.append([k if isinstance(k, int) else FREELY for k in row])
        for drone, command in enumerate(row):
            if not isinstance(command, int):
                own = [float(one) for one in command][: _count(world, drone)]
                numbers.append(own + [0.0] * (width - len(own)))
    return Commands(
        np.array([len(rows) for rows in episodes], np.int32),
        np.array(actions, np.int16).reshape(len(actions), drones),
        np.array(numbers, np.float64).reshape(len(numbers), width) + 0.0,  # no negative zero
    )


def given(commands: Commands, world: World) -> Iterator[list[list[Command]]]:
    """Yield the commands of each episode as drones of a world get them.

    Raises ValueError if one is none of these drones.
    """
    if commands.flights and commands.numbers.shape[1] != len(world.commands.names):
        raise ValueError(f"numbers must be {len(world.commands.names)} for each free flight")
    for rows in commands.episodes():
        yield [[_given(world, d, command) for d, command in enumerate(row)] for row in rows]


def _given(world: World, drone: int, command: Any) -> Command:
    if isinstance(command, int):
        if not 0 <= command < len(world.actions):
            raise ValueError(f"the commands have {command} for drone {drone}")
        return command
    return list(command[: _count(world, drone)])


def _count(world: World, drone: int) -> int:
    """Return how many numbers a command of a drone has; 0 if it flies from cell to cell."""
    own: Any = world.commands.of(drone)
    return int(own.numbers(drone)) if world.type_of(drone).free else 0


def joined(runs: Sequence[Commands]) -> dict[str, NDArray[Any]]:
    """Return the commands of runs as the arrays of a file (``ARRAYS``)."""
    arrays = {
        "epochs": np.stack([one.epochs for one in runs]),
        "actions": np.concatenate([one.actions for one in runs]),
        "numbers": np.concatenate([one.numbers for one in runs]),
    }
    return {name: array.astype(ARRAYS[name]) for name, array in arrays.items()}


def require_forms(
    forms: Mapping[str, Form], shape: tuple[int, int], most_epochs: int, drones: int
) -> None:
    """Raise ValueError unless arrays of a file can be those of ``shape`` (runs, episodes)."""
    runs, episodes = shape
    most = runs * episodes * most_epochs
    limits = {
        "epochs": ((runs, runs), (episodes, episodes)),
        "actions": ((0, most), (drones, drones)),
        "numbers": ((0, most * drones), (0, len(NUMBERS))),
    }
    for name, ends in limits.items():
        found, dtype = forms[name], np.dtype(ARRAYS[name])
        fits = len(found.shape) == 2 and all(
            low <= length <= high for length, (low, high) in zip(found.shape, ends, strict=True)
        )
        if found.dtype != dtype or not fits:
            words = (f"{high}" if low == high else f"at most {high}" for low, high in ends)
            raise ValueError(
                f"{name} must be {dtype} of the shape ({', '.join(words)}), not {found.dtype} of "
                f"the shape {found.shape}"
            )


def parted(arrays: dict[str, NDArray[Any]]) -> list[Commands]:
    """Return the commands of the runs of a file. Raises ValueError if arrays do not fit."""
    epochs, actions, numbers = (arrays[name] for name in ARRAYS)
    if epochs.size and epochs.min() < 0:
        raise ValueError("epochs: one is negative")
    if epochs.sum(dtype=np.int64) != len(actions):
        raise ValueError(f"epochs: they are not {len(actions)} together, as actions has")
    if actions.size and actions.min() < FREELY:
        raise ValueError(f"actions: one is less than {FREELY}")
    if (actions == FREELY).sum() != len(numbers):
        raise ValueError(f"numbers: {len(numbers)} rows, but actions has another number of flights")
    if not np.isfinite(numbers).all():
        raise ValueError("numbers: one is not finite")
    runs, at, flown = [], 0, 0
    for each in epochs:
        own = actions[at : at + int(each.sum(dtype=np.int64))]
        flights = int((own == FREELY).sum())
        runs.append(Commands(each, own, numbers[flown : flown + flights]))
        at, flown = at + len(own), flown + flights
    return runs


def decisions_sha256(commands: Sequence[Commands]) -> str:
    """Return the SHA-256 of what a policy decided in its runs, in the order of the seeds."""
    sha256 = hashlib.sha256()
    for each in commands:
        for name, kind in ARRAYS.items():
            array = getattr(each, name)
            sha256.update(repr(array.shape).encode())
            sha256.update(np.ascontiguousarray(array, kind).tobytes())
    return sha256.hexdigest()
