"""The work of ``desim-uav bench run``: a policy is evaluated by the protocol of the benchmark."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desim_uav.experiment.bench import submission
from desim_uav.experiment.bench.measure import Measured, measure
from desim_uav.experiment.bench.tasks import BENCHMARK, ENGINE, EPISODES, WARMUP, Task, Track
from desim_uav.experiment.compare import out_of_place, try_on
from desim_uav.experiment.processes import run_each
from desim_uav.experiment.provenance import clock, versions
from desim_uav.model.observations import information_of
from desim_uav.policies import load_policy
from desim_uav.policies.base import file_of
from desim_uav.run_folder import Place
from desim_uav.scenario.schema import Scenario

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


def check(task: Task, track: Track, policy: str, seeds: Sequence[int]) -> list[str]:
    """Return warnings about a policy in a task.

    Raises PolicyError if the policy cannot be loaded or does not fit the task.
    """
    load_policy(policy)  # before the engine is loaded, which takes seconds
    scenario = task.scenario(track)
    try_on(scenario, {policy: policy}, seeds, ENGINE)
    return out_of_place(scenario, {policy: policy}, seeds)


def submit(
    task: Task,
    track: Track,
    policy: str,
    place: Place,
    *,
    name: str | None = None,
    seeds: Sequence[int] = (),
    jobs: int = 1,
    command: Sequence[str] = (),
    on_seed: Callable[[], None] = lambda: None,
) -> Submitted:
    """Evaluate a policy on seeds of the protocol, by default all, and write the submission.

    After Ctrl-C the seeds that have ended are written. Raises KeyboardInterrupt if there is none.
    """
    chosen = list(seeds or track.seeds)
    now = clock()
    started = now()
    measured, interrupted = _measured(task, track, policy, chosen, jobs, on_seed)
    manifest = {
        **about(task, track, policy, name),
        "seeds": [one.row["seed"] for one in measured],
        "interrupted": interrupted,
        "command": list(command),
        "started": started,
        "finished": now(),
        "versions": versions(),
    }
    folder = submission.write(place, manifest, measured)
    return Submitted(folder, manifest, [one.row for one in measured])


def about(task: Task, track: Track, policy: str, name: str | None = None) -> dict[str, Any]:
    """Return the entries of a manifest that do not depend on what was reached."""
    loaded = load_policy(policy)
    return {
        "format": submission.FORMAT,
        "benchmark": BENCHMARK,
        "task": task.name,
        "track": track.name,
        "scenario_hash": task.scenario_hash,
        "policy": policy,
        "policy_sha256": policy_sha256(policy),
        "name": name or policy,
        "information": information(policy, task.scenario(track)),
        "knows_future": bool(getattr(loaded, "clairvoyant", False)),
        "ceiling": loaded.ceiling,
        "engine": ENGINE,
        "episodes": EPISODES,
        "warmup": WARMUP,
    }


def information(policy: str, scenario: Scenario) -> str:
    """Return what a policy uses: what it declares, or else what the observation declares."""
    said = getattr(load_policy(policy), "information", None)
    return str(said or OWN_KNOWLEDGE.get(policy) or information_of(scenario.observation))


def policy_sha256(policy: str) -> str | None:
    """Return the SHA-256 of a policy's file, or of the files in its folder; None without one."""
    file = file_of(policy)
    if file is None:
        return None
    found = hashlib.sha256()
    for each in sorted(file.rglob("*")) if file.is_dir() else [file]:
        if each.is_file():
            found.update(each.read_bytes())
    return found.hexdigest()


def _measured(
    task: Task,
    track: Track,
    policy: str,
    seeds: Sequence[int],
    jobs: int,
    on_seed: Callable[[], None],
) -> tuple[list[Measured], bool]:
    """Return what was measured in the order of seeds, and whether Ctrl-C has ended it early."""
    done: dict[int, Measured] = {}
    interrupted = False
    try:
        tasks = [(task, track, policy, seed) for seed in seeds]
        with closing(run_each(measure, tasks, jobs)) as ended:
            for number, measured in ended:
                done[number] = measured
                on_seed()
    except KeyboardInterrupt:
        if not done:
            raise
        interrupted = True
    return [done[number] for number in sorted(done)], interrupted
