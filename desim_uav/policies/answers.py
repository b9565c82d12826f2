"""Checks of the answers of a policy, before an engine gets them as commands."""

from __future__ import annotations

from typing import Any

from desim_uav.commands.given import Command
from desim_uav.world import World

MOST_SHOWN = 80
"""The largest number of characters of an answer that a message shows."""


class NoCommandError(ValueError):
    """An answer of a policy is not a command. The message has the drone and what is allowed."""


def commands_of(answers: Any, world: World) -> list[Command]:
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
    commands: list[Command] = []
    for drone, answer in enumerate(answers):
        own = world.commands.of(drone)
        command = answer if type(answer) is int else own.read(drone, answer)
        if command is None or (type(command) is int and not 0 <= command < actions):
            raise _refused(answer, f" for drone {drone}; allowed: {own.allowed(drone)}")
        commands.append(command)
    return commands


def _refused(answer: object, what: str) -> NoCommandError:
    text = f"{answer!r}"
    text = text[:MOST_SHOWN] + "…" * (len(text) > MOST_SHOWN)
    return NoCommandError(f"it returned {text}{what}")
