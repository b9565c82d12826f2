"""The options with which functions are compiled: strict IEEE arithmetic, and no counting."""

from __future__ import annotations

from collections.abc import Callable
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


def overload(function: Any) -> Callable[[Any], Any]:
    """Return Numba's decorator of that name, for functions that only kernels call."""
    return _shared(extending.overload, function, jit_options=INNER)


def overload_of_any(function: Any) -> Callable[[Any], Any]:
    """Return the same decorator for what takes any arguments and is not inlined."""
    options = {**INNER, "forceinline": False}
    return _shared(extending.overload, function, jit_options=options, strict=False)


def overload_method(kind: Any, name: str) -> Callable[[Any], Any]:
    """Return Numba's decorator of that name, for functions that only kernels call."""
    return _shared(extending.overload_method, kind, name, jit_options=INNER)


def overload_attribute(kind: Any, name: str) -> Callable[[Any], Any]:
    """Return Numba's decorator of that name, for functions that only kernels call."""
    return _shared(extending.overload_attribute, kind, name, jit_options=INNER)


def _shared(maker: Any, *of: Any, **options: Any) -> Callable[[Any], Any]:
    def decorate(implementation: Any) -> Any:
        result = maker(*of, **options)(implementation)
        share_last()
        return result

    return decorate
