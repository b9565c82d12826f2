"""Compare policies on common seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from desim_uav.api.arguments import (
    MOST_EPISODES,
    MOST_JOBS,
    ScenarioLike,
    opened,
    seeds_of,
    warn,
    whole,
)
from desim_uav.api.sources import InFolders, each_of, in_folders
from desim_uav.errors import Interrupted, UsageError
from desim_uav.experiment import compare as comparing
from desim_uav.experiment import compare_runs as finished
from desim_uav.experiment.compare import Comparison
from desim_uav.experiment.progress import progress as shown
from desim_uav.policies.base import PolicyLike
from desim_uav.run_folder import file_place
from desim_uav.scenario.draft import named_override
from desim_uav.scenario.load import Overrides, override_texts
from desim_uav.typed import typed

__all__ = ["Comparison", "compare", "compare_runs"]


@typed
def compare(
    scenario: ScenarioLike,
    overrides: Overrides | None = None,
    *,
    policies: Sequence[PolicyLike] | Mapping[str, PolicyLike],
    seeds: int | Sequence[int] = 10,
    first_seed: int = 0,
    world_seed: int | None = None,
    episodes: int = 20,
    warmup: int = 2,
    jobs: int = 1,
    against: str | None = None,
    out: str | Path | None = None,
    engine: str = "des",
    progress: bool = True,
) -> Comparison:
    """Compare policies on common seeds: means, 95 % intervals and paired differences.

    This is ``desim-uav compare SCENARIO``. On a seed all policies meet the same world, users, walks
    and requests. A seed draws the world too, unless there is a ``world_seed``.

    Args:
        scenario: A shipped name such as ``"case8"``, a file, its content, or a loaded scenario.
        overrides: Values for keys of it, such as ``{"users.count": 60}``.
        policies: As ``run`` takes them: a list, or a mapping that gives each a name.
        seeds: How many seeds, or which.
        first_seed: The first of so many; the others follow it.
        world_seed: What the world alone is drawn from. Default: the scenario's, or else each seed.
        episodes: Episodes that count, per policy and seed.
        warmup: Episodes before them that count in no measure.
        jobs: Runs at a time, each in a process of its own. A script that asks for more than one
            must begin its work under ``if __name__ == "__main__":``.
        against: The policy that the others are compared with. Default: the first.
        out: A CSV file for the values of each seed.
        engine: ``"des"`` (SimPy) or ``"batch"`` (compiled): their numbers are the same.
        progress: Show the progress, on a terminal or in a notebook.

    Raises:
        DesimError: one of its subclasses says what is wrong with the scenario, a policy or an
            option, before anything is run.
        Interrupted: Ctrl-C. Its ``result`` holds the runs that had ended before.
    """
    place = None if out is None else file_place(Path(out), "--out")
    episodes = whole("episodes", episodes, 1, MOST_EPISODES)
    warmup = whole("warmup", warmup, 0, MOST_EPISODES)
    jobs = whole("jobs", jobs, 1, MOST_JOBS)
    if any(override.startswith("seed=") for override in override_texts(overrides or ())):
        raise UsageError(
            f"{named_override('seed')}: each replication has its own; choose the first and "
            "their number"
        )
    found = opened(scenario, overrides, world_seed=world_seed)
    named = comparing.policies_by_name(policies)
    drawn = seeds_of(seeds, first_seed)
    for warning in comparing.out_of_place(found.scenario, named, drawn):
        warn(warning)
    with found.located():
        comparing.try_on(found.scenario, named, drawn, engine)
    with shown(progress, len(named) * len(drawn), "runs", engine) as advance, found.located():
        comparison = comparing.compare_policies(
            found.scenario,
            named,
            drawn,
            episodes,
            warmup,
            against=against,
            jobs=jobs,
            engine=engine,
            on_replication=advance,
        )
    if place is not None:
        comparison.save(place)
    return _whole(comparison)


@typed
def compare_runs(
    folders: Sequence[str | Path | InFolders],
    *,
    against: str | None = None,
    out: str | Path | None = None,
) -> Comparison:
    """Compare finished runs: each is the replication of its policy on its seed.

    This is ``desim-uav compare RUN…``.

    Args:
        folders: The run folders, or results of runs.
        against: The policy that the others are compared with. Default: that of the first run.
        out: A CSV file for the values of each seed.

    Raises:
        PolicyError: a folder cannot be read, or the runs are not of one scenario and one length.
        UsageError: ``against`` is not one of the policies, or ``out`` cannot be written.
    """
    place = None if out is None else file_place(Path(out), "--out")
    with in_folders("folders", each_of("folders", folders)) as sources:
        if not sources:
            raise UsageError("folders: give at least one run")
        comparison = finished.compare_runs([source.folder for source in sources], against)
    if place is not None:
        comparison.save(place)
    return comparison


def _whole(comparison: Comparison) -> Comparison:
    """Return it unless it was interrupted."""
    if comparison.interrupted:
        raise Interrupted(
            "interrupted; the runs that had ended are in the result of this error", comparison
        )
    return comparison
