"""Compute the bounds of the benchmark's runs anew, and write those of these tasks into its file.

    python analysis/bench_bounds.py TASK…

The bounds of other tasks in ``bounds.csv`` stay as they are.
"""

from __future__ import annotations

import csv
import io
import sys

from desim_uav.experiment.bench.bounds import COLUMNS, compute, kept
from desim_uav.experiment.bench.tasks import TRACKS, find_task, tasks
from desim_uav.run_folder import write_at
from desim_uav.shipped import bench_folder


def main(names: list[str]) -> None:
    """Compute and write the bounds."""
    found = dict(kept())
    for task in map(find_task, names):
        for track in TRACKS.values():
            for seed in track.seeds:
                bound = compute(task, track, seed)
                if bound is not None:
                    found[task.name, track.name, seed] = bound
            print(f"{task.name}, track {track.name}", file=sys.stderr)
    order = list(tasks())
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for key in sorted(found, key=lambda key: (order.index(key[0]), *key[1:])):
        writer.writerow([*key, repr(found[key])])
    write_at(bench_folder() / "bounds.csv", text.getvalue().encode())


if __name__ == "__main__":
    main(sys.argv[1:])
