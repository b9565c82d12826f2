"""A digest of everything that a kernel is compiled from: the code of all functions it reaches.

The digest is taken of the code that Python runs, not of the text of a file. The two differ if a
file has changed since it was imported, or if Python reads bytecode that is older than the file.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from enum import Enum
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from desim_uav.model import compiled_queues, compiled_registers, compiled_rows, numba_parts
from desim_uav.model.rows import is_row, layout_of

NOT_OURS = ("numpy", "numba", "math", "builtins")
"""Packages whose functions Numba replaces by versions of its own."""

STANDS_IN: dict[FunctionType, FunctionType] = {}
"""What compiled code has in the place of a function: the function that Numba's overload calls."""

RULES: set[FunctionType] = set()
"""The functions over rows."""


def code_digest(function: FunctionType, placed: bool = False) -> str:
    """Return the SHA-256 of a function and of every function it calls, directly or not.

    Docstrings, comments and line numbers do not count, unless the code names them in its faults
    (``placed``). What stands in compiled code in the place
    of a function counts as called by it. If the functions are over rows, so do the layout and the
    methods of these rows, and the code by which rows are compiled.
    """
    found: dict[FunctionType, str] = {}
    _reach(found, [function])
    rows = _rows_of(found)
    _reach(found, [of for row in rows for of in vars(row).values() if type(of) is FunctionType])
    if rows or RULES.intersection(found):
        _reach(
            found, _functions_of(compiled_rows, compiled_queues, compiled_registers, numba_parts)
        )
    parts = [*found.values(), *map(layout_of, rows)]
    if placed:
        parts += [f"{_name(one)} {_lines(one.__code__)}" for one in found]
    return hashlib.sha256("\n".join(sorted(parts)).encode()).hexdigest()


def _lines(code: CodeType) -> str:
    """Return the file of code and the lines of its instructions, which a fault in it names."""
    inner = [_lines(one) for one in code.co_consts if isinstance(one, CodeType)]
    lines = [line for _, _, line in code.co_lines()]
    return f"{code.co_filename} {lines} {inner}"


def _reach(found: dict[FunctionType, str], waiting: list[FunctionType]) -> None:
    """Add to ``found`` the functions that wait and all that they call, each with its code."""
    while waiting:
        one = waiting.pop()
        if one not in found:
            found[one], called = _described(one)
            waiting += called
            if one in STANDS_IN:
                waiting.append(STANDS_IN[one])


def _functions_of(*modules: ModuleType) -> list[FunctionType]:
    """Return the functions of modules, and the methods of their classes."""
    functions = list[FunctionType]()
    for module in modules:
        own = [value for value in vars(module).values() if _module_of(value) == module.__name__]
        classes = [value for value in own if isinstance(value, type)]
        own += [value for cls in classes for value in vars(cls).values()]
        functions += [value for value in own if isinstance(value, FunctionType)]
    return functions


def _module_of(value: Any) -> str | None:
    return getattr(value, "__module__", None)


def _rows_of(functions: Iterable[FunctionType]) -> set[Any]:
    """Return the classes of rows that functions are over.

    These stand in the modules of the functions, which need them at least for their annotations.
    """
    spaces = {id(function.__globals__): function.__globals__ for function in functions}
    return {value for space in spaces.values() for value in space.values() if is_row(value)}


@cache
def _described(function: FunctionType) -> tuple[str, list[FunctionType]]:
    """Return a function's code and the values of its global names, and the functions it calls."""
    code, called = function.__code__, list[FunctionType]()
    parts = [_name(function), repr(function.__defaults__), *_code(code, function.__doc__)]
    for name, value in _values(function):
        parts.append(f"{name} = {_value(value, called)}")
    return "\n".join(parts), called


def _name(value: Any) -> str:
    return f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', '')}"


def _code(code: CodeType, doc: str | None = None) -> Iterator[str]:
    yield code.co_code.hex()
    yield repr(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code(constant)
        elif isinstance(constant, frozenset):
            yield repr(sorted(map(repr, constant)))
        elif constant is None or constant != doc:
            yield repr(constant)


def _names(code: CodeType) -> set[str]:
    inner = (_names(one) for one in code.co_consts if isinstance(one, CodeType))
    return set(code.co_names).union(*inner)


def _values(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield the global names in a function, each with its value."""
    code = function.__code__
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        yield name, cell.cell_contents
    names = sorted(_names(code))
    for name in names:
        value = function.__globals__.get(name)
        yield name, value
        if isinstance(value, ModuleType) and not _foreign(value.__name__):
            yield from ((f"{name}.{of}", getattr(value, of)) for of in names if hasattr(value, of))


def _value(value: Any, called: list[FunctionType]) -> str:
    """Return a text that changes if compiled code would; functions are added to ``called``."""
    function = value if isinstance(value, FunctionType) else getattr(value, "__wrapped__", None)
    if isinstance(function, FunctionType):
        if not _foreign(function.__module__):
            called.append(function)
        return f"{_name(function)} {getattr(value, 'targetoptions', '')}"
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {value.tobytes().hex()}"
    if isinstance(value, type):
        return _class(value)
    if isinstance(value, tuple | list):
        return _listed(value, called)
    if isinstance(value, bool | int | float | complex | str | bytes | None):
        return repr(value)
    return f"a {_name(type(value))} {getattr(value, '__name__', '')}"


def _class(cls: Any) -> str:
    if is_row(cls):
        return layout_of(cls)
    members = list(cls) if issubclass(cls, Enum) else getattr(cls, "_fields", "")
    return f"{_name(cls)} {members}"


def _listed(values: Iterable[Any], called: list[FunctionType]) -> str:
    return ", ".join(_value(value, called) for value in values)


def _foreign(module: str | None) -> bool:
    return (module or "").partition(".")[0] in NOT_OURS
