"""The Numba types of rows, tables and queues, and how the fields of rows are read and written."""

from __future__ import annotations

import hashlib
from typing import Any, get_origin

import numpy as np
from numba import extending

from desim_uav.rowcode.bounds import A_QUEUE, A_TABLE
from desim_uav.rowcode.numba_parts import AttributeTemplate, cgutils, ir, types
from desim_uav.rowcode.rows import (
    Fitted,
    Int16,
    Int32,
    Maybe,
    Queue,
    Row,
    Table,
    held_by,
    is_far,
    is_row,
    layout_of,
    size_of,
)

infer_getattr: Any = extending.infer_getattr
intrinsic: Any = extending.intrinsic
lower_builtin: Any = extending.lower_builtin
lower_getattr_generic: Any = extending.lower_getattr_generic
lower_setattr_generic: Any = extending.lower_setattr_generic
models: Any = extending.models
register_model: Any = extending.register_model
type_callable: Any = extending.type_callable

I64, F64 = types.int64, types.float64
WORD = ir.IntType(64)
ZERO = ir.Constant(WORD, 0)


def name_of(kind: Any) -> str:
    """Return a name for a type, unique to its layout: Numba identifies types by their names."""
    layout = hashlib.sha256(layout_of(kind).encode()).hexdigest()[:8] if is_row(kind) else ""
    return f"{kind.__module__}.{kind.__qualname__}{layout}"


class Owned(types.Type):
    """The Numba type of a row, a table or a queue.

    ``owner`` is the name of the component of one's own that works on it, or empty. What is reached
    from it has the same owner, so functions are compiled for each owner, with indices checked.
    None is the owner of a queue whose indices have been checked.
    """

    def __init__(self, name: str, owner: str | None) -> None:
        self.owner = owner
        suffix = " checked before" if owner is None else f" of {owner}" if owner else ""
        super().__init__(name=f"{name}{suffix}")


class Pointer(Owned):
    """The Numba type of a row: the address of its first field."""

    def __init__(self, cls: type[Row], owner: str = "") -> None:
        self.cls = cls
        super().__init__(name_of(cls), owner)


class Entries(Owned):
    """The Numba type of a table: the address of its first entry, and their count."""

    called = A_TABLE

    def __init__(self, of: Any, owner: str = "") -> None:
        self.of = of
        super().__init__(f"Entries({name_of(of)})", owner)


class Line(Owned):
    """The Numba type of a queue: the address of its four words (see ``rows.QUEUE_WORDS``)."""

    called = A_QUEUE

    def __init__(self, of: Any, owner: str | None = "") -> None:
        self.of = of
        super().__init__(f"Line({name_of(of)})", owner)


@register_model(Pointer)
@register_model(Line)
class _Address(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, cgutils.voidptr_t)


@register_model(Entries)
class _Entries(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [("data", types.voidptr), ("count", I64)])


def type_of(kind: Any, owner: str) -> Any:
    """Return the Numba type of a field or entry of what this owner works on."""
    if is_row(kind):
        return Pointer(kind, owner)
    origin = get_origin(kind)
    if origin is Table:
        return Entries(held_by(kind), owner)
    if origin is Queue:
        return Line(held_by(kind), owner)
    if origin is Maybe:
        return Pointer(held_by(kind), owner)
    return NUMBERS[kind]


NUMBERS = {
    int: I64,
    float: F64,
    Int32: I64,
    Int16: I64,
    Fitted: I64,
    bool: types.int8,
    np.float32: types.float32,
    np.uint64: types.uint64,
}
"""The types of numbers where compiled code works with them."""

IN_MEMORY = {**NUMBERS, Int32: types.int32, Int16: types.int16}
"""The types of numbers in memory."""


def bytes_in_table(of: Any) -> int:
    """Return the length of an entry of a table in compiled code, in bytes."""
    return size_of(of) if is_row(of) else IN_MEMORY[of].bitwidth // 8


