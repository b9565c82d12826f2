"""The decorators of the compiled engine, whose kernels call kernels of other files."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array
from numpy.typing import NDArray

F = TypeVar("F", bound=Callable[..., Any])

OPTIONS: dict[str, Any] = {
    "nogil": True,
    "fastmath": False,
    "error_model": "numpy",
    "_nrt": False,
}
"""``_nrt``: no kernel allocates anything, so no references are counted."""

SOURCES = ("model", "engine/batch", "learning")


def inner(function: F) -> F:
    """A kernel that other kernels call and Python does not: part of their machine code.

    It is compiled once for all whole numbers; left to itself, Numba compiles it for each constant
    it is called with.
    """
    unwrapped = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    compiled: Any = numba.njit(**OPTIONS, **unwrapped)(function)
    template = compiled.get_call_template

    def for_any_number(args: Any, kws: Any) -> Any:
        general: Any = types.unliteral
        return template(tuple(map(general, args)), {name: general(k) for name, k in kws.items()})

    compiled.get_call_template = for_any_number
    return cast(F, compiled)


def kernel(function: F) -> F:
    """A kernel that Python calls: cached on disk, with all that it calls.

    Numba looks at a function's own file to see whether machine code on disk is stale, which is not
    enough here: it is, when any source of a kernel has changed.
    """
    compiled: Any = numba.njit(cache=True, **OPTIONS)(function)
    compiled._cache._cache_file._source_stamp = digest()
    return cast(F, compiled)


@cache
def digest() -> str:
    """What all sources of kernels say."""
    package = Path(__file__).parents[2]
    found = hashlib.sha256()
    for folder in SOURCES:
        for file in sorted((package / folder).glob("*.py")):
            found.update(file.read_bytes())
    return found.hexdigest()


# ---- memory without the weight of arrays


def _pointer(typing_context: Any, array: NDArray[Any]) -> Any:
    """An array's memory, indexed as it is and one word to hand on where an array is seven."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.make_array(signature.args[0])(context, builder, arguments[0]).data

    return types.CPointer(array.dtype)(array), generate


def _moved(typing_context: Any, memory: NDArray[Any], by: int) -> Any:
    """The memory that begins ``by`` numbers after this one."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.gep(*arguments[:1], arguments[1:])

    return memory(memory, types.int64), generate


def _table(typing_context: Any, memory: NDArray[Any], rows: int, columns: int) -> Any:
    """Memory as an array (rows, columns)."""
    kind = types.Array(memory.dtype, 2, "C")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data, *shape = arguments
        number = context.get_data_type(kind.dtype)
        size = context.get_constant(types.intp, context.get_abi_sizeof(number))
        strides = [builder.mul(shape[1], size), size]
        made = context.make_array(kind)(context, builder)
        populate_array(made, data, shape, strides, size, meminfo=None)
        return made._getvalue()

    return kind(memory, types.int64, types.int64), generate


pointer: Callable[..., Any] = intrinsic(_pointer)
moved: Callable[..., Any] = intrinsic(_moved)
table: Callable[..., Any] = intrinsic(_table)
