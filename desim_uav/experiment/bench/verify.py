"""The work of ``desim-uav bench verify``: a submission is replayed and compared bit for bit.

The commands in the folder are given to the drones again, so the policy is not needed, and no code
that came with the submission is run, or only after that and elsewhere (``again``). Times of
decisions cannot be checked.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from desim_uav.errors import DesimError, PolicyError
from desim_uav.experiment.bench.again import decided_again
from desim_uav.experiment.bench.bounds import less_crashes
from desim_uav.experiment.bench.commands import Commands, decisions_sha256
from desim_uav.experiment.bench.kept import BOUNDS, REFERENCES, bound_of, computed, kept
from desim_uav.experiment.bench.measure import replay
from desim_uav.experiment.bench.submission import Submission
from desim_uav.experiment.bench.tasks import ENGINE, EPISODES, STEPS, WARMUP, BenchTrack, Task
from desim_uav.experiment.processes import results_of
from desim_uav.measures.known import KNOWN
from desim_uav.policies.base import file_of

FIXED = {"engine": ENGINE, "episodes": EPISODES, "warmup": WARMUP}
OF_POLICY = ("information", "knows_future", "ceiling")
"""What a policy must still declare when it decides again. Its file may be another one: what counts
is what it decides."""

ALIKE = {BOUNDS: 1e-3}
"""By how much values of a revealed set may differ from those that are computed anew, as a share: a
bound is found by a descent, whose roundings depend on the processor."""


def differences(
    submission: Submission,
    *,
    decide: bool = False,
    jobs: int = 1,
    on_run: Callable[[], None] = lambda: None,
) -> list[str]:
    """Return everything in which a submission differs from the protocol and from its replay.

    With ``decide`` its policies decide again after all replays, in a process of their own. Raises
    DesimError if one cannot be loaded.
    """
    if decide and (lacking := lacking_policy(submission)):
        raise PolicyError(f"{lacking}: no such file of a policy")
    task, track = submission.task, submission.track
    listed = _of_protocol(submission)
    if any(line.startswith(tuple(FIXED)) for line in listed):
        return listed  # other runs would be replayed
    work = [
        (task, track, row, commands, submission.about.ceiling)
        for row, commands in zip(submission.rows, submission.commands, strict=True)
    ]
    revealed = [(task, track, seed) for seed in _revealed_seeds(submission)]
    found = results_of(of_set, revealed, jobs, on_run) + results_of(of_seed, work, jobs, on_run)
    listed += [line for lines in found for line in lines]
    return listed + (of_decisions(submission, jobs, on_run) if decide else [])


def lacking_policy(submission: Submission) -> str:
    """Return the first policy whose file is missing, or "".

    It is asked before the replays, which may take hours.
    """
    for training in submission.about.trainings:
        file = file_of(training.policy)
        if file is not None and not file.exists():
            return training.policy
    return ""


def runs_of(submission: Submission, decide: bool = False) -> int:
    """Return how many runs ``differences`` flies: the submission's, and a revealed set's.

    With ``decide`` those of the submission are flown twice.
    """
    return len(submission.rows) * (2 if decide else 1) + len(_revealed_seeds(submission))


def _revealed_seeds(submission: Submission) -> list[int]:
    """Return the seeds whose references and bounds are not those of the package."""
    return [] if submission.track.folder is None else list(dict.fromkeys(submission.about.seeds))


def of_set(task: Task, track: BenchTrack, seed: int) -> list[str]:
    """Return the references and bounds of a revealed set that are not those of its key, or missing.

    The public ones have their hashes in the package, and whoever sends a revealed set could have
    changed these. It has none of a task that was not named when it was revealed, and no scores.
    """
    folder, run, lines = track.folder, (task.name, track.name, seed), list[str]()
    assert folder is not None
    if not any(key[0] == task.name for file in (REFERENCES, BOUNDS) for key in kept(file, folder)):
        return []
    for file, values in computed(task, track, seed).items():
        there = {key[3]: value for key, value in kept(file, folder).items() if key[:3] == run}
        lines += [
            f"{folder / file}: seed {seed}: {name}: it has {_words(there.get(name))}, and computed "
            f"anew it is {_words(values.get(name))}"
            for name in {**there, **values}
            if name not in there
            or not math.isclose(there[name], values.get(name, math.nan), rel_tol=ALIKE.get(file, 0))
        ]
    return lines


def of_seed(
    task: Task,
    track: BenchTrack,
    row: Mapping[str, Any],
    commands: Commands,
    ceiling: bool,
) -> list[str]:
    """Return the differences of a row from its replay."""
    run, seed = _run_of(row), row["seed"]
    try:
        again = replay(task, track, seed, commands, ceiling)
    except DesimError as error:
        return [f"{run}: the commands cannot be replayed: {error}"]
    lines = [
        f"{run}: {name}: the folder has {_words(row[name])}, the replay {_words(value)}"
        for name, value in again.items()
        if row[name] != value
    ]
    lines += [f"{run}: {line}" for line in _of_bound(task, track, row)]
    return lines


def of_decisions(
    submission: Submission, jobs: int = 1, on_run: Callable[[], None] = lambda: None
) -> list[str]:
    """Return the differences of a submission from what its policies do and declare now."""
    again = decided_again(submission, jobs, on_run)
    lines = [
        f"{name}: the folder has {getattr(submission.about, name)!r}, "
        f"the policy now {getattr(again.about, name)!r}"
        for name in OF_POLICY
        if getattr(submission.about, name) != getattr(again.about, name)
    ]
    if any(getattr(again.about, name) != value for name, value in FIXED.items()) or (
        again.about.runs != submission.about.runs
    ):
        return [*lines, "the policies have flown other runs than they were asked for"]
    now = {_run_of(row): commands for row, commands in zip(again.rows, again.commands, strict=True)}
    for row, commands in zip(submission.rows, submission.commands, strict=True):
        unlike = now[_run_of(row)].first_unlike(commands)
        if unlike is not None:
            episode, epoch, drone = unlike
            lines.append(
                f"{_run_of(row)}: commands: the policy decides otherwise, first in episode "
                f"{episode - WARMUP}, at decision epoch {epoch}, for drone {drone}"
            )
    return lines


def _run_of(row: Mapping[str, Any]) -> str:
    """Return a run in words."""
    return f"seed {row['seed']}" + (f" of training {row['training']}" if row["training"] else "")


def _of_bound(task: Task, track: BenchTrack, row: Mapping[str, Any]) -> Sequence[str]:
    """Return the proven bounds that a row exceeds, which shows a defect of one of the two."""
    return [
        f"{name}: {row[name]!r} is better than the proven bound {bound!r}"
        for name, bound in bound_of(task, track, row["seed"]).items()
        if KNOWN[name].verdict(less_crashes(name, row) - bound) == "better"
    ]


def _of_protocol(submission: Submission) -> list[str]:
    lines = [
        f"{name}: the folder has {getattr(submission.about, name)!r}, the protocol {value!r}"
        for name, value in FIXED.items()
        if getattr(submission.about, name) != value
    ]
    seeds = submission.about.seeds
    if seeds != list(submission.track.seeds[: len(seeds)]):
        lines.append(f"seeds: {seeds} are not the first of the track {submission.track.name!r}")
    if (submission.about.training_steps or 0) > STEPS[submission.task.size]:
        lines.append(f"training_steps: more than the {STEPS[submission.task.size]:,} of the task")
    for number, training in enumerate(submission.about.trainings):
        runs = zip(submission.rows, submission.commands, strict=True)
        decided = decisions_sha256([each for row, each in runs if row["training"] == number])
        if training.decisions_sha256 != decided:
            lines.append(
                f"decisions_sha256 of training {number}: the folder has "
                f"{training.decisions_sha256!r}, the commands {decided!r}"
            )
    return lines


def _words(value: object) -> str:
    return "no value" if value is None else repr(value)
