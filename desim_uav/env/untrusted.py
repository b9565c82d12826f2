"""Numbers and lists from an untrusted source, such as a file of a saved state."""

from __future__ import annotations

from typing import Any

HIGHEST = 2**53
"""No whole number is larger, so that all of them are exact as 64-bit numbers of either kind."""


def listed(value: object, length: int | None = None) -> list[Any]:
    """Return a list. Raises ValueError if it is none, or not of this length."""
    if not isinstance(value, list) or length not in (None, len(value)):
        raise ValueError(f"{value!r:.40} is no list of {length or 'hops'}")
    return value


def whole(value: object, least: int, most: int) -> int:
    """Return a whole number. Raises ValueError if it is none, or not between two others."""
    if type(value) is not int or not least <= value <= most:
        raise ValueError(f"{value!r:.40} is not a whole number from {least} to {most}")
    return value


def number(value: Any) -> float:
    """Return a finite number as a float. Raises ValueError if it is none."""
    if type(value) not in (int, float) or not -HIGHEST <= value <= HIGHEST:
        raise ValueError(f"{value!r:.40} is not a number")
    return float(value)


def require(holds: bool, otherwise: str) -> None:
    """Raise ValueError with this text unless something holds."""
    if not holds:
        raise ValueError(otherwise)
