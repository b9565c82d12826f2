"""Compute the bounds of the benchmark's runs that are not kept yet, and write them into its file.

    python analysis/bench_bounds.py [-j 2] [--anew] [TASK…]

By default those of all tasks are computed; tasks whose model has no proven bound are left out. With
--anew the bounds that are kept are computed again. The bounds of other tasks stay as they are.
"""

from __future__ import annotations

import argparse
import csv
import io
import sys
from collections.abc import Mapping, Sequence
from contextlib import closing

from desim_uav.disk import write_at
from desim_uav.experiment.bench.bounds import COLUMNS, compute, has_bound, kept
from desim_uav.experiment.bench.tasks import TRACKS, BenchTrack, Task, find_task, tasks
from desim_uav.experiment.processes import run_each
from desim_uav.shipped import bench_folder

Key = tuple[str, str, int]


def main() -> None:
    """Compute and write the bounds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-j", dest="jobs", type=int, default=1)
    parser.add_argument("--anew", action="store_true")
    parser.add_argument("tasks", nargs="*", default=[*tasks()])
    asked = parser.parse_args()
    complete(list(map(find_task, asked.tasks)), asked.jobs, anew=asked.anew)


def complete(chosen: Sequence[Task], jobs: int, *, anew: bool = False) -> None:
    """Compute the bounds of tasks that are not kept, or all ``anew``, and write them."""
    found = dict(kept())
    work = [
        (task, track, seeds)
        for task in chosen
        for track in TRACKS.values()
        if has_bound(task, track)
        and (seeds := [s for s in track.seeds if anew or (task.name, track.name, s) not in found])
    ]
    with closing(run_each(bounds, work, jobs)) as ended:
        for number, values in ended:
            task, track, _ = work[number]
            found |= {(task.name, track.name, seed): value for seed, value in values.items()}
            write(found)
            print(f"bounds of {task.name}, track {track.name}", file=sys.stderr)
    kept.cache_clear()


def bounds(task: Task, track: BenchTrack, seeds: Sequence[int]) -> dict[int, float]:
    """Return the bounds of runs by their seeds."""
    found = {seed: compute(task, track, seed) for seed in seeds}
    return {seed: value for seed, value in found.items() if value is not None}


def write(found: Mapping[Key, float]) -> None:
    """Write bounds into the file beside the tasks, in the order of tasks, tracks and seeds."""
    order = list(tasks())
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for key in sorted(found, key=lambda key: (order.index(key[0]), *key[1:])):
        writer.writerow([*key, repr(found[key])])
    write_at(bench_folder() / "bounds.csv", text.getvalue().encode())


if __name__ == "__main__":
    main()
