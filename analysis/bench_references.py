"""Compute what the scores of the benchmark's runs refer to: the baseline's results and the bounds.

    python analysis/bench_references.py [-j 2] [--anew] [TASK…]

Only those that are missing are computed, by default of all tasks; with --anew all of these tasks.
They are written beside the tasks, and their hashes into the registry.
"""

from __future__ import annotations

import argparse

from desim_uav.experiment.bench.kept import complete
from desim_uav.experiment.bench.tasks import TRACKS, find_task, tasks


def main() -> None:
    """Compute and write what is missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-j", dest="jobs", type=int, default=1)
    parser.add_argument("--anew", action="store_true")
    parser.add_argument("tasks", nargs="*", default=[*tasks()])
    asked = parser.parse_args()
    chosen = list(map(find_task, asked.tasks))
    complete(chosen, [*TRACKS.values()], asked.jobs, anew=asked.anew)


if __name__ == "__main__":
    main()
