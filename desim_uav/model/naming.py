"""Errors of components of one's own, which name the component."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from desim_uav.errors import SimulationError
from desim_uav.registry import what_failed
from desim_uav.rowcode.bounds import OutsideError

F = TypeVar("F", bound=Callable[..., Any])


def naming(owner: str, function: F) -> F:
    """Wrap a function so that its errors name its component; return a built-in one unchanged."""
    if not owner:
        return function

    @wraps(function)
    def named(*arguments: Any) -> Any:
        try:
            return function(*arguments)
        except OutsideError as fault:
            raise OutsideError(owner, fault.of, fault.place, fault.numbers) from None
        except IndexError as error:  # of NumPy or of a sequence
            what = what_failed(error)
            raise SimulationError(f"component {owner!r} failed: {what}") from error

    return named  # type: ignore[return-value]
