"""Commands of free flight in environments: boxes of real numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.env.session import ActionError, real_numbers
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
        try:
            numbers[drone, :own] = real_numbers(action, (own,))
        except ActionError as problem:
            raise ActionError(f"drone_{drone}: {problem}") from problem
    return numbers.reshape(-1)
