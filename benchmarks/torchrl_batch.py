"""Steps per second of CPU time of TorchRL's rollouts: a batch, and a wrapped single environment.

python benchmarks/torchrl_batch.py          (extra torchrl)
"""

from __future__ import annotations

import time
import warnings
from typing import Any

import torch
from torchrl.envs.libs.pettingzoo import PettingZooWrapper

from desim_uav.env import UavParallelEnv
from desim_uav.env.torchrl import UavTorchEnv

LOCAL = {"observation.kind": "local"}
ENVS, DRONES, STEPS, ROUNDS = 32, 3, 120, 5


def rate(env: Any, envs: int) -> float:
    """Steps of all drones per second of CPU time, with random allowed actions."""
    began = time.process_time()
    env.rollout(STEPS, break_when_any_done=False)
    return envs * DRONES * STEPS / (time.process_time() - began)


def main() -> None:
    """Alternate between the two, after a round that compiles."""
    warnings.filterwarnings("ignore")
    torch.set_num_threads(1)
    batch = UavTorchEnv("case8", ENVS, LOCAL, world_seed=0, seed=0)
    plain = UavParallelEnv("case8", LOCAL, world_seed=0, engine="batch")
    single = PettingZooWrapper(plain, return_state=True)
    for round_ in range(ROUNDS + 1):
        of_batch, of_single = rate(batch, ENVS), rate(single, 1)
        if round_:
            times = of_batch / of_single
            print(f"batch {of_batch:9,.0f}   single {of_single:7,.0f}   {times:.1f} times")


if __name__ == "__main__":
    main()
