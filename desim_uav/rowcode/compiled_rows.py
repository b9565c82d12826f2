"""Rows, tables and functions that compiled code reaches by their addresses."""

from __future__ import annotations

from typing import Any

from desim_uav.rowcode.compiled_entries import first_of
from desim_uav.rowcode.compiled_types import (
    F64,
    I64,
    IN_MEMORY,
    NUMBERS,
    Entries,
    Pointer,
    intrinsic,
    lower_builtin,
    number_at,
    type_callable,
)
from desim_uav.rowcode.numba_parts import address_of as machine_code
from desim_uav.rowcode.numba_parts import cgutils, populate_array, types
from desim_uav.rowcode.options import overload
from desim_uav.rowcode.rows import Row, address, is_row, shaped

# ---- functions whose addresses rows hold


def call(function: Any, arguments: tuple[Any, ...]) -> None:
    """Call a function, which is given by its address in compiled code (see ``address_of``)."""
    function(*arguments)


def call_for_int(function: Any, arguments: tuple[Any, ...]) -> int:
    """Call a function as ``call`` does, and return its result, a whole number."""
    return int(function(*arguments))


def call_for_float(function: Any, arguments: tuple[Any, ...]) -> float:
    """Call a function as ``call`` does, and return its result, a float."""
    return float(function(*arguments))


def _caller(returned: Any) -> Any:
    """Return an intrinsic that calls the function at an address, which returns this type.

    If that function ends by an error, so does the caller.
    """

    def typed(typing_context: Any, function: Any, arguments: Any) -> Any:
        def generate(context: Any, builder: Any, sig: Any, values: Any) -> Any:
            parts, kinds = cgutils.unpack_tuple(builder, values[1]), list(arguments)
            convention = context.call_conv
            kind = convention.get_function_type(returned, kinds)
            place = builder.inttoptr(values[0], kind.as_pointer())
            status, value = convention.call_function(builder, place, returned, kinds, parts)
            with cgutils.if_unlikely(builder, status.is_error):
                convention.return_status_propagate(builder, status)
            return value

        return returned(I64, arguments), generate

    return intrinsic(typed)


_called, _called_for_int, _called_for_float = _caller(types.none), _caller(I64), _caller(F64)


@overload(call)
def _of_call(function: Any, arguments: Any) -> None:
    _called(function, arguments)


@overload(call_for_int)
def _of_call_for_int(function: Any, arguments: Any) -> Any:
    return _called_for_int(function, arguments)


@overload(call_for_float)
def _of_call_for_float(function: Any, arguments: Any) -> Any:
    return _called_for_float(function, arguments)


def address_of(kernel: Any, *classes: Any, owner: str = "") -> int:
    """Return the address of a kernel that takes rows of these classes and numbers.

    The kernel is compiled if necessary. The address is valid in this process only, and for ``call``
    and the like. ``owner`` is the component of one's own that the kernel is of, or empty.
    """
    numbers = {int: I64, float: F64, bool: types.boolean}
    arguments = tuple(Pointer(cls, owner) if is_row(cls) else numbers[cls] for cls in classes)
    return machine_code(kernel, arguments)


# ---- rows and tables from addresses


def pointer_to(cls: type[Row], owner: str = "") -> Any:
    """Return a function, for compiled code, that returns the row of a class at an address.

    ``owner`` is the component of one's own that works on it, or empty.
    """

    def at(typing_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
            return builder.inttoptr(arguments[0], cgutils.voidptr_t)

        return Pointer(cls, owner)(I64), generate

    return intrinsic(at)


def _place_of(typing_context: Any, of: Any) -> Any:
    """Return the address of a row, or of the first entry of a table."""

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        (value,) = arguments
        first = value if isinstance(of, Pointer) else first_of(context, builder, of, value)
        return builder.ptrtoint(first, cgutils.intp_t)

    return I64(of), generate


place_of: Any = intrinsic(_place_of)


@overload(address)
def _of_address(one: Any) -> Any:
    return place_of(one)


def _as_array(typing_context: Any, entries: Any, shape: Any) -> Any:
    """Return a table's or queue's entries as an array, whose shape may exceed a queue's count."""
    if is_row(entries.of):
        number = F64 if set(entries.of.kinds.values()) == {float} else I64
    else:
        number = IN_MEMORY[entries.of]
    kind = types.Array(number, len(shape), "C")

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        data = first_of(context, builder, entries, arguments[0])
        data = number_at(context, builder, data, kind.dtype)
        sizes = cgutils.unpack_tuple(builder, arguments[1])
        size = cgutils.intp_t(number.bitwidth // 8)
        strides = [size]
        for count in reversed(sizes[1:]):
            strides.insert(0, builder.mul(count, strides[0]))
        array = context.make_array(kind)(context, builder)
        populate_array(array, data, sizes, strides, size, meminfo=None)
        return array._getvalue()

    return kind(entries, shape), generate


as_array: Any = intrinsic(_as_array)


@type_callable(shaped)
def _type_of_shaped(context: Any) -> Any:
    def typed(entries: Any, shape: Any) -> Any:
        return _as_array(context, entries, shape)[0] if isinstance(entries, Entries) else None

    return typed


@lower_builtin(shaped, Entries, types.BaseTuple)
def _shaped(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    return _as_array(context, *sig.args)[1](context, builder, sig, arguments)


def entries_at(of: Any, owner: str = "") -> Any:
    """Return a function, for compiled code, that makes a table of an address and a count.

    Its entries are of type ``of``: int, float, np.float32, or bool for entries of one byte.
    ``owner`` is the component of one's own that works on it, or empty.
    """

    def at(typing_context: Any, address: Any, count: Any) -> Any:
        kind = Entries(of, owner)

        def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
            entries = cgutils.create_struct_proxy(kind)(context, builder)
            entries.data = builder.inttoptr(arguments[0], cgutils.voidptr_t)
            entries.count = arguments[1]
            return entries._getvalue()

        return kind(I64, I64), generate

    return intrinsic(at)


def array_at(of: Any) -> Any:
    """Return a function, for compiled code, that makes an array of an address and a count.

    Its numbers are of type ``of``: int, float or np.uint64.
    """
    kind = types.Array(NUMBERS[of], 1, "C")

    def at(typing_context: Any, address: Any, count: Any) -> Any:
        def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
            pointer = context.get_value_type(kind.dtype).as_pointer()
            data, size = builder.inttoptr(arguments[0], pointer), cgutils.intp_t(8)
            array = context.make_array(kind)(context, builder)
            populate_array(array, data, [arguments[1]], [size], size, meminfo=None)
            return array._getvalue()

        return kind(I64, I64), generate

    return intrinsic(at)
