"""Lists whose items have names: the types of drones, and the groups of users."""

from __future__ import annotations

from typing import Any, TypeVar

from desim_uav.scenario.components import errors
from desim_uav.scenario.yaml12 import KeyPath

T = TypeVar("T", bound=Any)


def named_items(items: tuple[T, ...], key: str, most: int) -> tuple[T, ...]:
    """Return items with a ``name`` and a ``count``, of which there may be so many in all.

    ``key`` is that of the list. Raises an error of pydantic for each name that occurs again, and
    ValueError if there are too many.
    """
    problems: list[tuple[KeyPath, str, object]] = []
    first: dict[str, int] = {}
    for number, one in enumerate(items):
        if one.name in first:
            message = f"is the name of {key}.{first[one.name]} too; names must differ"
            problems.append(((number, "name"), message, one.name))
        first.setdefault(one.name, number)
    if problems:
        raise errors(problems)
    count = sum(one.count for one in items)
    if count > most:
        raise ValueError(f"has {count} {key} in all; at most {most}")
    return items
