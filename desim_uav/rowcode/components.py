"""Components over rows: their fields as numbers and tables, their methods as machine code."""

from __future__ import annotations

import copy
import hashlib
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any, NamedTuple, TypeVar

from numba.core.errors import NumbaError, UnsupportedBytecodeError

from desim_uav.errors import SimulationError, has_instead, notice
from desim_uav.rowcode.bounds import owner_of
from desim_uav.rowcode.code_digest import class_digest
from desim_uav.rowcode.compiled_rows import address_of, call, pointer_to
from desim_uav.rowcode.kernels import checked_kernel, kernel, rule
from desim_uav.rowcode.packing import packed
from desim_uav.rowcode.rows import BoundedTable, Row, Table, Words, fill, row
from desim_uav.rowcode.value_text import OURS, ChangedError, UndescribedError

C = TypeVar("C")


def works_on_rows(component: Any, base: Any) -> bool:
    """Return whether a component works on rows: it has this base, and none of its plain methods."""
    own = type(component)
    return isinstance(component, base) and all(
        getattr(own, name) is getattr(base, name) for name in base.plain
    )


def over_rows(component: C, services: tuple[str, ...]) -> C:
    """Return a component whose mappings from services to numbers are tables, by service.

    Its tuples of numbers are tables too.
    """
    if not is_dataclass(component):
        return component
    twin = copy.copy(component)
    table_of = BoundedTable if owner_of(type(component)) else Table
    for field in fields(component):
        value = getattr(component, field.name)
        if isinstance(value, Mapping):
            table = table_of(float(value.get(name, 0.0)) for name in services)
            object.__setattr__(twin, field.name, table)
        elif type(value) in (tuple, list) and _are_numbers(value):
            object.__setattr__(twin, field.name, table_of(map(float, value)))
    return twin


def _are_numbers(values: Any) -> bool:
    return all(isinstance(one, int | float) for one in values)


def values_of(component: Any) -> Row:
    """Return the fields of a component that are numbers, or tables of numbers, as a row."""
    kinds: list[tuple[str, Any]] = []
    values = []
    for field in fields(component) if is_dataclass(component) else ():
        value = getattr(component, field.name)
        if isinstance(value, list) and _are_numbers(value):
            kinds.append((field.name, Table[float]))
        elif isinstance(value, bool | int | float):
            kinds.append((field.name, float if isinstance(value, float) else int))
        else:
            continue
        values.append(value)
    cls: Any = type(component)
    values_row: Row = fill(_row_of(cls, tuple(kinds)), values)
    return values_row


def left_out(component: Any) -> list[str]:
    """Return the names of the fields that compiled code does not have."""
    fields = type(values_of(component)).kinds
    return [name for name in getattr(component, "__dict__", {}) if name not in fields]


@cache
def _row_of(component: Any, kinds: tuple[tuple[str, Any], ...]) -> Any:
    """Return the class of rows for the fields of a class of components."""
    return row(type(component.__name__, (Row,), {"__annotations__": dict(kinds)}))


@cache
def ruled(method: Any) -> Any:
    """Return a method of a component as a rule, which kernels that call it have compiled."""
    return rule(method)


def own_kernel(function: Any, cls: Any) -> Any:
    """Return a kernel around a method of a class of components, with a file of its own on disk.

    A module may be named by the path of its file: a digest stands for it in the file's name.
    """
    digest = hashlib.sha256(f"{cls.__module__}:{cls.__qualname__}".encode()).hexdigest()[:16]
    name = re.sub(r"\W", "_", cls.__name__, flags=re.ASCII)[:40]
    function.__qualname__ = f"{function.__name__}_of_{name}_{digest}"
    return checked_kernel(function) if owner_of(cls) else kernel(function)


@cache
def remembering(cls: type[Row], component: Any) -> Any:
    """Return a class of rows with the numbers that a class of components remembers of each row."""
    kinds = {**cls.kinds, **component.remembers}
    return row(type(cls.__name__, (Row,), {"__annotations__": kinds}))


def kind_of(component: Any) -> str:
    """Return the name by which a scenario can name the class of a component."""
    return f"{type(component).__module__}:{type(component).__qualname__}"


# ---- functions that are known by their addresses


