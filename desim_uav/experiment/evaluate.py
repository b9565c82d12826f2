"""One replication: the measures of a policy in a scenario on one seed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from desim_uav.experiment.run import headline, run
from desim_uav.model.energy.battery import in_joules
from desim_uav.model.services import is_task
from desim_uav.policies import load_policy
from desim_uav.policies.base import PolicyLike, as_seen, policy_name
from desim_uav.scenario.schema import Scenario
from desim_uav.world import build_world

MEASURES = (
    "qoe1_percent",
    "qoe1_feasible_percent",
    "qoe2_iterations",
    "qoe3_percent",
    "qoe3_active_percent",
    "crashes_per_drone_episode",
    "reward_mean",
)

ENERGY = "j_per_mbit"
"""One more measure, if all batteries hold energy: that used in flight over what was served."""

OF_TASKS = ("completion_s", "deadlines_met_percent")
"""More measures, if services have tasks: their mean delay, and how many met their deadline."""

SOMETIMES = (ENERGY, *OF_TASKS)
"""The measures that only some scenarios have."""


def measures_of(*scenarios: Scenario) -> tuple[str, ...]:
    """Return the names of the measures of replications in some scenarios, in any of them."""
    has_energy = any(
        all(in_joules(drones.battery) for drones in scenario.fleet) for scenario in scenarios
    )
    names = (*MEASURES, ENERGY) if has_energy else MEASURES
    services = [service for scenario in scenarios for service in scenario.services.values()]
    return (*names, *OF_TASKS) if any(map(is_task, services)) else names


def evaluate(
    scenario: Scenario,
    policy: PolicyLike,
    seed: int,
    episodes: int,
    warmup: int,
    engine: str = "des",
    on_episode: Callable[[], None] = lambda: None,
) -> dict[str, float | None]:
    """Return the measures of ``episodes`` episodes after ``warmup``, in the world of the seed.

    QoE1 and QoE2 are means over all requests, QoE3 and the reward over episodes; energy and what
    was served are summed up before one is divided by the other. ``engine`` is auto, des or batch.
    """
    name, policy = policy_name(policy), load_policy(policy)
    scenario = as_seen(scenario, policy).model_copy(update={"seed": seed})
    world = build_world(scenario, scenario.effective_world_seed)
    results = run(
        world,
        policy,
        name,
        seed,
        episodes,
        warmup,
        on_episode=on_episode,
        engine=engine,
    )
    measured: dict[str, Any] = headline(results.requests, results.episodes)
    drone_episodes = episodes * scenario.drone_count
    measured["crashes_per_drone_episode"] = measured["crashes"] / drone_episodes
    return {name: measured[name] for name in measures_of(scenario)}
