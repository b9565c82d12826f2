"""The frozen tasks of the benchmark, its tracks, and the protocol by which policies are compared.

Each task is a scenario file. The registry holds the hash of each scenario, so that an edited
scenario is refused.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from desim_uav.env.tasks import WORLDS
from desim_uav.errors import ScenarioError, UsageError, did_you_mean
from desim_uav.experiment.bench.seeds import SEEDS
from desim_uav.scenario.load import load, scenario_hash
from desim_uav.scenario.schema import Scenario
from desim_uav.shipped import bench_folder

BENCHMARK = "uav-v1"
REGISTRY = "registry.json"
"""The file with the hashes of all scenarios, and of the references and bounds."""

FAMILIES = (
    *("coverage", "multi-service", "urban", "endurance"),
    *("edge", "harvest", "handover", "dispatch"),
)
SIZES = ("small", "medium", "large")
USUAL = "medium"
"""The size of a task whose name has no size."""

EPISODES, WARMUP = 16, 4
"""The counted episodes of a seed, and those of warm-up before them."""

ENGINE = "batch"
TRAINING_SEEDS = 10
STEPS = {"small": 1_000_000, "medium": 3_000_000, "large": 10_000_000}
"""The budget of a training: decision epochs of the environment, by the size of the task."""


@dataclass(frozen=True)
class BenchTrack:
    """Which worlds a policy is evaluated in.

    ``seeds`` draw the walks and requests, and the worlds too unless there is a ``world_seed``.
    ``seal`` and ``folder`` are those of a sealed set that was revealed; the public set has none.
    """

    name: str
    world_seed: int | None
    seeds: Sequence[int]
    about: str
    seal: str | None = None
    folder: Path | None = None

    def world_of(self, seed: int) -> int:
        """Return the world seed of a run on this seed."""
        return seed if self.world_seed is None else self.world_seed


TRACKS = {
    "one": BenchTrack(
        "one", 0, range(100, 100 + SEEDS["one"]), "world 0, in which policies may be trained"
    ),
    "any": BenchTrack(
        "any", None, WORLDS["test"][: SEEDS["any"]], "test worlds, in which none was trained"
    ),
}


@dataclass(frozen=True)
class Task:
    """A frozen task: its family, its size, and the hash of its scenario."""

    family: str
    size: str
    scenario_hash: str

    @property
    def name(self) -> str:
        """The whole name, such as ``uav-v1/coverage/small``."""
        return f"{BENCHMARK}/{self.family}/{self.size}"

    @property
    def path(self) -> Path:
        """The scenario file."""
        return bench_folder() / f"{self.family}-{self.size}.yaml"

    @property
    def about(self) -> str:
        """The first comment of the scenario file."""
        return self.path.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")

    def scenario(self, track: BenchTrack) -> Scenario:
        """Return the scenario of a track. Raises ScenarioError if the file has been edited."""
        scenario = load(self.path)
        digest = scenario_hash(scenario)
        if digest != self.scenario_hash:
            raise ScenarioError(
                f"{self.path}: the scenario of {self.name} is frozen and has been changed: its "
                f"hash is {digest}, but the registry has {self.scenario_hash}"
            )
        return scenario.model_copy(update={"world_seed": track.world_seed})


@cache
def tasks() -> dict[str, Task]:
    """Return all tasks by their whole names."""
    registry = json.loads((bench_folder() / REGISTRY).read_text(encoding="utf-8"))
    hashes = registry["scenarios"]
    listed = [
        Task(family, size, hashes[f"{family}-{size}"]) for family in FAMILIES for size in SIZES
    ]
    return {task.name: task for task in listed}


def find_task(name: str) -> Task:
    """Return the task of a name; its size may be left out. Raises UsageError."""
    task_of = tasks()
    for candidate in (name, f"{name}/{USUAL}"):
        if candidate in task_of:
            return task_of[candidate]
    names = [*task_of, *(f"{BENCHMARK}/{family}" for family in FAMILIES)]
    raise UsageError(
        f"{name}: unknown task{did_you_mean(name, names)}; a task is "
        f"{BENCHMARK}/{'|'.join(FAMILIES)}, and /{'|/'.join(SIZES)} may follow"
    )


def find_track(name: str, tracks: Mapping[str, BenchTrack] = TRACKS) -> BenchTrack:
    """Return the track of a name. Raises UsageError."""
    if name not in tracks:
        raise UsageError(
            f"--track {name}: unknown track{did_you_mean(name, tracks)}; allowed: "
            f"{', '.join(tracks)}"
        )
    return tracks[name]


def protocol() -> dict[str, Any]:
    """Return the protocol as plain data."""
    return {
        "episodes": EPISODES,
        "warmup": WARMUP,
        "engine": ENGINE,
        "training_seeds": TRAINING_SEEDS,
        "training_worlds": {"one": "world seed 0", "any": _words(WORLDS["train"])},
        "training_steps": STEPS,
        "tracks": {
            track.name: {
                "world_seed": track.world_seed,
                "seeds": list(track.seeds),
                "about": track.about,
            }
            for track in TRACKS.values()
        },
    }


def listing() -> dict[str, Any]:
    """Return all tasks and the protocol as plain data."""
    listed = [
        {
            "task": task.name,
            "size": task.size,
            "about": task.about,
            "scenario_hash": task.scenario_hash,
            "file": str(task.path),
        }
        for task in tasks().values()
    ]
    return {"benchmark": BENCHMARK, "tasks": listed, "protocol": protocol()}


def _words(seeds: range) -> str:
    return f"world seeds {seeds[0]} to {seeds[-1]}"
