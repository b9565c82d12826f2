"""Functions that are compiled on their own, when compiled code first calls them.

Compiled code calls such a function by the address in a *cell*, a number in the memory of this
process that it finds by its name. While the cell is 0, compiled code has Python fill it first.
"""

from __future__ import annotations

import _thread
import threading
from collections.abc import Callable
from ctypes import CFUNCTYPE, addressof, c_int64, c_void_p, cast
from types import FunctionType
from typing import Any, get_type_hints

from desim_uav.errors import SimulationError
from desim_uav.rowcode.compiled_rows import address_of
from desim_uav.rowcode.compiled_types import F64, I64, WORD, ZERO, Pointer, intrinsic
from desim_uav.rowcode.numba_parts import add_symbol, cgutils, ir, types
from desim_uav.rowcode.options import overload
from desim_uav.rowcode.rows import is_row

RETURNED = {int: I64, float: F64, bool: types.boolean, type(None): types.none}
"""The types of compiled code for the types that such a function may return."""


class UnfilledError(SimulationError):
    """A function that is compiled on its own could not be compiled; the arguments say why."""

    def __init__(self, name: str, why: str = "") -> None:
        super().__init__(name, why or _WHY.get(name, "it was not compiled"))

    def __str__(self) -> str:
        """Return the message."""
        return f"internal error: {self.args[0]} cannot be called: {self.args[1]}"


_WHY: dict[str, str] = {}
"""Why functions could not be compiled, by their names."""


class Cell:
    """The address of a function, which is compiled when ``fill`` is called; 0 before that."""

    def __init__(self, function: FunctionType, compiled: Callable[[], Any]) -> None:
        self.function, self.compiled = function, compiled
        self.name = f"{function.__module__}.{function.__qualname__}"
        self.value = c_int64(0)
        add_symbol(self.name, addressof(self.value))
        _CELLS[addressof(self.value)] = self

    @property
    def kinds(self) -> list[Any]:
        """The types of the arguments, rows and numbers, and that of the result."""
        hints = get_type_hints(self.function)
        result = hints.pop("return")
        return [*hints.values(), result]

    def fill(self) -> None:
        """Compile the function, once for all threads. Raises Numba's errors."""
        with _LOCK:
            if not self.value.value:
                self.value.value = address_of(self.compiled(), *self.kinds[:-1])


_LOCK = threading.Lock()

_CELLS: dict[int, Cell] = {}
"""All cells, by the addresses of their numbers."""


def _fill(at: int) -> None:
    """Fill a cell, or note why that has failed."""
    try:
        _CELLS[at].fill()
    except KeyboardInterrupt:
        _thread.interrupt_main()  # an error cannot pass through compiled code
    except Exception as error:
        _WHY[_CELLS[at].name] = " ".join(str(error).split())


_filled = CFUNCTYPE(None, c_int64)(_fill)

FILL = "desim_uav_fill_cell"
add_symbol(FILL, cast(_filled, c_void_p).value)


def called_by_cell(function: FunctionType, compiled: Callable[[], Any]) -> None:
    """Let compiled code call a function by its cell; ``compiled`` returns it as a kernel."""
    cell = Cell(function, compiled)

    def typed(typing_context: Any, arguments: Any) -> Any:
        *rows, result = cell.kinds
        kinds = [Pointer(one) if is_row(one) else RETURNED[one] for one in rows]
        returned = RETURNED[result]

        def generate(context: Any, builder: Any, sig: Any, values: Any) -> Any:
            parts = [
                value if isinstance(kind, Pointer) else context.cast(builder, value, source, kind)
                for value, source, kind in zip(
                    cgutils.unpack_tuple(builder, values[0]), arguments, kinds, strict=True
                )
            ]
            place = _place(context, builder, cell.name)
            convention = context.call_conv
            kind = convention.get_function_type(returned, kinds).as_pointer()
            place = builder.inttoptr(place, kind)
            status, value = convention.call_function(builder, place, returned, kinds, parts)
            with cgutils.if_unlikely(builder, status.is_error):
                convention.return_status_propagate(builder, status)
            return value

        return returned(arguments), generate

    caller = intrinsic(typed)

    def stub(*arguments: Any) -> Any:
        return caller(arguments)

    overload(function, forceinline=False)(stub)


def _place(context: Any, builder: Any, name: str) -> Any:
    """Return the number in a cell, which Python fills if it is 0; end by UnfilledError if not."""
    module = builder.module
    number = module.globals.get(name) or ir.GlobalVariable(module, WORD, name)
    with cgutils.if_unlikely(builder, builder.icmp_signed("==", builder.load(number), ZERO)):
        kind = ir.FunctionType(ir.VoidType(), [WORD])
        fill = cgutils.get_or_insert_function(module, kind, FILL)
        builder.call(fill, [builder.ptrtoint(number, WORD)])
        empty = builder.icmp_signed("==", builder.load(number), ZERO)
        with cgutils.if_unlikely(builder, empty):
            context.call_conv.return_user_exc(builder, UnfilledError, (name,))
    return builder.load(number)
