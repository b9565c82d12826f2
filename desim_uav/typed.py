"""Checks that the arguments of public functions have the types of their annotations."""

from __future__ import annotations

import importlib
import inspect
import operator
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import wraps
from os import PathLike
from pathlib import PurePath
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

from desim_uav.errors import UsageError, did_you_mean, in_short

F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True)
class Within:
    """The bounds of a number, both allowed, in an annotation: ``Annotated[int, Within(1, 10)]``.

    Bounds that are whole ask for a whole number. What is no number (None, or a sequence where one
    may be given instead) is left as it is.
    """

    low: float
    high: float

    @property
    def words(self) -> str:
        """What a number must be."""
        kind = "a number" if isinstance(self.low, float) else "a whole number"
        form = "g" if isinstance(self.low, float) else ""
        return f"{kind} from {self.low:{form}} to {self.high:{form}}"

    def holds(self, number: float) -> bool:
        """Return whether a number is within the bounds."""
        return self.low <= number <= self.high

    def value(self, argument: Any, name: str) -> Any:
        """Return an argument as a number of Python. Raises ValueError, which names it as said."""
        if _is_iterable(argument) or not _is_number(argument):
            return argument
        number = float(argument) if isinstance(self.low, float) else operator.index(argument)
        if not self.holds(number):
            raise ValueError(f"{name}: {argument!r}: must be {self.words}")
        return number


class OfTexts:
    """What a text must be, in an annotation; what is no text is left as it is."""

    def problem(self, text: str) -> str:
        """Return what is wrong with a text, or "" if it is allowed."""
        raise NotImplementedError

    def value(self, argument: object, name: str) -> Any:
        """Return an argument. Raises ValueError, which names it as said."""
        problem = self.problem(argument) if isinstance(argument, str) else ""
        if problem:
            raise ValueError(f"{name}: {problem}")
        return argument


@dataclass(frozen=True)
class Label(OfTexts):
    """A text that can stand on a line, of at most so many characters."""

    most: int

    def problem(self, text: str) -> str:
        """Return what is wrong with a label, or "" if it is allowed."""
        if text.strip() and text.isprintable() and len(text) <= self.most:
            return ""
        return f"{in_short(repr(text), 100)}: must be one line of 1 to {self.most} characters"


@dataclass(frozen=True)
class OneOf(OfTexts):
    """The names that are allowed, in an annotation; a function returns them when they are needed.

    What is no text is left as it is.
    """

    allowed: Callable[[], Iterable[str]]

    def problem(self, text: str) -> str:
        """Return what is wrong with a name, or "" if it is allowed."""
        allowed = list(self.allowed())
        if text in allowed:
            return ""
        return f"{text!r}{did_you_mean(text, allowed)}; allowed: {', '.join(allowed)}"


def typed(function: F, raises: type[Exception] = UsageError, names_in: str = "") -> F:
    """Let a function refuse arguments that do not have the types of its annotations.

    The error names the argument and says what it may be. Numbers and truth values of NumPy are
    accepted as those of Python are, and arrays and other iterables as sequences. Where the
    annotation is a Protocol, any object is accepted, and where it is a Literal any text, because
    the function itself can say better what is wrong with one. Of a class, the arguments of its
    constructor are checked. Bounds (``Within``) and texts (``OfTexts``) in an annotation are
    checked too, of values that were given.

    ``names_in`` is a module that is imported at the first call, for names of types that the
    function's own module has only for type checkers.
    """
    if isinstance(function, type):
        function.__init__ = typed(function.__init__, raises)  # type: ignore[misc]
        return function
    kinds: dict[str, Kind] = {}
    marks: dict[str, tuple[Any, ...]] = {}
    names = tuple(inspect.signature(function).parameters)

    def look() -> None:
        hints = hints_of(function, names_in)
        marks.update((name, marks_of(hint)) for name, hint in hints.items())
        kinds.update([(name, kind_of(hint)) for name, hint in hints.items()])

    def value_of(name: str, value: object) -> Any:
        if name not in kinds:
            return value
        if not kinds[name].has(value):
            text = in_short(repr(value), 100)
            raise raises(f"{name}: {text}: must be {kinds[name].one}")
        for mark in marks[name]:
            try:
                value = mark.value(value, name)
            except ValueError as error:
                raise raises(str(error)) from None
        return value

    @wraps(function)
    def checked(*args: Any, **kwargs: Any) -> Any:
        if not kinds:
            look()
        those = [value_of(name, value) for name, value in zip(names, args, strict=False)]
        others = {name: value_of(name, value) for name, value in kwargs.items()}
        return function(*those, *args[len(names) :], **others)

    checked.__dict__["__names_in__"] = names_in
    return checked  # type: ignore[return-value]


def hints_of(function: Callable[..., Any], names_in: str = "") -> dict[str, Any]:
    """Return the types of a function's parameters that are annotated, except ``*`` and ``**``."""
    several = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    texts = {
        name: parameter.annotation
        for name, parameter in inspect.signature(function).parameters.items()
        if parameter.annotation is not parameter.empty and parameter.kind not in several
    }
    names_in = names_in or getattr(function, "__names_in__", "")
    names = vars(importlib.import_module(names_in)) if names_in else {}
    names = names | getattr(inspect.unwrap(function), "__globals__", {})
    holder = type("", (), {"__annotations__": texts})
    return typing.get_type_hints(holder, names, include_extras=True)


