"""Larger studies: sweeps over scenarios, the table of the paper, and what is best possible."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from desim_uav.api import arguments
from desim_uav.api.found import Bounds, Optimum
from desim_uav.api.sources import each_of
from desim_uav.errors import Interrupted, UsageError, did_you_mean
from desim_uav.experiment import reproduce as paper
from desim_uav.experiment.bounds import bounds, work_of
from desim_uav.experiment.interrupt import at_once
from desim_uav.experiment.optimum import bounds_runs, optimum
from desim_uav.experiment.progress import progress as shown
from desim_uav.experiment.sweep.plan import Asked
from desim_uav.experiment.sweep.run import BACKENDS, sweep_to_folder
from desim_uav.experiment.sweep.table import Done
from desim_uav.policies.base import policy_name
from desim_uav.scenario.load import Overrides
from desim_uav.shipped import find_scenario
from desim_uav.typed import typed

PRESETS: dict[str, list[str | None]] = {
    "default": [None],
    "paper": ["paper"],
    "both": [None, "paper"],
}


ROUNDS_OF = "rounds"
"""The unit of the progress of bounds."""


@typed
def sweep(
    scenario: arguments.ScenarioLike,
    values: Overrides = (),
    *,
    out: str | Path,
    policies: str | Path | Sequence[str | Path] | None = None,
    train: bool = False,
    algorithms: str | Sequence[str] | None = None,
    seeds: int = 10,
    first_seed: int = 0,
    episodes: int = 20,
    warmup: int = 2,
    jobs: int | None = None,
    resume: bool = False,
    backend: str = "local",
    address: str | None = None,
    engine: str | None = None,
    progress: bool = True,
) -> Done:
    """Run policies, or train, in every combination of the values of some keys, on common seeds.

    This is ``desim-uav sweep``. Each job's row is kept in ``out`` as the job ends.

    Args:
        scenario: A shipped name, a file, its content, or a loaded scenario.
        values: For each key a list of values, such as ``{"drones.count": [2, 3, 4]}``, or texts as
            on the command line, such as ``["drones.count=2:4"]``.
        out: The folder of the sweep; its ``results`` are one Parquet dataset.
        policies: Names and files of policies to run, one or several. Default: the baseline, if
            nothing is trained.
        train: Train on each seed, too, and evaluate greedily.
        algorithms: What to train by. Default: the scenario's algorithm.
        seeds: How many seeds.
        first_seed: The first of them; the others follow it.
        episodes: Episodes that count, per job.
        warmup: Episodes before them that count in no measure.
        jobs: Jobs at a time. Default: 1, or all cores of a Ray cluster.
        resume: Run only what ``out`` has no row of.
        backend: ``"local"`` or ``"ray"``.
        address: Of the Ray cluster.
        engine: ``"des"`` or ``"batch"``. Default: the compiled engine, if it can run the scenario.
        progress: Show the progress.

    Raises:
        DesimError: one of its subclasses says what is wrong, before any job is run.
        Interrupted: Ctrl-C. Its ``result`` holds the jobs that had ended; they are kept.
    """
    given = locals()
    if backend not in BACKENDS:
        raise UsageError(
            f"--backend {backend}{did_you_mean(backend, BACKENDS)}; allowed: {', '.join(BACKENDS)}"
        )
    first_seed = arguments.whole("first_seed", first_seed, 0, arguments.LAST_FIRST_SEED)
    seeds = arguments.whole("seeds", seeds, 1, arguments.MOST_SEEDS)
    episodes = arguments.whole("episodes", episodes, 1, arguments.MOST_EPISODES)
    warmup = arguments.whole("warmup", warmup, 0, arguments.MOST_EPISODES)
    if jobs is not None:
        jobs = arguments.whole("jobs", jobs, 1, arguments.MOST_JOBS)
    asked = Asked(
        find_scenario(str(scenario)) if isinstance(scenario, str | Path) else scenario,
        values,
        None if policies is None else [_named(policy) for policy in each_of("policies", policies)],
        train,
        None if algorithms is None else each_of("algorithms", algorithms),
        range(first_seed, first_seed + seeds),
        episodes,
        warmup,
        engine,
    )
    done = sweep_to_folder(
        asked,
        Path(out),
        resume=resume,
        backend=backend,
        workers=jobs,
        address=address,
        command=arguments.command_of(sweep, given),
        show_progress=progress,
        say=arguments.warn,
    )
    if done.interrupted:
        raise Interrupted("interrupted; the jobs that had ended are kept", done)
    return done


def _named(policy: object) -> str:
    """Return a policy by the name that rows of a sweep have. Raises UsageError."""
    if not isinstance(policy, str | Path):
        raise UsageError(
            f"policies: {policy_name(policy)}: must be the name or the file of a policy, because "  # type: ignore[arg-type]
            "the rows of a sweep are known by it; compare takes objects"
        )
    return policy_name(policy)


@typed
def reproduce(
    cases: str = "1-9",
    *,
    seeds: int = 10,
    first_seed: int = 100,
    episodes: int | None = None,
    preset: str = "default",
    jobs: int = 1,
    out: str | Path = "runs/reproduce",
    engine: str = "batch",
    progress: bool = True,
) -> paper.Report:
    """Train and evaluate in the nine cases of the paper, and set them beside what it printed.

    This is ``desim-uav reproduce``. What was finished before in ``out`` is not done again.

    Args:
        cases: Which cases, such as ``"1-3,8"``.
        seeds: How many seeds.
        first_seed: The first of them; the others follow it. The defaults of learning were chosen on
            seeds below 100.
        episodes: Episodes to learn from. Default: the scenarios'.
        preset: ``"default"``, ``"paper"`` (as the paper's code trained) or ``"both"``.
        jobs: Jobs at a time, each in a process of its own.
        out: The folder for jobs, policies and tables.
        engine: ``"des"`` or ``"batch"``: their numbers are the same.
        progress: Show the progress.

    Raises:
        UsageError: an option is not one of those allowed, or ``out`` cannot be written.
    """
    given = locals()
    if preset not in PRESETS:
        raise UsageError(f"--preset {preset}: allowed: {', '.join(PRESETS)}")
    first_seed = arguments.whole("first_seed", first_seed, 0, arguments.LAST_FIRST_SEED)
    seeds = arguments.whole("seeds", seeds, 1, 10**4)
    jobs = arguments.whole("jobs", jobs, 1, arguments.MOST_JOBS)
    if episodes is not None:
        episodes = arguments.whole("episodes", episodes, 1, arguments.MOST_TRAINING)
    drawn = range(first_seed, first_seed + seeds)
    todo = paper.jobs(paper.numbers(cases), drawn, episodes, PRESETS[preset])
    with shown(progress, len(todo), "jobs", engine) as advance:
        rows = paper.run_jobs(todo, Path(out), jobs, advance, engine)
    return paper.report(rows, Path(out), " ".join(arguments.command_of(reproduce, given)))


@typed
def find_optimum(
    scenario: arguments.ScenarioLike,
    overrides: Overrides | None = None,
    *,
    seed: int | None = None,
    world_seed: int | None = None,
    seeds: int = 1,
    episodes: int = 20,
    progress: bool = False,
) -> Optimum:
    """Work out how well any policy could do in a scenario.

    This is ``desim-uav optimum``; the result has the entries that its ``--json`` prints.

    Args:
        scenario: A shipped name such as ``"case1"``, a file, its content, or a loaded scenario.
        overrides: Values for keys of it.
        seed: What everything random is drawn from. Default: the scenario's.
        world_seed: What the world alone is drawn from.
        seeds: On how many seeds runs are bounded, from the seed on.
        episodes: How many episodes a run has.
        progress: Show the progress.

    Raises:
        ScenarioError: the scenario is invalid, or its model is not the paper's: it has link
            classes, access points, an association by level or services that ask for a volume.
        UsageError: the scenario cannot be solved for another reason; the message names the key.
    """
    seeds = arguments.whole("seeds", seeds, 1, arguments.MOST_SEEDS)
    episodes = arguments.whole("episodes", episodes, 1, arguments.MOST_EPISODES)
    found = arguments.opened(scenario, overrides, seed, world_seed)
    total, show = work_of(seeds, episodes), progress and bounds_runs(found.scenario)
    with found.located(), shown(show, total, ROUNDS_OF) as advance:
        return Optimum(at_once(optimum, found.scenario, seeds, episodes, advance))


@typed
def find_bounds(
    scenario: arguments.ScenarioLike,
    overrides: Overrides | None = None,
    *,
    seeds: int | Sequence[int] = 10,
    first_seed: int = 0,
    episodes: int = 20,
    schedule: bool = True,
    progress: bool = False,
) -> Bounds:
    """Return upper bounds of QoE3 and QoE1 for all policies, in the runs of a comparison.

    A run has ``episodes`` episodes on the sample paths of its seed, as ``compare`` evaluates
    policies, after any warm-up. The bounds hold on each seed, and their means bound the means of
    any policy on the same seeds. The result has ``"means"`` and, for each seed, a row in
    ``"seeds"``, with ``qoe3_at_most_percent``, ``qoe1_at_most_percent`` (None if nothing is
    requested) and ``schedule_qoe3_percent``: what a schedule that knows the sample paths reaches.

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
    drawn = arguments.seeds_of(seeds, first_seed)
    episodes = arguments.whole("episodes", episodes, 1, arguments.MOST_EPISODES)
    found = arguments.opened(scenario, overrides)
    with found.located(), shown(progress, work_of(len(drawn), episodes), ROUNDS_OF) as advance:
        return Bounds(at_once(bounds, found.scenario, drawn, episodes, schedule, advance))
