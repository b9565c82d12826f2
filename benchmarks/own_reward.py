"""How fast training is with components of one's own, beside the built-in ones that they copy.

    python benchmarks/own_reward.py [--rounds 9]

Each trains case 8: once with the built-in component, once with the same written anew. The rounds
alternate; the figure is the median of the ratios of CPU times. Aim: 0.8.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from desim_uav.learning.training import Training
from desim_uav.model.demand.asking import RowDemand, ask_for_mix
from desim_uav.model.mobility.walking import RowMobility, go_on
from desim_uav.model.random.streams import exponential_us, heading
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


@dataclass(frozen=True)
class Walk(RowMobility):
    """The random walk, written anew."""

    speed_mps: float = 1.4
    leg_s: float = 60.0
    remembers: ClassVar = {"turn_us": int}

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        """Walk to a turn or to the edge of the map."""
        if walker.t_us == walker.turn_us:
            x, y = heading(stream)
            walker.vx_mps, walker.vy_mps = self.speed_mps * x, self.speed_mps * y
            walker.turn_us += int(self.leg_s * 1e6)
        go_on(walker, area, walker.turn_us)


@dataclass(frozen=True)
class Thinking(RowDemand):
    """The demand ``dynamic``, written anew."""

    think_time_s: float = 300.0

    def next_request(self, asker: Any, stream: Any, services: Any) -> None:
        """Ask at the start, and then after a think time each."""
        asker.wait_us = 0
        if asker.draws > 0:
            asker.wait_us = exponential_us(stream, self.think_time_s)
        ask_for_mix(asker, stream, services, 0.0)


MIX = ", ".join(f"{name}: 1" for name in ("throughput", "edge_computing", "data_gathering"))
COMPARED = {
    "reward": ("reward", "kind: coverage", "R1"),
    "mobility": ("users.mobility", "kind: random_walk", "Walk"),
    "demand": ("demand", f"kind: dynamic, mix: {{{MIX}}}", "Thinking"),
}
"""The key of each component, the built-in one, and the class that copies it."""


def main() -> None:
    """Train and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    rounds = parser.parse_args().rounds
    for name, (key, built_in, copy) in COMPARED.items():
        own = f"kind: '{Path(__file__).stem}:{copy}'"
        one, other = trained(f"{key}={{{built_in}}}"), trained(f"{key}={{{own}}}")
        ratios = [timed(one) / timed(other) for _ in range(rounds)]
        print(f"own {name} / built-in, case 8: {statistics.median(ratios):.2f} (aim: 0.8)")


def trained(override: str) -> Training:
    """A training that has been compiled."""
    world = build_world(load(scenario_path("case8"), [override]), 0)
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
