"""What many environments of case 8 in one world take, above one of them: resident memory, Linux.

python benchmarks/memory.py [--environments 1024]
"""

from __future__ import annotations

import argparse
import gc
import resource
from pathlib import Path

import numpy as np

from desim_uav import UavVectorEnv

AIM_MIB = 24
EPISODES = 2


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--environments", type=int, default=1024)
    count = parser.parse_args().environments
    one = flown(1)
    before = resident_mib()
    many = flown(count)
    taken = resident_mib() - before
    engine = many.sessions[0].engine
    arrays = engine.memory.nbytes + engine.path.nbytes
    print(f"{count} environments: {taken:.1f} MiB (aim: {AIM_MIB} for 1024)")
    path = engine.path.nbytes / 1024
    print(f"memory of each: {arrays / 1024:.1f} KiB, of which the sample path {path:.1f}")
    one.close()
    many.close()


def flown(count: int) -> UavVectorEnv:
    """Environments that have flown whole episodes, so that nothing is still to be made."""
    env = UavVectorEnv("case8", count, {"world_seed": 0})
    env.reset(seed=0)
    hover = np.full((count, env.sessions[0].drones), 4)
    for _ in range(EPISODES * 30):
        env.step(hover)
    return env


def resident_mib() -> float:
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


if __name__ == "__main__":
    main()
