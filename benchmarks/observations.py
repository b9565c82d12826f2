"""How long the compiled engine takes to write observations, and to keep account for the reward qoe.

    python benchmarks/observations.py [--rounds 7]

It plays case 8, and prints as a Markdown table, for each observation: the number of features of
the three drones, the time to write them, the time of a step of a vector environment of 64
environments, and the size of what this step returns. Below are the times of a step of training
with each reward. All are CPU times per decision epoch, the least of the rounds, which alternate.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from desim_uav import UavVectorEnv
from desim_uav.engine.compiled.calls import constants_at, state_at
from desim_uav.learning.training import Training
from desim_uav.rowcode.compiled_rows import call
from desim_uav.rowcode.kernels import kernel
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world

OBSERVATIONS: dict[str, dict[str, Any]] = {
    "local": {"kind": "local"},
    "team": {"kind": "team"},
    "radar": {"kind": "radar"},
    "radar, scales: 1": {"kind": "radar", "scales": 1},
    "radar, 7 x 7": {"kind": "radar", "cells_x": 7, "cells_y": 7},
}
REWARDS = ("multi_service", "qoe")
ENVS, STEPS, WRITES, EPISODES = 64, 30, 20_000, 150


@kernel
def describe_often(world: int, state: int, times: int) -> None:
    """Write the observations of all drones so many times."""
    w, s = constants_at(world), state_at(state)
    for _ in range(times):
        call(w.describe, (w, s))


def in_us(act: Callable[[], object], count: int) -> float:
    """The CPU time of an act in µs, per one of so many things that it does."""
    start = time.process_time()
    act()
    return (time.process_time() - start) / count * 1e6


class Flown:
    """A vector environment in the middle of its episodes."""

    def __init__(self, observation: dict[str, Any]) -> None:
        self.env = UavVectorEnv("case8", ENVS, {"observation": observation}, world_seed=0)
        self.env.reset(seed=0)
        self.rng = np.random.default_rng(0)
        self.steps(12)
        self.write = self.step = np.inf

    def steps(self, count: int) -> None:
        """Take random steps."""
        for _ in range(count):
            self.seen, *_ = self.env.step(self.rng.integers(0, 9, (ENVS, 3)))

    def measure(self) -> None:
        """Measure once more."""
        world, _, state = self.env.outputs.addresses[0, :3].tolist()
        often = in_us(lambda: describe_often(world, state, WRITES), WRITES)
        self.write = min(self.write, often)
        self.step = min(self.step, in_us(lambda: self.steps(STEPS), STEPS * ENVS))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7)
    rounds = parser.parse_args().rounds
    flown = {name: Flown(observation) for name, observation in OBSERVATIONS.items()}
    trained = {
        kind: Training(
            build_world(load(scenario_path("case8"), [f"reward={{kind: {kind}}}"]), 0), 0, "batch"
        )
        for kind in REWARDS
    }
    for training in trained.values():
        training.play(EPISODES)
    least = dict.fromkeys(REWARDS, np.inf)
    for _ in range(rounds):
        for one in flown.values():
            one.measure()
        for kind, training in trained.items():
            own = in_us(lambda one=training: one.play(EPISODES), EPISODES * 30)
            least[kind] = min(least[kind], own)
    print("| Observation | Features | Writing, µs | A step, µs | Bytes returned |")
    print("| --- | --- | --- | --- | --- |")
    for name, one in flown.items():
        size = one.seen[0].nbytes
        print(f"| `{name}` | {one.seen.shape[1]} | {one.write:.2f} | {one.step:.1f} | {size:,} |")
    print()
    for kind, lasted in least.items():
        print(f"training with {kind}: {lasted:.2f} µs a step")


if __name__ == "__main__":
    main()
