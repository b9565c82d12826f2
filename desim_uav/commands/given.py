"""What is given as a command: how it is read, and the error if it is none."""

from __future__ import annotations

import operator
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.rules import Action, Choice, Variant, fastest_of

Command = int | list[float]
"""An index into ``World.actions``, or the numbers of a displacement in free flight."""


class CommandError(ValueError):
    """What was given is not a command. The message says what is allowed."""


def by_name(actions: Sequence[Choice]) -> dict[str, int]:
    """Return the index of each action by its name.

    A name without a speed or a share is that at the highest one.
    """
    named = {kind.name.lower(): k for kind, k in fastest_of(actions).items()}
    for k, action in enumerate(actions):
        if isinstance(action, Variant):
            for one in (replace(action, share=None), replace(action, cruise_mps=None)):
                named[one.name.lower()] = k
    return named | {action.name.lower(): k for k, action in enumerate(actions)}


def index_of(actions: Sequence[Choice], answer: Any) -> int | None:
    """Return an answer of a policy, an action or a whole number, as an index; None for others.

    A number need not be that of an action.
    """
    if type(answer) is int:
        return answer
    if isinstance(answer, Action | Variant):
        return by_name(actions).get(answer.name.lower())
    try:
        if np.ndim(answer) > 0:
            return None
        whole = operator.index(answer)
    except (TypeError, ValueError, RuntimeError):
        return None
    return None if "bool" in str(getattr(answer, "dtype", type(answer).__name__)) else whole


def whole_numbers(actions: object, *shapes: tuple[int, ...]) -> NDArray[np.int64]:
    """Return actions as int64; they must have one of these shapes. Raises CommandError."""
    try:
        numbers = np.asarray(actions)
    except ValueError as problem:
        raise CommandError(f"actions must be whole numbers: {problem}") from problem
    if numbers.dtype != np.int64:
        if numbers.dtype.kind not in "iu":
            raise CommandError(f"actions must be whole numbers, not {actions!r}")
        numbers = numbers.astype(np.int64)
    if numbers.shape not in shapes:
        raise CommandError(f"actions must have the shape {shapes[0]}, not {numbers.shape}")
    return numbers


def real_numbers(actions: object, *shapes: tuple[int, ...]) -> NDArray[np.float64]:
    """Return actions as float64; they must have one of these shapes. Raises CommandError."""
    try:
        numbers = np.asarray(actions, np.float64)
    except (TypeError, ValueError) as problem:
        raise CommandError(f"actions must be numbers: {problem}") from problem
    if numbers.shape not in shapes:
        raise CommandError(f"actions must have the shape {shapes[0]}, not {numbers.shape}")
    if not np.isfinite(numbers).all():
        raise CommandError(f"actions must be finite numbers, not {numbers.tolist()}")
    return numbers


def out_of_range(commands: object, actions: Sequence[Choice]) -> CommandError:
    """Return the error of commands of which at least one is not an action."""
    return CommandError(f"actions must be from 0 to {len(actions) - 1}, not {commands}")


@contextmanager
def naming(drone: int) -> Iterator[None]:
    """Let errors say which drone's command is wrong."""
    try:
        yield
    except CommandError as problem:
        raise CommandError(f"drone_{drone}: {problem}") from problem
