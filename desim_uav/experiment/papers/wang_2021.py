"""Wang, Fang, Ding, Xiong 2021: the delay of tasks computed by users, by a drone, or by both.

The paper draws the delay of all tasks of an episode over their size, for learned policies and for
two lines that bound them: everything is computed by the users, or by the drone. The third line here
is the best split, which no policy can beat. Delays are proportional to the bits, so one task stands
for all those that users have one after the other.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import pandas as pd

from desim_uav.experiment.papers.row import FigureRow
from desim_uav.experiment.papers.simulated import flown, scenario_of
from desim_uav.experiment.statistics import estimate
from desim_uav.experiment.train.course import train
from desim_uav.model.rewards import RowReward
from desim_uav.model.rules import US
from desim_uav.policies.base import PolicyLike
from desim_uav.policies.tabular import Greedy

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ONE_TASK, LEARNED = "wang_2021.yaml", "wang_2021_learned.yaml"
SIZES_MIBIT = (60, 80, 100, 120, 140)
LINES = {"local": "never", "edge only": "always", "best split": "split"}
CYCLES_PER_BIT, USER_HZ, DRONE_HZ, LINK_BPS = 1000, 0.6e9, 1.2e9, 9_967_226
LOCAL_60_S = 104.8576
"""The delay that a comment in the authors' published code has for 60 Mibit, computed locally."""
ROUNDED_S = 2e-6
"""Each of up to three stages ends at a whole microsecond."""
SEEDS = range(9100, 9116)
"""Seeds, and worlds, in which nothing was trained or chosen."""
MOST_PERCENT = 5.0
"""How much longer than the best split the learned delay may be."""


@dataclass(frozen=True)
class Delay(RowReward):
    """Minus the mean time for which requests have been open in an episode of one step."""

    names = ("delay",)

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        """Write the term, in seconds."""
        open_us = state.open_us
        for service in range(len(state.open_requests)):
            open_us += state.open_requests[service] * state.now_us
        drone.terms[0] = -float(open_us) / US / max(1, state.opened)


def rows() -> Iterator[FigureRow]:
    """Yield the delays of the three lines, and how much longer a learned share takes."""
    local_s = simulated_s("local", 60)
    how = "a comment in the authors' code"
    yield FigureRow("60 Mibit, local: delay, s", how, LOCAL_60_S, local_s, ROUNDED_S, 6)
    for size in SIZES_MIBIT:
        for line, theirs in formulas_s(size).items():
            what, ours = f"{size} Mibit, {line}: delay, s", simulated_s(line, size)
            yield FigureRow(what, "the paper's formulas", theirs, ours, ROUNDED_S, 6)
    for size, learned_s in learned_delays_s().items():
        more = estimate(100.0 * (learned_s / split_s(size) - 1.0))
        what = f"{size} Mibit, learned share: longer than the best split by, %"
        how = f"mean over {len(SEEDS)} worlds; no policy is below 0"
        yield FigureRow(what, how, 0.0, more.mean or 0.0, MOST_PERCENT, 2)


@cache
def simulated_s(line: str, size_mibit: int) -> float:
    """Return the delay of a task of a user right below the drone, in a run."""
    scenario = scenario_of(
        ONE_TASK, {"offloading": LINES[line], "services.task.input_mbit": [mbit(size_mibit)]}
    )
    (task,) = flown(scenario, "hover").requests.itertuples()
    return float(task.t_end_s - task.t_request_s)


def mbit(size_mibit: int) -> float:
    """Return a size in Mbit."""
    return size_mibit * 2**20 / 1e6


def formulas_s(size_mibit: int) -> dict[str, float]:
    """Return the delay of each line; both parts of a split take the same time."""
    bits = size_mibit * 2**20
    local_s = bits * CYCLES_PER_BIT / USER_HZ
    edge_s = bits / LINK_BPS + bits * CYCLES_PER_BIT / DRONE_HZ
    split_s = local_s * edge_s / (local_s + edge_s)
    return {"local": local_s, "edge only": edge_s, "best split": split_s}


@cache
def learned_delays_s() -> dict[int, pd.Series]:
    """Return the mean delay of tasks of each size in each world, with a share that is learned.

    A table is trained in the world of seed 0; then it commands the drone in the other worlds.
    """
    table, _ = train(scenario_of(LEARNED), "batch")
    policy = Greedy.of_table(table, "learned share")
    return {size: delays_s(size, policy) for size in SIZES_MIBIT}


@cache
def split_s(size_mibit: int) -> pd.Series:
    """Return the mean delay of tasks of a size in each world, if all are split in the best way."""
    return delays_s(size_mibit, "hover", offloading="split")


def delays_s(size_mibit: int, policy: PolicyLike, **changes: Any) -> pd.Series:
    """Return the mean delay of tasks of a size in each world, by seed.

    The task of 0 s is left out, because its share is decided before the drone's first command.
    """
    scenario = scenario_of(LEARNED, {"services.task.input_mbit": [mbit(size_mibit)], **changes})
    means = {}
    for seed in SEEDS:
        tasks = flown(scenario, policy, seed).requests
        tasks = tasks[(tasks["outcome"] == "completed") & (tasks["t_request_s"] > 0)]
        means[seed] = (tasks["t_end_s"] - tasks["t_request_s"]).mean()
    return pd.Series(means)


def draw() -> Figure:
    """Draw the delay over the size of the tasks."""
    from desim_uav.report.figures.papers import Series, lines_figure

    series = [
        Series(
            line,
            SIZES_MIBIT,
            [simulated_s(line, size) for size in SIZES_MIBIT],
            tuple((float(size), formulas_s(size)[line]) for size in SIZES_MIBIT),
        )
        for line in LINES
    ]
    learned = [float(delays.mean()) for delays in learned_delays_s().values()]
    series.append(Series("learned share", SIZES_MIBIT, learned))
    return lines_figure(
        "Delay of all tasks",
        "size of all tasks, Mibit",
        "delay, s",
        series,
        "the paper's formulas",
    )
