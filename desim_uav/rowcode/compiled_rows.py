"""Rows in compiled code, where a row is a pointer to its fields, which are accessed by name."""

from __future__ import annotations

import hashlib
import operator
from typing import Any, get_origin

import numpy as np
from numba import extending

from desim_uav.rowcode.bounds import A_QUEUE, A_TABLE, CHECKED
from desim_uav.rowcode.numba_parts import (
    AttributeTemplate,
    TypingError,
    cgutils,
    fail_outside,
    ir,
    place_lowered,
    populate_array,
    signature,
    types,
)
from desim_uav.rowcode.numba_parts import address_of as machine_code
from desim_uav.rowcode.rows import (
    Queue,
    Row,
    Table,
    address,
    held_by,
    is_row,
    layout_of,
    width_of,
)

infer_getattr: Any = extending.infer_getattr
intrinsic: Any = extending.intrinsic
lower_builtin: Any = extending.lower_builtin
lower_getattr_generic: Any = extending.lower_getattr_generic
lower_setattr_generic: Any = extending.lower_setattr_generic
models: Any = extending.models
overload: Any = extending.overload
register_model: Any = extending.register_model
type_callable: Any = extending.type_callable

I64, F64 = types.int64, types.float64
WORD = ir.IntType(64)
ZERO = ir.Constant(WORD, 0)


def _name_of(kind: Any) -> str:
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
        told = " checked before" if owner is None else f" of {owner}" if owner else ""
        super().__init__(name=f"{name}{told}")


class Pointer(Owned):
    """The Numba type of a row: the address of its first field."""

    def __init__(self, cls: type[Row], owner: str = "") -> None:
        self.cls = cls
        super().__init__(_name_of(cls), owner)


class Entries(Owned):
    """The Numba type of a table: the address of its first entry, and their count."""

    called = A_TABLE

    def __init__(self, of: Any, owner: str = "") -> None:
        self.of = of
        super().__init__(f"Entries({_name_of(of)})", owner)


class Line(Owned):
    """The Numba type of a queue: the address of its four words (see ``rows.QUEUE_WORDS``)."""

    called = A_QUEUE

    def __init__(self, of: Any, owner: str | None = "") -> None:
        self.of = of
        super().__init__(f"Line({_name_of(of)})", owner)


@register_model(Pointer)
@register_model(Line)
class _Address(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, cgutils.voidptr_t)


@register_model(Entries)
class _Entries(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [("data", types.voidptr), ("count", I64)])


def _type_of(kind: Any, owner: str) -> Any:
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


def _load(context: Any, builder: Any, base: Any, words: int, kind: Any = I64, of: str = "") -> Any:
    """Return the number that is this many words behind an address."""
    place = number_at(context, builder, moved(builder, base, words), kind)
    return _apart(builder, builder.load(place), of or f"word {words}")


def _apart(builder: Any, instruction: Any, of: str) -> Any:
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
        return None if kind is None else _type_of(kind, row.owner)


@lower_getattr_generic(Pointer)
def _get(context: Any, builder: Any, row: Any, value: Any, name: str) -> Any:
    kind, place = row.cls.kinds[name], row.cls.places[name]
    field = _type_of(kind, row.owner)
    if isinstance(field, Pointer | Line):
        return moved(builder, value, place)
    if isinstance(field, Entries):
        entries = cgutils.create_struct_proxy(field)(context, builder)
        offset = _load(context, builder, value, place, I64, "offset")
        entries.data = builder.gep(value, [offset], inbounds=True)
        entries.count = _load(context, builder, value, place + 1, I64, "count")
        return entries._getvalue()
    return _load(context, builder, value, place, field, f"{_name_of(row.cls)}.{name}")


@lower_setattr_generic(Pointer)
def _set(context: Any, builder: Any, sig: Any, arguments: Any, name: str) -> None:
    row, kind = sig.args
    field = _type_of(row.cls.kinds[name], row.owner)
    value = context.cast(builder, arguments[1], kind, field)
    place = moved(builder, arguments[0], row.cls.places[name])
    stored = builder.store(value, number_at(context, builder, place, field))
    _apart(builder, stored, f"{_name_of(row.cls)}.{name}")


# ---- entries


