"""Whose data maps are, which their licences ask to be named."""

from __future__ import annotations

from collections.abc import Iterable

BETWEEN = "; "
"""What stands between the attributions of several files."""


def together(attributions: Iterable[str]) -> str:
    """Return several attributions as one, in which none stands twice."""
    parts = (part for one in attributions for part in one.split(BETWEEN))
    return BETWEEN.join(dict.fromkeys(filter(None, parts)))
