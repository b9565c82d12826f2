"""Digests of compiled functions, by which it is known whether machine code on disk is stale.

A digest depends on all that goes into machine code, and on nothing else: the byte code of a
function and of all functions it calls, the values of their global names, the layouts of rows. A
changed docstring or comment does not change it. What cannot be described has no digest.
"""

from __future__ import annotations

import dis
import hashlib
from collections.abc import Iterable, Iterator
from functools import cache
from types import CellType, CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple, cast

from desim_uav.rowcode import (
    compiled_apart,
    compiled_entries,
    compiled_queues,
    compiled_registers,
    compiled_rows,
    compiled_types,
    numba_parts,
)
from desim_uav.rowcode.numba_parts import overloads_of
from desim_uav.rowcode.rows import is_row, layout_of
from desim_uav.rowcode.value_text import (
    OURS,
    ChangedError,
    UndescribedError,
    ValueText,
    foreign,
    full_name,
)

STANDS_IN: dict[FunctionType, FunctionType] = {}
"""What compiled code calls in place of a function: the function that Numba's overload calls."""

COMPILING = (
    compiled_types,
    compiled_entries,
    compiled_rows,
    compiled_queues,
    compiled_registers,
    numba_parts,
)
"""The modules that compile rows."""

APART: set[FunctionType] = set()
"""The functions that are compiled on their own: their code is no part of what calls them."""

RULES: set[FunctionType] = set()
"""The functions that work on rows."""


def code_digest(function: FunctionType, placed: bool = False) -> str:
    """Return the SHA-256 of a function and of every function it calls, directly or not.

    Docstrings, comments and line numbers do not count, except line numbers of code that names them
    in its faults (``placed``). A function that stands in for another one in compiled code counts
    as called by it. If the functions work on rows, the layout and the methods of these rows count
    as well, and so does the code that compiles rows. Raises UndescribedError with the name of a
    value on which compiled code depends, if that value cannot be described.
    """
    number_of: dict[FunctionType, int] = {}
    texts = list(_reach(number_of, [function]))
    rows = sorted(_rows_of(number_of), key=layout_of)
    methods = [sorted(vars(row).items()) for row in rows]
    texts += _reach(
        number_of, [of for parts in methods for _, of in parts if type(of) is FunctionType]
    )
    if rows or RULES.intersection(number_of):
        functions = [*_functions_of(*COMPILING), cast(FunctionType, compiled_apart.called_by_cell)]
        texts += _reach(number_of, functions)
    texts += map(layout_of, rows)
    if placed:
        texts += [f"{number}: {_lines(one.__code__)}" for one, number in number_of.items()]
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()


def _lines(code: CodeType) -> str:
    """Return the file of code and the lines of its instructions, which a fault in it names."""
    inner = [_lines(one) for one in code.co_consts if isinstance(one, CodeType)]
    lines = [line for _, _, line in code.co_lines()]
    return f"{code.co_filename} {lines} {inner}"


def class_digest(cls: type) -> str:
    """Return the SHA-256 of all attributes of a class, and of all functions that its methods call.

    Functions of this package do not count. Raises UndescribedError as ``code_digest`` does.
    """
    text = ValueText()
    own_text = text.of(cls)
    texts = _reach({}, text.functions, ours=False)
    return hashlib.sha256("\n".join([own_text, *texts]).encode()).hexdigest()


def _reach(
    number_of: dict[FunctionType, int], functions: list[FunctionType], ours: bool = True
) -> Iterator[str]:
    """Yield the texts of functions and of all that they call, with the numbers of these in them.

    ``number_of`` has the number of each function, in the order in which they are met: two functions
    may have the same name. If not ``ours``, functions of this package are left out.
    """
    waiting = [one for one in functions if one not in number_of]
    for one in waiting:  # which grows
        number_of.setdefault(one, len(number_of))
    for one in waiting:
        text, called = _described(one)
        if not ours:
            called = [other for other in called if not str(other.__module__).startswith(OURS)]
        for other in called:
            if other not in number_of:
                number_of[other] = len(number_of)
                waiting.append(other)
        yield f"{number_of[one]}: {text} {[number_of[other] for other in called]}"


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
    """Return the classes of rows on which functions work.

    They are found in the modules of the functions, which need them at least for annotations.
    """
    spaces = {id(function.__globals__): function.__globals__ for function in functions}
    return {value for space in spaces.values() for value in space.values() if is_row(value)}


class _Known(NamedTuple):
    """The text of a function, and what it was made from, which is compared each time."""

    code: CodeType
    values: dict[str, Any]
    text: str
    called: list[FunctionType]


_KNOWN: dict[FunctionType, _Known] = {}
"""The texts of functions whose values cannot change in place."""

_FIRST: dict[FunctionType, str] = {}
"""The first text of each function. Numba does not compile a function again if a value changes."""


def _described(function: FunctionType) -> tuple[str, list[FunctionType]]:
    """Return a function's code with all values in it, and the functions that it calls."""
    code, values = function.__code__, dict(_values(function))
    entry = _KNOWN.get(function)
    if entry and entry.code is code and _same(entry.values, values):
        return entry.text, entry.called
    text = ValueText()
    parts = [full_name(function), *_code(text, code, function.__doc__)]
    for name, value in values.items():
        try:
            parts.append(f"{name} = {text.of(value)}")
        except UndescribedError as error:
            if _is_used(code, name):
                raise UndescribedError(f"{name!r} in {full_name(function)!r} is {error}") from None
    parts += [f"{full_name(one)}{one.__annotations__}" for one in text.functions if one in APART]
    called = [one for one in text.functions if one not in APART]
    own_text = "\n".join(parts)
    if text.lasting:
        _KNOWN[function] = _Known(code, values, own_text, called)
    of_values = "\n".join(part for part in parts if not part.startswith(OVERLOADS))
    if _FIRST.setdefault(function, of_values) != of_values:
        changed = f"the code of {full_name(function)!r}, or a value in it, has changed"
        raise ChangedError(f"{changed} in this process")
    return own_text, called


