"""Train PPO and MAPPO for tasks of the benchmark, and submit them to the leaderboard.

    python analysis/leaderboard_ppo.py [-j 2] [PART]

Only what is missing is made: networks in runs/leaderboard, which are not kept, and submissions in
analysis/leaderboard, which are. With PART only those are made whose name contains it. Training
needs PyTorch (pip install -e ".[ppo]"). For each network its steps and its processor time are
printed; ``desim-uav bench board analysis/leaderboard`` makes the tables.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from desim_uav.experiment.bench.run import submit
from desim_uav.experiment.bench.tasks import USUAL, Task, find_task, find_track
from desim_uav.experiment.processes import run_each
from desim_uav.policies.mlp import MlpFile
from desim_uav.run_folder import Place
from desim_uav.scenario.load import loads
from desim_uav.shipped import find_table

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "analysis" / "leaderboard"
MADE = Path("runs") / "leaderboard"

WORLDS = {"one": ("-S", "world_seed=0"), "any": ("--worlds", "train")}
"""The worlds of a training, by the track: world 0, or the 1,024 training worlds."""

KINDS: dict[str, tuple[str, ...]] = {"PPO": (), "MAPPO": ("--central",)}
SEED = 0
"""Of a training: there is one for each network."""

SETTINGS = ("-S", "episode.steps=120", "-S", "reward={kind: qoe, w1: 0.5, crash: 15}")
"""The settings of all trainings; all others are the defaults of ``policies/ppo.py``."""


@dataclass(frozen=True)
class Entry:
    """A row of the leaderboard: an algorithm in a task and track, and where its network is from.

    ``source`` is the file of a shipped network, or the steps of a training in the task. These are
    steps of all drones together, as those of ``policies/ppo.py``; the budgets of the benchmark
    count decision epochs, in which all drones decide.
    """

    task: Task
    track: str
    kind: str
    source: str | int

    @property
    def name(self) -> str:
        """The name of the submission's folder."""
        return f"{self.task.family}-{self.task.size}-{self.track}-{self.said}"

    @property
    def said(self) -> str:
        """What the leaderboard calls it, as part of a file name."""
        return self.kind.lower().replace(" ", "-")

    @property
    def network(self) -> str:
        """The network's file, or the name of a shipped one."""
        if isinstance(self.source, str):
            return self.source
        return str(MADE / f"{self.name}-{SEED}.npz")

    def command(self) -> list[str]:
        """Return the training as a command, to be run in the repository's root."""
        scenario = self.task.path.relative_to(ROOT)
        given = ("--steps", str(self.source), "--seed", str(SEED), "--out", self.network)
        own = (*KINDS[self.kind], *WORLDS[self.track])
        return ["policies/ppo.py", str(scenario), *given, *own, *SETTINGS]


def of(family: str, track: str, kind: str, source: str | int, size: str = USUAL) -> Entry:
    """Return an entry of a task."""
    return Entry(find_task(f"uav-v1/{family}/{size}"), track, kind, source)


ELSEWHERE = "PPO of multi-service"
"""The name of a network that was trained in training worlds of another task."""

ENTRIES = [
    of("multi-service", "one", "PPO", "ppo_case8.npz"),
    of("multi-service", "one", "MAPPO", "mappo_case8.npz"),
    of("multi-service", "any", "PPO", "ppo_case8_any.npz"),
    of("multi-service", "any", "MAPPO", "mappo_case8_any.npz"),
    of("coverage", "one", "PPO", 600_000),
    of("coverage", "one", "MAPPO", 250_000),
    of("coverage", "any", "PPO", 300_000),
    *(
        of(family, track, ELSEWHERE, "ppo_case8_any.npz", size)
        for size in ("medium", "small", "large")
        for family in ("rush", "swarm", "multi-service")
        for track in ("one", "any")
        if (family, size) != ("multi-service", "medium")
    ),
]


def main() -> None:
    """Make what is missing: first all networks, then all submissions."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-j", dest="jobs", type=int, default=1)
    parser.add_argument("part", nargs="?", default="")
    asked = parser.parse_args()
    missing = [
        entry
        for entry in ENTRIES
        if asked.part in entry.name and not (FOLDER / entry.name).exists()
    ]
    MADE.mkdir(parents=True, exist_ok=True)
    work = [(each,) for each in missing if not find_table(each.network).exists()]
    with closing(run_each(trained, work, asked.jobs)) as ended:
        for _, line in ended:
            print(line, flush=True)
    for entry in missing:
        make(entry, asked.jobs)
        print(FOLDER / entry.name, flush=True)


def trained(entry: Entry) -> str:
    """Train a network, and return a line that says what it took."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *entry.command()], cwd=ROOT, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return f"{entry.network}: {spent_s:.0f} s of processor time"


def make(entry: Entry, jobs: int) -> None:
    """Make the submission of an entry."""
    about = MlpFile(find_table(entry.network)).about["training"]
    steps = about["steps_done"] // loads(about["scenario_yaml"]).drones.count
    track = find_track(entry.track)
    command = ["desim-uav", "bench", "run", entry.task.name, "--track", track.name]
    command += ["--policy", entry.network, "--name", entry.kind, "--training-steps", str(steps)]
    submit(
        *(entry.task, track, entry.network, Place(FOLDER / entry.name, entry.name)),
        name=entry.kind,
        training_steps=steps,
        jobs=jobs,
        command=command,
    )


if __name__ == "__main__":
    main()
