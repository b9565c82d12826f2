"""How far from optimal is what is learned? One drone of case 4, whose optimum is known exactly.

python analysis/learned_against_optimum.py [SEEDS [EPISODES]]

Trains on each seed from 100 on, in the world of the seed, evaluates greedily (20 episodes after 2
of warm-up), and divides the reward per step by the largest long-run average any policy can have.
"""

import argparse
import tempfile
from pathlib import Path

from script import count

from desim_uav.experiment.evaluate import evaluate
from desim_uav.experiment.optimum import optimum
from desim_uav.experiment.reproduce import FIRST_SEED
from desim_uav.experiment.statistics import estimate
from desim_uav.experiment.train.course import train
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path


def main(seeds: int = 10, episodes: int | None = None) -> None:
    """Print a Markdown table: a row a seed and algorithm, and the mean."""
    print("| seed | algorithm | reward a step | optimum | share | QoE3 % | best QoE3 % |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    shares: dict[str, list[float]] = {"q_learning": [], "sarsa": []}
    for seed in range(FIRST_SEED, FIRST_SEED + seeds):
        for algorithm, found in shares.items():
            settings = [f"seed={seed}", "drones.count=1", f"learning.algorithm={algorithm}"]
            settings += [] if episodes is None else [f"learning.episodes={episodes}"]
            scenario = load(scenario_path("case4"), settings)
            best = optimum(scenario, seeds=1, episodes=1)["one_drone"]
            with tempfile.TemporaryDirectory() as folder:
                policy = Path(folder) / "policy.npz"
                policy.write_bytes(train(scenario)[0].to_bytes())
                learned = evaluate(scenario, str(policy), seed, 20, 2)
            reward = learned["reward_mean"] / scenario.episode.steps
            found.append(reward / best["best_reward"]["reward_per_step"])
            print(
                f"| {seed} | {algorithm} | {reward:.4f} | "
                f"{best['best_reward']['reward_per_step']:.4f} | {found[-1]:.3f} | "
                f"{learned['qoe3_percent']:.1f} | {best['best_qoe3']['qoe3_percent']:.1f} |"
            )
    for algorithm, found in shares.items():
        mean = estimate(found)
        half_width = "" if mean.half_width is None else f" ± {mean.half_width:.3f}"
        print(f"\n{algorithm}: {mean.mean:.3f}{half_width} of the optimum")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("seeds", nargs="?", type=count(), default=10)
    parser.add_argument("episodes", nargs="?", type=count(), help="of a training")
    main(**vars(parser.parse_args()))
