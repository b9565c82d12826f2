"""The decorators of the compiled engine, whose kernels call kernels of other files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from desim_uav.model.kernels import OPTIONS, for_any_number

F = TypeVar("F", bound=Callable[..., Any])

UNWRAPPED: dict[str, Any] = {
    **OPTIONS,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}


def inner(function: F) -> F:
    """A kernel that other kernels call and Python does not."""
    return for_any_number(function, UNWRAPPED)


def part(function: F) -> F:
    """The same; it becomes part of the machine code of those that call it, which are few."""
    return for_any_number(function, {**UNWRAPPED, "forceinline": True})
