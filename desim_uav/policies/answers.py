"""Checks of the answers of a policy, before an engine gets them as commands."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np

from desim_uav.engine.free import numbers_of
from desim_uav.model.rules import Action, AtSpeed, fastest_of
from desim_uav.rules.decide import can_take
from desim_uav.world import World

MOST_SHOWN = 80
"""The largest number of characters of an answer that a message shows."""


class NoCommandError(ValueError):
    """An answer of a policy is not a command. The message has the drone and what is allowed."""


def commands_of(answers: Any, world: World) -> list[Any]:
    """Return the answers of a policy as commands: indices of actions, or numbers of free flight.

    There must be one for each drone. Raises NoCommandError. An action that the mask forbids is
    allowed (see ``Engine.step``).
    """
    drones, actions = len(world.type_numbers), len(world.actions)
    try:
        count = -1 if isinstance(answers, str | bytes | dict | set) else len(answers)
    except TypeError:
        count = -1
    if count != drones:
        raise _refused(answers, f"; allowed: a list with a command for each of {drones} drone(s)")
    commands: list[Any] = []
    for drone, answer in enumerate(answers):
        command = answer if type(answer) is int else _command(answer, drone, world)
        if command is None or (type(command) is int and not 0 <= command < actions):
            raise _refused(answer, f" for drone {drone}; allowed: {_allowed(drone, world)}")
        commands.append(command)
    return commands


def _command(answer: Any, drone: int, world: World) -> Any:
    """Return an answer that is not an ``int`` as a command, or None if it is not a command."""
    if isinstance(answer, Action | AtSpeed):
        return {**fastest_of(world.actions), **_indices(world)}.get(answer)
    try:
        if np.ndim(answer) > 0:
            free = world.type_of(drone).free
            given = numbers_of(world, world.type_numbers[drone], answer) if free else None
            return None if given is None else answer
        whole = operator.index(answer)
    except (TypeError, ValueError, RuntimeError):
        return None
    return None if "bool" in str(getattr(answer, "dtype", type(answer).__name__)) else whole


def _indices(world: World) -> dict[Any, int]:
    return {action: k for k, action in enumerate(world.actions)}


def _refused(answer: Any, what: str) -> NoCommandError:
    shown = f"{answer!r}"
    shown = shown[:MOST_SHOWN] + "…" * (len(shown) > MOST_SHOWN)
    return NoCommandError(f"it returned {shown}{what}")


def _allowed(drone: int, world: World) -> str:
    """Return what a drone can be commanded, in words."""
    own = world.type_of(drone)
    known = [(k, each) for k, each in enumerate(world.actions) if can_take(int(each), own.free)]
    indices = ", ".join(f"{k} ({action.name.lower()})" for k, action in known)
    if own.free:
        return f"{own.command_numbers} finite numbers, or the index of an action: {indices}"
    return f"the index of an action, a whole number: {indices}"
