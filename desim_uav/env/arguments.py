"""Checks of the types of the arguments of environments."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from gymnasium import error

from desim_uav import typed as types_of
from desim_uav.errors import UsageError

F = TypeVar("F", bound=Callable[..., Any])


class ArgumentError(UsageError, error.Error):
    """An argument of an environment has a wrong type; this is also an error of Gymnasium."""


def typed(method: F) -> F:
    """Let a method of an environment refuse arguments that have not the types of its annotations.

    Raises ArgumentError.
    """
    return types_of.typed(method, ArgumentError)
