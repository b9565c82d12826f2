"""Checks the tables of a run for a page, whose script does not check their numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.errors import PolicyError
from desim_uav.model.rules import US
from desim_uav.report.run import Run

if TYPE_CHECKING:
    import pandas as pd

Whole = NDArray[np.int64]


class Checks:
    """Checks of a run's tables, which raise PolicyError with the file and the column."""

    def __init__(self, run: Run) -> None:
        self.run = run

    def error(self, table: str, problem: str) -> PolicyError:
        """Return the error about a problem of a table."""
        return PolicyError(f"{self.run.folder / table}.parquet: {problem}")

    def expect(self, holds: bool, table: str, problem: str) -> None:
        """Raise PolicyError, with the table's file, if something does not hold."""
        if not holds:
            raise self.error(table, problem)

    def finite(self, frame: pd.DataFrame, table: str, name: str) -> NDArray[np.float64]:
        """Return a column of numbers that can be drawn."""
        values: NDArray[np.float64] = frame[name].to_numpy(np.float64)
        fits = bool((np.isfinite(values) & (np.abs(values) < 1e9)).all())
        self.expect(fits, table, f"{name}: empty or far too large")
        return values

    def us(self, frame: pd.DataFrame, table: str, name: str, lowest: int) -> Whole:
        """Return a column of seconds in microseconds, none of which may be below ``lowest``."""
        us = whole(self.finite(frame, table, name) * US)
        self.expect(bool((us >= lowest).all()), table, f"{name}: below {lowest / US:g} s")
        return us

    def within(self, frame: pd.DataFrame, table: str, name: str, end: int) -> None:
        """Check that a column's numbers are at least 0 and below ``end``."""
        values = frame[name].to_numpy()
        within = bool(((values >= 0) & (values < end)).all())
        self.expect(within, table, f"{name}: not of this run (0 to {end - 1})")

    def codes(
        self, frame: pd.DataFrame, table: str, name: str, words: Any, none: int | None = None
    ) -> Whole:
        """Return a column of names as numbers, with ``none`` for missing names.

        ``words`` are names, which are numbered in their order, or members of an enumeration.
        """
        names = words if isinstance(words, list) else [word.name.lower() for word in words]
        code = frame[name].map({word: number for number, word in enumerate(names)})
        if none is not None:
            code = code.where(frame[name].notna(), none)
        unknown = frame[name][code.isna()]
        self.expect(unknown.empty, table, f"{name}: {next(iter(unknown), None)!r} is not known")
        return whole(code.to_numpy(np.float64))


def whole(values: NDArray[np.float64]) -> Whole:
    """Return numbers rounded to whole numbers."""
    return np.rint(values).astype(np.int64)
