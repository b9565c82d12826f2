"""What would have happened: a run, and the same run in which another policy goes on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from desim_uav.api import arguments
from desim_uav.api.kept import InFolder, InMemory, Tables
from desim_uav.api.replay import Replay
from desim_uav.api.run import RunResult
from desim_uav.errors import UsageError
from desim_uav.experiment import command
from desim_uav.experiment import fork as forking
from desim_uav.experiment.progress import progress as shown
from desim_uav.experiment.replay.again import Source
from desim_uav.policies.base import PolicyLike, load_policy, policy_name
from desim_uav.scenario.load import Overrides
from desim_uav.typed import typed


class Counterfactual:
    """Two branches of a run, which have everything before a decision epoch in common.

    ``original`` is the run of the first policy. In ``other``, another policy goes on from the epoch
    ``at``, with the same walks, requests and other draws.
    """

    def __init__(
        self, original: RunResult, other: RunResult, about: dict[str, Any], folder: Path | None
    ) -> None:
        self.original, self.other = original, other
        self.folder = folder
        """The folder with both branches, if they were written."""
        self._about = about

    @property
    def at(self) -> tuple[int, int]:
        """The episode and the step from which the other policy goes on."""
        return self._about["episode"], self._about["step"]

    def summary(self) -> dict[str, Any]:
        """Return the measures of both branches since the fork's episode, and their difference."""
        return self._about | ({} if self.folder is None else {"run_dir": str(self.folder)})

    def difference(self) -> dict[str, Any]:
        """Return by how much the other branch's measures exceed the original's."""
        return dict(self._about["difference"])

    @property
    def shown(self) -> str:
        """The episodes that both branches are played in: from that of the fork on."""
        return f"{self.at[0]}-{int(self._about['episodes']) - 1}"

    @contextmanager
    def sources(self) -> Iterator[list[Source]]:
        """Have both branches in folders while something is made of them."""
        with self.original.sources() as original, self.other.sources() as other:
            yield [*original, *other]

    @typed
    def replay(self, file: str | Path | None = None, *, progress: bool = True) -> Replay:
        """Make the page that plays both branches side by side, from the fork's episode on.

        Raises UsageError if ``file`` cannot be written.
        """
        return self.original.replay(file, beside=self.other, episodes=self.shown, progress=progress)

    def __repr__(self) -> str:
        told = self._about
        change = ", ".join(
            f"{name[:4].upper().replace('QOE', 'QoE')} {told['difference'][name]:+.2f}"
            for name in ("qoe1_percent", "qoe2_iterations", "qoe3_percent")
            if told["difference"][name] is not None
        )
        return (
            f"<{told['scenario']}, seed {told['seed']}: {told['to']} instead of {told['policy']} "
            f"from {told['episode']}:{told['step']} on: {change}>"
        )


@typed
def counterfactual(
    scenario: arguments.ScenarioLike,
    overrides: Overrides | None = None,
    *,
    policy: PolicyLike = "baseline",
    to: PolicyLike,
    fork: str | tuple[int, int],
    seed: int | None = None,
    world_seed: int | None = None,
    episodes: int = 1,
    warmup: int = 0,
    out: str | Path | bool | None = None,
    engine: str = "des",
    progress: bool = True,
) -> Counterfactual:
    """Run a policy, and let another one go on from one of its decision epochs: what if?

    This is ``desim-uav run … --fork EPISODE:STEP --to POLICY``. Without ``out`` both branches stay
    in memory. Events are kept, so that the replay shows both.

    Args:
        scenario: As in ``run``; so are the other arguments that are not listed here.
        overrides: Values for keys of it.
        policy: The policy of the original run.
        to: The policy that goes on from the fork. It begins there, with streams of its own.
        fork: The episode and the step, ``(0, 12)`` or ``"0:12"``, at whose decision epoch the
            branches part.
        seed: What everything random is drawn from.
        world_seed: What the world alone is drawn from.
        episodes: Episodes that count; at least as many that the episode of the fork is among them.
        warmup: Episodes before them that count in no measure.
        out: A folder for both branches, or True for the one that the command line would choose.
        engine: ``"des"`` or ``"batch"``: their numbers are the same.
        progress: Show the progress.

    Raises:
        DesimError: one of its subclasses says what is wrong; UsageError is for an epoch that the
            run does not have. Nothing is written then.
    """
    given = locals()
    episodes = arguments.whole("episodes", episodes, 1, arguments.MOST_EPISODES)
    warmup = arguments.whole("warmup", warmup, 0, arguments.MOST_EPISODES)
    parts = [fork] if isinstance(fork, str) or not isinstance(fork, Iterable) else fork
    at = forking.At.of(":".join(map(str, parts)))
    if at.episode >= arguments.MOST_EPISODES:
        raise UsageError(f"--fork {at}: there are at most {arguments.MOST_EPISODES:,} episodes")
    found = arguments.opened(scenario, overrides, seed, world_seed)
    with found.located():
        prepared = command.prepare(found.scenario, policy, engine, keep_events=True)
    other, name = load_policy(to), policy_name(to)
    told = arguments.command_of(counterfactual, given)
    for notice in (prepared.notice, getattr(other, "notice", lambda world: "")(prepared.world)):
        if notice:
            arguments.warn(notice)
    how = command.How(max(episodes, at.episode + 1), warmup, True, engine, told)
    branches = forking.Branches(prepared, other, name, at, how)
    total = 2 * (how.episodes + warmup)
    if out is None or out is False:
        tables = Tables(), Tables()
        with shown(progress, total, engine=engine) as advance:
            done = forking.record_branches(branches, (tables[0].write, tables[1].write), advance)
        kept = [InMemory(each, own) for each, own in zip(done[:2], tables, strict=True)]
        return Counterfactual(RunResult(kept[:1]), RunResult(kept[1:]), done.about, None)
    place = forking.place_of_fork(prepared, name, at, None if out is True else Path(out))
    with shown(progress, total, engine=engine) as advance:
        folder, done = forking.write_branches(branches, place, advance)
    results = [RunResult([InFolder(folder / branch)]) for branch in forking.BRANCHES]
    return Counterfactual(results[0], results[1], done.about, folder)
