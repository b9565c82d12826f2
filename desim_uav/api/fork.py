"""What would have happened: a run, and the same run in which another policy goes on."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from desim_uav.api.parameters import (
    MOST_EPISODES,
    EngineName,
    Episodes,
    RunName,
    Seed,
    Warmup,
    verb,
)
from desim_uav.errors import UsageError

if TYPE_CHECKING:
    from desim_uav.api.branches import Counterfactual
    from desim_uav.api.kinds import Overrides, PolicyLike, ScenarioLike


@verb
def counterfactual(
    scenario: ScenarioLike,
    overrides: Overrides | None = None,
    *,
    policy: PolicyLike = "baseline",
    to: PolicyLike,
    fork: str | tuple[int, int],
    seed: Seed = None,
    world_seed: Seed = None,
    episodes: Episodes = 1,
    warmup: Warmup = 0,
    out: str | Path | bool | None = None,
    name: RunName = None,
    engine: EngineName = "auto",
    progress: bool = True,
) -> Counterfactual:
    """Run a policy, and let another one go on from one of its decision epochs: what if?

    In Python, this does what ``desim-uav run … --fork EPISODE:STEP --to POLICY`` does. Without
    ``out`` both branches stay in memory. Events are kept, so that the replay shows both.

    Args:
        scenario: As in ``run``; so are the other arguments that are not listed here.
        overrides: Values for keys of it.
        policy: The policy of the original run.
        to: The policy that goes on from --fork; see --policy. In Python, it goes on from ``fork``,
            and begins there, with streams of its own.
        fork: Also play what would have happened if the policy --to had gone on from this step (both
            numbers from 0), and compare both. Events are kept. In Python, it is the episode and the
            step, ``(0, 12)`` or ``"0:12"``, at whose decision epoch the branches part.
        seed: What everything random is drawn from.
        world_seed: What the world alone is drawn from.
        episodes: Episodes that count; at least as many that the episode of the fork is among them.
        warmup: Episodes before them that count in no measure.
        out: A folder for both branches, or True for the one that the command line would choose.
        name: A label of both branches.
        engine: ``"des"``, ``"batch"`` or ``"auto"``, as in ``run``: their numbers are the same.
        progress: Show the progress.

    Raises:
        DesimError: one of its subclasses says what is wrong; UsageError is for an epoch that the
            run does not have. Nothing is written then.
    """
    parameters = locals()
    from desim_uav.api import arguments
    from desim_uav.api.branches import Counterfactual
    from desim_uav.api.kept import InFolder, InMemory, Tables
    from desim_uav.api.run_result import RunResult
    from desim_uav.experiment import command
    from desim_uav.experiment import fork as forking
    from desim_uav.experiment.progress import progress as shown
    from desim_uav.policies.base import load_policy, policy_name

    parts = [fork] if isinstance(fork, str) or not isinstance(fork, Iterable) else fork
    at = forking.At.of(":".join(map(str, parts)))
    if at.episode >= MOST_EPISODES:
        raise UsageError(f"--fork {at}: there are at most {MOST_EPISODES:,} episodes")
    source = arguments.opened(scenario, overrides, seed, world_seed)
    with source.located():
        prepared = command.prepare(source.scenario, policy, engine, keep_events=True)
    other, other_name = load_policy(to), policy_name(to)
    words = arguments.command_of(counterfactual, parameters)
    for notice in (prepared.notice, getattr(other, "notice", lambda world: "")(prepared.world)):
        if notice:
            arguments.warn(notice)
    asked = (words, source.settings, name)
    how = command.How(max(episodes, at.episode + 1), warmup, True, engine, *asked)
    branches = forking.Branches(prepared, other, other_name, at, how)
    total = 2 * (how.episodes + warmup)
    if out is None or out is False:
        tables = Tables(), Tables()
        with shown(progress, total, engine=engine) as advance:
            forked = forking.record_branches(branches, (tables[0].write, tables[1].write), advance)
        runs = [InMemory(each, own) for each, own in zip(forked[:2], tables, strict=True)]
        return Counterfactual(RunResult(runs[:1]), RunResult(runs[1:]), forked.about, None)
    place = forking.place_of_fork(branches, None if out is True else Path(out))
    with shown(progress, total, engine=engine) as advance:
        folder, forked = forking.write_branches(branches, place, advance)
    results = [RunResult([InFolder(folder / branch)]) for branch in forking.BRANCHES]
    return Counterfactual(results[0], results[1], forked.about, folder)
