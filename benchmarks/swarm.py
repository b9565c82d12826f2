"""What a large swarm takes: wall time, and memory above that of its world.

    python benchmarks/swarm.py [--drones 100] [--users 10000]

One episode of the baseline on the paper's map, static demand, events not logged. The memory is the
growth of the process's peak (resident set) over its value before the first event.
"""

from __future__ import annotations

import argparse
import resource
import time

from desim_uav.experiment.run import play
from desim_uav.policies import load_policy
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import build_world


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drones", type=int, default=100)
    parser.add_argument("--users", type=int, default=10_000)
    args = parser.parse_args()
    scenario = from_mapping(
        {
            "name": "swarm",
            "drones": {"count": args.drones},
            "users": {"count": args.users},
            "demand": {"kind": "static"},
        }
    )
    world, policy = build_world(scenario, 0), load_policy("baseline")
    draw(world, 0, 0)
    before, start = _peak_mib(), time.perf_counter()
    ((log, _),) = play(world, policy, "baseline", 0)
    print(f"{args.drones} drones, {args.users} users, {len(log.requests)} requests")
    print(f"{time.perf_counter() - start:.1f} s, {_peak_mib() - before:.0f} MiB above the world")


def _peak_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
