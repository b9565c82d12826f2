"""The leaderboard, from the submissions in ``analysis/leaderboard``."""

from __future__ import annotations

from pathlib import Path

from desim_uav.experiment.bench import board
from desim_uav.experiment.bench.submission import read

ROWS = Path(__file__).parents[2] / "analysis" / "leaderboard"


def markdown() -> str:
    """Return its tables, one below another."""
    found = [read(folder) for folder in sorted(ROWS.iterdir()) if folder.is_dir()]
    return board.markdown(board.board(found)).replace("## ", "### ")
