"""A best policy as a list of steps, from the drone's start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.rules import Action
from desim_uav.optimum.gain import path, renewal_after
from desim_uav.optimum.graph import Graph
from desim_uav.optimum.lone_drone import LoneState, LoneStep
from desim_uav.optimum.process import DroneProcess


@dataclass(frozen=True)
class Itinerary:
    """One row per step; the rows from ``again_from`` on repeat forever, unless it is None."""

    rows: list[dict[str, Any]]
    again_from: int | None


def in_the_long_run(process: DroneProcess, graph: Graph, choice: NDArray[np.int64]) -> Itinerary:
    """Return the steps until they repeat, or until a crash with a random or no replacement."""
    rows: list[dict[str, Any]] = []
    row_of: dict[int | None, int] = {}
    renewal: int | None = 0
    while renewal not in row_of and renewal is not None:
        row_of[renewal] = len(rows)
        for number in path(graph, choice, renewal):
            state = graph.states[number]
            if state[1] < 0:
                return Itinerary(rows, None)
            rows += _decision(process, state, graph.actions[choice[number]])
            renewal = renewal_after(graph, choice, number)
    return Itinerary(rows, row_of.get(renewal))


def in_an_episode(
    process: DroneProcess, graph: Graph, choices: NDArray[np.int64], steps: int
) -> Itinerary:
    """Return the steps of an episode, or until a crash with a random or no replacement."""
    rows: list[dict[str, Any]] = []
    number = int(graph.renewals[0])
    while len(rows) < steps and graph.states[number][1] >= 0:
        column = choices[steps - len(rows), number]
        rows += _decision(process, graph.states[number], graph.actions[column])
        number = int(graph.target[number, column])
        if number >= len(graph.states):
            renewal = number - len(graph.states)
            if renewal == len(graph.renewals):
                break
            number = int(graph.renewals[renewal])
    return Itinerary(rows[:steps], None)


def without_battery(
    process: DroneProcess, command: Callable[[tuple[int, int, int]], Action]
) -> Itinerary:
    """Return the steps until they repeat."""
    rows: list[dict[str, Any]] = []
    state, row_of = process.start, {}
    while state not in row_of:
        row_of[state] = len(rows)
        action = command(state[0])
        rows += _decision(process, state, action)
        state = (process.neighbour(state[0], action), 0)
    return Itinerary(rows, row_of[state])


def _decision(process: DroneProcess, state: LoneState, action: Action) -> list[dict[str, Any]]:
    """Return the rows of the steps after a decision; the first one has the action."""
    steps = process.outcome(state, action).steps
    return [_row(action if k == 0 else None, step) for k, step in enumerate(steps)]


def _row(action: Action | None, step: LoneStep) -> dict[str, Any]:
    observed = step.observation
    return {
        "action": None if action is None else action.name.lower(),
        "cell": list(observed.cell),
        "level": observed.level,
        "mode": observed.mode.name.lower(),
        "battery_s": observed.battery_s,
        "attached_users": observed.attached_users,
        "reward": step.reward,
    }
