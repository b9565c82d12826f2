"""The benchmark: its frozen tasks, submissions that can be replayed, and the leaderboard."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from desim_uav.api.parameters import Jobs, verb
from desim_uav.errors import Interrupted, UsageError
from desim_uav.experiment.bench.seeds import SEEDS
from desim_uav.typed import Within

if TYPE_CHECKING:
    from desim_uav.experiment.bench.leaderboard import Leaderboard
    from desim_uav.experiment.bench.run import Submitted

MOST_EXPORTED = 1024
"""The most runs of a data set: the number of training worlds."""


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
    seeds: Annotated[int | None, Within(1, max(SEEDS.values()))] = None,
    name: str | None = None,
    training_steps: Annotated[int | None, Within(1, 10**12)] = None,
    out: str | Path | None = None,
    revealed: str | Path | None = None,
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
        seeds: Run only the first N seeds of the track, 10 or 32; the leaderboard then says so.
        name: What the leaderboard calls the policy. By default it is the policy's name.
        training_steps: The steps (decision epochs) of a training, at most those that the task
            allows. They are stated in the submission and cannot be checked.
        out: The folder of the submission. By default it is a new one in runs/.
        revealed: The folder of a sealed set, as `bench reveal` writes it. By default the seeds are
            those of the public set.
        jobs: The number of seeds that are run at a time. In Python, each is run in a process of its
            own, and a script that asks for more than one must begin its work under
            ``if __name__ == "__main__":``.
        progress: Show the progress, on a terminal or in a notebook.

    Raises:
        DesimError: one of its subclasses says what is wrong with the task, a policy or an option,
            before anything is run.
        Interrupted: Ctrl-C. Its ``result`` holds the submission of the first seeds that had ended.
    """
    parameters = locals()
    from desim_uav.api import arguments
    from desim_uav.experiment.bench.run import check, submit
    from desim_uav.experiment.bench.sealed import revealed as tracks_of
    from desim_uav.experiment.bench.submission import blank, place_of
    from desim_uav.experiment.bench.tasks import ENGINE, find_task, find_track
    from desim_uav.experiment.command import label_of
    from desim_uav.experiment.progress import progress as shown

    task_, worlds = find_task(task), find_track(track, tracks_of(_path(revealed)))
    policies = [policy] if isinstance(policy, str | Path) else list(policy)
    if not policies:
        raise UsageError("policy: give at least one")
    names = [str(each) for each in policies]
    if name is not None and blank(name):
        raise UsageError(f"name: {name!r}: it must not be blank")
    if seeds is not None and seeds > len(worlds.seeds):
        raise UsageError(f"seeds: {seeds}: track {track} has {len(worlds.seeds)}")
    all_seeds = list(worlds.seeds[:seeds])
    for warning in check(task_, worlds, names, all_seeds, training_steps):
        arguments.warn(warning)
    place = place_of(task_, worlds, label_of(names[0]), _path(out))
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
    folder: str | Path,
    *,
    decide: bool = False,
    receipts: str | Path | None = None,
    revealed: str | Path | None = None,
    jobs: Jobs = 1,
    progress: bool = True,
) -> list[str]:
    """Replay a submission bit for bit, and name every difference.

    In Python, this does what ``desim-uav bench verify`` does, and returns the differences: none if
    the submission is verified.

    Args:
        folder: The submission, as `bench run` writes it.
        decide: Let the policy decide again as well, without the future unless it declares to know
            that. This runs its code, in a process of its own.
        receipts: A file of the referee in which a submission without differences is noted.
        revealed: The folder of the sealed set on which it was made, as `bench reveal` writes it.
        jobs: The number of seeds that are run at a time. In Python, it is as in ``bench_run``.
        progress: Show the progress, on a terminal or in a notebook.

    Raises:
        PolicyError: the folder cannot be read, or a policy cannot be loaded.
    """
    from desim_uav.experiment.bench.receipts import add_receipt
    from desim_uav.experiment.bench.sealed import revealed as tracks_of
    from desim_uav.experiment.bench.submission import read
    from desim_uav.experiment.bench.tasks import ENGINE
    from desim_uav.experiment.bench.verify import differences, runs_of
    from desim_uav.experiment.progress import progress as shown

    submission = read(Path(folder), tracks_of(_path(revealed)))
    with shown(progress, runs_of(submission, decide), "runs", ENGINE) as advance:
        listed = differences(submission, decide=decide, jobs=jobs, on_run=advance)
    if receipts is not None and not listed:
        add_receipt(Path(receipts), submission.folder, decide)
    return listed


