"""Run a policy in a scenario."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from desim_uav.api.parameters import (
    MOST_SEEDS,
    EngineName,
    Episodes,
    FirstSeed,
    RunName,
    Seed,
    Warmup,
    verb,
)
from desim_uav.errors import UsageError
from desim_uav.typed import Within

if TYPE_CHECKING:
    from desim_uav.api.kept import Kept
    from desim_uav.api.kinds import Overrides, PolicyLike, ScenarioLike
    from desim_uav.api.run_result import RunResult


@verb
def run(
    scenario: ScenarioLike,
    overrides: Overrides | None = None,
    *,
    policy: PolicyLike = "baseline",
    seed: Seed = None,
    seeds: Annotated[int | Sequence[int] | None, Within(1, MOST_SEEDS)] = None,
    first_seed: FirstSeed = 0,
    world_seed: Seed = None,
    episodes: Episodes = 1,
    warmup: Warmup = 0,
    events: bool = False,
    out: str | Path | bool | None = None,
    name: RunName = None,
    engine: EngineName = "auto",
    resume: bool = False,
    progress: bool = True,
) -> RunResult:
    """Run a policy in a scenario, log every request, and measure the quality of experience.

    The log is a folder of Parquet tables. QoE1 is the share of the requested time that was served,
    QoE2 the time for which a request was open but not served, in steps, and QoE3 the share of
    users that were attached to a drone, averaged over time.

    In Python, this does what ``desim-uav run`` does; the result holds the tables and the measures.
    Without ``out`` everything stays in memory and no file is written.

    Args:
        scenario: The name of a shipped scenario, such as case8, or a scenario file (YAML). In
            Python, it may also be the content of one, or a loaded scenario.
        overrides: Set a key of the scenario, as in users.count=60. In a terminal, -S may be
            repeated. In Python, it may also be a mapping, such as ``{"users.count": 60}``.
        policy: The policy: baseline, tour, random, hover, a trained one (case8.npz), a planner
            (greedy, rollout:BASE, clairvoyant), commands from a file (script:FILE.csv), a network
            (sb3:FILE.zip, rllib:DIR), or a class of your own ("package.module:Class"). In Python,
            it may also be a policy object or class, the result of ``train``, or a plain function
            ``f(observation, mask) -> action``.
        seed: The seed of all random draws. By default it is the scenario's.
        seeds: How many seeds to run on, or which; each draws a world of its own, unless there is a
            ``world_seed``. The tables then have a column ``seed``.
        first_seed: The first of so many ``seeds``; the others follow it.
        world_seed: The seed of the world alone: buildings, homes of users, clusters. By default it
            is the scenario's world_seed, or else the seed. In Python, a warning says if a policy
            was learned in another world.
        episodes: The number of episodes that count, per policy and seed.
        warmup: The number of warm-up episodes before them, which count in no measure.
        events: Keep the event log and the drones' flights, too.
        out: The folder to write the run to. It must be new or empty. By default it is
            runs/<scenario>-<policy>-s<seed>, and the keys that were set. In Python, the run is
            written as it goes, so that a long run needs little memory, if this is a folder, or True
            for the one that the command line would choose; with ``seeds``, a folder per seed is
            made in it.
        name: A label of the run, which its manifest, ls, reports and replays show.
        engine: The engine: des (SimPy, easy to read) or batch (compiled, fast). Their numbers are
            the same. With auto, SimPy begins if batch has yet to be compiled, which another
            process does meanwhile, and batch takes over at a later episode.
        resume: Continue the interrupted run in --out, or the last one of this name in runs/. The
            result is that of an uninterrupted run. In Python, ``out`` says which run is continued,
            as well if it had fewer episodes; True means the last interrupted run of this name. With
            ``seeds``, seeds that had not begun are begun.
        progress: Show the progress, on a terminal or in a notebook.

    Raises:
        DesimError: one of its subclasses says what is wrong with the scenario, the policy or an
            option, or that a run cannot be continued, before anything is run.
        Interrupted: Ctrl-C. Its ``result`` holds what had ended before.
    """
    parameters = locals()
    from desim_uav.api import arguments
    from desim_uav.api.run_result import RunResult
    from desim_uav.api.running import apart, interrupted, place_of, run_one
    from desim_uav.experiment import command
    from desim_uav.experiment.progress import progress as shown

    if seeds is not None and seed is not None:
        raise UsageError("seed and seeds exclude each other")
    source = arguments.opened(scenario, overrides, seed, world_seed)
    all_seeds = [source.scenario.seed] if seeds is None else arguments.seeds_of(seeds, first_seed)
    scenarios = [source.scenario.model_copy(update={"seed": one}) for one in all_seeds]
    with source.located():
        first = command.prepare(scenarios[0], policy, engine, events)
    several, set_ = seeds is not None, source.settings
    places = [place_of(one, policy, out, several, resume, set_) for one in scenarios]
    for notice in filter(None, [first.notice or apart(first, scenarios)]):
        arguments.warn(notice)
    words = arguments.command_of(run, parameters)
    how = command.How(episodes, warmup, events, engine, words, set_, name)
    runs: list[Kept] = []
    with shown(progress, (warmup + episodes) * len(all_seeds), engine=engine) as advance:
        for one, place in zip(scenarios, places, strict=True):
            try:
                with source.located():
                    prepared = command.prepare(one, policy, engine, events) if runs else first
                    runs.append(run_one(prepared, how, place, advance))
            except KeyboardInterrupt:
                if not runs:
                    raise
                raise interrupted(runs, len(all_seeds)) from None
            if runs[-1].manifest["interrupted"]:
                raise interrupted(runs, len(all_seeds))
    return RunResult(runs, several)


@verb
def read_run(folder: str | Path) -> RunResult:
    """Read the folder of a finished run; its tables are read when they are asked for.

    Raises PolicyError, naming the file, for a folder that is unreadable, has changed since it was
    written, or is not a run's.
    """
    from desim_uav.api.run_result import of_folder

    return of_folder(folder)
