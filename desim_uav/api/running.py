"""Where the run of each seed goes, and what is said of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from desim_uav.api.kept import InFolder, InMemory, Kept, Tables
from desim_uav.api.run_result import RunResult
from desim_uav.errors import Interrupted, UsageError
from desim_uav.experiment import command
from desim_uav.experiment import resume as resuming
from desim_uav.policies.base import PolicyLike
from desim_uav.run_folder import Replaced, RunPlace
from desim_uav.scenario.schema import Scenario


def apart(first: command.Prepared, scenarios: Sequence[Scenario]) -> str:
    """Return a warning if later seeds have other worlds than that of the policy's training."""
    learned = getattr(first.policy, "world_seed", None)
    if learned is None or {one.effective_world_seed for one in scenarios} == {learned}:
        return ""
    return (
        f"{first.name} was learned in world {learned} and is run in a world for each seed; "
        f"set the world seed to {learned} to run it in its own world"
    )


def run_one(
    prepared: command.Prepared,
    how: command.How,
    place: RunPlace | Path | None,
    advance: Callable[[], None],
) -> Kept:
    """Run on one seed, in memory or into a folder; or continue the run in a folder, a Path."""
    if isinstance(place, Path):
        continuation = resuming.begun(prepared, how, place)
        if continuation.done == how.episodes:
            return InFolder(place)
        outcome = command.write_run(prepared, how, Replaced(place), advance, continuation)
        return InFolder(Path(outcome.summary["run_dir"]), outcome)
    if place is not None:
        outcome = command.write_run(prepared, how, place, advance)
        return InFolder(Path(outcome.summary["run_dir"]), outcome)
    tables = Tables()
    return InMemory(command.record(prepared, how, tables.write, advance), tables)


def place_of(
    scenario: Scenario,
    policy: PolicyLike,
    out: str | Path | bool | None,
    several: bool,
    resume: bool,
    overrides: Sequence[str],
) -> RunPlace | Path | None:
    """Return where the run of a scenario's seed stands, if in a folder; a Path if it is continued.

    Raises UsageError if no folder can be made there, or if there is no run to be continued.
    """
    if out is None or out is False:
        if resume:
            raise UsageError("resume: there is nothing to continue without out, the run's folder")
        return None
    if out is True:
        place = command.place_of(scenario, policy, None, overrides)
        return resuming.unfinished(place) if resume and not several else place
    folder = Path(out) / f"s{scenario.seed}" if several else Path(out)
    if resume and folder.is_dir() and any(folder.iterdir()):
        return folder
    if resume and not several:
        raise UsageError(f"--out {out}: there is no run to be continued with --resume")
    return command.place_of(scenario, policy, folder)


def interrupted(runs: Sequence[Kept], seeds: int) -> Interrupted:
    """Return the error that Ctrl-C raises, with the runs of the seeds that had ended."""
    result = RunResult(runs, several=seeds > 1)
    return Interrupted(
        f"interrupted in seed {runs[-1].manifest['seed']} ({len(runs)} of {seeds}); the episodes "
        "that had ended are in the result of this error",
        result,
    )
