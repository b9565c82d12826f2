"""Make the whole leaderboard: references, bounds, trainings, submissions, tables and figure.

    python analysis/leaderboard.py [-j 2] [--missing] [PART]

Only what is missing or out of date is made: submissions in analysis/leaderboard, and the policies
that are trained for them, in runs/leaderboard. With PART only those submissions are made whose
folder's name contains it; with --missing they are only listed. The tables and the performance
profile are then made of all submissions that are there. This calls leaderboard_ppo.py for the
networks.

The processor time of each training and of each submission is kept in leaderboard_times.csv. At the
end that of this call and the sum of all that are kept are printed.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import leaderboard_ppo
import leaderboard_times

import desim_uav as du
from desim_uav.errors import PolicyError
from desim_uav.experiment.bench.kept import complete
from desim_uav.experiment.bench.run import submit
from desim_uav.experiment.bench.submission import read
from desim_uav.experiment.bench.tasks import (
    FAMILIES,
    SIZES,
    TRACKS,
    TRAINING_SEEDS,
    BenchTrack,
    Task,
    find_task,
    tasks,
)
from desim_uav.experiment.processes import run_each
from desim_uav.run_folder import RunPlace

FOLDER = Path(__file__).parent / "leaderboard"
MADE = Path("runs") / "leaderboard"

BUILT_IN, GREEDY = ("random", "hover", "baseline"), "greedy"
LEARNED = {"Q-learning": "q_learning", "SARSA": "sarsa"}
ROLLOUT, CLAIRVOYANT = "rollout of Q-learning", "clairvoyant, 10 tries"
SEARCHED = {
    *((family, size) for family in ("coverage", "multi-service") for size in ("small", "medium")),
    ("urban", "small"),
}
"""The tasks in which the planners fly that search by simulations: families and sizes."""


@dataclass(frozen=True)
class Table:
    """A table that is trained in world 0 with the task's settings, and where it is kept."""

    task: Task
    algorithm: str
    seed: int

    @property
    def place(self) -> Path:
        """The file of the table."""
        name = f"{self.task.family}-{self.task.size}-{self.algorithm}-{self.seed}"
        return MADE / name / "policy.npz"


@dataclass(frozen=True)
class Entry:
    """What flies in a task: its name on the leaderboard, its tracks, and its trainings."""

    task: Task
    name: str
    tracks: Sequence[str] = tuple(TRACKS)
    trainings: int = 0

    def label(self, track: str) -> str:
        """Return the name of a submission's folder."""
        said = "".join(letter if letter.isalnum() else "-" for letter in self.name.lower())
        return f"{self.task.family}-{self.task.size}-{track}-{said}"

    def policies(self) -> list[str]:
        """Return the policies that fly, of which those that are learned may have to be trained."""
        if self.name == CLAIRVOYANT:
            return ["clairvoyant:tries=10"]
        before = "rollout:" if self.name == ROLLOUT else ""
        return [f"{before}{table.place}" for table in self.tables()] or [self.name]

    def tables(self) -> list[Table]:
        """Return the tables that fly, or that a planner continues with."""
        algorithm, many = {ROLLOUT: ("q_learning", 1)}.get(
            self.name, (LEARNED.get(self.name, ""), self.trainings)
        )
        return [Table(self.task, algorithm, seed) for seed in range(many)]

    def training_steps(self) -> int | None:
        """Return the decision epochs of a training; None if nothing is trained."""
        if self.name in (*BUILT_IN, GREEDY, CLAIRVOYANT):
            return None
        scenario = self.task.scenario(TRACKS["one"])
        return scenario.learning.episodes * scenario.episode.steps


def entries() -> Iterator[Entry]:
    """Yield what the leaderboard has, what is cheap first."""
    known = [find_task(f"uav-v1/{family}/{size}") for size in SIZES for family in FAMILIES]
    yield from (Entry(task, name) for task in known for name in BUILT_IN)
    for task in known:
        if not task.scenario(TRACKS["one"]).free:  # tables choose among actions
            yield from (Entry(task, name, trainings=TRAINING_SEEDS) for name in LEARNED)
    yield from (Entry(task, GREEDY) for task in known if task.size == SIZES[0])
    for name in (ROLLOUT, CLAIRVOYANT):
        searched = [task for task in known if (task.family, task.size) in SEARCHED]
        yield from (Entry(task, name, ("one",)) for task in searched)
    yield from (Entry(task, GREEDY) for task in known if task.size != SIZES[0])


