"""A figure of the simulator beside the figure that theory predicts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

ERRORS = 4.0
"""The largest allowed difference of an estimate, in standard errors."""


@dataclass(frozen=True)
class Exact:
    """A figure that is known exactly and may differ by at most ``tolerance``.

    The tolerance is a share of the theory's figure if ``relative``. ``cases`` is the number of
    cases compared, of which this is the worst.
    """

    what: str
    ours: float
    theory: float
    tolerance: float = 0.0
    relative: bool = False
    cases: int = 1

    @property
    def away(self) -> float:
        """The difference."""
        away = abs(self.ours - self.theory)
        return away / abs(self.theory) if self.relative else away

    @property
    def holds(self) -> bool:
        """Whether the difference is within the tolerance; NaN is not."""
        return self.away <= self.tolerance

    def cells(self) -> tuple[str, ...]:
        """Figure, ours, theory, deviation, limit, number."""
        of = " relative" if self.relative else ""
        limit = f"{self.tolerance:.2g}{of}" if self.tolerance else "equal"
        form = "" if self.tolerance < 1e-12 else ".10g"
        ours, theory = (f"{n:{form}}".removesuffix(".0") for n in (self.ours, self.theory))
        return self.what, ours, theory, f"{self.away:.2g}{of}", limit, f"{self.cases:,}"


@dataclass(frozen=True)
class Estimate:
    """The mean of independent replications; it may differ by at most 4 standard errors."""

    what: str
    ours: float
    theory: float
    error: float
    replications: int

    @classmethod
    def of(cls, what: str, values: Sequence[float] | np.ndarray, theory: float) -> Estimate:
        """Return the mean of the values of independent replications."""
        found = np.asarray(values, float)
        error = float(found.std(ddof=1)) / math.sqrt(len(found))
        return cls(what, float(found.mean()), theory, error, len(found))

    @property
    def away(self) -> float:
        """The difference in standard errors."""
        return abs(self.ours - self.theory) / self.error if self.error > 0 else math.inf

    @property
    def holds(self) -> bool:
        """Is it near enough?"""
        return self.away <= ERRORS

    def cells(self) -> tuple[str, ...]:
        """Figure, ours, theory, deviation, limit, number."""
        ours, theory = f"{self.ours:.6g} ± {self.error:.2g}", f"{self.theory:.9g}"
        limit = f"{ERRORS:g} standard errors"
        return self.what, ours, theory, f"{self.away:.2f} s.e.", limit, f"{self.replications:,}"


Figure = Exact | Estimate


def check(figures: Any) -> None:
    """Every one holds, and there are some: what a test asserts."""
    found = list(figures)
    assert found
    for figure in found:
        assert figure.holds, figure
