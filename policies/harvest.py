"""Learn the weights of the drones of Bayerlein et al. 2021 by an evolution strategy, in one file.

python policies/harvest.py --out weights.json

Each generation draws weights (``desim_uav/experiment/papers/harvester.py``) from normal
distributions, at first with mean 0 and deviation 1, and flies all of them in the same missions,
which are new in each generation. The better half of them, the best ones most, move the means and
deviations (a cross-entropy method). A mission counts as the paper's evaluation counts it: the share
of data that was collected if all drones have landed, else 0. Without ``--out``, the weights that
come with the package are replaced.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np

from desim_uav.disk import file_place, write_at
from desim_uav.errors import DesimError, require_within
from desim_uav.experiment.interrupt import end_politely
from desim_uav.experiment.papers.harvest import drawn, ground_of
from desim_uav.experiment.papers.harvester import FEATURES, WEIGHTS, Harvester
from desim_uav.experiment.provenance import commit, processor

FIRST_SEED = 2**41
"""The first seed of missions, which no evaluation has."""
LEAST = 0.02
"""The least deviation of a weight."""

OPTIONS = {
    "seed": (0, 0, 2**20, "what all is drawn from"),
    "generations": (14, 1, 1024, "how often weights are drawn"),
    "population": (16, 2, 4096, "weights of a generation"),
    "missions": (16, 1, 1024, "missions that each of them flies"),
}
"""The default of each option, the least and the greatest value, and what it is."""


def counted(ground, weights, seed):
    """Return the value of a mission, which the training maximises."""
    mission, town = drawn(ground.town, seed), ground.town
    policy = Harvester(weights, town, mission.devices, len(mission.starts))
    outcome = ground.flown(mission, seed, policy)
    return outcome.landed * outcome.collected


def train(options, save, say=lambda line: None):
    """Train for some generations; call ``save`` with the weights after each."""
    ground, rng, began = ground_of(), np.random.default_rng(options.seed), time.process_time()
    mean, deviations = np.zeros(len(FEATURES)), np.ones(len(FEATURES))
    chosen = options.population // 2
    shares = np.log(chosen + 0.5) - np.log(np.arange(1, chosen + 1))
    shares /= shares.sum()
    for generation in range(options.generations):
        first = FIRST_SEED + options.seed * 2**20 + generation * options.missions
        tried = mean + deviations * rng.standard_normal((options.population, len(mean)))
        seeds = range(first, first + options.missions)
        scores = [np.mean([counted(ground, weights, seed) for seed in seeds]) for weights in tried]
        best = tried[np.argsort(scores)[::-1][:chosen]]
        mean = 0.5 * mean + 0.5 * shares @ best
        spread = np.sqrt(shares @ (best - mean) ** 2)
        deviations = np.maximum(0.7 * deviations + 0.3 * spread, LEAST)
        took_s = time.process_time() - began
        say(f"generation {generation + 1}, {took_s:.0f} s: mean {100 * np.mean(scores):.1f} %")
        save(mean, generation + 1, took_s)


def main(arguments=None):
    """Train, and write the weights after each generation."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=WEIGHTS, help="the file of the weights")
    for name, (default, _, _, meaning) in OPTIONS.items():
        parser.add_argument(f"--{name}", type=int, default=default, help=meaning)
    options, written = parser.parse_args(arguments), ["no file"]

    def save(weights, generations, took_s):
        numbers = [round(float(weight), 4) for weight in weights]
        training = {name: value for name, value in vars(options).items() if name != "out"}
        training |= {"generations": generations, "processor_s": round(took_s)}
        training |= {"processor": processor(), "commit": commit()}
        content = {"weights": dict(zip(FEATURES, numbers, strict=True)), "training": training}
        written.append(write_at(place, (json.dumps(content, indent=1) + "\n").encode()))

    try:
        require_within(vars(options), {name: bounds for name, (_, *bounds, _) in OPTIONS.items()})
        place = file_place(options.out, "--out", [".json"])
        train(options, save, lambda line: print(line, file=sys.stderr, flush=True))
    except DesimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(f"interrupted; {written[-1]} has the weights of the last generation", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    end_politely()
    sys.exit(main())
