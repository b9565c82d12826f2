"""The decorators of the compiled engine, whose kernels call kernels of other files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
from numba import types

from desim_uav.model.kernels import OPTIONS

F = TypeVar("F", bound=Callable[..., Any])

UNWRAPPED: dict[str, Any] = {
    **OPTIONS,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}


def inner(function: F) -> F:
    """A kernel that other kernels call and Python does not."""
    return _for_any_number(function, UNWRAPPED)


def part(function: F) -> F:
    """The same; it becomes part of the machine code of those that call it, which are few."""
    return _for_any_number(function, {**UNWRAPPED, "forceinline": True})


def _for_any_number(function: F, options: dict[str, Any]) -> F:
    """Compile it once for all whole numbers.

    Left to itself, Numba compiles it for each constant it is called with.
    """
    compiled: Any = numba.njit(**options)(function)
    template = compiled.get_call_template

    def for_any_number(args: Any, kws: Any) -> Any:
        general: Any = types.unliteral
        return template(tuple(map(general, args)), {name: general(k) for name, k in kws.items()})

    compiled.get_call_template = for_any_number
    return cast(F, compiled)
