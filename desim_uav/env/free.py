"""Commands of free flight in environments: boxes of real numbers, beside indices of actions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.free import numbers_of
from desim_uav.env.session import ActionError, real_numbers, whole_numbers
from desim_uav.model.rules import Action
from desim_uav.rules.words import AIMS
from desim_uav.world import World


def aims_of(numbers: NDArray[np.float64], world: World) -> NDArray[np.float64]:
    """Return commands (…, drones * numbers) with all that an engine knows: (…, drones, AIMS)."""
    own = numbers.reshape(-1, len(world.type_numbers), world.command_numbers)
    aims = np.zeros((*own.shape[:2], AIMS))
    flown = world.dimensions
    aims[:, :, :flown] = own[:, :, :flown]
    if world.chooses_cruise:
        aims[:, :, AIMS - 2] = own[:, :, flown]
    if world.scenario.limited_battery:
        aims[:, :, AIMS - 1] = own[:, :, -1]
    return aims


def of_all(actions: Sequence[Any], world: World) -> NDArray[np.float64]:
    """Return the actions of the drones as one. Raises ActionError, which names the drone.

    A drone whose battery is unlimited has no number for the wish to charge, which is 0 then.
    """
    numbers = np.zeros((len(actions), world.command_numbers))
    for drone, action in enumerate(actions):
        own = world.type_of(drone).command_numbers
        numbers[drone, :own] = _numbers(drone, action, own)
    return numbers.reshape(-1)


def _numbers(drone: int, action: Any, count: int) -> NDArray[np.float64]:
    """Return the numbers of a command of a drone. Raises ActionError, which names the drone."""
    try:
        return real_numbers(action, (count,))
    except ActionError as problem:
        raise ActionError(f"drone_{drone}: {problem}") from problem


def each_own(actions: Sequence[Any], world: World) -> list[int | list[float]]:
    """Return the commands of drones of which some fly freely and others from cell to cell.

    The former have numbers, the latter the index of one of their own actions. Raises ActionError,
    which names the drone.
    """
    commands: list[int | list[float]] = []
    for drone, action in enumerate(actions):
        own = world.type_of(drone)
        if own.free:
            commands.append(_numbers(drone, action, own.command_numbers).tolist())
            continue
        try:
            command = int(whole_numbers(action, ()))
        except ActionError as problem:
            raise ActionError(f"drone_{drone}: {problem}") from problem
        if not 0 <= command < len(own.actions):
            last = len(own.actions) - 1
            raise ActionError(f"drone_{drone}: actions must be from 0 to {last}, not {command}")
        commands.append(command)
    return commands


def apart(
    commands: Sequence[int | list[float]], world: World
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return commands as indices of actions (1, drones), and their numbers (1, drones, AIMS)."""
    fly, drones = world.actions.index(Action.FLY), len(commands)
    indices, aims = np.full((1, drones), fly), np.zeros((1, drones, AIMS))
    for drone, command in enumerate(commands):
        numbers = numbers_of(world, world.type_numbers[drone], command)
        if numbers is None:
            indices[0, drone] = command
        else:
            aims[0, drone] = numbers
    return indices, aims