def marks_of(hint: object) -> tuple[Within | OfTexts, ...]:
    """Return the bounds and names that an annotation, or one of its alternatives, asks for."""
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return tuple(mark for one in typing.get_args(hint) for mark in marks_of(one))
    return tuple(mark for mark in getattr(hint, "__metadata__", ()) if isinstance(mark, MARKS))


MARKS = (Within, OfTexts)


class Kind(NamedTuple):
    """A type: whether a value ``has`` it, and what ``one`` and ``several`` of it are called."""

    has: Callable[[Any], bool]
    one: str
    several: str


def kind_of(hint: object) -> Kind:
    """Return the kind of values that an annotation stands for."""
    if hint in _PLAIN:
        return _PLAIN[hint]
    origin, of = typing.get_origin(hint), typing.get_args(hint)
    make = _OF_OTHERS.get(Mapping if origin is dict else origin)
    return make(of) if make else _of_class(origin or hint)


def _either(of: Sequence[Any]) -> Kind:
    kinds = [kind_of(one) for one in of]
    return Kind(
        lambda value: any(kind.has(value) for kind in kinds),
        _joined(kind.one for kind in kinds),
        _joined(kind.several for kind in kinds),
    )


def _one_of(of: Sequence[Any]) -> Kind:
    names = _joined(map(repr, of))
    return Kind(lambda value: isinstance(value, str) or value in of, names, names)


def _tuple(of: Sequence[Any]) -> Kind:
    kinds = [kind_of(one) for one in of]
    inner = ", ".join(kind.one for kind in kinds)

    def has(value: Any) -> bool:
        if not _is_iterable(value) or not hasattr(value, "__len__") or len(value) != len(kinds):
            return False
        return all(kind.has(one) for kind, one in zip(kinds, value, strict=True))

    return Kind(has, f"a tuple ({inner})", f"tuples ({inner})")


def _sequence(of: Sequence[Any]) -> Kind:
    kind = kind_of(of[0])
    if typing.get_origin(of[0]) is tuple:  # the function names all entries that are wrong
        return Kind(_is_iterable, f"a sequence of {kind.several}", f"sequences of {kind.several}")

    def has(value: Any) -> bool:
        if not _is_iterable(value) or isinstance(value, Iterator):
            return _is_iterable(value)
        if isinstance(value, range) or hasattr(value, "dtype"):  # whose entries have one type
            return all(map(kind.has, list(value[:1])))
        return all(map(kind.has, value))

    return Kind(has, f"a sequence of {kind.several}", f"sequences of {kind.several}")


def _of_class(hint: object) -> Kind:
    name = getattr(hint, "__name__", str(hint))
    if hint is Any or not isinstance(hint, type) or getattr(hint, "_is_protocol", False):
        return Kind(lambda value: True, "an object", "objects")
    if issubclass(hint, PurePath | PathLike):
        hint = PathLike
    article = "an" if name[0] in "AEIO" else "a"
    return Kind(lambda value: isinstance(value, hint), f"{article} {name}", f"{name}s")


def _is_whole(value: Any) -> bool:
    try:
        operator.index(value)
    except TypeError:
        return False
    return not isinstance(value, bool)


def _is_number(value: object) -> bool:
    return not isinstance(value, bool) and (hasattr(value, "__float__") or _is_whole(value))


def _is_truth(value: object) -> bool:
    kind = type(value)
    return kind is bool or (kind.__module__ == "numpy" and kind.__name__ in ("bool", "bool_"))


def _is_iterable(value: object) -> bool:
    """Return whether a value can be a sequence; an array without a dimension cannot."""
    if isinstance(value, str | bytes | Mapping) or getattr(value, "ndim", 1) == 0:
        return False
    return isinstance(value, Iterable)


def _joined(words: Iterable[str]) -> str:
    """Join words by commas, and the last one by "or"; each is named once."""
    *first, last = dict.fromkeys(words)
    return f"{', '.join(first)} or {last}" if first else last


_PLAIN: dict[Any, Kind] = {
    type(None): Kind(lambda value: value is None, "None", "None"),
    bool: Kind(_is_truth, "True or False", "truth values"),
    int: Kind(_is_whole, "a whole number", "whole numbers"),
    float: Kind(_is_number, "a number", "numbers"),
    str: Kind(lambda value: isinstance(value, str), "a text", "texts"),
}
"""The kinds of plain types."""

_OF_OTHERS: dict[Any, Callable[[Sequence[Any]], Kind]] = {
    typing.Union: _either,
    types.UnionType: _either,
    Annotated: lambda of: kind_of(of[0]),
    Literal: _one_of,
    tuple: _tuple,
    type: lambda of: Kind(lambda value: isinstance(value, type), "a class", "classes"),
    Callable: lambda of: Kind(callable, "a function", "functions"),
    Mapping: lambda of: Kind(lambda value: isinstance(value, Mapping), "a mapping", "mappings"),
    Sequence: _sequence,
}
"""For the origin of each generic type, the function that makes its kind from its arguments."""
