"""The leaderboard and its figure, from the submissions in ``analysis/leaderboard``."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import desim_uav as du

ROWS = Path(__file__).parents[2] / "analysis" / "leaderboard"
FAMILIES = ("coverage", "multi-service")


@cache
def made() -> du.Leaderboard:
    """Return the leaderboard."""
    return du.bench_board([ROWS])


def markdown() -> str:
    """Return its tables, one below another."""
    return made().markdown().replace("## ", "### ")


def write_figures(folder: Path) -> None:
    """Write its performance profiles: of all tasks, and of two in which more policies fly."""
    made().save(None, folder / "profiles.svg")
    du.bench_board(
        [each for family in FAMILIES for each in sorted(ROWS.glob(f"{family}-medium-*"))],
        figure=folder / "profiles_of_cases.svg",
    )
