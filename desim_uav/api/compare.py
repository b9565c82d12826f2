"""Compare policies on common seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from desim_uav.api.parameters import (
    MOST_SEEDS,
    EngineName,
    Episodes,
    FirstSeed,
    Jobs,
    Seed,
    Warmup,
    verb,
)
from desim_uav.errors import Interrupted, UsageError
from desim_uav.typed import Within

if TYPE_CHECKING:
    from desim_uav.api.kinds import InFolders, Overrides, PolicyLike, ScenarioLike
    from desim_uav.experiment.compare import Comparison


@verb
def compare(
    scenario: ScenarioLike,
    overrides: Overrides | None = None,
    *,
    policies: Sequence[PolicyLike] | Mapping[str, PolicyLike],
    seeds: Annotated[int | Sequence[int], Within(1, MOST_SEEDS)] = 10,
    first_seed: FirstSeed = 0,
    world_seed: Seed = None,
    episodes: Episodes = 20,
    warmup: Warmup = 2,
    jobs: Jobs = 1,
    against: str | None = None,
    measure: str | Sequence[str] | None = None,
    out: str | Path | None = None,
    engine: EngineName = "auto",
    progress: bool = True,
) -> Comparison:
    """Compare policies on common seeds: means, 95 % intervals and paired differences.

    In Python, this does what ``desim-uav compare SCENARIO`` does. On a seed all policies meet the
    same world, users, walks and requests. A seed draws the world too, unless there is a
    ``world_seed``.

    Args:
        scenario: A shipped name such as ``"case8"``, a file, its content, or a loaded scenario.
        overrides: Set a key of the scenario, as in users.count=60. In a terminal, -S may be
            repeated. In Python, it may also be a mapping, such as ``{"users.count": 60}``.
        policies: The policies to run in the scenario; see `run --policy`. In a terminal, they are
            separated by commas. In Python, it is a list, or a mapping that gives each a name.
        seeds: The number of seeds. On a seed all policies meet the same users and requests. In
            Python, it may also be a list of seeds.
        first_seed: The first seed; the others follow it.
        world_seed: The seed of the world alone: buildings, homes of users, clusters. By default it
            is the scenario's world_seed, or else the seed.
        episodes: The number of episodes that count, per policy and seed.
        warmup: The number of warm-up episodes before them, which count in no measure.
        jobs: The number of runs at a time, each in a process of its own. In Python, a script that
            asks for more than one must begin its work under ``if __name__ == "__main__":``.
        against: The policy that the others are compared with. By default it is the first.
        measure: A measure to compare, such as age_s; it can be given several times. By default
            these are those that the services of the scenario have.
        out: A CSV file for the values of each policy and seed.
        engine: The engine: des (SimPy, easy to read) or batch (compiled, fast). Their numbers are
            the same. With auto, SimPy begins if batch has yet to be compiled, which another
            process does meanwhile, and batch takes over at a later episode.
        progress: Show the progress, on a terminal or in a notebook.

    Raises:
        DesimError: one of its subclasses says what is wrong with the scenario, a policy or an
            option, before anything is run.
        Interrupted: Ctrl-C. Its ``result`` holds the runs that had ended before.
    """
    from desim_uav.api.arguments import opened, seeds_of, warn
    from desim_uav.disk import file_place
    from desim_uav.experiment import compare as comparing
    from desim_uav.experiment.progress import progress as shown
    from desim_uav.measures.known import chosen, names_of
    from desim_uav.scenario.draft import named_override
    from desim_uav.scenario.load import override_texts

    place = None if out is None else file_place(Path(out), "--out", [".csv"])
    if any(override.startswith("seed=") for override in override_texts(overrides or ())):
        raise UsageError(
            f"{named_override('seed')}: each replication has its own; choose the first and "
            "their number"
        )
    source = opened(scenario, overrides, world_seed=world_seed)
    measures = chosen(names_of(measure), source.scenario) or None
    by_name = comparing.policies_by_name(policies)
    all_seeds = seeds_of(seeds, first_seed)
    for warning in comparing.out_of_place(source.scenario, by_name, all_seeds):
        warn(warning)
    with source.located():
        comparing.try_on(source.scenario, by_name, all_seeds, engine)
    with (
        shown(progress, len(by_name) * len(all_seeds), "runs", engine) as advance,
        source.located(),
    ):
        comparison = comparing.compare_policies(
            source.scenario,
            by_name,
            all_seeds,
            episodes,
            warmup,
            against=against,
            jobs=jobs,
            engine=engine,
            measures=measures,
            on_replication=advance,
        )
    if place is not None:
        comparison.save(place)
    return _whole(comparison)


@verb
def compare_runs(
    folders: Sequence[str | Path | InFolders],
    *,
    against: str | None = None,
    measure: str | Sequence[str] | None = None,
    out: str | Path | None = None,
) -> Comparison:
    """Compare finished runs: each is the replication of its policy on its seed.

    In Python, this does what ``desim-uav compare RUN…`` does.

    Args:
        folders: The folders of finished runs; in a terminal also one scenario, to run --policies
            in. In Python, results of runs may be among them.
        against: The policy that the others are compared with. Default: that of the first run.
        measure: A measure to compare, or several. Default: those that the services have.
        out: A CSV file for the values of each seed.

    Raises:
        PolicyError: a folder cannot be read, or the runs are not of one scenario and one length.
        UsageError: ``against`` is not one of the policies, the runs do not have a measure, or
            ``out`` cannot be written.
    """
    from desim_uav.api.sources import each_of, in_folders
    from desim_uav.disk import file_place
    from desim_uav.experiment import compare_runs as finished
    from desim_uav.measures.known import names_of

    place = None if out is None else file_place(Path(out), "--out", [".csv"])
    with in_folders("folders", each_of("folders", folders)) as sources:
        if not sources:
            raise UsageError("folders: give at least one run")
        paths = [source.folder for source in sources]
        names = names_of(measure) or None
        comparison = finished.compare_runs(paths, against, names)
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
