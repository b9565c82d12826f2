"""How fast training is with a reward of one's own, beside the built-in one that it copies.

    python benchmarks/own_reward.py [--rounds 9]

Both train case 8 with R1: once the built-in, once the same written as a ``RowReward``. The rounds
alternate; the figure is the median of the ratios of CPU times. Aim: 0.8.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desim_uav.learning.training import Training
from desim_uav.model.rewards import RowReward
from desim_uav.rules.words import CRASHED, QUEUED
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world

EPISODES = 256


@dataclass(frozen=True)
class R1(RowReward):
    """The paper's R1, written anew."""

    names = ("users",)

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        """One term: users."""
        if not QUEUED <= drone.mode <= CRASHED:
            share = drone.attached_users * len(state.drones) / len(state.users)
            drone.terms[0] = min(share, 1.0)


def main() -> None:
    """Train and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    rounds = parser.parse_args().rounds
    kinds = ("coverage", f"{Path(__file__).stem}:R1")
    built_in, own = (trained(kind) for kind in kinds)
    ratios = [timed(built_in) / timed(own) for _ in range(rounds)]
    print(f"own reward / built-in, case 8: {statistics.median(ratios):.2f} (aim: 0.8)")


def trained(kind: str) -> Training:
    """A training that has been compiled."""
    world = build_world(load(scenario_path("case8"), [f"reward={{kind: '{kind}'}}"]), 0)
    training = Training(world, 0, "batch")
    training.play(64)
    return training


def timed(training: Training) -> float:
    """The CPU time of some hundred episodes."""
    start, last = time.process_time(), training.episode + EPISODES
    while training.episode < last:
        training.play(64)
    return time.process_time() - start


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))
    main()
