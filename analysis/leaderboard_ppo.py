"""Train PPO and MAPPO for tasks of the benchmark, and submit them to the leaderboard.

    python analysis/leaderboard_ppo.py [-j 2] [PART]

Only what is missing is made: networks in runs/leaderboard, which are not kept, and submissions in
analysis/leaderboard, which are. With PART only those are made whose name contains it. First all
networks of the first seed are trained, then those of the second one, and so on, so that after
Ctrl-C all algorithms have about as many trainings; --trainings N submits the first N. The processor
times are kept in leaderboard_times.csv; ``desim-uav bench board analysis/leaderboard`` makes the
tables.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import leaderboard_times

from desim_uav.errors import PolicyError
from desim_uav.experiment.bench.run import submit
from desim_uav.experiment.bench.submission import read
from desim_uav.experiment.bench.tasks import USUAL, Task, find_task, find_track
from desim_uav.experiment.processes import run_each
from desim_uav.policies.mlp import MlpFile
from desim_uav.run_folder import RunPlace
from desim_uav.scenario.load import loads
from desim_uav.shipped import find_table

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "analysis" / "leaderboard"
MADE = Path("runs") / "leaderboard"

WORLDS = {"one": ("-S", "world_seed=0"), "any": ("--worlds", "train")}
"""The worlds of a training, by the track: world 0, or the 1,024 training worlds."""

KINDS: dict[str, tuple[str, ...]] = {"PPO": (), "MAPPO": ("--central",)}
TRAININGS = 10

SETTINGS = ("-S", "episode.steps=120", "-S", "reward={kind: qoe, w1: 0.5, crash: 15}")
"""The settings of all trainings; all others are the defaults of ``policies/ppo.py``."""


@dataclass(frozen=True)
class Entry:
    """A row of the leaderboard: an algorithm in a task and track, and where its networks are from.

    ``source`` is the file of a shipped network, or the steps of each of so many ``trainings`` in
    the task. These are steps of all drones together, as those of ``policies/ppo.py``; the budgets
    of the benchmark count decision epochs, in which all drones decide.
    """

    task: Task
    track: str
    kind: str
    source: str | int
    trainings: int = 1

    @property
    def name(self) -> str:
        """The name of the submission's folder."""
        return f"{self.task.family}-{self.task.size}-{self.track}-{self.said}"

    @property
    def said(self) -> str:
        """What the leaderboard calls it, as part of a file name."""
        return self.kind.lower().replace(" ", "-")

    def network(self, seed: int) -> str:
        """Return the network's file, or the name of a shipped one."""
        if isinstance(self.source, str):
            return self.source
        return str(MADE / f"{self.name}-{seed}.npz")

    def there(self) -> list[str]:
        """Return the networks that are there, of the first seeds."""
        names = [self.network(seed) for seed in range(self.trainings)]
        missing = [not find_table(name).exists() for name in names]
        return names[: missing.index(True) if True in missing else None]

    def command(self, seed: int, out: Path) -> list[str]:
        """Return the training as a command, to be run in the repository's root."""
        scenario = self.task.path.relative_to(ROOT)
        given = ("--steps", str(self.source), "--seed", str(seed), "--out", str(out))
        own = (*KINDS[self.kind], *WORLDS[self.track])
        return ["policies/ppo.py", str(scenario), *given, *own, *SETTINGS]

    def submitted(self) -> int:
        """Return how many trainings have been submitted."""
        try:
            return len(read(FOLDER / self.name).about.trainings)
        except PolicyError:
            return 0


def of(
    family: str,
    track: str,
    kind: str,
    source: str | int,
    size: str = USUAL,
    trainings: int = 1,
) -> Entry:
    """Return an entry of a task."""
    return Entry(find_task(f"uav-v1/{family}/{size}"), track, kind, source, trainings)


ELSEWHERE = "PPO of multi-service"
"""The name of a network that was trained in training worlds of another task."""

STEPS, STEPS_SMALL = 1_200_000, 300_000

