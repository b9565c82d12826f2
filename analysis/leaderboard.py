"""Make the submissions of the leaderboard that are still missing in analysis/leaderboard.

    python analysis/leaderboard.py [-j 2]

`desim-uav bench board analysis/leaderboard/*` makes the tables of them.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from desim_uav.experiment.bench.run import submit
from desim_uav.experiment.bench.tasks import find_task, find_track
from desim_uav.run_folder import Place

FOLDER = Path(__file__).parent / "leaderboard"
CHEAP = {"random": "random", "hover": "hover", "baseline": "baseline"}
MULTI, COVERAGE = "uav-v1/multi-service/medium", "uav-v1/coverage/medium"
RUSH, URBAN = "uav-v1/rush/medium", "uav-v1/urban/medium"
FEW = 3
"""The seeds of a planner that takes long."""

ROWS: list[tuple[str, str, dict[str, str], int]] = [
    *((MULTI, track, CHEAP | {"Q-learning": "case8.npz"}, 10) for track in ("one", "any")),
    *((COVERAGE, track, CHEAP | {"Q-learning": "case5.npz"}, 10) for track in ("one", "any")),
    *(
        (task, track, {"greedy": "greedy"}, 10)
        for task in (MULTI, COVERAGE)
        for track in ("one", "any")
    ),
    (RUSH, "one", CHEAP | {"Q-learning of case 8": "case8.npz"}, 10),
    (URBAN, "one", CHEAP | {"Q-learning": "urban_downlink.npz"}, 10),
    (MULTI, "one", {"rollout of Q-learning": "rollout:case8.npz"}, 10),
    (MULTI, "one", {"clairvoyant, 10 tries": "clairvoyant:tries=10"}, FEW),
    (COVERAGE, "one", {"clairvoyant, 10 tries": "clairvoyant:tries=10"}, FEW),
]
"""Tasks, tracks, policies by the names that the leaderboard gives them, and numbers of seeds."""


def main() -> None:
    """Make what is missing, row by row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-j", dest="jobs", type=int, default=1)
    jobs = parser.parse_args().jobs
    for task_name, track_name, policies, seeds in ROWS:
        task, track = find_task(task_name), find_track(track_name)
        for name, policy in policies.items():
            label = "".join(c if c.isalnum() else "-" for c in name.lower())
            folder = FOLDER / f"{task.family}-{task.size}-{track.name}-{label}"
            if folder.exists():
                continue
            since_s = time.perf_counter()
            command = ["desim-uav", "bench", "run", task.name, "--track", track.name]
            command += ["--policy", policy, "--name", name, "--seeds", str(seeds)]
            submit(
                *(task, track, policy, Place(folder, label)),
                name=name,
                seeds=track.seeds[:seeds],
                jobs=jobs,
                command=command,
            )
            print(f"{folder.name}: {time.perf_counter() - since_s:.1f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
