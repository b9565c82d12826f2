"""The fields of a component of one's own as a row, for its compiled functions."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from desim_uav.model.rows import Row, fill, row


def values_of(component: Any) -> Row:
    """Return the numbers of a frozen dataclass as a row of a class of its own.

    Raises TypeError, naming the field, if one is no number.
    """
    kinds: dict[str, type] = {}
    for field in fields(component):
        value = getattr(component, field.name)
        if not isinstance(value, bool | int | float):
            raise TypeError(f"its field {field.name!r} is no number")
        kinds[field.name] = float if isinstance(value, float) else int
    cls: Any = row(type(type(component).__name__, (Row,), {"__annotations__": kinds}))
    made: Row = fill(cls, [kind(getattr(component, name)) for name, kind in kinds.items()])
    return made
