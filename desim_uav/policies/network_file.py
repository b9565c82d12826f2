"""Checks that all network files share: which settings are allowed, and why one is refused.

Such a file may come from an untrusted source, and its settings could ask for any amount of memory.
"""

from __future__ import annotations

WIDEST, DEEPEST = 4096, 32
"""The largest number of units per layer (or of quantiles), and of layers per network."""


def are_widths(value: object) -> bool:
    """Return whether ``value`` is a list of allowed layer widths."""
    return isinstance(value, list) and len(value) <= DEEPEST and all(map(is_width, value))


def is_width(value: object) -> bool:
    """Return whether ``value`` is an allowed layer width."""
    return type(value) is int and 1 <= value <= WIDEST


def is_bool(value: object) -> bool:
    """Return whether ``value`` is True or False, and not a number."""
    return isinstance(value, bool)


def reason(error: Exception) -> str:
    """Return an error's message as one line."""
    text = str(getattr(error, "strerror", None) or error)
    return " ".join(text.split())[:300] or type(error).__name__
