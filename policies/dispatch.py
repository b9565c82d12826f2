"""Learn the few numbers of a dispatcher by an evolution strategy, in one file with NumPy only.

python policies/dispatch.py uav-v1/dispatch/small --out dispatch.npz
desim-uav bench run uav-v1/dispatch/small --policy dispatch.npz

Each generation draws weights (``desim_uav/policies/dispatcher.py``) from normal distributions and
flies all of them in the same episodes, which are new in each generation. The better half of them,
the best ones most, move the means and deviations (a cross-entropy method). An episode counts as in
the benchmark's task dispatch: QoE1, QoE3 and QoE2 between those of ``baseline`` and their best
values, less crashes. The world is that of ``world_seed`` (default 0).
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from desim_uav.disk import file_place, write_at
from desim_uav.errors import DesimError, UsageError
from desim_uav.experiment.bench.score import SCORED, score
from desim_uav.experiment.bench.tasks import find_task
from desim_uav.experiment.provenance import command, commit, processor
from desim_uav.experiment.run import play
from desim_uav.policies import load_policy
from desim_uav.policies.dispatcher import WEIGHTS, Dispatcher, problem_of, to_bytes
from desim_uav.scenario.load import dump, load
from desim_uav.shipped import find_scenario
from desim_uav.world import build_world

OPTIONS = {
    "steps": (300_000, 1, 2**50, "decision epochs of the whole training, at most"),
    "seed": (0, 0, 2**20, "what weights and episodes are drawn from"),
    "population": (16, 4, 4096, "dispatchers of a generation"),
    "episodes": (6, 1, 4096, "episodes that each of them flies, drones carried over"),
    "deviation": (0.3, 1e-6, 10.0, "the first one of all weights"),
    "least": (0.02, 0.0, 10.0, "the least deviation of a weight"),
}
"""The default of each option, the least and the greatest value, and what it is."""

FIRST_SEED = 2**41
"""The first seed of episodes, which no track of the benchmark has."""


def options_of(**changes):
    """The options of a training, with these changes. Raises UsageError for what cannot be."""
    options = {name: default for name, (default, *_) in OPTIONS.items()} | changes
    for name, (_, least, most, _) in OPTIONS.items():
        if not least <= options[name] <= most:
            raise UsageError(f"--{name} {options[name]}: must be from {least} to {most}")
    return argparse.Namespace(**options)


def flown(world, policy, seed, episodes):
    """The measures of some episodes, and the number of decision epochs."""
    closed, attached_us, crashes, epochs = [], 0, 0, 0
    for log, _ in play(world, policy, "dispatcher", seed, episodes, engine="batch"):
        for one in log.requests:
            open_us = one.t_end_us - one.t_request_us - one.served_us
            closed.append((100.0 * one.served_us / one.asked_us, open_us / world.step_us))
        attached_us += log.attached_us
        crashes += len(log.crashed)
        epochs += len(log.steps) // len(world.starts)
    first, second = np.mean(closed, axis=0)
    third = 100.0 * attached_us / (world.horizon_us * len(world.homes) * episodes)
    names = ("qoe1_percent", "qoe2_iterations", "qoe3_percent", "crashes_per_drone_episode")
    crashes /= episodes * len(world.starts)
    return dict(zip(names, map(float, (first, second, third, crashes)), strict=True)), epochs


def train(scenario, options, save=lambda weights, steps: None, say=lambda line: None):
    """Train for at most so many decision epochs; return the weights."""
    seed = scenario.world_seed if scenario.world_seed is not None else 0
    world, began = build_world(scenario, seed), time.monotonic()
    if problem := problem_of(world):
        raise UsageError(f"{scenario.name}: {problem}")
    rng = np.random.default_rng(options.seed)
    first, generation = FIRST_SEED + options.seed * 2**20, 0
    zero, steps = flown(world, load_policy("baseline"), first, 4 * options.episodes)
    mean, deviations = np.array([*WEIGHTS.values()]), np.full(len(WEIGHTS), options.deviation)
    longest, chosen = 0, options.population // 2
    shares = np.log(chosen + 0.5) - np.log(np.arange(1, chosen + 1))
    shares /= shares.sum()
    while steps + longest <= options.steps:
        generation, spent, scores = generation + 1, steps, []
        drawn = mean + deviations * rng.standard_normal((options.population, len(mean)))
        for weights in drawn:
            policy = Dispatcher(weights=weights)
            row, epochs = flown(world, policy, first + generation, options.episodes)
            scores.append(score(SCORED["dispatch"], row, zero, {}))
            steps += epochs
        best = drawn[np.argsort(scores)[::-1][:chosen]]
        mean = 0.5 * mean + 0.5 * shares @ best
        spread = np.sqrt(shares @ (best - mean) ** 2)
        deviations = np.maximum(0.7 * deviations + 0.3 * spread, options.least)
        longest = max(longest, steps - spent)
        say(
            f"{steps:,} steps, {time.monotonic() - began:.0f} s: "
            f"score {np.mean(scores):.3f}, of the best {max(scores):.3f}"
        )
        save(mean, steps)
    return mean


def scenario_of(name, changes):
    """The scenario of a file, a shipped name, or a task of the benchmark."""
    task = name.startswith("uav-v1/")
    return load(find_task(name).path if task else find_scenario(name), changes)


def main(arguments=None):
    """Train, and write the policy file after each generation."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenario", help="a scenario file, a shipped name or a benchmark's task")
    parser.add_argument("--out", type=Path, help="the policy file; default: SCENARIO.npz")
    parser.add_argument("-S", dest="changes", action="append", default=[], metavar="KEY=VALUE")
    for name, (default, _, _, meaning) in OPTIONS.items():
        parser.add_argument(f"--{name}", type=type(default), default=default, help=meaning)
    asked = vars(parser.parse_args(arguments))
    told = {"numpy": np.__version__, "commit": commit(), "processor": processor()}

    def save(weights, steps):
        training = vars(options) | told | {"command": command(sys.argv), "steps_done": steps}
        training["scenario_yaml"] = dump(scenario)
        write_at(place, to_bytes(weights, {"training": training}))

    try:
        name, out, changes = (asked.pop(key) for key in ("scenario", "out", "changes"))
        scenario = scenario_of(name, ["observation={kind: local}", *changes])
        options = options_of(**asked)
        place = file_place(out or Path(f"{scenario.name}.npz"), "--out")
        train(scenario, options, save, lambda line: print(line, file=sys.stderr, flush=True))
    except DesimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(f"interrupted; {place} has the policy of the last generation", file=sys.stderr)
        return 130
    print(f"desim-uav run {name} --policy {place}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
