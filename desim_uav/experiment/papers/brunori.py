"""Brunori, Colonnese, Cuomo, Iocchi 2021: the nine cases of the paper's table.

The trainings are those of ``desim-uav reproduce`` with its defaults, on ten seeds. Each one that
has ended is kept in ``FOLDER``, where both commands look before they train.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from desim_uav.experiment import reproduce
from desim_uav.experiment.paper_table import PaperRow
from desim_uav.experiment.papers.row import FigureRow
from desim_uav.experiment.papers.simulated import STANDARD_ERRORS
from desim_uav.experiment.published import POLICIES, PUBLISHED, best_qoe3

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FOLDER = Path("runs/reproduce")
SEEDS = range(reproduce.FIRST_SEED, reproduce.FIRST_SEED + 10)
EPISODES: int | None = None
"""The episodes of a training, by default those of the scenario."""


def rows() -> Iterator[FigureRow]:
    """Yield QoE3 of each policy in each case, and whether the best printed one is reached."""
    for case in PUBLISHED:
        yield from rows_of(case, finished(case))


def finished(case: int) -> list[PaperRow]:
    """Return the rows of a case; jobs that are kept are not run again."""
    todo = reproduce.jobs([case], SEEDS, EPISODES, [None])
    return reproduce.run_jobs(todo, FOLDER, os.cpu_count() or 1)


def rows_of(case: int, done: Sequence[PaperRow]) -> Iterator[FigureRow]:
    """Yield the rows of a case."""
    where = "printed, of one training; its seed, users and requests are not given"
    for policy in POLICIES:
        qoe3 = qoe3_percent(done, policy)
        what = f"case {case}, {policy.replace('_', '-')}: QoE3, %"
        ours = math.fsum(qoe3) / len(qoe3)
        yield FigureRow(what, where, PUBLISHED[case][policy][2], ours, None, 1)
    learned = qoe3_percent(done, POLICIES[1])
    ours, limit = math.fsum(learned) / len(learned), STANDARD_ERRORS * standard_error(learned)
    what = f"case {case}: Q-learning reaches the best printed QoE3, %"
    yield FigureRow(what, "printed", best_qoe3(case), ours, limit, 1, at_least=True)


def qoe3_percent(done: Sequence[PaperRow], policy: str) -> list[float]:
    """Return QoE3 of a policy on each seed, with greedy drones after the training."""
    return [float(row["qoe3_percent"]) for row in done if row["policy"] == policy]


def standard_error(values: Sequence[float]) -> float:
    """Return the standard error of the mean of independent values."""
    mean = math.fsum(values) / len(values)
    squares = math.fsum((value - mean) ** 2 for value in values)
    return math.sqrt(squares / (len(values) - 1) / len(values))


def draw() -> Figure:
    """Draw QoE3 over the cases: ours as lines, the printed ones as points."""
    from desim_uav.report.figures.papers import Series, lines_figure

    cases = list(PUBLISHED)
    done = {case: finished(case) for case in cases}
    series = []
    for policy in POLICIES:
        means = [math.fsum(qoe3_percent(done[case], policy)) / len(SEEDS) for case in cases]
        printed = tuple((float(case), PUBLISHED[case][policy][2]) for case in cases)
        series.append(Series(policy.replace("_", "-"), cases, means, points=printed))
    return lines_figure("QoE3, means over ten seeds", "case", "QoE3, %", series, "printed")
