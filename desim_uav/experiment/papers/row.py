"""A figure of a published paper beside what is computed here."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class FigureRow:
    """One figure: what the paper says of it, how that was read, and ours.

    It holds if both are at most ``limit`` apart: the reading error, half a unit of the last printed
    digit, or 4 standard errors of an estimate. Without a limit it is an open question: nothing is
    claimed, because the paper leaves out what the figure depends on, or we have not read it.
    """

    figure: str
    """The quantity that is compared, with its unit."""
    where: str
    """The place in the paper, and how the figure was read or computed from it."""
    theirs: float
    ours: float
    limit: float | None
    digits: int
    """The number of decimal places that are shown."""
    at_least: bool = False
    """Whether only a figure of ours that is lower is a difference: more is as good."""

    @property
    def apart(self) -> float:
        """The absolute difference of the two figures; 0 if more is as good, and ours is more."""
        if self.at_least and self.ours > self.theirs:
            return 0.0
        return float(abs(self.ours - self.theirs))

    @property
    def holds(self) -> bool | None:
        """Whether the difference is within the limit (not if it is NaN); None without a limit."""
        return None if self.limit is None else bool(self.apart <= self.limit)

    def content(self) -> dict[str, Any]:
        """Return the row as plain values."""
        return asdict(self) | {"apart": self.apart, "holds": self.holds}

    def cells(self) -> tuple[str, ...]:
        """Return the row as text: figure, where, theirs, ours, apart, limit, holds."""
        theirs, ours = (f"{number:.{self.digits}f}" for number in (self.theirs, self.ours))
        limit = "" if self.limit is None else f"{self.limit:.2g}"
        holds = {True: "yes", False: "NO", None: "open"}[self.holds]
        return self.figure, self.where, theirs, ours, f"{self.apart:.2g}", limit, holds


def evaluated(
    figure: str, where: str, theirs: float, ours: float, digits: int, half_units: float = 1.0
) -> FigureRow:
    """Return a row whose figure is known to ``digits`` digits after the point."""
    return FigureRow(
        figure, where, theirs, ours, half_units * 0.5 * 10.0**-digits * (1 + 1e-9), digits
    )
