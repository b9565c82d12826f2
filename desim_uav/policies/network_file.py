"""What the files of networks have in common: how their settings must look, and why one is refused.

Such a file may come from anyone, and a setting can ask for any amount of memory.
"""

from __future__ import annotations

from typing import Any

WIDEST, DEEPEST = 4096, 32
"""The units of a layer, or quantiles, and the layers of a network, at most."""


def are_widths(value: Any) -> bool:
    """Are these the units of a network's layers?"""
    return isinstance(value, list) and len(value) <= DEEPEST and all(map(is_width, value))


def is_width(value: Any) -> bool:
    """Are these the units of a layer?"""
    return type(value) is int and 1 <= value <= WIDEST


def is_bool(value: Any) -> bool:
    """Is it true or false, and no number?"""
    return isinstance(value, bool)


def reason(error: Exception) -> str:
    """What an error says, in one line."""
    text = str(getattr(error, "strerror", None) or error)
    return " ".join(text.split())[:300] or type(error).__name__
