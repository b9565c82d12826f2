"""Checks of the types of the arguments of environments."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from gymnasium import error

from desim_uav import typed as types_of
from desim_uav.errors import UsageError, in_short

F = TypeVar("F", bound=Callable[..., Any])


class ArgumentError(UsageError, error.Error):
    """An argument of an environment has a wrong type; this is also an error of Gymnasium."""


def typed(method: F) -> F:
    """Let a method of an environment refuse arguments that have not the types of its annotations.

    Raises ArgumentError.
    """
    return types_of.typed(method, ArgumentError)


def of_class(wrapped: type, env: object) -> None:
    """Raise ArgumentError if an environment is none of this class, and no wrapper of one."""
    if not isinstance(getattr(env, "unwrapped", None), wrapped):
        text = in_short(repr(env), 100)
        raise ArgumentError(f"env: {text}: must be a {wrapped.__name__}, or a wrapper of one")
