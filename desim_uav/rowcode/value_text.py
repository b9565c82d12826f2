"""Values as texts: two values that compiled code could tell apart never have the same text.

No text stands for the type of a value alone: a value that has no text raises ``UndescribedError``.
"""

from __future__ import annotations

import hashlib
import struct
import sys
import sysconfig
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache, cached_property, partial
from pathlib import Path
from types import (
    BuiltinFunctionType,
    FunctionType,
    GenericAlias,
    GetSetDescriptorType,
    MappingProxyType,
    MemberDescriptorType,
    MethodDescriptorType,
    MethodType,
    ModuleType,
    SimpleNamespace,
    WrapperDescriptorType,
)
from typing import Any, TypeVar, get_args, get_origin

import numpy as np

from desim_uav.rowcode.numba_parts import is_compiled, is_registry, name_of_type
from desim_uav.rowcode.rows import held_by, is_row, layout_of, origin_of

VERSIONED = ("numpy", "numba", "llvmlite")
"""Packages on which compiled code depends by their version only, because users do not edit them."""

OURS = "desim_uav."
"""How the names of this package's modules begin."""

OPTIONS = ("targetoptions", "locals", "_prefer_literal", "_ctor_kwargs")
"""The attributes in which Numba keeps the options of its decorators."""

ARRAYS = (np.ndarray, np.memmap, np.recarray)
NAMED = (GetSetDescriptorType, MemberDescriptorType, MethodDescriptorType, WrapperDescriptorType)
"""Parts of classes that are written in C, or made from the names of a class's slots."""


class UndescribedError(Exception):
    """A value has no text. The message says what it is."""


class ChangedError(UndescribedError):
    """A value of a function is not what it was when the function was first described."""


class ValueText:
    """Makes the texts of values.

    ``functions`` are the functions in them, in the order in which they were met: a text has only
    the name of a function. ``lasting`` is False if a value may have another text later on.
    """

    def __init__(self) -> None:
        self.functions: list[FunctionType] = []
        self.lasting = True
        self._within: list[int] = []

    def of(self, value: Any) -> str:
        """Return the text of a value. Raises UndescribedError."""
        kind = type(value)
        if kind in PLAIN:
            return f"{kind.__name__} {value!r}"
        if kind is FunctionType:
            return self._function(value)
        if id(value) in self._within:  # a value that holds itself
            return f"the value {len(self._within) - self._within.index(id(value))} above"
        self._within.append(id(value))
        try:
            return self._text(kind, value)
        finally:
            self._within.pop()

    def _text(self, kind: type, value: Any) -> str:
        for base, text in WHOLE.items():
            if isinstance(value, base):
                return text(self, value)
        if callable(value) and (place := _importable_from(value)):
            return f"{place}.{value.__name__}"
        for base, text in PARTS.items():
            if isinstance(value, base):
                return f"{self._kind(kind, base)} {text(self, value)}"
        return self._other(kind, value)

    def _other(self, kind: type, value: Any) -> str:
        if is_compiled(value):
            return f"compiled {self._function(value.__wrapped__)} {self._options(value)}"
        if is_registry(value):
            return f"a {full_name(kind)}"
        if name := name_of_type(value):
            return f"{self._class(kind)} {name}"
        if get_origin(value) is not None:
            return f"{self.of(get_origin(value))}[{self._all(get_args(value))}]"
        if kind.__module__ == "typing":
            return f"{full_name(kind)} {value!r}"
        if is_dataclass(kind) or kind is SimpleNamespace:
            self.lasting = False
            return f"{self._class(kind)} {self._named(_attributes(value))}"
        raise UndescribedError(f"a value of type {full_name(kind)!r}")

    def _kind(self, kind: type, base: type) -> str:
        """Return the text of the type of a value, including what a derived type adds."""
        return full_name(kind) if kind is base else self._class(kind)

    def _function(self, function: FunctionType) -> str:
        if not foreign(function.__module__):
            self.functions.append(function)
        return f"function {full_name(function)}"

    def _all(self, values: Iterable[Any]) -> str:
        return f"({', '.join(map(self.of, values))})"

    def _named(self, values: Iterable[tuple[Any, Any]]) -> str:
        return self._all(part for pair in values for part in pair)

    def _member(self, value: Any) -> str:
        return f"{value.name} of {self._class(type(value))}"

    def _options(self, compiled: Any) -> str:
        """Return the text of the options of Numba's decorator, which do not change afterwards."""
        before = self.lasting
        options = self._named((name, getattr(compiled, name, None)) for name in OPTIONS)
        self.lasting = before
        return options

    def _module(self, module: ModuleType) -> str:
        if foreign(module.__name__):
            return f"module {module.__name__}"
        raise UndescribedError(f"the module {module.__name__!r}, without an attribute of it")

    def _of_numpy(self, value: Any) -> str:
        kind = type(value)
        dtype = value if isinstance(value, np.dtype) else value.dtype
        if dtype.hasobject or (isinstance(value, np.ndarray) and kind not in ARRAYS):
            raise UndescribedError(f"a value of type {full_name(kind)!r} and data type {dtype}")
        text = f"{kind.__module__}.{kind.__name__} {dtype!r} {dtype.alignment}"
        if isinstance(value, np.dtype):
            return text
        if isinstance(value, np.ndarray):
            self.lasting = False
            flags = value.flags
            text += f" {value.shape} {flags.c_contiguous} {flags.f_contiguous} {flags.aligned}"
        return f"{text} {hashlib.sha256(value.tobytes()).hexdigest()}"

    def _class(self, cls: Any) -> str:
        if is_row(cls):
            return self._row(cls)
        text = f"class {full_name(cls)}"
        if issubclass(cls, Enum):
            members = self._named((name, one.value) for name, one in cls.__members__.items())
            return f"{text} {self._all(cls.__bases__)} {members}"
        if foreign(cls.__module__):
            return text
        if issubclass(cls, tuple) and hasattr(cls, "_fields"):
            text = f"{text} {cls._fields} {self._named(cls._field_defaults.items())}"
        if str(cls.__module__).startswith(OURS):  # of which compiled code has no more than this
            return text
        self.lasting = False
        parts = (pair for pair in sorted(vars(cls).items()) if _counts(cls, *pair))
        return f"{text} {self._all(cls.__bases__)} {self._named(parts)}"

    def _row(self, cls: Any) -> str:
        """Return the text of a class of rows, which has functions in its methods."""
        kinds = (held_by(kind) if origin_of(kind) else kind for kind in cls.kinds.values())
        methods = [part for _, part in sorted(vars(cls).items()) if type(part) is FunctionType]
        return f"row {layout_of(cls)} {self._all(filter(is_row, kinds))} {self._all(methods)}"

    def _set(self, values: Iterable[Any]) -> str:
        before = len(self.functions)
        texts = sorted(map(self.of, values))
        if len(self.functions) > before:
            raise UndescribedError("a set of functions, which have no order")
        return f"{{{', '.join(texts)}}}"

    def _changing(self, values: Any) -> str:
        """Return the text of a dictionary or a list."""
        self.lasting = False
        if isinstance(values, list):
            return self._all(values)
        return self._named(values.items())


