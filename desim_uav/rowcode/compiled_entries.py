"""The entries of tables and queues in compiled code, and indexing of rows that define it."""

from __future__ import annotations

import operator
from typing import Any

from desim_uav.rowcode.bounds import CHECKED
from desim_uav.rowcode.compiled_types import (
    I64,
    WORD,
    ZERO,
    Entries,
    Line,
    Pointer,
    bytes_in_table,
    get_field,
    half_of,
    intrinsic,
    load,
    lower_builtin,
    moved,
    store,
    type_callable,
    type_of,
    words_behind,
)
from desim_uav.rowcode.numba_parts import (
    TypingError,
    cgutils,
    fail_outside,
    place_lowered,
    signature,
    types,
)
from desim_uav.rowcode.options import overload
from desim_uav.rowcode.rows import BYTES, Fitted, Int32, is_row

# ---- entries


def first_of(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return the address of the first entry of a table or a queue."""
    if isinstance(kind, Entries):
        return cgutils.create_struct_proxy(kind)(context, builder, value=value).data
    return words_behind(builder, value, half_of(context, builder, value, 0))


def _entry(context: Any, builder: Any, kind: Any, value: Any, k: Any) -> Any:
    """Return the address of entry k of a table or a queue."""
    size = cgutils.intp_t(bytes_in_table(kind.of))
    first = first_of(context, builder, kind, value)
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
            return signature(type_of(entries.of, entries.owner or ""), entries, I64)
        return None

    return typed


@lower_builtin(operator.getitem, Entries, I64)
@lower_builtin(operator.getitem, Line, I64)
def _get_item(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    _require_inside(context, builder, sig.args[0], *arguments)
    return _get_entry(context, builder, sig, arguments)


def _get_entry(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    if sig.args[0].of is Fitted:
        return _get_fitted(context, builder, sig.args[0], *arguments)
    place = _entry(context, builder, sig.args[0], *arguments)
    if isinstance(sig.return_type, Pointer):
        return place
    of = sig.args[0].of
    return load(context, builder, place, of, f"entry {of.__name__}")


def _get_fitted(context: Any, builder: Any, kind: Any, value: Any, k: Any) -> Any:
    """Return entry k of a table of Fitted, whose stored count is below 0 if they have 32 bits."""
    entries = cgutils.create_struct_proxy(kind)(context, builder, value=value)
    found = cgutils.alloca_once(builder, WORD)
    with builder.if_else(_is_less(builder, entries.count)) as branches:
        for branch, of in zip(branches, (Int32, int), strict=True):
            with branch:
                size = cgutils.intp_t(BYTES[of])
                place = builder.gep(entries.data, [builder.mul(k, size)], inbounds=True)
                number = load(context, builder, place, of, f"entry {Fitted.__name__}")
                builder.store(number, found)
    return builder.load(found)


def _is_less(builder: Any, count: Any) -> Any:
    """Return whether a stored count says that entries of Fitted have 32 bits."""
    return builder.icmp_signed("<", count, ZERO)


@type_callable(operator.setitem)
def _type_of_set_item(context: Any) -> Any:
    def typed(entries: Any, k: Any, value: Any) -> Any:
        if isinstance(entries, Entries | Line) and not is_row(entries.of) | (entries.of is Fitted):
            return signature(types.none, entries, I64, type_of(entries.of, entries.owner or ""))
        return None

    return typed


@lower_builtin(operator.setitem, Entries, I64, types.Number)
@lower_builtin(operator.setitem, Line, I64, types.Number)
def _set_item(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    _require_inside(context, builder, sig.args[0], *arguments[:2])
    return _set_entry(context, builder, sig, arguments)


def _set_entry(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    place = _entry(context, builder, sig.args[0], *arguments[:2])
    of = sig.args[0].of
    store(context, builder, arguments[2], place, of, f"entry {of.__name__}")
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
        count = cgutils.create_struct_proxy(kind)(context, builder, value=value).count
        if kind.of is Fitted:
            return builder.select(_is_less(builder, count), builder.not_(count), count)
        return count
    return half_of(context, builder, value, 1)


# ---- entries of which the caller knows that there is memory for them


def _spare(typing_context: Any, entries: Any, k: Any) -> Any:
    """Return entry k, which may be one after the last."""
    return type_of(entries.of, entries.owner or "")(entries, I64), _get_entry


def _set_spare(typing_context: Any, entries: Any, k: Any, value: Any) -> Any:
    """Change entry k, a number, which may be one after the last."""
    kind = type_of(entries.of, entries.owner or "")
    if is_row(entries.of):
        raise TypingError("an entry that is a row cannot be assigned")
    return types.none(entries, I64, kind), _set_entry


spare, set_spare = intrinsic(_spare), intrinsic(_set_spare)


# ---- queues, whose halves 1 to 3 are the count, the size of the buffer, whether the queue overran


def _half(typing_context: Any, line: Any, half: Any) -> Any:
    """Read half 1, 2 or 3 of a queue."""
    place = half.literal_value

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        return half_of(context, builder, arguments[0], place)

    return I64(line, half), generate


def _set_half(typing_context: Any, line: Any, half: Any, value: Any) -> Any:
    """Write half 1, 2 or 3 of a queue."""
    place = half.literal_value

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        at = moved(builder, arguments[0], 4 * place)
        store(context, builder, arguments[2], at, Int32, f"half {place}")
        return context.get_dummy_value()

    return types.none(line, half, I64), generate


half: Any = intrinsic(prefer_literal=True)(_half)
set_half: Any = intrinsic(prefer_literal=True)(_set_half)


# ---- indexing of classes of rows that define it


@overload(operator.getitem, by_types=True)
def _of_getitem(row: Any, place: Any) -> Any:
    method: Any = _method_of(row, "__getitem__")

    def getitem(row: Any, place: Any) -> Any:
        return method(row, place)

    return getitem if method and not _is_bounded(row) else None


@overload(operator.setitem, by_types=True)
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
            _, call = resolved(typing_context, (row, place, *values))
            return signature(call.return_type, row, place, *values)

        return typed

    @lower_builtin(operation, Pointer, types.BaseTuple, *others)
    def checked(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        (row, kinds, *_), (base, place, *_) = sig.args, arguments
        for k, bound in enumerate(row.cls.bounds):
            at = context.cast(builder, builder.extract_value(place, k), kinds[k], I64)
            count = get_field(context, builder, row, base, bound)
            with cgutils.if_unlikely(builder, builder.icmp_unsigned(">=", at, count)):
                numbers, of = (at, count), f"the {bound}"
                fail_outside(context, builder, row.owner, of, place_lowered(), numbers)
        method, call = resolved(context.typing_context, sig.args)
        return context.get_function(method, call)(builder, arguments)


_checked(operator.getitem, "__getitem__")
_checked(operator.setitem, "__setitem__", types.Number)