def main() -> None:
    """Make what is missing, then the tables and the figure of all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-j", dest="jobs", type=int, default=1)
    parser.add_argument("--missing", action="store_true")
    parser.add_argument("part", nargs="?", default="")
    asked = parser.parse_args()
    if asked.missing:
        print(*told_missing(asked.part), sep="\n")
        return
    since_s, work = time.perf_counter(), missing(asked.part)
    chosen = [task for task in tasks().values() if task in [e.task for e, _ in work]]
    complete(chosen, [*TRACKS.values()], asked.jobs)
    train_all([entry for entry, _ in work], asked.jobs)
    with closing(run_each(make, work, asked.jobs)) as ended:
        for number, spent_s in ended:
            entry, tracks = work[number]
            leaderboard_times.keep(FOLDER, spent_s)
            total_s = sum(spent_s.values())
            print(f"{', '.join(map(entry.label, tracks))}: {total_s:.1f} s of processor time")
            sys.stdout.flush()
    leaderboard_ppo.complete(asked.part, asked.jobs)
    page = MADE / "leaderboard.md"
    du.bench_board([FOLDER], out=page, figure=page.with_suffix(".svg"))
    print(
        f"{page}: {len(work)} of {len([*entries()])} entries were made, "
        f"{leaderboard_times.spent_s():.0f} s of processor time, "
        f"{time.perf_counter() - since_s:.0f} s in all"
    )
    kept_s = leaderboard_times.kept(FOLDER)
    print(f"in all {sum(kept_s.values()):.0f} s of processor time for {len(kept_s)} parts")


def missing(part: str = "") -> list[tuple[Entry, list[str]]]:
    """Return what is missing or out of date, and in which tracks."""
    found = []
    for entry in entries():
        asked = [name for name in entry.tracks if part in entry.label(name)]
        tracks = [name for name in asked if not is_up_to_date(entry, TRACKS[name])]
        if tracks:
            found.append((entry, tracks))
    return found


def told_missing(part: str = "") -> list[str]:
    """Return the rows that are missing, and those with fewer trainings than the protocol asks."""
    rows = [
        f"{entry.task.family}, {entry.task.size}, track {track}: {entry.name}"
        for entry, tracks in missing(part)
        for track in tracks
    ]
    return rows + leaderboard_ppo.told_missing(part)


def is_up_to_date(entry: Entry, track: BenchTrack) -> bool:
    """Return whether a submission is there, of this version of the task, with all its runs."""
    try:
        found = read(FOLDER / entry.label(track.name))
    except PolicyError:
        return False
    return (
        found.about.seeds == [*track.seeds]
        and len(found.about.trainings) == max(1, entry.trainings)
        and not found.about.interrupted
    )


def train_all(entries: Sequence[Entry], jobs: int) -> None:
    """Train the tables that fly and are not there, each once though several entries need it."""
    tables = {table: None for entry in entries for table in entry.tables()}
    work = [(table,) for table in tables if not table.place.exists()]
    with closing(run_each(trained, work, jobs)) as ended:
        for number, spent_s in ended:
            name = work[number][0].place.parent.name
            leaderboard_times.keep(FOLDER, {f"training of {name}": spent_s})
            print(f"{name}: {spent_s:.1f} s of processor time", flush=True)


def trained(table: Table) -> float:
    """Train a table, and return the processor time that it took, in seconds."""
    since_s = time.process_time()
    learned = du.train(
        table.task.path, algorithm=table.algorithm, seed=table.seed, world_seed=0, progress=False
    )
    learned.save(table.place.parent)
    return time.process_time() - since_s


def make(entry: Entry, tracks: Sequence[str]) -> dict[str, float]:
    """Make the submissions of an entry that are out of date.

    Returns the processor time of each in seconds. The tables that fly are there.
    """
    spent_s: dict[str, float] = {}
    policies, steps = entry.policies(), entry.training_steps()
    for track in (TRACKS[name] for name in tracks):
        if is_up_to_date(entry, track):
            continue
        since_s = time.process_time()
        folder, new = (where / entry.label(track.name) for where in (FOLDER, MADE / "new"))
        shutil.rmtree(new, ignore_errors=True)
        command = ["desim-uav", "bench", "run", entry.task.name, "--track", track.name]
        command += [word for policy in policies for word in ("--policy", policy)]
        command += ["--name", entry.name]
        command += [] if steps is None else ["--training-steps", str(steps)]
        submit(
            *(entry.task, track, policies, RunPlace(new, new.name)),
            name=entry.name,
            training_steps=steps,
            command=command,
        )
        shutil.rmtree(folder, ignore_errors=True)
        shutil.move(new, folder)
        spent_s[entry.label(track.name)] = time.process_time() - since_s
    return spent_s


if __name__ == "__main__":
    main()
