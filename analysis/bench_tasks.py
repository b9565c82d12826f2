"""Do the benchmark's tasks tell policies apart, and is there something left to gain?

    python analysis/bench_tasks.py [-j 2] [--seeds 6] [FAMILY…]

Flies the policies that need no training, and one that is trained in world 0, in the small task of
each family, in track one. A table has their scores with intervals, and their paired differences
from the best one that knows no future. Submissions and trainings are kept in runs/bench_tasks, and
only those that are missing are made; references and bounds are written beside the tasks.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from script import row

import desim_uav as du
from desim_uav.errors import PolicyError
from desim_uav.experiment.bench.board import board
from desim_uav.experiment.bench.kept import complete
from desim_uav.experiment.bench.score import Interval
from desim_uav.experiment.bench.submission import read, read_all
from desim_uav.experiment.bench.tasks import FAMILIES, TRACKS, Task, find_task

MADE = Path("runs") / "bench_tasks"
TRACK = TRACKS["one"]
EVERYWHERE = ("baseline", "hover", "random", "greedy")
LEARNED, ROLLOUT = "learned", "rollout of learned"
ALSO = {"harvest": ("tour",), "coverage": (ROLLOUT,), "multi-service": ("ppo_case8_any.npz",)}
SHIPPED = {"coverage": "case4.npz"}
"""Tables that come with the package, where a task has the scenario of a case."""

PPO_STEPS = 400_000
"""The steps of a network that flies freely, where no table can; tables are trained as the task's
key ``learning`` says."""


def main() -> None:
    """Make what is missing, and print a table for each family."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-j", dest="jobs", type=int, default=1)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("families", nargs="*", default=[*FAMILIES])
    asked = parser.parse_args()
    for family in asked.families:
        task = find_task(f"uav-v1/{family}/small")
        complete([task], [TRACK], asked.jobs, seeds=asked.seeds)
        names = (*EVERYWHERE, *ALSO.get(family, ()), LEARNED)
        folders = [flown(task, name, asked.seeds, asked.jobs) for name in names]
        (table,) = board(read_all(folders))
        print(f"\n{task.name}\n")
        print(row(["Policy", "Score", "Less than the best by", *table["measures"], "Crashes"]))
        print(row(["---"] * (4 + len(table["measures"]))))
        for one in table["rows"]:
            measures = [f"{one[name].value:.4g}" for name in table["measures"]]
            crashes = f"{one['crashes_per_drone_episode']:.3f}"
            print(
                row([one["policy"], *map(cell, (one["score"], one["to_best"])), *measures, crashes])
            )
        sys.stdout.flush()


def trained(task: Task) -> Path:
    """Return a table that was trained in world 0 or, for free flight, a network."""
    if task.family in SHIPPED:
        return Path(SHIPPED[task.family])
    file = MADE / f"{task.family}-learned" / "policy.npz"
    if not file.exists() and task.scenario(TRACK).free:
        file.parent.mkdir(parents=True, exist_ok=True)
        script = Path(__file__).parents[1] / "policies" / "ppo.py"
        asked = ["--steps", str(PPO_STEPS), "--out", str(file), "-S", "world_seed=0"]
        subprocess.run([sys.executable, str(script), str(task.path), *asked], check=True)
    elif not file.exists():
        du.train(task.path, seed=0, world_seed=0, progress=False).save(file.parent)
    return file


def flown(task: Task, name: str, seeds: int, jobs: int) -> Path:
    """Return the folder of a submission, which is made if it is missing or has other seeds."""
    folder = MADE / f"{task.family}-{name.replace(' ', '-').removesuffix('.npz')}-flown"
    try:
        if len(read(folder).about.seeds) == seeds:
            return folder
    except PolicyError:
        pass
    policy = {LEARNED: "", ROLLOUT: "rollout:"}.get(name, name)
    policy += str(trained(task)) if name in (LEARNED, ROLLOUT) else ""
    return du.bench_run(
        task.name, policy, seeds=seeds, name=name, out=folder, jobs=jobs, progress=False
    ).folder


def cell(interval: Interval | None) -> str:
    """Return a value with its interval."""
    if interval is None:
        return ""
    return f"{interval.value:.3f} [{interval.low:.3f}, {interval.high:.3f}]"


if __name__ == "__main__":
    main()
