"""Measure what a newcomer meets: random masked actions in a Gymnasium loop, with nothing compiled.

    python benchmarks/newcomer.py [--seconds 20]

It makes an empty folder of machine code, and in it plays ``gymnasium.make("desim_uav/Case8-v0")``
in a process of its own. It prints when the first step had been taken (in seconds since the import
began), when the compiled engine took over, and the rate of steps from then on as a share of that of
an environment with ``engine="batch"``, with which it alternates.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from typing import Any

PIECE = 500
"""The steps between two looks at the clock."""


def played(env: Any, rng: Any, steps: int) -> float:
    """Take so many random allowed steps; return the seconds of processor time that they took."""
    import numpy as np

    drones = len(env.action_space.nvec)
    begun = time.process_time()
    for _ in range(steps):
        masks = env.unwrapped.action_masks().reshape(drones, -1)
        _, _, terminated, truncated, _ = env.step(
            [int(rng.choice(np.flatnonzero(mask))) for mask in masks]
        )
        if terminated or truncated:
            env.reset()
    return time.process_time() - begun


def newcomer(seconds: float) -> None:
    """Play, and print what was met."""
    begun = time.perf_counter()
    import gymnasium
    import numpy as np

    import desim_uav  # noqa: F401

    rng = np.random.default_rng(0)
    env = gymnasium.make("desim_uav/Case8-v0")
    _, info = env.reset(seed=0)
    played(env, rng, 1)
    print(
        f"first step after {time.perf_counter() - begun:.1f} s "
        f"({time.process_time():.1f} s of processor time)",
        flush=True,
    )
    steps, spent = 0, 0.0
    while not info["compiled"]:
        spent += played(env, rng, 100)
        steps += 100
        _, info = env.reset()
    print(
        f"SimPy engine: {steps / max(spent, 1e-9):,.0f} steps/s; "
        f"compiled engine after {time.perf_counter() - begun:.1f} s",
        flush=True,
    )
    compiled = gymnasium.make("desim_uav/Case8-v0", engine="batch")
    compiled.reset(seed=0)
    times = {"auto": 0.0, "batch": 0.0}
    until, pieces = time.perf_counter() + seconds, 0
    while time.perf_counter() < until:
        times["auto"] += played(env, rng, PIECE)
        times["batch"] += played(compiled, rng, PIECE)
        pieces += 1
    rates = {name: PIECE * pieces / spent for name, spent in times.items()}
    print(
        f"from then on {rates['auto']:,.0f} steps/s; engine='batch' {rates['batch']:,.0f} steps/s; "
        f"ratio {rates['auto'] / rates['batch']:.2f}"
    )


def main() -> None:
    """Run the newcomer's process with an empty folder of machine code."""
    parser = argparse.ArgumentParser(description="What a newcomer meets.")
    parser.add_argument("--seconds", type=float, default=20.0, help="how long rates are compared")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.here:
        newcomer(asked.seconds)
        return
    from desim_uav.experiment.interrupt import end_politely

    end_politely()  # and with this process the other one
    with tempfile.TemporaryDirectory() as empty:
        command = [sys.executable, __file__, "--here", "--seconds", str(asked.seconds)]
        environment = {**os.environ, "NUMBA_CACHE_DIR": empty, "DESIM_UAV_COMPILE_AHEAD": "1"}
        subprocess.run(command, env=environment, check=True)


if __name__ == "__main__":
    main()
