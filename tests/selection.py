"""Which parameters of a test run by default."""

from collections.abc import Iterable
from math import ceil
from typing import Any

import pytest

THOROUGH_SEEDS = 3
"""How many seeds of a range are thorough besides those that run by default."""


def by_default(
    chosen: Iterable[Any], values: Iterable[Any], at_most: int | None = None
) -> list[Any]:
    """Return all values as parameters of a test; those that are not among the chosen are thorough.

    If there are more than ``at_most`` others, so many of them are thorough, and the rest only runs
    by hand. For a range, which holds seeds, ``at_most`` is THOROUGH_SEEDS unless it is given.
    """
    chosen = list(chosen)
    others = [value for value in values if value not in chosen]
    if at_most is None:
        at_most = THOROUGH_SEEDS if isinstance(values, range) else len(others)
    thorough = others[:: ceil(len(others) / at_most)] if others else []
    return [
        value if value in chosen else pytest.param(value, marks=_mark(value in thorough))
        for value in values
    ]


def _mark(is_thorough: bool) -> pytest.MarkDecorator:
    return pytest.mark.thorough if is_thorough else pytest.mark.slow


def at_length(brief: Any, long: Any) -> list[Any]:
    """Return a value that runs by default, and one so long that it is only run by hand."""
    return [brief, pytest.param(long, marks=pytest.mark.slow)]
