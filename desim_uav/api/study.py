"""Larger studies: sweeps over scenarios, the table of the paper, and what is best possible."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from desim_uav.api.parameters import (
    EngineName,
    Episodes,
    FirstSeed,
    Jobs,
    Seed,
    Seeds,
    TrainingEpisodes,
    Warmup,
    verb,
)
from desim_uav.errors import Interrupted, UsageError
from desim_uav.typed import OneOf, Within

if TYPE_CHECKING:
    from desim_uav.api.found import Bounds, Optimum
    from desim_uav.api.kinds import Overrides, ScenarioLike
    from desim_uav.experiment.reproduce import Report
    from desim_uav.experiment.sweep.table import Done

PRESETS: dict[str, list[str | None]] = {
    "default": [None],
    "paper": ["paper"],
    "both": [None, "paper"],
}
ROUNDS_OF = "rounds"
"""The unit of the progress of bounds."""

FewSeeds = Annotated[int, Within(1, 10**4)]


def _backends() -> Iterable[str]:
    from desim_uav.experiment.sweep.run import BACKENDS

    return BACKENDS


@verb
def sweep(
    scenario: ScenarioLike,
    values: Overrides = (),
    *,
    out: str | Path,
    policies: str | Path | Sequence[str | Path] | None = None,
    train: bool = False,
    algorithms: str | Sequence[str] | None = None,
    seeds: Seeds = 10,
    first_seed: FirstSeed = 0,
    episodes: Episodes = 20,
    warmup: Warmup = 2,
    jobs: Jobs | None = None,
    resume: bool = False,
    backend: Annotated[str, OneOf(_backends)] = "local",
    address: str | None = None,
    measure: str | Sequence[str] | None = None,
    engine: EngineName = "auto",
    progress: bool = True,
) -> Done:
    """Run or train policies for every combination of values of some keys, on common seeds.

    In Python, this does what ``desim-uav sweep`` does. Each job's row is kept in ``out`` as the job
    ends.

    Args:
        scenario: The name of a shipped scenario, such as case8, or a scenario file (YAML). In
            Python, it may also be the content of one, or a loaded scenario.
        values: The values of a key of the scenario: a,b,c or first:last or first:last:step. If
            several keys are given, every combination of values is run. In a terminal, -S may be
            repeated. In Python, it may also be a mapping, such as
            ``{"drones.count": [2, 3, 4]}``, or a list, such as ``["drones.count=2:4"]``.
        out: The folder of the sweep. Its results/ is one Parquet dataset with a row per job.
        policies: The policies to run, by their names or files; see `run --policy`. By default it is
            the baseline, unless policies are trained. In a terminal, they are separated by commas.
        train: Train on each seed as well, and evaluate the learned policies.
        algorithms: The algorithms to train by. By default it is the scenario's. In a terminal, they
            are separated by commas.
        seeds: The number of seeds. On a seed all policies meet the same users and requests.
        first_seed: The first seed; the others follow it.
        episodes: The number of episodes that count, per policy and seed.
        warmup: The number of warm-up episodes before them, which count in no measure.
        jobs: The number of jobs at a time. By default it is 1, or all cores of a Ray cluster.
        resume: Continue the sweep of the folder: run only the jobs without a row in results/.
        backend: Where the jobs run: in processes of this machine, or in a Ray cluster.
        address: The address of the Ray cluster: auto, or HOST:PORT. By default a cluster is
            started on this machine.
        measure: A measure of the table at the end, such as age_s; it can be given several times.
            By default it has the most important ones. results/ has them and those of `compare`.
        engine: The engine: des (SimPy, easy to read) or batch (compiled, fast). Their numbers are
            the same. With auto, SimPy begins if batch has yet to be compiled, which another
            process does meanwhile, and batch takes over at a later episode. What is trained waits
            for batch.
        progress: Show the progress.

    Raises:
        DesimError: one of its subclasses says what is wrong, before any job is run.
        Interrupted: Ctrl-C. Its ``result`` holds the jobs that had ended; they are kept.
    """
    parameters = locals()
    from desim_uav.api import arguments
    from desim_uav.api.sources import each_of
    from desim_uav.experiment.sweep.plan import SweepPlan
    from desim_uav.experiment.sweep.run import sweep_to_folder
    from desim_uav.measures.known import names_of
    from desim_uav.shipped import find_scenario

    plan = SweepPlan(
        find_scenario(str(scenario)) if isinstance(scenario, str | Path) else scenario,
        values,
        None if policies is None else [_named(policy) for policy in each_of("policies", policies)],
        train,
        None if algorithms is None else each_of("algorithms", algorithms),
        range(first_seed, first_seed + seeds),
        episodes,
        warmup,
        engine,
        names_of(measure),
    )
    outcome = sweep_to_folder(
        plan,
        Path(out),
        resume=resume,
        backend=backend,
        workers=jobs,
        address=address,
        command=arguments.command_of(sweep, parameters),
        show_progress=progress,
        say=arguments.warn,
    )
    if outcome.interrupted:
        raise Interrupted("interrupted; the jobs that had ended are kept", outcome)
    return outcome


def _named(policy: object) -> str:
    """Return a policy by the name that rows of a sweep have. Raises UsageError."""
    from desim_uav.policies.base import policy_name

    if not isinstance(policy, str | Path):
        raise UsageError(
            f"policies: {policy_name(policy)}: must be the name or the file of a policy, because "  # type: ignore[arg-type]
            "the rows of a sweep are known by it; compare takes objects"
        )
    return policy_name(policy)


@verb
def reproduce(
    cases: str = "1-9",
    *,
    seeds: FewSeeds = 10,
    first_seed: FirstSeed = 100,
    episodes: TrainingEpisodes | None = None,
    preset: Annotated[str, OneOf(lambda: PRESETS)] = "default",
    jobs: Jobs = 1,
    out: str | Path = "runs/reproduce",
    engine: EngineName = "auto",
    progress: bool = True,
) -> Report:
    """Train and evaluate in the paper's nine cases, and compare with the numbers in the paper.

    In Python, this does what ``desim-uav reproduce`` does.

    Args:
        cases: The cases of the paper, such as 1-3,8.
        seeds: The number of seeds.
        first_seed: The first seed; the others follow it. The defaults of learning were chosen on
            seeds below 100.
        episodes: The number of episodes to learn from. By default it is the scenario's.
        preset: How to train: with our defaults, as the paper's code did, or both ways.
        jobs: The number of jobs at a time, each in a process of its own.
        out: The folder for jobs, policies and tables. Jobs that it holds are not run again.
        engine: The engine: des (SimPy, easy to read) or batch (compiled, fast). Their numbers are
            the same. With auto, it is batch.
        progress: Show the progress.

    Raises:
        UsageError: an option is not one of those allowed, or ``out`` cannot be written.
    """
    parameters = locals()
    from desim_uav.api import arguments
    from desim_uav.experiment import reproduce as paper
    from desim_uav.experiment.progress import progress as shown

    all_seeds = range(first_seed, first_seed + seeds)
    todo = paper.jobs(paper.numbers(cases), all_seeds, episodes, PRESETS[preset])
    with shown(progress, len(todo), "jobs", engine) as advance:
        rows = paper.run_jobs(todo, Path(out), jobs, advance, engine)
    return paper.report(rows, Path(out), " ".join(arguments.command_of(reproduce, parameters)))


@verb
def find_optimum(
    scenario: ScenarioLike,
    overrides: Overrides | None = None,
    *,
    seed: Seed = None,
    world_seed: Seed = None,
    seeds: FewSeeds = 1,
    episodes: Episodes = 20,
    progress: bool = False,
) -> Optimum:
    """Work out how well any policy could do in a scenario.

    In Python, this does what ``desim-uav optimum`` does; the result has the entries that its
    ``--json`` prints.

    Args:
        scenario: The name of a shipped scenario, such as case8, or a scenario file (YAML). In
            Python, it may also be the content of one, or a loaded scenario.
        overrides: Set a key of the scenario, as in users.count=60. In a terminal, -S may be
            repeated. In Python, it may also be a mapping, such as ``{"users.count": 60}``.
        seed: The seed of all random draws. By default it is the scenario's.
        world_seed: The seed of the world alone: buildings, homes of users, clusters. By default it
            is the scenario's world_seed, or else the seed.
        seeds: The number of seeds on which runs are bounded, from the seed on.
        episodes: The number of episodes of a run.
        progress: Show the progress.

    Raises:
        ScenarioError: the scenario is invalid, or its model is not the paper's: it has link
            classes, access points, an association by level or services that ask for a volume. With
            sensors, other keys can prevent a bound of the mean age; the message names them.
        UsageError: the scenario cannot be solved for another reason; the message names the key.
    """
    from desim_uav.api import arguments
    from desim_uav.api.found import Optimum
    from desim_uav.experiment.bounds import work_of
    from desim_uav.experiment.interrupt import at_once
    from desim_uav.experiment.optimum import bounds_runs, optimum
    from desim_uav.experiment.progress import progress as shown

    source = arguments.opened(scenario, overrides, seed, world_seed)
    total, show = work_of(source.scenario, seeds, episodes), bounds_runs(source.scenario)
    with source.located(), shown(progress and show, total, ROUNDS_OF) as advance:
        return Optimum(at_once(optimum, source.scenario, seeds, episodes, advance))


@verb
def find_bounds(
    scenario: ScenarioLike,
    overrides: Overrides | None = None,
    *,
    seeds: int | Sequence[int] = 10,
    first_seed: FirstSeed = 0,
    episodes: Episodes = 20,
    schedule: bool = True,
    progress: bool = False,
) -> Bounds:
    """Return upper bounds of QoE3 and QoE1 for all policies, in the runs of a comparison.

    A run has ``episodes`` episodes on the sample paths of its seed, as ``compare`` evaluates
    policies, after any warm-up. The bounds hold on each seed, and their means bound the means of
    any policy on the same seeds. The result has ``"means"`` and, for each seed, a row in
    ``"seeds"``, with ``qoe3_at_most_percent``, ``crash_free_at_most_percent`` (the bound of QoE3
    for policies whose drones do not crash), ``qoe1_at_most_percent`` (None if nothing is requested)
    and ``schedule_qoe3_percent``: what a schedule without crashes that knows the sample paths
    reaches (None if there is none). Where sensors gather data, the rows have ``age_at_least_s``
    instead: no policy has a lower mean age.

    Args:
        scenario: A shipped name such as ``"case8"``, a file, its content, or a loaded scenario.
        overrides: Values for keys of it.
        seeds: How many seeds, or which.
        first_seed: The first of them; the others follow it.
        episodes: How many episodes a run has.
        schedule: Look for a good schedule too, which tells how close the bound of QoE3 is.
        progress: Show the progress.

    Raises:
        ScenarioError: the scenario is invalid, or its model is not the paper's.
        UsageError: runs cannot be bounded for another reason; the message names the key.
    """
    from desim_uav.api import arguments
    from desim_uav.api.found import Bounds
    from desim_uav.experiment.bounds import bounds, work_of
    from desim_uav.experiment.interrupt import at_once
    from desim_uav.experiment.progress import progress as shown

    all_seeds = arguments.seeds_of(seeds, first_seed)
    source = arguments.opened(scenario, overrides)
    total = work_of(source.scenario, len(all_seeds), episodes)
    with source.located(), shown(progress, total, ROUNDS_OF) as advance:
        return Bounds(at_once(bounds, source.scenario, all_seeds, episodes, schedule, advance))
