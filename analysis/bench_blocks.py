"""How long must the runs of the benchmark be? Episode by episode, in one of its tasks.

python analysis/bench_blocks.py

Flies the baseline and two networks in the small multi-service, in 8 of its test worlds, for 48
episodes that are carried over from one to the next. Prints by how much one network is above the
baseline in each episode, and the range of the difference between the networks over blocks of
several lengths, both as the mean of QoE1 and QoE3 in percentage points.
"""

import pandas as pd

import desim_uav as du
from desim_uav.env.tasks import WORLDS
from desim_uav.shipped import bench_folder

POLICIES = ("baseline", "ppo_case8_any.npz", "mappo_case8_any.npz")
WORLDS_FLOWN, EPISODES = 8, 48
BLOCKS = (5, 8, 16)


def main() -> None:
    """Print both tables."""
    first, second = (scores_of(name) - scores_of(POLICIES[0]) for name in POLICIES[1:])
    print(f"{POLICIES[1]} above the baseline, by episode: {first.round(1).tolist()}")
    apart = first - second
    print(f"mean difference of the networks: {apart.mean():+.2f}")
    for length in BLOCKS:
        means = [apart[at : at + length].mean() for at in range(0, EPISODES - length + 1, length)]
        print(f"in blocks of {length} episodes: {min(means):+.2f} to {max(means):+.2f}")


def scores_of(policy: str) -> pd.Series:
    """Return the mean of QoE1 and QoE3 by episode, over the worlds."""
    flown = du.run(
        bench_folder() / "multi-service-small.yaml",
        policy=policy,
        seeds=WORLDS["test"][:WORLDS_FLOWN],
        episodes=EPISODES,
        warmup=0,
        engine="batch",
        progress=False,
    ).episodes
    return flown.groupby("episode")[["qoe1_percent", "qoe3_percent"]].mean().mean(axis=1)


if __name__ == "__main__":
    main()
