"""Components of one's own in compiled code."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

from numba.core.errors import NumbaError

from desim_uav.engine.values import values_of
from desim_uav.model.admission import RowAdmission
from desim_uav.model.compiled_rows import address_of, pointer_to
from desim_uav.model.kernels import kernel, rule
from desim_uav.model.rewards import RowReward
from desim_uav.model.rows import Words, packed
from desim_uav.rules.rewards import add_up, clear_terms
from desim_uav.rules.rows import Constants, Drone, Path, State
from desim_uav.rules.words import TOO_LARGE

LARGEST_REWARD = 1e100
"""The largest magnitude of a drone's reward; sums of such rewards over a run stay finite."""


@dataclass(frozen=True)
class Own:
    """A compiled function of one's own: its address, and the component's fields in memory."""

    function: int
    values: Words


def why_not_compiled(component: Any) -> str:
    """Return why a reward or an admission rule of one's own is not compiled; nothing if it is."""
    try:
        if isinstance(component, RowReward):
            compiled_reward(component)
        elif isinstance(component, RowAdmission):
            compiled_admission(component)
        else:
            return "it does not work on rows"
    except TypeError as error:
        return str(error)
    except NumbaError as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        return lines[1] if len(lines) > 1 else lines[0]
    return ""


@cache
def _ruled(function: Any) -> Any:
    return rule(function)


@cache
def compiled_reward(reward: RowReward) -> Own:
    """Compile a reward, which stays loaded. Raises TypeError and Numba's errors."""
    values = values_of(reward)
    pay = _ruled(type(reward).pay)
    values_at: Any = pointer_to(type(values))

    def reward_all(world: Any, state: Any) -> None:
        own = values_at(world.reward_values)
        for d in range(len(state.drones)):
            drone = state.drones[d]
            clear_terms(drone)
            pay(own, world, state, drone)
            add_up(state, drone)
            if not -LARGEST_REWARD <= state.rewards[d] <= LARGEST_REWARD:
                state.full |= TOO_LARGE

    return Own(_address(reward_all, reward, Constants, State), packed(values))


@cache
def compiled_admission(admission: RowAdmission) -> Own:
    """Compile an admission rule, which stays loaded. Raises TypeError and Numba's errors."""
    values = values_of(admission)
    scan_rows = _ruled(type(admission).scan_rows)
    values_at: Any = pointer_to(type(values))

    def scan(world: Any, path: Any, state: Any, drone: Any, phase: int) -> None:
        scan_rows(values_at(world.admission_values), world, path, state, drone, phase)

    function = _address(scan, admission, Constants, Path, State, Drone, int)
    return Own(function, packed(values))


def _address(function: Any, component: Any, *arguments: Any) -> int:
    """Compile a function of a component, which has a file of its own on disk."""
    kind = type(component)
    name = f"{function.__name__}_of_{kind.__module__}_{kind.__qualname__}"
    function.__qualname__ = name.replace(".", "_")
    return address_of(kernel(function), *arguments)