PLAIN = {type(None), bool, int, str, bytes, type(Ellipsis), type(NotImplemented), range}
"""Types whose ``repr`` describes a value completely."""

WHOLE: dict[Any, Callable[[ValueText, Any], str]] = {
    type: ValueText._class,
    Enum: ValueText._member,
    ModuleType: ValueText._module,
    np.generic: ValueText._of_numpy,
    np.ndarray: ValueText._of_numpy,
    np.dtype: ValueText._of_numpy,
}
"""What makes the text of a value, by a type of which it is an instance."""

PARTS: dict[type, Callable[[ValueText, Any], str]] = {
    bool: lambda text, value: repr(bool(value)),
    int: lambda text, value: int.__repr__(value),
    float: lambda text, value: struct.pack("<d", value).hex(),
    complex: lambda text, value: struct.pack("<dd", value.real, value.imag).hex(),
    str: lambda text, value: str.__repr__(value),
    bytes: lambda text, value: bytes.__repr__(value),
    tuple: lambda text, value: text._all(tuple.__iter__(value)),
    list: lambda text, value: text._changing(value),
    dict: lambda text, value: text._changing(value),
    MappingProxyType: lambda text, value: text._changing(dict(value)),
    frozenset: lambda text, value: text._set(value),
    set: lambda text, value: text._set(value),
    slice: lambda text, value: text._all((value.start, value.stop, value.step)),
    partial: lambda text, value: text._all((value.func, value.args, value.keywords)),
    MethodType: lambda text, value: text._all((value.__func__, value.__self__)),
    staticmethod: lambda text, value: text.of(value.__func__),
    classmethod: lambda text, value: text.of(value.__func__),
    property: lambda text, value: text._all((value.fget, value.fset, value.fdel)),
    cached_property: lambda text, value: text.of(value.func),
    TypeVar: lambda text, value: value.__name__,
    GenericAlias: lambda text, value: text._all((value.__origin__, value.__args__)),
    BuiltinFunctionType: lambda text, value: text._all(
        (value.__name__, value.__module__ if _of_module(value) else value.__self__)
    ),
    type(cache(len)): lambda text, value: text.of(value.__wrapped__),
    **dict.fromkeys(NAMED, lambda text, value: full_name(value)),
}
"""The same for other types; the name of the type is put before the text."""


def full_name(value: Any) -> str:
    """Return the name of a class or function with that of its module."""
    return f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', '')}"


@cache
def foreign(module: str | None) -> bool:
    """Return whether a module belongs to Python itself or to a package in ``VERSIONED``."""
    root = (module or "").partition(".")[0]
    if root not in sys.stdlib_module_names:
        return root in VERSIONED
    file = getattr(sys.modules.get(root), "__file__", None)
    return file is None or Path(file).is_relative_to(sysconfig.get_path("stdlib"))


def _of_module(function: BuiltinFunctionType) -> bool:
    return function.__self__ is None or isinstance(function.__self__, ModuleType)


def _importable_from(value: Any) -> str | None:
    """Return the module of Python or of ``VERSIONED`` that has a callable by its name, if any."""
    place = getattr(value, "__module__", None)
    place = place or ("numpy" if isinstance(value, np.ufunc) else "numpy.random")
    member = getattr(sys.modules.get(place), getattr(value, "__name__", ""), None)
    return place if foreign(place) and member == value else None


def _attributes(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the fields of a dataclass, or what a value holds by name."""
    if is_dataclass(value):
        for field in fields(value):
            yield field.name, getattr(value, field.name, None)
    yield from sorted(getattr(value, "__dict__", {}).items())


def _counts(cls: Any, name: str, part: Any) -> bool:
    """Return whether compiled code could depend on this attribute of a class."""
    if name.startswith("__"):  # of which a dataclass has some of its own
        own = isinstance(part, FunctionType) and part.__module__ is not None
        return own and part.__code__.co_filename != "<string>"
    of_tuple = (*getattr(cls, "_fields", ()), "_fields", "_field_defaults", "_make", "_replace")
    named_tuple = issubclass(cls, tuple) and name in (*of_tuple, "_asdict")
    return not named_tuple and not name.startswith("_abc_")