def _same(values: dict[str, Any], others: dict[str, Any]) -> bool:
    """Return whether these are the same objects, under the same names in the same order."""
    return list(values) == list(others) and all(
        one is other for one, other in zip(values.values(), others.values(), strict=True)
    )


def _values(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield the values that compiled code takes from outside a function, each with a name."""
    code = function.__code__
    yield "its defaults", function.__defaults__
    for name, value in (function.__kwdefaults__ or {}).items():
        yield f"the default of {name}", value
    if function in STANDS_IN:
        yield "what stands in for it", STANDS_IN[function]
    elif _may_have_overloads(function) and (overloads := overloads_of(function)):
        yield OVERLOADS, overloads
    outside = {
        name: cell.cell_contents
        for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True)
        if cell != EMPTY
    }
    spaces = function.__globals__, cast(Any, function).__builtins__
    for name in _names(code):
        for space in spaces:
            if name in space and name not in outside:
                outside[name] = space[name]
    for name, value in outside.items():
        if _has_values(value):
            ours = str(function.__module__).startswith(OURS)
            yield from (_in_module_of_ours if ours else _in_module)(code, name, value)
        else:
            yield name, value


def _may_have_overloads(function: FunctionType) -> bool:
    """Return whether a function may have overloads that are not known by other means."""
    return function not in APART and not str(function.__module__).startswith(OURS)


OVERLOADS = "its overloads"
"""The name for what Numba compiles in place of a function; it may be added at any time."""

EMPTY = CellType()
"""The cell of a variable without a value."""


def _in_module(code: CodeType, name: str, module: ModuleType) -> Iterator[tuple[str, Any]]:
    """Yield what a function uses of a module, including attributes of attributes."""
    for chain in _loaded(code):
        if chain[0] == name:
            dots, value = 1, cast(Any, module)
            while _has_values(value) and dots < len(chain):
                value, dots = getattr(value, chain[dots], None), dots + 1
            yield ".".join(chain[:dots]), value


def _in_module_of_ours(code: CodeType, name: str, module: ModuleType) -> Iterator[tuple[str, Any]]:
    """Yield at least what a function of this package uses of a module.

    This takes less time than ``_in_module``. Code of ours uses modules for their attributes only.
    """
    for attribute in _names(code):
        value = vars(module).get(attribute)
        if _has_values(value):
            yield from _in_module_of_ours(code, f"{name}.{attribute}", cast(ModuleType, value))
        elif attribute in vars(module):
            yield f"{name}.{attribute}", value


def _has_values(value: Any) -> bool:
    """Return whether a value is a module whose values compiled code depends on."""
    return isinstance(value, ModuleType) and not foreign(value.__name__)


def _is_used(code: CodeType, name: str) -> bool:
    """Return whether a value's name is not only the name of some attribute in the code."""
    return not name.isidentifier() or name in {chain[0] for chain in _loaded(code)}


@cache
def _loaded(code: CodeType) -> tuple[tuple[str, ...], ...]:
    """Return the names that code loads from outside, each with the attributes that follow it."""
    chains, follows = list[list[str]](), False
    for one in dis.get_instructions(code):
        if one.opname in ("LOAD_GLOBAL", "LOAD_DEREF", "LOAD_CLASSDEREF"):
            chains.append([one.argval])
            follows = True
        elif one.opname in ("LOAD_ATTR", "LOAD_METHOD") and follows:
            chains[-1].append(one.argval)
        elif one.opname != "EXTENDED_ARG":
            follows = False
    inner = [_loaded(constant) for constant in code.co_consts if isinstance(constant, CodeType)]
    return tuple(dict.fromkeys([*map(tuple, chains), *(one for each in inner for one in each)]))


@cache
def _names(code: CodeType) -> tuple[str, ...]:
    """Return the names in byte code of what is neither an argument nor a local variable."""
    inner = (_names(one) for one in code.co_consts if isinstance(one, CodeType))
    return tuple(sorted(set(code.co_names).union(*inner)))


def _code(text: ValueText, code: CodeType, doc: str | None = None) -> Iterator[str]:
    """Yield the texts of byte code, the names in it, its exception table and its constants."""
    yield f"{code.co_code.hex()} {code.co_exceptiontable.hex()} {code.co_flags}"
    arguments = code.co_argcount + code.co_kwonlyargcount
    yield f"{code.co_varnames[:arguments]} {code.co_posonlyargcount} {code.co_kwonlyargcount}"
    yield f"{code.co_names} {code.co_cellvars} {code.co_freevars}"
    for place, constant in enumerate(code.co_consts):
        if isinstance(constant, CodeType):
            yield from _code(text, constant)
        elif place > 0 or constant != doc or doc is None or _loads_first(code):
            yield text.of(constant)


def _loads_first(code: CodeType) -> bool:
    """Return whether byte code loads its first constant, which is then not only the docstring."""
    likely = [load for load in LOADS if bytes((load, 0)) in code.co_code]
    steps = zip(code.co_code[::2], code.co_code[1::2], strict=True) if likely else ()
    return any(operation in likely and argument == 0 for operation, argument in steps)


LOADS = [dis.opmap[name] for name in ("LOAD_CONST", "RETURN_CONST") if name in dis.opmap]
