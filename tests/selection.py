"""Which parameters of a test run by default."""

from collections.abc import Iterable
from typing import Any

import pytest


def by_default(chosen: Iterable[Any], values: Iterable[Any]) -> list[Any]:
    """All values as parameters of a test; those that are not among the chosen are thorough."""
    chosen = list(chosen)
    return [
        value if value in chosen else pytest.param(value, marks=pytest.mark.thorough)
        for value in values
    ]


def at_length(brief: Any, long: Any) -> list[Any]:
    """A value that runs by default, and one so long that it is only run by hand."""
    return [brief, pytest.param(long, marks=pytest.mark.slow)]