def moved(builder: Any, base: Any, size: int) -> Any:
    """Return an address increased by a number of bytes."""
    return builder.gep(base, [cgutils.intp_t(size)], inbounds=True)


def number_at(context: Any, builder: Any, place: Any, kind: Any) -> Any:
    """Return an address as a pointer to a number of this Numba type."""
    return builder.bitcast(place, context.get_value_type(kind).as_pointer())


def load(context: Any, builder: Any, place: Any, kind: Any, of: str) -> Any:
    """Return the number of a type at an address, as compiled code works with it."""
    own, worked = IN_MEMORY[kind], NUMBERS[kind]
    value = apart(builder, builder.load(number_at(context, builder, place, own)), of)
    return value if own == worked else builder.sext(value, WORD)


def store(context: Any, builder: Any, value: Any, place: Any, kind: Any, of: str) -> None:
    """Write a number of a type to an address."""
    own = IN_MEMORY[kind]
    if own != NUMBERS[kind]:
        value = builder.trunc(value, context.get_value_type(own))
    apart(builder, builder.store(value, number_at(context, builder, place, own)), of)


def half_of(context: Any, builder: Any, base: Any, half: int) -> Any:
    """Return one of the numbers of 32 bits of which a table or a queue consists."""
    return load(context, builder, moved(builder, base, 4 * half), Int32, f"half {half}")


def words_behind(builder: Any, base: Any, words: Any) -> Any:
    """Return the address that is a number of words behind another one."""
    return builder.gep(base, [builder.mul(words, cgutils.intp_t(8))], inbounds=True)


def apart(builder: Any, instruction: Any, of: str) -> Any:
    """Mark a load or store as an access to the field or entries that ``of`` names, and return it.

    LLVM then knows that a store to another field does not change a loaded value. Arrays
    (``as_array``) are not marked, so they may alias any field.
    """
    module = builder.module
    kind = module.add_metadata([of, module.add_metadata(["rows"]), ZERO])
    instruction.set_metadata("tbaa", module.add_metadata([kind, kind, ZERO]))
    return instruction


# ---- fields


@infer_getattr
class _Fields(AttributeTemplate):
    key = Pointer

    def generic_resolve(self, row: Any, name: str) -> Any:
        kind = row.cls.kinds.get(name)
        return None if kind is None else type_of(kind, row.owner)


@lower_getattr_generic(Pointer)
def get_field(context: Any, builder: Any, row: Any, value: Any, name: str) -> Any:
    """Return a field of a row by its name."""
    kind = row.cls.kinds[name]
    field, place = type_of(kind, row.owner), moved(builder, value, row.cls.byte_of[name])
    if get_origin(kind) is Maybe:
        return words_behind(builder, value, half_of(context, builder, place, 0))
    if isinstance(field, Pointer | Line):
        return place
    if isinstance(field, Entries):
        entries = cgutils.create_struct_proxy(field)(context, builder)
        if is_far(row.cls, name):
            offset = load(context, builder, place, int, "offset")
            entries.data = builder.gep(value, [offset], inbounds=True)
            entries.count = load(context, builder, moved(builder, place, 8), int, "count")
        else:
            distance = load(context, builder, place, Int32, "distance")
            entries.data = words_behind(builder, value, distance)
            entries.count = load(context, builder, moved(builder, place, 4), Int32, "count of 32")
        return entries._getvalue()
    return load(context, builder, place, kind, f"{name_of(row.cls)}.{name}")


@lower_setattr_generic(Pointer)
def _set(context: Any, builder: Any, sig: Any, arguments: Any, name: str) -> None:
    row, given = sig.args
    kind = row.cls.kinds[name]
    value = context.cast(builder, arguments[1], given, type_of(kind, row.owner))
    place = moved(builder, arguments[0], row.cls.byte_of[name])
    store(context, builder, value, place, kind, f"{name_of(row.cls)}.{name}")
