"""Component slots: a name in a scenario file becomes a class.

A built-in enters itself with ``@register("mobility", "random_walk")``. A user's own component is
named ``"package.module:Class"``; importing it runs its code, so it is to be trusted like code.
"""

from __future__ import annotations

import difflib
import importlib
import pkgutil
from collections.abc import Callable, Iterable
from types import ModuleType
from typing import TypeVar

_SLOTS: dict[str, dict[str, type]] = {}

T = TypeVar("T", bound=type)


def register(slot: str, name: str) -> Callable[[T], T]:
    """Enter a class under ``name`` in ``slot``; its ``kind`` then names it in files and tables."""

    def enter(component: T) -> T:
        _SLOTS.setdefault(slot, {})[name] = component
        component.kind = name  # type: ignore[attr-defined]
        return component

    return enter


def discover(package: ModuleType) -> None:
    """Import every module of a package, so that its components enter themselves."""
    for module in pkgutil.iter_modules(package.__path__, package.__name__ + "."):
        importlib.import_module(module.name)


def names(slot: str) -> list[str]:
    """The built-in names of a slot, in the order they were entered."""
    return list(_SLOTS.get(slot, {}))


def resolve(slot: str, name: str) -> type:
    """The class called ``name``: a built-in, or ``"package.module:Class"``.

    Raises ValueError with the built-in names and the nearest one, or with the cause when a
    user's own class cannot be imported.
    """
    built_in = _SLOTS.get(slot, {})
    if name in built_in:
        return built_in[name]
    if ":" in name:
        return _import_class(name)
    raise ValueError(
        f"unknown {slot} {name!r}{did_you_mean(name, built_in)}; "
        f'allowed: {", ".join(built_in)}, or "package.module:Class"'
    )


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`` (did you mean 'x'?)`` for the nearest known word, or nothing."""
    nearest = difflib.get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f" (did you mean {nearest[0]!r}?)" if nearest else ""


def _import_class(name: str) -> type:
    module_name, _, class_name = name.partition(":")
    try:
        found = getattr(importlib.import_module(module_name), class_name)
    except Exception as error:  # a user's module may raise anything while it is imported
        raise ValueError(f"cannot import {name!r}: {type(error).__name__}: {error}") from error
    if not isinstance(found, type):
        raise ValueError(f"{name!r} is not a class")
    if "kind" not in vars(found):
        found.kind = name  # type: ignore[attr-defined]
    return found