ValuesAt = Callable[[int], Any]
"""Returns the values of a component at an address."""


class Function(NamedTuple):
    """A compiled function of a component, with the name by which it is kept.

    ``around`` returns it, given the component's class and a function that returns the component's
    values at an address. ``arguments`` are the types with which it is compiled.
    """

    name: str
    around: Callable[[Any, ValuesAt], Any]
    arguments: tuple[Any, ...]


class Compiled(NamedTuple):
    """A compiled component: the addresses of its functions by name, and its values in memory.

    Addresses are valid in this process.
    """

    functions: dict[str, int]
    values: Words


def compiled(
    functions: tuple[Function, ...], component: Any, services: tuple[str, ...]
) -> Compiled:
    """Compile functions of a component, which stay loaded. Raises Numba's errors."""
    values = values_of(over_rows(component, services))
    kinds: tuple[Any, Any] = type(component), type(values)
    check_unchanged(component)
    return Compiled({one.name: _address(one, *kinds) for one in functions}, packed(values))


def check_unchanged(component: Any) -> None:
    """Raise SimulationError if values in the code of a component of one's own have changed.

    Numba goes on with the values that it found when it first compiled the code in this process,
    while Python uses the present ones.
    """
    cls = component if isinstance(component, type) else type(component)
    if cls.__module__.startswith(OURS):
        return
    try:
        class_digest(cls)
    except ChangedError as error:
        name = f"{cls.__module__}:{cls.__qualname__}"
        raise SimulationError(
            f"component {name!r}: {error} after it had been compiled; restart Python (in a "
            "notebook, its kernel), or import its module again with importlib.reload"
        ) from error
    except UndescribedError:
        return


@cache
def _address(one: Function, cls: Any, values: Any) -> int:
    """Compile a function of a class of components, which has a file of its own on disk."""
    owner = owner_of(cls)
    code = own_kernel(one.around(cls, pointer_to(values, owner)), cls)
    return address_of(code, *one.arguments, owner=owner)


def compiled_or_none(
    key: str, component: Any, functions: tuple[Function, ...], services: tuple[str, ...] = ()
) -> Compiled | None:
    """Compile functions of a component, or print a notice with the reason and return None."""
    kinds = type(component), type(values_of(over_rows(component, services)))
    if kinds in _ONLY_PYTHON or not hasattr(call_at, "overloads"):
        return None  # the latter if NUMBA_DISABLE_JIT is set
    try:
        return compiled(functions, component, services)
    except NOT_COMPILED as error:
        _ONLY_PYTHON.add(kinds)
        why = cause_of(error, over_rows(component, services))
        notice(f"{key}: {kind_of(component)!r} is not compiled, and drawn more slowly: {why}")
        return None


_ONLY_PYTHON: set[tuple[type, type]] = set()
"""The classes of components, and of rows of their values, of which a notice has been printed."""


@kernel
def call_at(function: int, arguments: tuple[int, ...]) -> None:
    """Call a function at an address."""
    call(function, arguments)


NOT_COMPILED = (NumbaError, UnsupportedBytecodeError, NotImplementedError)
"""The errors that Numba raises for Python code that it does not compile."""

CAUSES = ("Untyped global name", "Unknown attribute", "NameError", "nsupported", "Cannot unify")
"""Texts by which the line that names the cause is found in Numba's messages."""


def cause_of(error: Exception, component: Any) -> str:
    """Return in one line why Numba has not compiled a component over rows (None: a function)."""
    message = str(error)
    for name in left_out(component):
        if f"'{name}'" in message:
            return f"its field {name!r} is no number"
    lines = [line.strip(" -") for line in message.splitlines() if line.strip()]
    causes = (line for cause in CAUSES for line in lines if cause in line)
    line = next(causes, lines[1] if len(lines) > 1 else lines[0])
    return line + _fields_instead(line)


def _fields_instead(line: str) -> str:
    """Return the fields of a row, if Numba's message names a field that it does not have."""
    match = re.search(r"Unknown attribute '(\w+)' of type ([\w.]+)\.(\w+?)[0-9a-f]{8}\b", line)
    if match is None:
        return ""
    row_class = getattr(sys.modules.get(match[2]), match[3], None)
    return "" if row_class is None else has_instead(row_class, match[1])
