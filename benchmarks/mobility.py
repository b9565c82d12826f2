"""How long training takes with each model of mobility and demand, beside the default one.

    python benchmarks/mobility.py [--rounds 7]

Each trains case 8, with the same number of users. The rounds alternate; a figure is the median of
the ratios of CPU times to those with ``random_walk``, or with the demand ``poisson`` at the same
mean rate.
"""

from __future__ import annotations

import argparse
import statistics
import time

from desim_uav.learning.training import Training
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world

EPISODES = 192

WALKS = {
    "random_waypoint": "kind: random_waypoint",
    "gauss_markov": "kind: gauss_markov",
    "gauss_markov, steps of 60 s": "kind: gauss_markov, step_s: 60",
    "manhattan, blocks of 240 m": "kind: manhattan",
    "group": "kind: group",
    "levy": "kind: levy",
}
DEMANDS = {
    "profile": "kind: profile, profiles: [[[0, 12]]]",
    "profile, linear, 24 points": "kind: profile, shape: linear, profiles: [["
    + ", ".join(f"[{hour}, {11 + 2 * (hour % 2)}]" for hour in range(24))
    + "]]",
}
BASES = {
    "users.mobility": ("kind: random_walk", WALKS),
    "demand": ("kind: poisson, rate_per_hour: 12", DEMANDS),
}


def main() -> None:
    """Train and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7)
    rounds = parser.parse_args().rounds
    for key, (base, others) in BASES.items():
        first = trained(f"{key}={{{base}}}")
        for name, model in others.items():
            other = trained(f"{key}={{{model}}}")
            ratios = [timed(other) / timed(first) for _ in range(rounds)]
            print(f"{key}: {name} / {base.split(',')[0][6:]}: {statistics.median(ratios):.2f}")


def trained(override: str) -> Training:
    """A training that has been compiled."""
    training = Training(build_world(load(scenario_path("case8"), [override]), 0), 0, "batch")
    training.play(64)
    return training


def timed(training: Training) -> float:
    """The CPU time of some hundred episodes."""
    start, last = time.process_time(), training.episode + EPISODES
    while training.episode < last:
        training.play(64)
    return time.process_time() - start


if __name__ == "__main__":
    main()
