"""The methods and attributes of queues in compiled code (see ``rows.Queue``)."""

from __future__ import annotations

from typing import Any

from desim_uav.rowcode.bounds import CHECKED
from desim_uav.rowcode.compiled_entries import half, set_half, set_spare, spare
from desim_uav.rowcode.compiled_rows import as_array, place_of
from desim_uav.rowcode.compiled_types import I64, Line, Pointer, infer_getattr, lower_builtin
from desim_uav.rowcode.numba_parts import (
    AbstractTemplate,
    AttributeTemplate,
    cgutils,
    fail_outside,
    place_lowered,
    signature,
    types,
)
from desim_uav.rowcode.options import overload_attribute, overload_method
from desim_uav.rowcode.rows import is_row

# ---- methods whose indices are checked where they are called, so that a fault has its line


class _Checked(AbstractTemplate):
    """A method of a queue that an owner works on; ``key`` is its name, and ``this`` the queue."""

    this: Line

    def generic(self, arguments: Any, keywords: Any) -> Any:
        """Return the types with which it is called, or None."""
        kinds = [types.unliteral(kind) for kind in arguments]
        _, result_type = _bare(self.context, self.this, self.key, kinds)
        if result_type is None:
            return None
        result = result_type.return_type
        if isinstance(result, Pointer):
            result = Pointer(result.cls, self.this.owner or "")
        return signature(result, *kinds, recvr=self.this)


def _bare(typing: Any, line: Line, name: str, kinds: Any) -> Any:
    """Return a method that checks nothing, and the types with which it is called, or None."""
    method = typing.resolve_getattr(Line(line.of, None), name)
    return method, method.get_call_type(typing, kinds, {})


def _checked(name: str, index_of: Any) -> Any:
    """Return a template for a method that first checks an index below a count.

    ``index_of`` is compiled, and returns both, given the queue and the method's arguments.
    """

    @lower_builtin(name, Line, types.VarArg(types.Any))
    def call(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        line, *kinds = sig.args
        bare = Line(line.of, None)
        form = signature(types.UniTuple(I64, 2), bare, *kinds)
        numbers = context.compile_internal(builder, index_of, form, arguments)
        index, count = cgutils.unpack_tuple(builder, numbers, 2)
        with cgutils.if_unlikely(builder, builder.icmp_unsigned(">=", index, count)):
            fail_outside(context, builder, line.owner, line.called, place_lowered(), (index, count))
        method, call_type = _bare(context.typing_context, line, name, kinds)
        method_code = context.get_function(method, call_type)
        context.add_linking_libs(getattr(method_code, "libs", ()))
        return method_code(builder, arguments)

    return type(name, (_Checked,), {"key": name})


def _last(line: Any) -> Any:
    return len(line) - 1, len(line)


def _place(line: Any, place: Any, value: Any) -> Any:
    return place, len(line) + 1


def _place_of(line: Any, value: Any) -> Any:
    place = 0
    while place < len(line) and spare(line, place) != value:
        place += 1
    return place, len(line)


METHODS = {
    "pop": _checked("pop", _last),
    "insert": _checked("insert", _place),
    "remove": _checked("remove", _place_of),
}


@infer_getattr
class _Methods(AttributeTemplate):
    """The methods of a queue that an owner works on; others have the methods below."""

    key = Line

    def generic_resolve(self, line: Any, name: str) -> Any:
        """Return a method, or None."""
        if name in METHODS and (line.owner or (CHECKED and line.owner is not None)):
            return types.BoundFunction(METHODS[name], line)
        return None


# ---- methods that check nothing


@overload_method(Line, "append")
def _append(line: Any, value: Any) -> None:
    count = len(line)
    if count < half(line, 2):
        set_spare(line, count, value)
        set_half(line, 1, count + 1)
    else:
        set_half(line, 3, 1)


@overload_method(Line, "added")
def _added(line: Any) -> Any:
    count = len(line)
    if count < half(line, 2):
        set_half(line, 1, count + 1)
    else:
        set_half(line, 3, 1)
    return spare(line, count)  # the spare entry if the queue overruns


@overload_method(Line, "pop")
def _pop(line: Any) -> Any:
    last = len(line) - 1
    set_half(line, 1, last)
    return spare(line, last)


@overload_method(Line, "space")
def _space(line: Any, entries: Any) -> Any:
    return place_of(line), half(line, 2)


@overload_method(Line, "fill")
def _fill(line: Any, entries: Any, count: Any) -> None:
    if count > half(line, 2):
        set_half(line, 3, 1)
        count = half(line, 2)
    set_half(line, 1, count)


@overload_method(Line, "take", by_types=True)
def _take(line: Any, entries: Any, first: Any, count: Any) -> Any:
    width = line.of.words if is_row(line.of) else 1

    def take(line: Any, entries: Any, first: Any, count: Any) -> None:
        if count > half(line, 2):
            set_half(line, 3, 1)
            count = half(line, 2)
        set_half(line, 1, count)
        ours, theirs = as_array(line, (count, width)), as_array(entries, (first + count, width))
        for k in range(count):
            for column in range(width):
                ours[k, column] = theirs[first + k, column]

    return take


@overload_method(Line, "clear")
def _clear(line: Any) -> None:
    set_half(line, 1, 0)


@overload_method(Line, "insert")
def _insert(line: Any, place: Any, value: Any) -> None:
    count = len(line)
    if count < half(line, 2):
        for k in range(count, place, -1):
            set_spare(line, k, spare(line, k - 1))
        set_spare(line, place, value)
        set_half(line, 1, count + 1)
    else:
        set_half(line, 3, 1)


@overload_method(Line, "remove")
def _remove(line: Any, value: Any) -> None:
    place, last = 0, len(line) - 1
    while spare(line, place) != value:
        place += 1
    for k in range(place, last):
        set_spare(line, k, spare(line, k + 1))
    set_half(line, 1, last)


@overload_attribute(Line, "overrun")
def _overrun(line: Any) -> Any:
    return half(line, 3)


@overload_attribute(Line, "buffer")
def _buffer(line: Any) -> Any:
    return half(line, 2)
