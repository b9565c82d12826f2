"""One replication: the measures of a policy in a scenario on one seed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from desim_uav.experiment.run import run
from desim_uav.measures.known import compared_in
from desim_uav.measures.tally import headline
from desim_uav.policies import load_policy
from desim_uav.policies.base import PolicyLike, as_seen, policy_name
from desim_uav.scenario.schema import Scenario
from desim_uav.world import build_world


def evaluate(
    scenario: Scenario,
    policy: PolicyLike,
    seed: int,
    episodes: int,
    warmup: int,
    engine: str = "des",
    on_episode: Callable[[], None] = lambda: None,
    measures: Sequence[str] | None = None,
) -> dict[str, float | None]:
    """Return the measures of ``episodes`` episodes after ``warmup``, in the world of the seed.

    QoE1 and QoE2 are means over all requests, QoE3 and the reward over episodes; energy and what
    was served are summed up before one is divided by the other. ``engine`` is auto, des or batch.
    ``measures`` are names of measures that the scenario has, by default those of a comparison.
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
    found = headline(results.requests, results.episodes, results.sensors)
    return replicated(found, scenario, compared_in(scenario) if measures is None else measures)


def replicated(
    found: dict[str, Any], scenario: Scenario, names: Sequence[str]
) -> dict[str, float | None]:
    """Return these measures of a replication, given those that its tables have.

    A measure that they do not have, as they hold no request or sensor, is None.
    """
    drone_episodes = found["episodes"] * scenario.drone_count
    found = found | {"crashes_per_drone_episode": found["crashes"] / drone_episodes}
    return {name: found.get(name) for name in names}
