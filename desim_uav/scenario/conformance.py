"""Whether a class has what its Protocol asks for, and returns only values that somebody reads."""

from __future__ import annotations

import dis
import inspect
import typing
from collections.abc import Iterator
from types import FunctionType
from typing import Any


def answering(class_: type) -> Iterator[str]:
    """Yield the methods of a user's own class that return something where nothing is read."""
    for name, method in vars(class_).items():
        if isinstance(method, FunctionType) and not class_.__module__.startswith("desim_uav."):
            base = next((vars(of)[name] for of in class_.__mro__[1:] if name in vars(of)), None)
            annotation = getattr(base, "__annotations__", {}).get("return", "")
            if annotation in (None, "None") and returns_a_value(method):
                yield name


def returns_a_value(function: FunctionType) -> bool:
    """Return whether a function returns something other than None; ``super()`` may do anything."""
    if "super" in function.__code__.co_names:
        return False
    before = None
    for step in dis.get_instructions(function):
        if step.opname == "RETURN_CONST" and step.argval is not None:
            return True
        nothing = before is not None and (before.opname, before.argval) == ("LOAD_CONST", None)
        if step.opname == "RETURN_VALUE" and not nothing:
            return True
        before = step
    return False


def is_interface(protocol: object) -> bool:
    """Return whether components need the methods of a Protocol, and not a certain base class."""
    return all(getattr(one, "_is_protocol", False) for one in _alternatives(protocol))


def lacks(class_: object, protocol: object) -> list[str]:
    """Return the methods that are missing for a Protocol, or for the first of a union of them."""
    missing = [
        [name for name in _methods(one) if not hasattr(class_, name)]
        for one in _alternatives(protocol)
    ]
    return missing[0] if all(missing) else []


def _alternatives(protocol: object) -> tuple[Any, ...]:
    """Return the Protocols of a union, or the one that there is."""
    return typing.get_args(protocol) or (protocol,)


def _methods(protocol: type) -> list[str]:
    return [n for n, m in vars(protocol).items() if not n.startswith("_") and callable(m)]


def attributes(protocol: object) -> list[str]:
    """Return the attributes that a Protocol, or each of a union of them, asks for."""
    annotations = [inspect.get_annotations(one) for one in _alternatives(protocol)]
    return [name for name in annotations[0] if all(name in other for other in annotations)]
