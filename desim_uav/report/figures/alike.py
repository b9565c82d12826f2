"""Runs that a figure shows as one, because they differ only in their seeds."""

from __future__ import annotations

from collections.abc import Sequence

from desim_uav.errors import PolicyError
from desim_uav.report.figures.style import short
from desim_uav.report.run import Run
from desim_uav.scenario.load import seedless

MOST_SERIES = 12
"""The largest number of series in a figure, by services and runs."""


def alike_in_all_but_seeds(runs: Sequence[Run]) -> list[tuple[str, list[Run]]]:
    """Return groups of runs with the same policy whose scenarios differ at most in seeds.

    Each has the name of its policy or, if policies have several groups, of its first folder. Groups
    are in the order of their first runs. Raises PolicyError if two runs of a group have the same
    seed.
    """
    groups: list[list[Run]] = []
    for run in runs:
        same = next((group for group in groups if _differ_in_seed(run, group[0])), None)
        if same is None:
            groups.append([run])
            continue
        for other in same:
            if other.scenario.seed == run.scenario.seed:
                raise PolicyError(
                    f"{run.folder}: {run.manifest['policy']} on seed {run.scenario.seed} is given "
                    f"twice; {other.folder} has the same scenario, policy and seed"
                )
        same.append(run)
    names = [str(group[0].manifest["policy"]) for group in groups]
    if len(set(names)) < len(names):
        names = [str(group[0].folder) for group in groups]
    return [(short(name), group) for name, group in zip(names, groups, strict=True)]


def _differ_in_seed(one: Run, other: Run) -> bool:
    """Return whether two runs have the same policy, and scenarios that differ in seeds at most."""
    same_policy = one.manifest["policy"] == other.manifest["policy"]
    return same_policy and seedless(one.scenario) == seedless(other.scenario)
