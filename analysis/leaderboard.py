"""Make the submissions of the leaderboard that are still missing in analysis/leaderboard.

    python analysis/leaderboard.py [-j 2] [PART]

With PART only those are made whose folder's name contains it. Tables that do not ship are trained
first, in world 0 with the settings of the task, into runs/. `desim-uav bench board
analysis/leaderboard` makes the tables of them.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import desim_uav as du
from desim_uav.experiment.bench.run import submit
from desim_uav.experiment.bench.tasks import Task, find_task, find_track
from desim_uav.run_folder import Place

FOLDER = Path(__file__).parent / "leaderboard"
CHEAP = {"random": "random", "hover": "hover", "baseline": "baseline"}
SARSA, OWN = {"SARSA": "train:sarsa"}, {"Q-learning": "train:q_learning"}
GREEDY = {"greedy": "greedy"}
ROLLOUT = {"rollout of Q-learning": "rollout:case8.npz"}
CLAIRVOYANT = {"clairvoyant, 10 tries": "clairvoyant:tries=10"}
MULTI, COVERAGE = "uav-v1/multi-service/medium", "uav-v1/coverage/medium"
RUSH, URBAN = "uav-v1/rush/medium", "uav-v1/urban/medium"

ROWS: list[tuple[str, str, dict[str, str], int]] = [
    (MULTI, "one", CHEAP | {"Q-learning": "case8.npz"} | SARSA | GREEDY, 10),
    (MULTI, "any", CHEAP | {"Q-learning": "case8.npz"} | SARSA | GREEDY, 10),
    (COVERAGE, "one", CHEAP | {"Q-learning": "case5.npz"} | SARSA | GREEDY, 10),
    (COVERAGE, "any", CHEAP | {"Q-learning": "case5.npz"} | SARSA | GREEDY, 10),
    (RUSH, "one", CHEAP | OWN | SARSA | GREEDY, 10),
    (URBAN, "one", CHEAP | {"Q-learning": "urban_downlink.npz"}, 10),
    (MULTI, "one", ROLLOUT, 10),
    (MULTI, "one", CLAIRVOYANT, 3),
    (COVERAGE, "one", CLAIRVOYANT, 3),
]
"""Tasks, tracks, policies by the names that the leaderboard gives them, and numbers of seeds."""


def main() -> None:
    """Make what is missing, row by row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-j", dest="jobs", type=int, default=1)
    parser.add_argument("part", nargs="?", default="")
    asked = parser.parse_args()
    for task, track, policies, seeds in ROWS:
        for name, policy in policies.items():
            folder = FOLDER / _label(find_task(task), track, name)
            if not folder.exists() and asked.part in folder.name:
                since_s = time.perf_counter()
                make(folder, task, track, name, policy, seeds, asked.jobs)
                print(f"{folder.name}: {time.perf_counter() - since_s:.1f} s", file=sys.stderr)


def make(
    folder: Path, task_name: str, track_name: str, name: str, policy: str, seeds: int, jobs: int
) -> None:
    """Make one submission."""
    task, track = find_task(task_name), find_track(track_name)
    if policy.startswith("train:"):
        policy = trained(task, policy.removeprefix("train:"))
    command = ["desim-uav", "bench", "run", task.name, "--track", track.name]
    command += ["--policy", policy, "--name", name, "--seeds", str(seeds)]
    submit(
        *(task, track, policy, Place(folder, folder.name)),
        name=name,
        seeds=track.seeds[:seeds],
        jobs=jobs,
        command=command,
    )


def trained(task: Task, algorithm: str) -> str:
    """Return the file of a table that was trained in world 0 of a task; train it if it is not."""
    folder = Path("runs") / f"leaderboard-{task.family}-{task.size}-{algorithm}"
    if not folder.exists():
        du.train(task.path, world_seed=0, algorithm=algorithm, out=folder)
    return str(folder / "policy.npz")


def _label(task: Task, track: str, name: str) -> str:
    said = "".join(letter if letter.isalnum() else "-" for letter in name.lower())
    return f"{task.family}-{task.size}-{track}-{said}"


if __name__ == "__main__":
    main()