@verb
def bench_board(
    folders: Sequence[str | Path],
    *,
    out: str | Path | None = None,
    figure: str | Path | None = None,
    receipts: str | Path | None = None,
    revealed: str | Path | None = None,
) -> Leaderboard:
    """Make the leaderboard of submissions, in Markdown. It does not replay them.

    In Python, this does what ``desim-uav bench board`` does.

    Args:
        folders: Submissions, as `bench run` writes them, or folders of submissions.
        out: The file for the tables. By default they are printed. In Python, they are not; the
            result has them.
        figure: The file for the performance profiles: .png, .pdf or .svg.
        receipts: The file in which `bench verify --receipts` has noted what it has verified.
        revealed: The folder of a sealed set, as `bench reveal` writes it.

    Raises:
        PolicyError: a submission cannot be read, two in a task have one name, or there is no
            profile for a figure, because no policy has a score.
        UsageError: a file cannot be written.
    """
    from desim_uav.experiment.bench.leaderboard import Leaderboard
    from desim_uav.experiment.bench.receipts import read_receipts
    from desim_uav.experiment.bench.sealed import revealed as tracks_of
    from desim_uav.experiment.bench.submission import read_all

    submissions = read_all([Path(folder) for folder in folders], tracks_of(_path(revealed)))
    checks = {} if receipts is None else read_receipts(Path(receipts))
    board = Leaderboard.of(submissions, checks)
    board.save(_path(out), _path(figure))
    return board


@verb
def bench_export(
    task: str,
    policy: str | Path,
    *,
    track: str = "one",
    seeds: Annotated[int, Within(1, MOST_EXPORTED)] = 8,
    observation: str | None = None,
    out: str | Path | None = None,
    progress: bool = True,
) -> Path:
    """Write a Minari data set of a policy's runs, for offline learning.

    In Python, this does what ``desim-uav bench export`` does, and returns the folder.

    Args:
        task: The task, such as uav-v1/coverage or uav-v1/coverage/small.
        policy: The policy: a name, a file or a class, as in `run --policy`. In Python, it is named
            as on the command line, too, because the data set records it.
        track: The track: the world 0, or training worlds, none of which is a test world.
        seeds: The number of runs, each of as many episodes as in a submission. Their seeds are
            those of trainings, from 1000000 on, and not those of submissions.
        observation: What is observed in the data set, such as radar, with its default settings. By
            default it is the observation of the task or, if the policy needs one, of the policy.
        out: The folder of the data set. By default it is a new one in runs/.
        progress: Show the progress, on a terminal or in a notebook.

    Raises:
        MissingExtraError: Minari is not installed.
        DesimError: one of its other subclasses says what is wrong with the task, the policy or an
            option, before anything is run.
    """
    parameters = locals()
    from desim_uav.api import arguments
    from desim_uav.experiment.bench.export import export
    from desim_uav.experiment.bench.submission import place_of
    from desim_uav.experiment.bench.tasks import ENGINE, find_task, find_track
    from desim_uav.experiment.command import label_of
    from desim_uav.experiment.progress import progress as shown

    task_, worlds, name = find_task(task), find_track(track), str(policy)
    place = place_of(task_, worlds, label_of(name), _path(out))
    with shown(progress, seeds, "runs", ENGINE) as advance:
        return export(
            *(task_, worlds, name, place),
            seeds=seeds,
            observation=observation,
            command=arguments.command_of(bench_export, parameters),
            on_run=advance,
        )


@verb
def bench_seal(key: str | Path) -> str:
    """Seal a set of test worlds, seeds and paths that follow from a secret key.

    In Python, this does what ``desim-uav bench seal`` does, and returns the seal, a hash of the key
    that can be published.

    Args:
        key: The file with the key. If there is none, a new one with a random key is written.

    Raises:
        PolicyError: the file has no key.
        UsageError: a file cannot be written.
    """
    from desim_uav.experiment.bench.sealed import make_key, read_key, seal_of

    file = Path(key)
    if not file.exists():
        make_key(file)
    return seal_of(read_key(file))


@verb
def bench_reveal(
    key: str | Path,
    tasks: Sequence[str] = (),
    *,
    out: str | Path | None = None,
    jobs: Jobs = 1,
) -> Path:
    """Reveal a sealed set, and compute the references and bounds of its runs.

    In Python, this does what ``desim-uav bench reveal`` does, and returns the folder of the set. If
    the set is there already, only what is missing is computed.

    Args:
        key: The file with the key of the seal.
        tasks: The tasks to compute references and bounds for, which takes up to minutes each.
        out: The folder of the set. By default it is a new one in runs/.
        jobs: The number of runs that are computed at a time. In Python, it is as in ``bench_run``.

    Raises:
        PolicyError: the file has no key, or the folder has the set of another key.
        UsageError: a task is unknown, or the folder cannot be written.
    """
    from desim_uav.experiment.bench.kept import complete
    from desim_uav.experiment.bench.sealed import read_key, reveal, tracks_of
    from desim_uav.experiment.bench.tasks import find_task

    chosen, secret = [find_task(task) for task in tasks], read_key(Path(key))
    folder = reveal(secret, _path(out))
    complete(chosen, list(tracks_of(secret, folder).values()), jobs)
    return folder


def _path(place: str | Path | None) -> Path | None:
    return None if place is None else Path(place)
