"""Runs of the scenario files that stand beside these modules."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from desim_uav.experiment.command import prepare
from desim_uav.experiment.papers.row import FigureRow
from desim_uav.experiment.run import Results, run
from desim_uav.policies.base import PolicyLike
from desim_uav.scenario.load import load
from desim_uav.scenario.schema import Scenario

HERE = Path(__file__).parent
STANDARD_ERRORS = 4.0
"""The limit of estimates, in standard errors."""


def scenario_of(name: str, changes: Mapping[str, Any] | None = None) -> Scenario:
    """Return the scenario of a file of this folder, with some keys changed."""
    return load(HERE / name, {} if changes is None else changes)


def flown(scenario: Scenario, policy: PolicyLike, seed: int = 0, episodes: int = 1) -> Results:
    """Run episodes on a seed in the compiled engine and return their tables."""
    prepared = prepare(scenario.model_copy(update={"seed": seed}), policy, "batch")
    world, name = prepared.world, prepared.name
    return run(world, prepared.policy, name, seed, episodes, engine="batch")


def estimated(
    figure: str, where: str, theirs: float, values: Iterable[float], digits: int
) -> FigureRow:
    """Return a row of a mean of independent values; its limit is 4 of its standard errors."""
    values = list(values)
    count = len(values)
    mean = math.fsum(values) / count
    variance = math.fsum((value - mean) ** 2 for value in values) / (count - 1)
    return FigureRow(
        figure, where, theirs, mean, STANDARD_ERRORS * math.sqrt(variance / count), digits
    )
