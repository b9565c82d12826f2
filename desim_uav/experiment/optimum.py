"""The work of ``desim-uav optimum``: how well any policy could do in a scenario."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.errors import UsageError
from desim_uav.experiment.bounds import bounds
from desim_uav.optimum.cover import FairCover, Spots, cover, fair_cover, instant_bound
from desim_uav.optimum.discounted import optimal_return
from desim_uav.optimum.gain import best_policy, long_run
from desim_uav.optimum.gathering import gathers, refuse_other_gathering
from desim_uav.optimum.graph import Forced, Graph, explore, unlimited
from desim_uav.optimum.horizon import best_episode, episode_total
from desim_uav.optimum.itinerary import (
    Itinerary,
    in_an_episode,
    in_the_long_run,
    without_battery,
)
from desim_uav.optimum.paper_model import refuse_other_models
from desim_uav.optimum.process import DroneProcess
from desim_uav.rules.rewards import Coverage
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World, build_world

Array = NDArray[np.float64]
Brought = tuple[Array, list[Forced]]
"""The gain of each action, and the actions whose gain is spread over several steps."""

NO_COVERS: dict[str, Any] = {
    "cover": None,
    "instant_at_most_percent": None,
    "fair_cover": None,
}
"""What is known of the best cells if users move."""

LARGEST = 2 * 10**7
"""The largest number of states times steps of an episode that is searched."""


def optimum(
    scenario: Scenario,
    seeds: int,
    episodes: int,
    on_work: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """Return everything that can be computed about the best policies, as one JSON object.

    Runs of so many episodes are bounded on so many seeds, from the scenario's own on. Raises
    ScenarioError, with all keys that prevent it, if the model is not the paper's, and UsageError,
    with the key, if the scenario cannot be solved for another reason.
    """
    of_ages = gathers(scenario)
    static = scenario.users_stay and not of_ages
    if of_ages:
        refuse_other_gathering(scenario)
    else:
        refuse_other_models(scenario, several_types=not static)
    world = build_world(scenario, scenario.effective_world_seed)
    lone = scenario.drone_count == 1 and static
    process = DroneProcess(world) if lone else None
    solution: dict[str, Any] = {
        "scenario": scenario.name,
        "seed": scenario.seed,
        "world_seed": scenario.effective_world_seed,
        "drones": scenario.drone_count,
        "users": len(world.homes),
        **(_covers(world) if static else NO_COVERS),
        "one_drone": None,
        "discounted": None,
        "runs": None,
        "runs_refused": None,
    }
    if bounds_runs(scenario):
        all_seeds = range(scenario.seed, scenario.seed + seeds)
        try:
            solution["runs"] = bounds(scenario, all_seeds, episodes, on_work=on_work)
        except UsageError as error:
            if not static:
                raise
            solution["runs_refused"] = str(error)
    if process is not None:
        solution["one_drone"] = _one_drone(world, process)
        if not scenario.limited_battery:
            solution["discounted"] = _discounted(world, process)
    return solution


def bounds_runs(scenario: Scenario) -> bool:
    """Return whether bounds of runs say more than the best cells and the best of one drone."""
    several = scenario.drone_count > 1 and scenario.limited_battery
    return several or not scenario.users_stay or gathers(scenario)


def _covers(world: World) -> dict[str, Any]:
    """Return the best cells for drones that hover, by QoE3 and, if it is the reward, by R1."""
    places, users = Spots(world), len(world.homes)
    best = cover(places)
    fair = fair_cover(places) if world.scenario.reward == Coverage() else None
    return {
        "cover": {
            "cells": [list(cell) for cell in best.cells],
            "users": best.users,
            "qoe3_percent": 100 * best.users / users,
            "at_most_percent": 100 * best.at_most / users,
            "exact": best.exact,
        },
        "instant_at_most_percent": 100 * instant_bound(places) / users,
        "fair_cover": None if fair is None else _fair(fair, users, world.scenario.drone_count),
    }


def _fair(fair: FairCover, users: int, drones: int) -> dict[str, Any]:
    return {
        "cells": [list(cell) for cell in fair.cells],
        "reward_sum": fair.score / users,
        "reward_per_step": fair.score / users / drones,
        "at_most_per_step": fair.at_most / users / drones,
        "qoe3_percent": 100 * fair.users / users,
        "least_qoe3_percent": None if fair.least is None else 100 * fair.least / users,
        "exact": fair.exact,
    }


def _discounted(world: World, process: DroneProcess) -> dict[str, Any]:
    """Return the best discounted return of one drone without a battery, and its policy."""
    gamma, three_d = world.scenario.learning.gamma, world.scenario.three_d
    values, commands = optimal_return(world, gamma)
    start = process.start[0]
    best = float(values[start if three_d else start[:2]])
    itinerary = without_battery(
        process, lambda node: world.actions[commands[node if three_d else node[:2]]]
    )
    return {
        "gamma": gamma,
        "return": best,
        "reward_per_step": (1 - gamma) * best,
        "policy": _plain(itinerary),
    }


class Solved(NamedTuple):
    """The best value of one measure per step, with bounds; ``beside`` is the other measure."""

    best: float
    low: float
    high: float
    beside: float
    itinerary: Itinerary


def _one_drone(world: World, process: DroneProcess) -> dict[str, Any]:
    """Return the best reward and the best QoE3 of one drone."""
    episode = world.scenario.episode
    limited = world.scenario.limited_battery
    if limited and not episode.carry_over and world.only_type.on_crash == "end_episode":
        raise UsageError(
            "drones.battery.on_crash: the best episode cannot be computed with 'end_episode', "
            "unless episode.carry_over is true"
        )
    graph = explore(process) if limited else unlimited(process)
    covered = graph.attached_us * (100.0 / (world.step_us * len(world.homes)))
    if episode.carry_over:
        earning = _long_run(process, graph, graph.reward, covered)
        covering = _long_run(process, graph, covered, graph.reward)
    else:
        earning = _episode(process, graph, (graph.reward, graph.forced), (covered, []))
        covering = _episode(process, graph, (covered, []), (graph.reward, graph.forced))
    return {
        "over": "long run" if episode.carry_over else "episode",
        "states": len(graph.states),
        "best_reward": {
            "reward_per_step": earning.best,
            "low": earning.low,
            "high": earning.high,
            "qoe3_percent": earning.beside,
            "policy": _plain(earning.itinerary),
        },
        "best_qoe3": {
            "qoe3_percent": covering.best,
            "low": covering.low,
            "high": covering.high,
            "reward_per_step": covering.beside,
            "policy": _plain(covering.itinerary),
        },
    }


def _long_run(process: DroneProcess, graph: Graph, goal: Array, other: Array) -> Solved:
    best = best_policy(graph, goal)
    beside = long_run(graph, other, best.choice)
    itinerary = in_the_long_run(process, graph, best.choice)
    return Solved(best.gain, best.low, best.high, beside, itinerary)


def _episode(process: DroneProcess, graph: Graph, goal: Brought, other: Brought) -> Solved:
    steps = process.world.scenario.episode.steps
    if steps * len(graph.states) > LARGEST:
        raise UsageError(
            f"episode.steps: {steps} steps by {len(graph.states)} states are more than {LARGEST}; "
            f"set episode.carry_over to solve the long run instead"
        )
    best = best_episode(graph, *goal, steps)
    beside = episode_total(graph, *other, best.choices)
    plan = in_an_episode(process, graph, best.choices, steps)
    return Solved(best.total / steps, best.low / steps, best.high / steps, beside / steps, plan)


def _plain(itinerary: Itinerary) -> dict[str, Any]:
    return {"steps": itinerary.rows, "again_from": itinerary.again_from}
