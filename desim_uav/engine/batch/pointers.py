"""Arrays without their weight: memory that kernels hand on in one word, where an array is seven."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import types as numba_types
from numba.extending import intrinsic
from numba.np import arrayobj

types: Any = numba_types
populate_array: Any = arrayobj.populate_array


def _pointer(typing_context: Any, array: Any) -> Any:
    """An array's memory, to be indexed as the array is."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.make_array(signature.args[0])(context, builder, arguments[0]).data

    return types.CPointer(array.dtype)(array), generate


def _moved(typing_context: Any, memory: Any, by: Any) -> Any:
    """The memory that begins so many numbers after this one."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.gep(arguments[0], [arguments[1]])

    return memory(memory, types.int64), generate


def _table(typing_context: Any, memory: Any, rows: Any, columns: Any) -> Any:
    """Memory as an array (rows, columns)."""
    kind = types.Array(memory.dtype, 2, "C")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data, *shape = arguments
        number = context.get_data_type(kind.dtype)
        size = context.get_constant(types.intp, context.get_abi_sizeof(number))
        strides = [builder.mul(shape[1], size), size]
        found = context.make_array(kind)(context, builder)
        populate_array(found, data, shape, strides, size, meminfo=None)
        return found._getvalue()

    return kind(memory, types.int64, types.int64), generate


def _whole_at(typing_context: Any, address: Any) -> Any:
    """Whole numbers at an address."""
    return _memory_at(types.int64), _from_address


def _real_at(typing_context: Any, address: Any) -> Any:
    """Real numbers at an address."""
    return _memory_at(types.float64), _from_address


def _small_at(typing_context: Any, address: Any) -> Any:
    """Bytes at an address."""
    return _memory_at(types.int8), _from_address


def _memory_at(number: Any) -> Any:
    return types.CPointer(number)(types.int64)


def _from_address(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))


in_kernels: Any = intrinsic
pointer: Callable[[Any], Any] = in_kernels(_pointer)
moved: Callable[[Any, int], Any] = in_kernels(_moved)
table: Callable[[Any, int, int], Any] = in_kernels(_table)
whole_at: Callable[[int], Any] = in_kernels(_whole_at)
real_at: Callable[[int], Any] = in_kernels(_real_at)
small_at: Callable[[int], Any] = in_kernels(_small_at)
