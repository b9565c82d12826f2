"""The work of ``desim-uav bench run``: a policy is evaluated by the protocol of the benchmark."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import Any

from desim_uav.errors import UsageError
from desim_uav.experiment.bench import submission
from desim_uav.experiment.bench.commands import decisions_sha256
from desim_uav.experiment.bench.measure import (
    Measured,
    Recorder,
    is_shipped,
    knows_future,
    measure,
)
from desim_uav.experiment.bench.tasks import (
    BENCHMARK,
    ENGINE,
    EPISODES,
    STEPS,
    WARMUP,
    BenchTrack,
    Task,
)
from desim_uav.experiment.compare import out_of_place, try_on
from desim_uav.experiment.interrupt import undisturbed
from desim_uav.experiment.processes import run_each
from desim_uav.experiment.provenance import clock, versions
from desim_uav.model.observations import information_of
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.policies import load_policy
from desim_uav.policies.base import as_seen, base_of, file_of
from desim_uav.run_folder import RunPlace
from desim_uav.scenario.schema import Scenario
from desim_uav.world import build_world

OWN_KNOWLEDGE = {
    "random": "nothing",
    "hover": "nothing",
    "baseline": "local, and the map",
}
"""What built-in policies use that are no planners and observe nothing."""


@dataclass(frozen=True)
class Submitted:
    """A submission that was written, and the rows in it."""

    folder: Path
    manifest: dict[str, Any]
    rows: Sequence[dict[str, Any]]

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C came before the last seed had ended."""
        return bool(self.manifest["interrupted"])

    def content(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return self.manifest | {"folder": str(self.folder), "rows": list(self.rows)}


def check(
    task: Task,
    track: BenchTrack,
    policies: Sequence[str],
    seeds: Sequence[int],
    training_steps: int | None = None,
) -> list[str]:
    """Return warnings about policies in a task.

    Raises UsageError if one is given twice, if they do not all know the same, or if a training was
    longer than the task allows, and PolicyError if one cannot be loaded or does not fit the task.
    """
    within_budget(task, training_steps)
    if len({*policies}) < len(policies):
        raise UsageError("--policy: one is given twice; each stands for a training of its own")
    for policy in policies:
        load_policy(policy)  # before the engine is loaded, which takes seconds
    about(task, track, policies)
    scenario = task.scenario(track)
    try_on(scenario, {}, seeds, ENGINE)
    for policy in policies:
        _begin_once(task, track, policy, seeds[0])
    return out_of_place(scenario, {policy: policy for policy in policies}, seeds)


def _begin_once(task: Task, track: BenchTrack, policy: str, seed: int) -> None:
    """Let a policy begin in the world of a seed, as in a run. Raises PolicyError if it cannot."""
    recorder = Recorder(load_policy(policy), seed)
    world = build_world(as_seen(task.scenario(track), policy), track.world_of(seed))
    recorder.begin(world, Streams(seed, Purpose.LEARNER))


def within_budget(task: Task, training_steps: int | None) -> None:
    """Raise UsageError if a training was longer than the task allows."""
    if training_steps is not None and training_steps > STEPS[task.size]:
        raise UsageError(
            f"--training-steps {training_steps}: {task.name} allows at most {STEPS[task.size]:,}"
        )


def submit(
    task: Task,
    track: BenchTrack,
    policy: str | Sequence[str],
    place: RunPlace,
    *,
    name: str | None = None,
    seeds: Sequence[int] = (),
    training_steps: int | None = None,
    jobs: int = 1,
    command: Sequence[str] = (),
    on_run: Callable[[], None] = lambda: None,
) -> Submitted:
    """Evaluate a policy on seeds of the protocol, by default all, and write the submission.

    Several policies are those of several trainings: all are evaluated on all seeds. ``on_run`` is
    called after each run. After Ctrl-C the first seeds are written, up to one on which not all
    policies have flown. Raises KeyboardInterrupt if there is none, and UsageError if a training was
    longer than the task allows.
    """
    within_budget(task, training_steps)
    policies = [policy] if isinstance(policy, str) else list(policy)
    all_seeds = list(seeds or track.seeds)
    now = clock()
    started = now()
    content = about(task, track, policies, name)
    measured, interrupted = _measured(task, track, policies, all_seeds, jobs, on_run)
    with suppress(KeyboardInterrupt), undisturbed():  # what has been flown is written
        manifest = {
            **content,
            "trainings": _with_decisions(content["trainings"], measured),
            **({} if training_steps is None else {"training_steps": training_steps}),
            "seeds": list({one.row["seed"]: None for one in measured}),
            "interrupted": interrupted,
            "command": list(command),
            "started": started,
            "finished": now(),
            "versions": versions(),
        }
        folder = submission.write(place, manifest, measured)
    return Submitted(folder, manifest, [one.row for one in measured])


def about(
    task: Task, track: BenchTrack, policies: Sequence[str], name: str | None = None
) -> dict[str, Any]:
    """Return the entries of a manifest that do not depend on what was reached.

    Raises UsageError if the policies do not all know the same, as those of one algorithm do.
    """
    policy, *others = policies
    knowledge = _knowledge(policy, task.scenario(track))
    for other in others:
        if _knowledge(other, task.scenario(track)) != knowledge:
            raise UsageError(
                f"--policy {other}: it does not use the same as {policy}; the policies of a "
                "submission are those of several trainings of one algorithm"
            )
    listed = [{"policy": each, "policy_sha256": policy_sha256(each)} for each in policies]
    return {
        "format": submission.FORMAT,
        "benchmark": BENCHMARK,
        "task": task.name,
        "track": track.name,
        "seal": track.seal,
        "scenario_hash": task.scenario_hash,
        "trainings": listed,
        "name": name or policy,
        **knowledge,
        "engine": ENGINE,
        "episodes": EPISODES,
        "warmup": WARMUP,
    }


def _with_decisions(
    trainings: Sequence[dict[str, Any]], measured: Sequence[Measured]
) -> list[dict[str, Any]]:
    """Return the trainings with the digests of what their policies decided."""
    return [
        training
        | {
            "decisions_sha256": decisions_sha256(
                [one.commands for one in measured if one.row[submission.TRAINING] == number]
            )
        }
        for number, training in enumerate(trainings)
    ]


def _knowledge(policy: str, scenario: Scenario) -> dict[str, Any]:
    """Return what a policy uses, and how high its drones may fly."""
    loaded = load_policy(policy)
    return {
        "information": information(policy, scenario),
        "knows_future": knows_future(loaded),
        "ceiling": loaded.ceiling,
    }


def information(policy: str, scenario: Scenario) -> str:
    """Return what a policy uses: what it declares, or else what its observation declares.

    One that declares what it uses ``besides`` its base uses that and what the base uses. Of a
    planner or an observation that is not part of the package, it says that more is within reach.
    """
    loaded, base = load_policy(policy), base_of(policy)
    besides: str | None = getattr(loaded, "besides", None)
    if base is not None and besides is not None:
        return f"{information(base, scenario)}; {besides}"
    own = getattr(loaded, "information", None) or OWN_KNOWLEDGE.get(policy)
    text = str(own or information_of(as_seen(scenario, loaded).observation))
    plans = hasattr(loaded, "watch") and not is_shipped(loaded)
    if plans or not is_shipped(getattr(loaded, "observation", None)):
        return f"{text} (as it declares; it is shown all of the present)"
    return text


def policy_sha256(policy: str) -> str | None:
    """Return the SHA-256 of a policy's file, or of the files in its folder; None without one."""
    file = file_of(policy)
    if file is None:
        return None
    sha256 = hashlib.sha256()
    for each in sorted(file.rglob("*")) if file.is_dir() else [file]:
        if each.is_file():
            sha256.update(each.read_bytes())
    return sha256.hexdigest()


def _measured(
    task: Task,
    track: BenchTrack,
    policies: Sequence[str],
    seeds: Sequence[int],
    jobs: int,
    on_run: Callable[[], None],
) -> tuple[list[Measured], bool]:
    """Return what was measured, training by training, and whether Ctrl-C has ended it early.

    A seed that ended before an earlier one is then left out: nobody may choose seeds.
    """
    runs = [(number, seed) for seed in seeds for number in range(len(policies))]
    measured_of: dict[tuple[int, int], Measured] = {}
    interrupted = False
    try:
        tasks = [(task, track, policies[number], seed) for number, seed in runs]
        with closing(run_each(measure, tasks, jobs)) as ended:
            for run, measured in ended:
                measured_of[runs[run]] = measured
                on_run()
    except KeyboardInterrupt:
        interrupted = True
    numbers = range(len(policies))
    whole = list(takewhile(lambda seed: all((n, seed) in measured_of for n in numbers), seeds))
    if not whole:
        raise KeyboardInterrupt
    return [
        replace(measured_of[n, seed], row={submission.TRAINING: n} | measured_of[n, seed].row)
        for n in numbers
        for seed in whole
    ], interrupted
