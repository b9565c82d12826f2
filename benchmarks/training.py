"""Steps a second of training, compiled and with SimPy, in one run.

    python benchmarks/training.py [--rounds 5] [--cases 1,8]

Both learn the same numbers. Episodes alternate between the two, so that whatever else the machine
does meets both. CPU time of one process; medians of the rounds.
"""

from __future__ import annotations

import argparse
import statistics
import time

from desim_uav.learning.training import Training
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world

EPISODES = {"des": 20, "batch": 200}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--cases", default="1,4,8")
    args = parser.parse_args()
    print(f"{'':8}{'SimPy':>12}{'compiled':>12}{'ratio':>8}   steps/s")
    for case in args.cases.split(","):
        rates = measured(f"case{case}", args.rounds)
        simpy, compiled = (statistics.median(rates[engine]) for engine in EPISODES)
        print(f"case {case:3}{simpy:12.0f}{compiled:12.0f}{compiled / simpy:8.1f}")


def measured(case: str, rounds: int) -> dict[str, list[float]]:
    """Steps a second in each round, by engine."""
    scenario = load(scenario_path(case))
    world = build_world(scenario, 0)
    trainings = {engine: Training(world, 0, engine) for engine in EPISODES}
    rates: dict[str, list[float]] = {engine: [] for engine in EPISODES}
    for training in trainings.values():
        for _ in range(20):  # compiled, and no longer at the very beginning
            training.play()
    for _ in range(rounds):
        for engine, training in trainings.items():
            start = time.process_time()
            left = EPISODES[engine]
            while left:
                left -= len(training.play(left)) // len(training.learners)
            steps = EPISODES[engine] * scenario.episode.steps
            rates[engine].append(steps / (time.process_time() - start))
    return rates


if __name__ == "__main__":
    main()
