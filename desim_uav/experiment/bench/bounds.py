"""The proven bounds of the benchmark's runs: values that no policy exceeds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from desim_uav.errors import DesimError
from desim_uav.experiment.bench.score import CRASHES
from desim_uav.experiment.bench.tasks import EPISODES, BenchTrack, Task
from desim_uav.model.demand.demand import Continuous
from desim_uav.optimum.gathering import gathers, refuse_other_gathering
from desim_uav.optimum.paper_model import refuse_other_models

ROUNDS = {"endurance": 50}
"""The rounds in which prices are improved, where runs are so long that they are few."""

CRASH_PRICE = 0.1
"""What a crash per drone and episode costs in the bound of QoE3, as a share.

A score is at most 1 if it costs at least as much there: if the bound is 10 % above the reference.
"""


def has_bound(task: Task, track: BenchTrack) -> bool:
    """Return whether bounds are proven for the model of a task."""
    scenario = task.scenario(track)
    try:
        if gathers(scenario):
            refuse_other_gathering(scenario)
        else:
            refuse_other_models(scenario, several_types=True)
    except DesimError:
        return False
    return True


def less_crashes(name: str, row: Mapping[str, Any]) -> float:
    """Return the value of a measure in a run as its bound counts it: less the price of crashes."""
    value = float(row[name])
    if name not in ("qoe1_percent", "qoe3_percent"):
        return value
    return value - 100.0 * CRASH_PRICE * float(row[CRASHES])


def compute(task: Task, track: BenchTrack, seed: int) -> dict[str, float]:
    """Return the bounds of a run, by measure; empty if none is proven.

    QoE3 less ``CRASH_PRICE`` for each crash per drone and episode is at most the bound.
    QoE1 has the bound of QoE3 if all users always have an open request, and else none that is
    better than 100 % and quickly computed. The mean age of sensors is at least its bound.
    """
    if not has_bound(task, track):
        return {}
    from desim_uav.optimum.run import ages, bound  # which compile code
    from desim_uav.world import build_world

    scenario = task.scenario(track)
    world = build_world(scenario, track.world_of(seed))
    if gathers(scenario):
        return {"age_s": ages.BoundedAges(world, seed, EPISODES).age_at_least_s()}
    rounds = ROUNDS.get(task.family, bound.ROUNDS)
    qoe3 = 100.0 * bound.BoundedRun(world, seed, EPISODES, rounds).qoe3(CRASH_PRICE)
    always = all(type(own) is Continuous for own in scenario.demands)
    return {"qoe3_percent": qoe3} | ({"qoe1_percent": qoe3} if always else {})
