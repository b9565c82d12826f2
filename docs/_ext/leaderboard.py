"""The leaderboard, from the submissions in ``analysis/leaderboard``."""

from __future__ import annotations

from pathlib import Path

from desim_uav.experiment.bench import board
from desim_uav.experiment.bench.submission import read_all

ROWS = Path(__file__).parents[2] / "analysis" / "leaderboard"


def markdown() -> str:
    """Return its tables, one below another."""
    return board.markdown(board.board(read_all([ROWS]))).replace("## ", "### ")
