"""The bounds of runs over several seeds, with their means."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from desim_uav.experiment.statistics import estimate
from desim_uav.optimum.gathering import gathers, refuse_other_gathering
from desim_uav.optimum.paper_model import refuse_other_models
from desim_uav.optimum.run.ages import BoundedAges, rounds_in
from desim_uav.optimum.run.bound import ROUNDS, BoundedRun
from desim_uav.optimum.run.schedule import TURNS
from desim_uav.scenario.schema import Scenario
from desim_uav.world import build_world

MEASURES = (
    "qoe3_at_most_percent",
    "crash_free_at_most_percent",
    "qoe1_at_most_percent",
    "schedule_qoe3_percent",
)


AGES = ("age_at_least_s",)
"""The measure that is bounded in scenarios with sensors."""


def work_of(scenario: Scenario, seeds: int, episodes: int) -> int:
    """Return how often ``bounds`` reports progress, at most."""
    if gathers(scenario):
        return seeds * sum(map(rounds_in, range(episodes)))
    return seeds * (3 * ROUNDS + TURNS * episodes + episodes)


def bounds(
    scenario: Scenario,
    seeds: Sequence[int],
    episodes: int,
    schedule: bool = True,
    on_work: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """Return the bounds of a run on each seed, in the world of that seed, and their means.

    Where there are sensors, the mean age is bounded, and else QoE3 and QoE1. Raises ScenarioError
    if the model is not one in which this is proven, and UsageError, with the key, if a run
    cannot be bounded for another reason.
    """
    if gathers(scenario):
        refuse_other_gathering(scenario)
        names: Sequence[str] = AGES
        rows = [_row_of_ages(scenario, seed, episodes, on_work) for seed in seeds]
    else:
        refuse_other_models(scenario, several_types=True)
        names = MEASURES
        rows = [_row(scenario, seed, episodes, schedule, on_work) for seed in seeds]
    means = {name: estimate(row[name] for row in rows).values() for name in names}
    return {"episodes": episodes, "means": means, "seeds": rows}


def _row_of_ages(
    scenario: Scenario, seed: int, episodes: int, on_work: Callable[[], None]
) -> dict[str, Any]:
    seeded = scenario.model_copy(update={"seed": seed})
    world = build_world(seeded, seeded.effective_world_seed)
    bound = BoundedAges(world, seed, episodes, on_work=on_work).age_at_least_s()
    return {
        "seed": seed,
        "world_seed": seeded.effective_world_seed,
        "age_at_least_s": bound,
    }


def _row(
    scenario: Scenario, seed: int, episodes: int, schedule: bool, on_work: Callable[[], None]
) -> dict[str, Any]:
    seeded = scenario.model_copy(update={"seed": seed})
    world = build_world(seeded, seeded.effective_world_seed)
    bound = BoundedRun(world, seed, episodes, on_work=on_work).bound(schedule)
    return {
        "seed": seed,
        "world_seed": seeded.effective_world_seed,
        **{name: getattr(bound, name) for name in MEASURES},
        "gap_percent": bound.gap_percent,
    }