ENTRIES = [
    *(
        of(family, track, kind, STEPS_SMALL, "small", TRAININGS)
        for family in ("coverage", "multi-service")
        for track in ("one", "any")
        for kind in KINDS
    ),
    *(
        of("multi-service", track, kind, STEPS, trainings=TRAININGS)
        for track in ("any", "one")
        for kind in KINDS
    ),
    of("coverage", "one", "PPO", 600_000),
    of("coverage", "one", "MAPPO", 250_000),
    of("coverage", "any", "PPO", 300_000),
    *(
        of("multi-service", track, ELSEWHERE, "ppo_case8_any.npz", size)
        for size in ("small", "large")
        for track in ("one", "any")
    ),
]


def main() -> None:
    """Make what is missing: first all networks, then all submissions."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-j", dest="jobs", type=int, default=1)
    parser.add_argument("--trainings", type=int, default=TRAININGS)
    parser.add_argument("part", nargs="?", default="")
    asked = parser.parse_args()
    complete(asked.part, asked.jobs, asked.trainings)


def complete(part: str, jobs: int, trainings: int = TRAININGS) -> None:
    """Make what is missing of the entries whose name contains ``part``."""
    missing = [
        entry
        for entry in ENTRIES
        if part in entry.name and entry.submitted() < min(trainings, entry.trainings)
    ]
    work = [
        (entry, seed)
        for seed in range(trainings)
        for entry in missing
        if seed < entry.trainings and not find_table(entry.network(seed)).exists()
    ]
    MADE.mkdir(parents=True, exist_ok=True)
    with closing(run_each(trained, work, jobs)) as ended:
        for number, spent_s in ended:
            entry, seed = work[number]
            leaderboard_times.keep(FOLDER, {f"training of {entry.name}-{seed}": spent_s})
            print(f"{entry.network(seed)}: {spent_s:.0f} s of processor time", flush=True)
    for entry in missing:
        networks = entry.there()[:trainings]
        if len(networks) > entry.submitted():
            leaderboard_times.keep(FOLDER, {entry.name: make(entry, networks, jobs)})
            print(FOLDER / entry.name, flush=True)


def told_missing(part: str = "") -> list[str]:
    """Return the rows of networks that are missing, or have fewer trainings than they should."""
    return [
        f"{entry.task.family}, {entry.task.size}, track {entry.track}: {entry.kind}, "
        f"{entry.submitted()} of {entry.trainings} trainings"
        for entry in ENTRIES
        if part in entry.name and entry.submitted() < entry.trainings
    ]


def trained(entry: Entry, seed: int) -> float:
    """Train a network, and return the processor time that it took, in seconds.

    The network has its name only after the training: an interrupted one leaves a network, too.
    """
    since_s, place = leaderboard_times.spent_s(), ROOT / entry.network(seed)
    new = place.with_name(f"new-{place.name}")
    subprocess.run(
        [sys.executable, *entry.command(seed, new.relative_to(ROOT))], cwd=ROOT, check=True
    )
    new.replace(place)
    return leaderboard_times.spent_s() - since_s


def make(entry: Entry, networks: Sequence[str], jobs: int) -> float:
    """Make the submission of an entry, and return the processor time that it took."""
    since_s = leaderboard_times.spent_s()
    about = MlpFile(find_table(networks[0])).about["training"]
    steps = about["steps_done"] // loads(about["scenario_yaml"]).drone_count
    track, place = find_track(entry.track), FOLDER / entry.name
    command = ["desim-uav", "bench", "run", entry.task.name, "--track", track.name]
    command += [word for network in networks for word in ("--policy", network)]
    command += ["--name", entry.kind, "--training-steps", str(steps)]
    new = MADE / "new" / entry.name
    shutil.rmtree(new, ignore_errors=True)
    submit(
        *(entry.task, track, networks, RunPlace(new, new.name)),
        name=entry.kind,
        training_steps=steps,
        jobs=jobs,
        command=command,
    )
    shutil.rmtree(place, ignore_errors=True)
    shutil.move(new, place)
    return leaderboard_times.spent_s() - since_s


if __name__ == "__main__":
    main()
