"""The bounds of runs over several seeds, with their means."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from desim_uav.experiment.statistics import estimate
from desim_uav.optimum.paper_model import refuse_other_models
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


def work_of(seeds: int, episodes: int) -> int:
    """Return how often ``bounds`` reports progress, at most."""
    return seeds * (3 * ROUNDS + TURNS * episodes + episodes)


def bounds(
    scenario: Scenario,
    seeds: Sequence[int],
    episodes: int,
    schedule: bool = True,
    on_work: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """Return the bounds of a run on each seed, in the world of that seed, and their means.

    Raises ScenarioError if the model is not the paper's, and UsageError, with the key, if a run
    cannot be bounded for another reason.
    """
    refuse_other_models(scenario, several_types=True)
    rows = [_row(scenario, seed, episodes, schedule, on_work) for seed in seeds]
    means = {name: estimate(row[name] for row in rows).values() for name in MEASURES}
    return {"episodes": episodes, "means": means, "seeds": rows}


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
