"""The benchmark: its frozen tasks, submissions that can be replayed, and the leaderboard."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from desim_uav.api import arguments
from desim_uav.errors import Interrupted, UsageError
from desim_uav.experiment.bench.leaderboard import Leaderboard
from desim_uav.experiment.bench.run import Submitted, check, submit
from desim_uav.experiment.bench.submission import place_of, read, read_all
from desim_uav.experiment.bench.tasks import ENGINE, SEEDS, find_task, find_track, listing
from desim_uav.experiment.bench.verify import differences
from desim_uav.experiment.command import label_of
from desim_uav.experiment.progress import progress as shown
from desim_uav.typed import typed

__all__ = ["Leaderboard", "Submitted", "bench_board", "bench_list", "bench_run", "bench_verify"]


def bench_list() -> dict[str, Any]:
    """Return the tasks of the benchmark with their hashes, the tracks and the protocol.

    This is ``desim-uav bench list``; the result is what its ``--json`` prints.
    """
    return listing()


@typed
def bench_run(
    task: str,
    policy: str | Path | Sequence[str | Path],
    *,
    track: str = "one",
    seeds: int = SEEDS,
    name: str | None = None,
    training_steps: int | None = None,
    out: str | Path | None = None,
    jobs: int = 1,
    progress: bool = True,
) -> Submitted:
    """Evaluate a policy by the protocol of the benchmark, and write a submission.

    This is ``desim-uav bench run``.

    Args:
        task: Such as ``"uav-v1/coverage"`` or ``"uav-v1/coverage/small"``.
        policy: The policy's name, file or class, as on the command line, because the submission
            records it; or those of several trainings, which make one submission.
        track: ``"one"`` for one world, ``"any"`` for test worlds.
        seeds: The first so many of the protocol's seeds; the leaderboard tells if some are missing.
        name: What the leaderboard calls the policy. Default: the policy's name.
        training_steps: The decision epochs of the longest training, which the submission states.
        out: The folder to write. Default: a new one in ``runs``.
        jobs: Runs at a time, each in a process of its own. A script that asks for more than one
            must begin its work under ``if __name__ == "__main__":``.
        progress: Show the progress, on a terminal or in a notebook.

    Raises:
        DesimError: one of its subclasses says what is wrong with the task, a policy or an option,
            before anything is run.
        Interrupted: Ctrl-C. Its ``result`` holds the submission of the seeds that had ended.
    """
    given = locals()
    seeds = arguments.whole("seeds", seeds, 1, SEEDS)
    jobs = arguments.whole("jobs", jobs, 1, arguments.MOST_JOBS)
    if training_steps is not None:
        training_steps = arguments.whole("training_steps", training_steps, 1, 10**12)
    chosen, worlds = find_task(task), find_track(track)
    policies = [policy] if isinstance(policy, str | Path) else list(policy)
    if not policies:
        raise UsageError("policy: give at least one")
    names = [str(each) for each in policies]
    drawn = list(worlds.seeds[:seeds])
    for warning in check(chosen, worlds, names, drawn, training_steps):
        arguments.warn(warning)
    place = place_of(chosen, worlds, label_of(names[0]), None if out is None else Path(out))
    with shown(progress, len(drawn) * len(names), "runs", ENGINE) as advance:
        done = submit(
            *(chosen, worlds, names, place),
            name=name,
            seeds=drawn,
            training_steps=training_steps,
            jobs=jobs,
            command=arguments.command_of(bench_run, given),
            on_run=advance,
        )
    if done.interrupted:
        kept = len(done.manifest["seeds"])
        raise Interrupted(f"interrupted; {kept} of {len(drawn)} seeds are kept", done)
    return done


@typed
def bench_verify(
    folder: str | Path, *, decide: bool = False, jobs: int = 1, progress: bool = True
) -> list[str]:
    """Replay a submission bit for bit, and return every difference; none if it is verified.

    This is ``desim-uav bench verify``.

    Args:
        folder: The submission.
        decide: Load its policies as well and let them decide again, which runs their code.
        jobs: Runs at a time, each in a process of its own, as in ``bench_run``.
        progress: Show the progress, on a terminal or in a notebook.

    Raises:
        PolicyError: the folder cannot be read, or a policy cannot be loaded.
    """
    jobs = arguments.whole("jobs", jobs, 1, arguments.MOST_JOBS)
    found = read(Path(folder))
    with shown(progress, len(found.rows), "runs", ENGINE) as advance:
        return differences(found, decide=decide, jobs=jobs, on_run=advance)


@typed
def bench_board(
    folders: Sequence[str | Path],
    *,
    out: str | Path | None = None,
    figure: str | Path | None = None,
) -> Leaderboard:
    """Make the leaderboard of submissions, which are not replayed.

    This is ``desim-uav bench board``.

    Args:
        folders: Submissions, or folders of submissions.
        out: A Markdown file for the tables.
        figure: A PNG, PDF or SVG file for the performance profiles.

    Raises:
        PolicyError: a submission cannot be read, two in a task have one name, or there is no
            profile for a figure, because no policy has a score.
        UsageError: a file cannot be written.
    """
    board = Leaderboard.of(read_all([Path(folder) for folder in folders]))
    board.save(*(None if file is None else Path(file) for file in (out, figure)))
    return board
