"""How much memory a long run takes: its requests are logged, then analysed, as `run` and `qoe` do.

    python benchmarks/long_run.py [--requests 10000000] [--engine batch]

2,000 users at home ask for about ten services each in an episode of 30 minutes; episodes follow
until that many requests are logged. Logging and analysis are a process each; what is told is the
most memory a process has held, less what it held after one episode, and how large the tables are.
They go to a temporary folder, about 90 bytes a request.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SCENARIO = """
name: long_run
users: {count: 2000}
drones: {count: 3, bandwidth_kbps: null, battery: null}
stations: {count: 0}
demand: {kind: poisson, rate_per_hour: 60, mix: {short: 1}}
services:
  short: {kind: uniform_choice, duration_min: [0.25, 0.5], bandwidth_kbps: [10]}
"""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--requests", type=int, default=10_000_000)
    parser.add_argument("--engine", default="batch", choices=["des", "batch"])
    parser.add_argument("--part", choices=["log", "analyse"], help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.part:
        print(json.dumps(log(args) if args.part == "log" else analyse(args.folder)))
        return
    from desim_uav.experiment.interrupt import end_politely

    end_politely()  # and with this process that of a part
    with tempfile.TemporaryDirectory() as folder:
        for part in ("log", "analyse"):
            command = [sys.executable, *sys.argv, "--part", part, "--folder", folder]
            told = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
            print(f"{part}: {', '.join(f'{name} {value:,}' for name, value in told.items())}")


def log(args: argparse.Namespace) -> dict[str, float]:
    from desim_uav.experiment.command import How, place_of, prepare, write_run
    from desim_uav.scenario.load import loads

    scenario = loads(SCENARIO)

    def logged(episodes: int, name: str) -> int:
        how = How(episodes, warmup=0, keep_events=False, engine=args.engine, command=[])
        prepared = prepare(scenario, "baseline", args.engine)
        done = write_run(prepared, how, place_of(scenario, "baseline", args.folder / name))
        return int(done.summary["requests"])

    an_episode = logged(1, "first")
    before, began = most_mib(), time.perf_counter()
    requests = logged(-(-args.requests // an_episode) + 1, "run")
    size = sum(file.stat().st_size for file in (args.folder / "run").iterdir())
    return {
        "requests": requests,
        "seconds": round(time.perf_counter() - began),
        "MiB above": round(most_mib() - before),
        "MiB of tables": round(size / 2**20),
    }


def analyse(folder: Path) -> dict[str, float]:
    from desim_uav.experiment.command import read_summary

    read_summary(folder / "first", "service")
    before, began = most_mib(), time.perf_counter()
    found, _ = read_summary(folder / "run", "service")
    return {
        "requests": found["requests"],
        "seconds": round(time.perf_counter() - began),
        "MiB above": round(most_mib() - before),
    }


def most_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
