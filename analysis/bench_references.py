"""Compute what the scores of the benchmark's runs refer to: the baseline's results and the bounds.

    python analysis/bench_references.py [-j 2] [--anew] [--seeds 4] [--track any] [TASK…]

Only those that are missing are computed, by default of all tasks; with --anew all of these tasks,
and with --seeds only the first seeds of each track. They are written beside the tasks, and their
hashes into the registry. After Ctrl-C those that were computed are kept.
"""

from __future__ import annotations

import argparse

from script import count

from desim_uav.errors import DesimError
from desim_uav.experiment.bench.kept import complete
from desim_uav.experiment.bench.tasks import TRACKS, find_task, tasks


def main() -> None:
    """Compute and write what is missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-j", dest="jobs", type=count(256), default=1)
    parser.add_argument("--anew", action="store_true")
    parser.add_argument("--seeds", type=count())
    parser.add_argument("--track", choices=[*TRACKS])
    parser.add_argument("tasks", nargs="*", default=[*tasks()])
    asked = parser.parse_args()
    try:
        chosen = list(map(find_task, asked.tasks))
    except DesimError as error:
        parser.error(str(error))
    tracks = [TRACKS[name] for name in ([asked.track] if asked.track else TRACKS)]
    complete(chosen, tracks, asked.jobs, anew=asked.anew, seeds=asked.seeds)


if __name__ == "__main__":
    main()