def _first_of(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return the address of the first entry of a table or a queue."""
    if isinstance(kind, Entries):
        return cgutils.create_struct_proxy(kind)(context, builder, value=value).data
    return builder.gep(value, [_load(context, builder, value, 0, I64, "offset")], inbounds=True)


def _entry(context: Any, builder: Any, kind: Any, value: Any, k: Any) -> Any:
    """Return the address of entry k of a table or a queue."""
    size = cgutils.intp_t(BYTES.get(kind.of) or 8 * width_of(kind.of))
    first = _first_of(context, builder, kind, value)
    return builder.gep(first, [builder.mul(k, size)], inbounds=True)


def _require_inside(context: Any, builder: Any, kind: Any, value: Any, k: Any) -> None:
    """End the function by OutsideError if indices of this owner are checked, and there is no k."""
    if not (CHECKED or kind.owner):
        return
    count = _count(context, builder, kind, value)
    with cgutils.if_unlikely(builder, builder.icmp_unsigned(">=", k, count)):
        fail_outside(context, builder, kind.owner, kind.called, place_lowered(), (k, count))


@type_callable(operator.getitem)
def _type_of_item(context: Any) -> Any:
    def typed(entries: Any, k: Any) -> Any:
        if isinstance(entries, Entries | Line) and isinstance(k, types.Integer):
            return signature(_type_of(entries.of, entries.owner or ""), entries, I64)
        return None

    return typed


@lower_builtin(operator.getitem, Entries, I64)
@lower_builtin(operator.getitem, Line, I64)
def _get_item(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    _require_inside(context, builder, sig.args[0], *arguments)
    return _get_entry(context, builder, sig, arguments)


def _get_entry(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    place = _entry(context, builder, sig.args[0], *arguments)
    if isinstance(sig.return_type, Pointer):
        return place
    loaded = builder.load(number_at(context, builder, place, sig.return_type))
    return _apart(builder, loaded, f"entry {sig.return_type}")


@type_callable(operator.setitem)
def _type_of_set_item(context: Any) -> Any:
    def typed(entries: Any, k: Any, value: Any) -> Any:
        if isinstance(entries, Entries | Line) and not is_row(entries.of):
            return signature(types.none, entries, I64, _type_of(entries.of, entries.owner or ""))
        return None

    return typed


@lower_builtin(operator.setitem, Entries, I64, types.Number)
@lower_builtin(operator.setitem, Line, I64, types.Number)
def _set_item(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    _require_inside(context, builder, sig.args[0], *arguments[:2])
    return _set_entry(context, builder, sig, arguments)


def _set_entry(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    place = _entry(context, builder, sig.args[0], *arguments[:2])
    stored = builder.store(arguments[2], number_at(context, builder, place, sig.args[2]))
    _apart(builder, stored, f"entry {sig.args[2]}")
    return context.get_dummy_value()


@type_callable(len)
def _type_of_len(context: Any) -> Any:
    def typed(entries: Any) -> Any:
        if isinstance(entries, Entries | Line):
            return signature(I64, entries)
        return None

    return typed


@lower_builtin(len, Entries)
@lower_builtin(len, Line)
def _len(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    return _count(context, builder, *sig.args, *arguments)


def _count(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return the number of entries of a table or a queue."""
    if isinstance(kind, Entries):
        return cgutils.create_struct_proxy(kind)(context, builder, value=value).count
    return _load(context, builder, value, 1)


# ---- entries of which the caller knows that there is memory for them


def _spare(typing_context: Any, entries: Any, k: Any) -> Any:
    """Return entry k, which may be one after the last."""
    return _type_of(entries.of, entries.owner or "")(entries, I64), _get_entry


def _set_spare(typing_context: Any, entries: Any, k: Any, value: Any) -> Any:
    """Change entry k, a number, which may be one after the last."""
    kind = _type_of(entries.of, entries.owner or "")
    if is_row(entries.of):
        raise TypingError("an entry that is a row cannot be assigned")
    return types.none(entries, I64, kind), _set_entry


spare, set_spare = intrinsic(_spare), intrinsic(_set_spare)


# ---- queues, whose words 1 to 3 are the count, the size of the buffer, whether the queue overran


def _word(typing_context: Any, line: Any, word: Any) -> Any:
    """Read word 1, 2 or 3 of a queue."""
    place = word.literal_value

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        return _load(context, builder, arguments[0], place)

    return I64(line, word), generate


def _set_word(typing_context: Any, line: Any, word: Any, value: Any) -> Any:
    """Write word 1, 2 or 3 of a queue."""
    place = word.literal_value

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        at = number_at(context, builder, moved(builder, arguments[0], place), I64)
        _apart(builder, builder.store(arguments[2], at), f"word {place}")
        return context.get_dummy_value()

    return types.none(line, word, I64), generate


word: Any = intrinsic(prefer_literal=True)(_word)
set_word: Any = intrinsic(prefer_literal=True)(_set_word)


# ---- indexing of classes of rows that define it


@overload(operator.getitem)
def _of_getitem(row: Any, place: Any) -> Any:
    method: Any = _method_of(row, "__getitem__")

    def getitem(row: Any, place: Any) -> Any:
        return method(row, place)

    return getitem if method and not _is_bounded(row) else None


@overload(operator.setitem)
def _of_setitem(row: Any, place: Any, value: Any) -> Any:
    method: Any = _method_of(row, "__setitem__")

    def setitem(row: Any, place: Any, value: Any) -> None:
        method(row, place, value)

    return setitem if method and not _is_bounded(row) else None


def _method_of(row: Any, name: str) -> Any:
    """Return a method of the class of a row, or None."""
    return getattr(row.cls, name, None) if isinstance(row, Pointer) else None


def _is_bounded(row: Any) -> bool:
    """Return whether the places in a row, whose class has the names of their ``bounds``, count."""
    return bool((CHECKED or row.owner) and getattr(row.cls, "bounds", ()))


def _checked(operation: Any, name: str, *others: Any) -> None:
    """Have compiled code check the bounds of places in rows where it calls a method by indexing."""

    def resolved(typing_context: Any, arguments: tuple[Any, ...]) -> Any:
        method = typing_context.resolve_value_type(_method_of(arguments[0], name))
        return method, typing_context.resolve_function_type(method, arguments, {})

    @type_callable(operation)
    def type_of_call(typing_context: Any) -> Any:
        def typed(row: Any, place: Any, *values: Any) -> Any:
            if not _method_of(row, name) or not _is_bounded(row):
                return None
            _, found = resolved(typing_context, (row, place, *values))
            return signature(found.return_type, row, place, *values)

        return typed

    @lower_builtin(operation, Pointer, types.BaseTuple, *others)
    def checked(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        (row, kinds, *_), (base, place, *_) = sig.args, arguments
        for k, bound in enumerate(row.cls.bounds):
            at = context.cast(builder, builder.extract_value(place, k), kinds[k], I64)
            count = _get(context, builder, row, base, bound)
            with cgutils.if_unlikely(builder, builder.icmp_unsigned(">=", at, count)):
                met, of = (at, count), f"the {bound}"
                fail_outside(context, builder, row.owner, of, place_lowered(), met)
        method, found = resolved(context.typing_context, sig.args)
        return context.get_function(method, found)(builder, arguments)


_checked(operator.getitem, "__getitem__")
_checked(operator.setitem, "__setitem__", types.Number)


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
def _of_call(function: Any, arguments: Any) -> Any:
    def called(function: Any, arguments: Any) -> None:
        _called(function, arguments)

    return called


@overload(call_for_int)
def _of_call_for_int(function: Any, arguments: Any) -> Any:
    def called(function: Any, arguments: Any) -> Any:
        return _called_for_int(function, arguments)

    return called


@overload(call_for_float)
def _of_call_for_float(function: Any, arguments: Any) -> Any:
    def called(function: Any, arguments: Any) -> Any:
        return _called_for_float(function, arguments)

    return called


def address_of(kernel: Any, *classes: Any, owner: str = "") -> int:
    """Return the address of a kernel that takes rows of these classes and numbers.

    The kernel is compiled if necessary. The address is valid in this process only, and for ``call``
    and the like. ``owner`` is the component of one's own that the kernel is of, or empty.
    """
    numbers = {int: I64, float: F64}
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
        first = value if isinstance(of, Pointer) else _first_of(context, builder, of, value)
        return builder.ptrtoint(first, cgutils.intp_t)

    return I64(of), generate


place_of: Any = intrinsic(_place_of)


@overload(address)
def _of_address(one: Any) -> Any:
    def found(one: Any) -> Any:
        return place_of(one)

    return found


def _as_array(typing_context: Any, entries: Any, shape: Any) -> Any:
    """Return a table's or queue's entries as an array, whose shape may exceed a queue's count."""
    of = set(entries.of.kinds.values()) if is_row(entries.of) else {entries.of}
    kind = types.Array(F64 if of == {float} else I64, len(shape), "C")

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        data = _first_of(context, builder, entries, arguments[0])
        data = number_at(context, builder, data, kind.dtype)
        sizes = cgutils.unpack_tuple(builder, arguments[1])
        size = cgutils.intp_t(8)
        strides = [size]
        for count in reversed(sizes[1:]):
            strides.insert(0, builder.mul(count, strides[0]))
        made = context.make_array(kind)(context, builder)
        populate_array(made, data, sizes, strides, size, meminfo=None)
        return made._getvalue()

    return kind(entries, shape), generate


as_array: Any = intrinsic(_as_array)


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
            made = context.make_array(kind)(context, builder)
            populate_array(made, data, [arguments[1]], [size], size, meminfo=None)
            return made._getvalue()

        return kind(I64, I64), generate

    return intrinsic(at)
