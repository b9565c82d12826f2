"""Components as plain values, as scenario files and hashes have them, and the code of one's own."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any
from uuid import uuid4

from pydantic import BaseModel

from desim_uav.own_code import digest_of
from desim_uav.registry import kind_name
from desim_uav.rowcode.code_digest import class_digest
from desim_uav.rowcode.value_text import UndescribedError

GIVEN = "_given_parameters"
"""The attribute with the parameters of a component whose class is not a dataclass."""


def described(component: object, hashed: bool = False) -> dict[str, Any]:
    """Return the kind and the parameters of a component as plain Python values, the kind first.

    To be ``hashed``, parameters that came later are left out (see ``unchanged``), and a component
    of one's own has the digest of its code.
    """
    class_ = type(component)
    plain = {"kind": kind_name(component)}
    if hashed and (code := code_of(class_)):
        plain["code"] = code
    if not dataclasses.is_dataclass(component):
        return plain | getattr(component, GIVEN, {})
    left_out = unchanged(component) if hashed else ()
    names = [f.name for f in dataclasses.fields(component) if f.init and f.name not in left_out]
    return plain | {name: _plain(getattr(component, name), hashed) for name in names}


def code_of(class_: type) -> str:
    """Return the digest of the code of a class of one's own; "" for a built-in class.

    It is a new one each time if the class is not from a file and its code cannot be described.
    """
    if class_.__module__.startswith("desim_uav."):
        return ""
    try:
        return digest_of(class_.__module__) or class_digest(class_)
    except UndescribedError:
        return uuid4().hex


def own_classes(value: object) -> Iterator[type]:
    """Yield the classes of all components of one's own in a scenario, or in a part of one."""
    if isinstance(value, BaseModel):
        parts = [getattr(value, name) for name in type(value).model_fields]
    elif hasattr(type(value), "kind"):
        if not type(value).__module__.startswith("desim_uav."):
            yield type(value)
        parts = list(vars(value).values()) if hasattr(value, "__dict__") else []
    else:
        parts = list(value) if isinstance(value, list | tuple) else []
        parts += value.values() if isinstance(value, Mapping) else ()
    for part in parts:
        yield from own_classes(part)


def _plain(value: object, hashed: bool) -> Any:
    """Return the value of a parameter: components and named tuples are mappings."""
    if hasattr(type(value), "kind"):
        return described(value, hashed)
    if hasattr(value, "_asdict"):
        return value._asdict()
    if isinstance(value, tuple):
        return tuple(_plain(item, hashed) for item in value)
    return value


def unchanged(section: object) -> list[str]:
    """Return the keys of a section or a component that came later and have their defaults.

    They are named in a class attribute ``later``. A scenario that was written before there was such
    a key has its default, and keeps its hash (see ``scenario.load.scenario_hash``).
    """
    later = getattr(type(section), "later", ())
    return [name for name in later if getattr(section, name) == _default(type(section), name)]


def _default(owner: Any, name: str) -> Any:
    """Return the default of a key of a section or a dataclass."""
    if dataclasses.is_dataclass(owner):
        field = next(each for each in dataclasses.fields(owner) if each.name == name)
        factory = field.default_factory
        return field.default if factory is dataclasses.MISSING else factory()
    return owner.model_fields[name].get_default(call_default_factory=True)
