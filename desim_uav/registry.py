"""Component slots: a name in a scenario file becomes a class.

A built-in enters itself with ``@register("mobility", "random_walk")``. A user's own component is
named ``"package.module:Class"``; importing it runs its code, so it is to be trusted like code.
"""

from __future__ import annotations

import difflib
import importlib
import pkgutil
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, ModuleType
from typing import TypeVar

from desim_uav.errors import DesimError, SimulationError

_SLOTS: dict[str, dict[str, type]] = {}

_PLUG_INS: dict[str, str] = {}
"""The source file of each module that a component of a user's own came from: the module's name."""

FAULTS = (Exception, SystemExit)
"""What a user's own code may raise; ``sys.exit`` in a component must not end us in silence."""

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


def what_failed(error: BaseException) -> str:
    """Say what an error says, with the file and the line of the user's own code that raised it."""
    frames = [(frame.f_code, line) for frame, line in traceback.walk_tb(error.__traceback__)]
    own = [at for at in frames if at[0].co_filename in _PLUG_INS] or [
        at for at in frames if _is_foreign(at[0])
    ]
    said = f"{type(error).__name__}: {error}"
    if not own:
        return said
    code, line = own[-1]
    within = "" if code.co_name == "<module>" else f", in {code.co_qualname}"
    return f"{said} ({code.co_filename}:{line}{within})"


@contextmanager
def naming_plug_ins() -> Iterator[None]:
    """Turn what a component of a user's own raises into one SimulationError that names it."""
    try:
        yield
    except DesimError:
        raise
    except FAULTS as error:
        frames = traceback.walk_tb(error.__traceback__)
        codes = [frame.f_code for frame, _ in frames if frame.f_code.co_filename in _PLUG_INS]
        if not codes:
            raise
        name = f"{_PLUG_INS[codes[-1].co_filename]}:{codes[-1].co_qualname.partition('.')[0]}"
        raise SimulationError(f"component {name!r} failed: {what_failed(error)}") from error


def _is_foreign(code: CodeType) -> bool:
    """Is this code neither the package's nor the import system's?"""
    file = code.co_filename
    return not file.startswith("<") and not Path(file).is_relative_to(Path(__file__).parent)


def _import_class(name: str) -> type:
    module_name, _, class_name = name.partition(":")
    try:
        module = importlib.import_module(module_name)
        found = getattr(module, class_name)
    except FAULTS as error:
        raise ValueError(f"cannot import {name!r}: {what_failed(error)}") from error
    _PLUG_INS[str(getattr(module, "__file__", None))] = module_name
    if not isinstance(found, type):
        raise ValueError(f"{name!r} is not a class")
    if "kind" not in vars(found):
        found.kind = name  # type: ignore[attr-defined]
    return found
