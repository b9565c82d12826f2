"""The options with which functions are compiled: strict IEEE arithmetic, and no counting."""

from __future__ import annotations

from collections.abc import Callable
from inspect import signature
from typing import Any

from numba import extending

from desim_uav.rowcode.bounds import CHECKED
from desim_uav.rowcode.numba_parts import WITHOUT_COUNTING, InnerCompiler, share_last

MAKER: dict[str, Any] = {
    **{"nogil": True, "fastmath": False, "error_model": "numpy", "no_cfunc_wrapper": True},
    **({"boundscheck": True} if CHECKED else {}),
}

OPTIONS: dict[str, Any] = {**MAKER, **WITHOUT_COUNTING}

WITHIN: dict[str, Any] = {
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "pipeline_class": InnerCompiler,
}

INNER: dict[str, Any] = {**OPTIONS, **WITHIN, "forceinline": True}
"""The options of functions that only kernels call, whose machine code they become part of."""

CHECK: dict[str, Any] = {"boundscheck": True}
"""What is added to the options of code of one's own, whose indices of arrays are checked."""


def overload(function: Any, by_types: bool = False, **options: Any) -> Callable[[Any], Any]:
    """Return a decorator of what compiled code calls in place of a function, inlined.

    If ``by_types``, the decorated function returns it, or None, given the types of the arguments.
    """
    return _shared(extending.overload, by_types, function, **options)


def overload_method(kind: Any, name: str, by_types: bool = False) -> Callable[[Any], Any]:
    """Return a decorator, as ``overload``, of a method of a type of compiled code."""
    return _shared(extending.overload_method, by_types, kind, name)


def overload_attribute(kind: Any, name: str) -> Callable[[Any], Any]:
    """Return a decorator, as ``overload``, of an attribute of a type of compiled code."""
    return _shared(extending.overload_attribute, False, kind, name)


def _shared(maker: Any, by_types: bool, *of: Any, **options: Any) -> Callable[[Any], Any]:
    def decorate(implementation: Any) -> Any:
        typed: Any = implementation if by_types else lambda *types: implementation
        typed.__signature__ = signature(implementation)
        maker(*of, jit_options={**INNER, **options})(typed)
        share_last()
        return implementation

    return decorate
