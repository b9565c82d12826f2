"""The Numba types of rows, tables and queues, and how the fields of rows are read and written."""

from __future__ import annotations

import hashlib
from typing import Any, get_origin

import numpy as np
from numba import extending

from desim_uav.rowcode.bounds import A_QUEUE, A_TABLE
from desim_uav.rowcode.numba_parts import AttributeTemplate, cgutils, ir, types
from desim_uav.rowcode.rows import Queue, Row, Table, held_by, is_row, layout_of

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
    return NUMBERS[kind]


NUMBERS = {
    int: I64,
    float: F64,
    bool: types.int8,
    np.float32: types.float32,
    np.uint64: types.uint64,
}
BYTES = {bool: 1, np.float32: 4}


def moved(builder: Any, base: Any, words: int) -> Any:
    """Return an address increased by a number of words."""
    return builder.gep(base, [cgutils.intp_t(8 * words)], inbounds=True)


def number_at(context: Any, builder: Any, place: Any, kind: Any) -> Any:
    """Return an address as a pointer to a number of this Numba type."""
    return builder.bitcast(place, context.get_value_type(kind).as_pointer())


def load(context: Any, builder: Any, base: Any, words: int, kind: Any = I64, of: str = "") -> Any:
    """Return the number that is this many words behind an address."""
    place = number_at(context, builder, moved(builder, base, words), kind)
    return apart(builder, builder.load(place), of or f"word {words}")


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
    kind, place = row.cls.kinds[name], row.cls.places[name]
    field = type_of(kind, row.owner)
    if isinstance(field, Pointer | Line):
        return moved(builder, value, place)
    if isinstance(field, Entries):
        entries = cgutils.create_struct_proxy(field)(context, builder)
        offset = load(context, builder, value, place, I64, "offset")
        entries.data = builder.gep(value, [offset], inbounds=True)
        entries.count = load(context, builder, value, place + 1, I64, "count")
        return entries._getvalue()
    return load(context, builder, value, place, field, f"{name_of(row.cls)}.{name}")


@lower_setattr_generic(Pointer)
def _set(context: Any, builder: Any, sig: Any, arguments: Any, name: str) -> None:
    row, kind = sig.args
    field = type_of(row.cls.kinds[name], row.owner)
    value = context.cast(builder, arguments[1], kind, field)
    place = moved(builder, arguments[0], row.cls.places[name])
    stored = builder.store(value, number_at(context, builder, place, field))
    apart(builder, stored, f"{name_of(row.cls)}.{name}")
