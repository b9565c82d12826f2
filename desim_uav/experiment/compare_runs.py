"""Finished runs compared, each as the replication of its policy on its seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from desim_uav.errors import PolicyError
from desim_uav.experiment.command import read_summary
from desim_uav.experiment.compare import Comparison, Replication, reference_of, world_seed_of
from desim_uav.experiment.evaluate import replicated
from desim_uav.measures.known import chosen, compared_in
from desim_uav.parquet_file import no_such, read_table
from desim_uav.records import EPISODES
from desim_uav.report.manifest import read_manifest
from desim_uav.run_folder import read_scenario
from desim_uav.scenario.load import scenario_hash, seedless, to_plain
from desim_uav.scenario.schema import Scenario


def compare_runs(
    folders: Sequence[Path],
    against: str | None = None,
    measures: Sequence[str] | None = None,
) -> Comparison:
    """Compare finished runs; each is the replication of its policy on its seed.

    ``measures`` are names of measures, by default those that comparisons have in the scenario.
    Raises PolicyError if a folder cannot be read, if the runs differ in scenario or length, or if
    two runs have the same policy and seed, and UsageError for a measure that they do not have.
    """
    runs = [_read(folder, measures) for folder in folders]
    first = runs[0]
    of_seed: dict[tuple[str, int], Path] = {}
    for run in runs:
        _fits(run, first)
        policy, seed = run.replication.policy, run.replication.seed
        if (policy, seed) in of_seed:
            raise PolicyError(
                f"{run.folder}: {policy} on seed {seed} is given twice; "
                f"{of_seed[policy, seed]} has the same policy and seed"
            )
        of_seed[policy, seed] = run.folder
    policies = list(dict.fromkeys(policy for policy, _ in of_seed))
    return Comparison(
        first.scenario.name,
        first.episodes,
        first.warmup,
        policies,
        reference_of(policies, against),
        [run.replication for run in runs],
    )


@dataclass(frozen=True)
class _Run:
    """A finished run; ``scenario`` has no seeds."""

    folder: Path
    scenario: Scenario
    as_run: bool
    """Whether the files and components of its scenario are what they were in the run."""
    episodes: int
    warmup: int
    replication: Replication


def _read(folder: Path, measures: Sequence[str] | None) -> _Run:
    if not folder.is_dir():
        raise PolicyError(
            f"{no_such(folder, 'run folder')} (to compare policies in a scenario, use --policies)"
        )
    summary, _ = read_summary(folder)
    numbers = read_table(folder, "episodes", EPISODES)["episode"]
    scenario = read_scenario(folder)
    if not summary["episodes"]:
        raise PolicyError(f"{folder}: the run has no counted episode")
    policy, seed = summary["policy"], summary["seed"]
    names = compared_in(scenario) if measures is None else chosen(measures, scenario)
    return _Run(
        folder,
        seedless(scenario),
        scenario_hash(scenario) == read_manifest(folder)["scenario_hash"],
        summary["episodes"],
        int((numbers < 0).sum()),
        Replication(
            *(policy, seed, world_seed_of(scenario, seed)),
            replicated(summary, scenario, names),
        ),
    )


def _fits(run: _Run, first: _Run) -> None:
    if scenario_hash(run.scenario) != scenario_hash(first.scenario):
        where = _difference(to_plain(run.scenario), to_plain(first.scenario)) or "a file it names"
        raise PolicyError(f"{run.folder}: its scenario is not that of {first.folder}: {where}")
    for one in (run, first):
        if not one.as_run:
            raise PolicyError(
                f"{one.folder}: a file or component of its scenario has changed since the run"
            )
    if (run.episodes, run.warmup) != (first.episodes, first.warmup):
        raise PolicyError(
            f"{run.folder}: {run.episodes} episode(s) after {run.warmup} of warm-up, "
            f"but {first.folder}: {first.episodes} after {first.warmup}"
        )


def _difference(one: object, other: object, path: tuple[str, ...] = ()) -> str | None:
    """Return the first key other than ``name`` in which two scenarios differ, with both values."""
    if isinstance(one, dict) and isinstance(other, dict):
        for key in [*one, *(key for key in other if key not in one)]:
            difference = _difference(one.get(key), other.get(key), (*path, key))
            if difference and (*path, key) != ("name",):
                return difference
        return None
    return None if one == other else f"{'.'.join(path)} is {one}, not {other}"
