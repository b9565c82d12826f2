"""The leaderboard and its figure, from the submissions in ``analysis/leaderboard``."""

from __future__ import annotations

import runpy
import sys
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


def missing() -> str:
    """Return a list of the rows that are not there yet, or have too few trainings."""
    sys.path.insert(0, str(ROWS.parent))
    script = runpy.run_path(str(ROWS.parent / "leaderboard.py"), run_name="making_the_leaderboard")
    rows = script["told_missing"]()
    return "\n".join(f"- {row}" for row in rows) + "\n" if rows else "None is missing.\n"


def write_figures(folder: Path) -> None:
    """Write its performance profiles: of all tasks, and of two in which more policies fly."""
    made().save(None, folder / "profiles.svg")
    du.bench_board(
        [each for family in FAMILIES for each in sorted(ROWS.glob(f"{family}-medium-*"))],
        figure=folder / "profiles_of_cases.svg",
    )
