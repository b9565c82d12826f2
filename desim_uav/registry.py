"""Component slots: turn the ``kind`` in a scenario file into a class.

A built-in component registers itself with ``@register("mobility", "random_walk")``. A component of
your own is named ``"package.module:Class"``. Importing it runs its code, so use only components
that you trust; ``desim-uav --no-plugins`` refuses them all.
"""

from __future__ import annotations

import importlib
import importlib.util
import pkgutil
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, ClassVar, TypeVar

from desim_uav import own_code
from desim_uav.errors import DesimError, SimulationError, did_you_mean, has_instead
from desim_uav.plug_ins import ADMISSION
from desim_uav.typed import typed

_SLOTS: dict[str, dict[str, type]] = {}

_PLUG_INS: dict[str, str] = {}
"""The name of each module that a user's own component came from, by the module's source file."""

FAULTS = (Exception, SystemExit)
"""What a user's own code may raise. ``sys.exit`` in it must not end the program silently."""

T = TypeVar("T", bound=type)


class FieldMark:
    """Marks a field of a component, in its annotation, with what a scenario may say there.

    ``as_field`` returns what validates the field; ``scenario.components`` sets it.
    """

    as_field: ClassVar[Callable[[Any], Any]]

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> Any:
        """Return the validation of the field."""
        return FieldMark.as_field(self).__get_pydantic_core_schema__(source, handler)

    def __get_pydantic_json_schema__(self, schema: object, handler: object) -> Any:
        """Return the JSON Schema of the field."""
        return FieldMark.as_field(self).__get_pydantic_json_schema__(schema, handler)


@dataclass(frozen=True)
class ComponentField(FieldMark):
    """Marks a field that is a component itself: its slot, default kind and interface.

    ``by_name``: the name of a kind alone stands for a component without parameters.
    """

    slot: str
    default: str
    protocol: type
    by_name: bool = False


@dataclass(frozen=True)
class NameOr(FieldMark):
    """Marks a field that is one of some names, if any, or else of the type ``form``.

    The form is a named tuple, which a mapping stands for, or an annotated tuple of such ones.
    ``says`` describes such a value to users. ``made`` turns it into the field's value, if not
    ``None``; it may raise ValueError.
    """

    names: tuple[str, ...]
    form: Any
    says: str
    made: Callable[[Any], Any] | None = None


@dataclass(frozen=True)
class Checked(FieldMark):
    """Marks a field whose value must pass a check, which raises ValueError with the reason."""

    check: Callable[[Any], None]


@typed
def register(slot: str, name: str) -> Callable[[T], T]:
    """Register the decorated class as ``name`` in ``slot``, for instance as a "mobility".

    Scenario files then name the class as ``kind: name``. The attribute ``kind`` of the class is
    set to ``name``.
    """

    def enter(component: T) -> T:
        _SLOTS.setdefault(slot, {})[name] = component
        component.kind = name  # type: ignore[attr-defined]
        return component

    return enter


def discover(package: ModuleType, deep: bool = False) -> None:
    """Import every module of a package, so that its components register themselves.

    If ``deep``, the modules of the packages in it are imported too.
    """
    listed = pkgutil.walk_packages if deep else pkgutil.iter_modules
    for module in listed(package.__path__, package.__name__ + "."):
        importlib.import_module(module.name)


def kind_name(component: object) -> str:
    """Return the kind of a component as a scenario names it: "module:Class" if it is one's own."""
    class_ = type(component)
    return str(vars(class_).get("kind", f"{class_.__module__}:{class_.__qualname__}"))


def names(slot: str) -> list[str]:
    """Return the built-in names of a slot in the order of their registration."""
    return list(_SLOTS.get(slot, {}))


def resolve(slot: str, name: str) -> type:
    """Return the class called ``name``: a built-in one, or ``"package.module:Class"``.

    Raises ValueError for an unknown name, with the built-in names and the nearest of them, and for
    a class that cannot be imported, with the cause.
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


def what_failed(error: BaseException) -> str:
    """Return an error's message, with the file and line of the user's own code that raised it."""
    if isinstance(error, DesimError):  # whose messages are whole
        return str(error)
    frames = [(frame.f_code, line) for frame, line in traceback.walk_tb(error.__traceback__)]
    own = [at for at in frames if at[0].co_filename in _PLUG_INS] or [
        at for at in frames if _is_foreign(at[0])
    ]
    message = f"{type(error).__name__}: {error}{_fields(error)}"
    if not own:
        return message
    code, line = own[-1]
    within = "" if code.co_name == "<module>" else f", in {code.co_qualname}"
    return f"{message} ({code.co_filename}:{line}{within})"


def _fields(error: BaseException) -> str:
    """Return the fields of an object of ours that lacks an attribute, for a message, or ""."""
    of = type(getattr(error, "obj", None))
    if not isinstance(error, AttributeError) or not of.__module__.startswith("desim_uav."):
        return ""
    return has_instead(of, str(error.name))


@contextmanager
def naming_plug_ins() -> Iterator[None]:
    """Turn an error raised by a user's own component into a SimulationError that names it."""
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
    """Return whether this code belongs neither to this package nor to the import system."""
    file = code.co_filename
    return not file.startswith("<") and not Path(file).is_relative_to(Path(__file__).parent)


class _NotThereError(ValueError):
    """There is no such file, or nothing of this name in a module."""


def _imported(name: str) -> ModuleType:
    """Return a module by its name, or by the path of its file, which ends in ``.py``."""
    if not name.endswith(".py"):
        return importlib.import_module(name)
    file = Path(name).resolve()
    if not file.is_file():
        raise _NotThereError("no such file")
    if str(file) in sys.modules:
        return sys.modules[str(file)]
    spec = importlib.util.spec_from_file_location(str(file), file)
    assert spec is not None and spec.loader is not None, "it ends in .py"
    module = importlib.util.module_from_spec(spec)
    sys.modules[str(file)] = module  # dataclasses look for the module of their class
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[str(file)]
        raise
    return module


def _import_class(name: str) -> type:
    ADMISSION.ask(name)
    module_name, _, class_name = name.rpartition(":")
    try:
        module = _imported(module_name)
        if not hasattr(module, class_name):
            classes = [key for key, one in vars(module).items() if isinstance(one, type)]
            nearest = did_you_mean(class_name, classes)
            raise _NotThereError(f"{module_name!r} has no {class_name!r}{nearest}")
        class_ = getattr(module, class_name)
    except _NotThereError as error:
        raise ValueError(f"cannot import {name!r}: {error}") from error
    except FAULTS as error:
        raise ValueError(f"cannot import {name!r}: {what_failed(error)}") from error
    try:
        if not module_name.endswith(".py"):  # a path is of one file
            own_code.check_place(module)
        own_code.check_unchanged(module)
    except ValueError as error:
        raise ValueError(f"cannot use {name!r}: {error}") from error
    _PLUG_INS[str(getattr(module, "__file__", None))] = module_name
    if not isinstance(class_, type):
        raise ValueError(f"{name!r} is not a class")
    if "kind" not in vars(class_):
        class_.kind = name  # type: ignore[attr-defined]
    return class_
