"""The proven bounds of the benchmark's runs, which are kept because they take seconds each.

``bounds.csv`` beside the tasks has the bound of QoE3 for each task, track and seed that it lists.
"""

from __future__ import annotations

import csv
from functools import cache

from desim_uav.errors import DesimError
from desim_uav.experiment.bench.tasks import EPISODES, BenchTrack, Task
from desim_uav.optimum.paper_model import refuse_other_models
from desim_uav.shipped import bench_folder

COLUMNS = ("task", "track", "seed", "qoe3_at_most_percent")
ROUNDS = {"endurance": 50}
"""The rounds in which prices are improved, where runs are so long that they are few."""

CLOSE = 1e-6
"""The difference in percent that two computations of a bound may have on different machines."""


def has_bound(task: Task, track: BenchTrack) -> bool:
    """Return whether the bound of QoE3 is proven for the model of a task."""
    try:
        refuse_other_models(task.scenario(track), several_types=True)
    except DesimError:
        return False
    return True


def bound_of(task: Task, track: BenchTrack, seed: int) -> float | None:
    """Return the upper bound of QoE3 for all policies, in percent; None if none is proven."""
    bound = kept().get((task.name, track.name, seed))
    return compute(task, track, seed) if bound is None else bound


def compute(task: Task, track: BenchTrack, seed: int) -> float | None:
    """Return the same without looking at the kept ones."""
    if not has_bound(task, track):
        return None
    from desim_uav.optimum.run import bound  # which compiles code
    from desim_uav.world import build_world

    world = build_world(task.scenario(track), track.world_of(seed))
    rounds = ROUNDS.get(task.family, bound.ROUNDS)
    return 100.0 * bound.BoundedRun(world, seed, EPISODES, rounds).qoe3()


@cache
def kept() -> dict[tuple[str, str, int], float]:
    """Return the kept bounds by task, track and seed."""
    file = bench_folder() / "bounds.csv"
    if not file.exists():
        return {}
    with file.open(encoding="utf-8", newline="") as lines:
        return {
            (row["task"], row["track"], int(row["seed"])): float(row["qoe3_at_most_percent"])
            for row in csv.DictReader(lines)
        }
