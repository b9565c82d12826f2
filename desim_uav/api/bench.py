"""The benchmark: its frozen tasks, submissions that can be replayed, and the leaderboard."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from desim_uav.api.parameters import Jobs, verb
from desim_uav.errors import Interrupted, UsageError
from desim_uav.typed import Within

if TYPE_CHECKING:
    from desim_uav.experiment.bench.leaderboard import Leaderboard
    from desim_uav.experiment.bench.run import Submitted

SEEDS = 10
"""The seeds of the protocol (see ``experiment/bench/tasks.py``)."""


def bench_list() -> dict[str, Any]:
    """List the tasks, their hashes, the tracks and the protocol.

    In Python, this returns what ``desim-uav bench list --json`` prints.
    """
    from desim_uav.experiment.bench.tasks import listing

    return listing()


@verb
def bench_run(
    task: str,
    policy: str | Path | Sequence[str | Path],
    *,
    track: str = "one",
    seeds: Annotated[int, Within(1, SEEDS)] = SEEDS,
    name: str | None = None,
    training_steps: Annotated[int | None, Within(1, 10**12)] = None,
    out: str | Path | None = None,
    jobs: Jobs = 1,
    progress: bool = True,
) -> Submitted:
    """Evaluate a policy by the protocol, and write a submission that can be replayed.

    In Python, this does what ``desim-uav bench run`` does.

    Args:
        task: The task, such as uav-v1/coverage or uav-v1/coverage/small.
        policy: The policy: a name, a file or a class, as in `run --policy`. If several are given,
            these are the policies of several trainings, which make one submission. In Python, they
            are named as on the command line, too, because the submission records it.
        track: The track: one world, or test worlds in which no policy was trained.
        seeds: Run only the first N seeds of the protocol; the leaderboard then says so.
        name: What the leaderboard calls the policy. By default it is the policy's name.
        training_steps: The steps (decision epochs) of a training, at most those that the task
            allows. They are stated in the submission and cannot be checked.
        out: The folder of the submission. By default it is a new one in runs/.
        jobs: The number of seeds that are run at a time. In Python, each is run in a process of its
            own, and a script that asks for more than one must begin its work under
            ``if __name__ == "__main__":``.
        progress: Show the progress, on a terminal or in a notebook.

    Raises:
        DesimError: one of its subclasses says what is wrong with the task, a policy or an option,
            before anything is run.
        Interrupted: Ctrl-C. Its ``result`` holds the submission of the seeds that had ended.
    """
    parameters = locals()
    from desim_uav.api import arguments
    from desim_uav.experiment.bench.run import check, submit
    from desim_uav.experiment.bench.submission import place_of
    from desim_uav.experiment.bench.tasks import ENGINE, find_task, find_track
    from desim_uav.experiment.command import label_of
    from desim_uav.experiment.progress import progress as shown

    task_, worlds = find_task(task), find_track(track)
    policies = [policy] if isinstance(policy, str | Path) else list(policy)
    if not policies:
        raise UsageError("policy: give at least one")
    names = [str(each) for each in policies]
    all_seeds = list(worlds.seeds[:seeds])
    for warning in check(task_, worlds, names, all_seeds, training_steps):
        arguments.warn(warning)
    place = place_of(task_, worlds, label_of(names[0]), None if out is None else Path(out))
    with shown(progress, len(all_seeds) * len(names), "runs", ENGINE) as advance:
        submission = submit(
            *(task_, worlds, names, place),
            name=name,
            seeds=all_seeds,
            training_steps=training_steps,
            jobs=jobs,
            command=arguments.command_of(bench_run, parameters),
            on_run=advance,
        )
    if submission.interrupted:
        count = len(submission.manifest["seeds"])
        raise Interrupted(f"interrupted; {count} of {len(all_seeds)} seeds are kept", submission)
    return submission


@verb
def bench_verify(
    folder: str | Path, *, decide: bool = False, jobs: Jobs = 1, progress: bool = True
) -> list[str]:
    """Replay a submission bit for bit, and name every difference.

    In Python, this does what ``desim-uav bench verify`` does, and returns the differences: none if
    the submission is verified.

    Args:
        folder: The submission, as `bench run` writes it.
        decide: Load the policy as well, and let it decide again. This runs its code.
        jobs: The number of seeds that are run at a time. In Python, it is as in ``bench_run``.
        progress: Show the progress, on a terminal or in a notebook.

    Raises:
        PolicyError: the folder cannot be read, or a policy cannot be loaded.
    """
    from desim_uav.experiment.bench.submission import read
    from desim_uav.experiment.bench.tasks import ENGINE
    from desim_uav.experiment.bench.verify import differences
    from desim_uav.experiment.progress import progress as shown

    submission = read(Path(folder))
    with shown(progress, len(submission.rows), "runs", ENGINE) as advance:
        return differences(submission, decide=decide, jobs=jobs, on_run=advance)


@verb
def bench_board(
    folders: Sequence[str | Path],
    *,
    out: str | Path | None = None,
    figure: str | Path | None = None,
) -> Leaderboard:
    """Make the leaderboard of submissions, in Markdown. It does not replay them.

    In Python, this does what ``desim-uav bench board`` does.

    Args:
        folders: Submissions, as `bench run` writes them, or folders of submissions.
        out: The file for the tables. By default they are printed. In Python, they are not; the
            result has them.
        figure: The file for the performance profiles: .png, .pdf or .svg.

    Raises:
        PolicyError: a submission cannot be read, two in a task have one name, or there is no
            profile for a figure, because no policy has a score.
        UsageError: a file cannot be written.
    """
    from desim_uav.experiment.bench.leaderboard import Leaderboard
    from desim_uav.experiment.bench.submission import read_all

    board = Leaderboard.of(read_all([Path(folder) for folder in folders]))
    board.save(*(None if file is None else Path(file) for file in (out, figure)))
    return board
