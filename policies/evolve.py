"""Learn the few numbers of a policy by an evolution strategy, in one file with NumPy only.

python policies/evolve.py uav-v1/dispatch/small --out dispatch.npz
python policies/evolve.py case8 --worlds train --out planner_case8.npz
desim-uav run case8 --policy planner_case8.npz

Drones that fly freely and decide by event get a dispatcher (``desim_uav/policies/dispatcher.py``),
all others a planner (``desim_uav/policies/planner.py``). Each generation draws numbers from normal
distributions and flies all of them in the same episodes, which are new in each generation. The
better half of them, the best ones most, move the means and deviations (a cross-entropy method).
An episode of a dispatcher counts as in the benchmark's task dispatch: QoE1, QoE3 and QoE2 between
those of ``baseline`` and their best values, less crashes. One of a planner counts by the mean of
QoE1 and QoE3, less crashes. All services must ask for a time. The world is that of ``world_seed``
(default 0); with ``--worlds train``, all fly in the same ``--many`` training worlds, which are new
in each generation.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from desim_uav.disk import file_place, write_at
from desim_uav.env.tasks import WORLDS
from desim_uav.errors import DesimError, UsageError, require_within
from desim_uav.experiment.bench.score import QOE, SCORED, score
from desim_uav.experiment.bench.tasks import find_task
from desim_uav.experiment.interrupt import end_politely
from desim_uav.experiment.provenance import command, commit, processor
from desim_uav.experiment.run import play
from desim_uav.model.services import is_one_time
from desim_uav.policies import dispatcher, load_policy, planner
from desim_uav.policies.weights_file import to_bytes
from desim_uav.scenario.load import dump, load
from desim_uav.shipped import find_scenario
from desim_uav.world import build_world

OPTIONS = {
    "steps": (300_000, 1, 2**50, "decision epochs of the whole training, at most"),
    "seed": (0, 0, 2**20, "what weights and episodes are drawn from"),
    "population": (16, 4, 4096, "policies of a generation"),
    "many": (8, 1, 1024, "training worlds of a generation"),
    "episodes": (6, 1, 4096, "episodes that each policy flies in a world, drones carried over"),
    "deviation": (0.3, 1e-6, 10.0, "the first one of all weights, in their scales"),
    "least": (0.02, 0.0, 10.0, "the least deviation of a weight, in its scale"),
}
"""The default of each option, the least and the greatest value, and what it is."""

FIRST_SEED = 2**41
"""The first seed of episodes, which no track of the benchmark has."""


def options_of(worlds="own", **changes):
    """The options of a training, with these changes. Raises UsageError for what cannot be."""
    options = {name: default for name, (default, *_) in OPTIONS.items()} | changes
    require_within(options, {name: bounds for name, (_, *bounds, _) in OPTIONS.items()})
    return argparse.Namespace(worlds=worlds, **options)


def kind_of(scenario):
    """The module of what is learned: the class of the policy, its weights and their scales.

    Raises UsageError if a service does not ask for a time, because QoE1 and QoE3 do not score it,
    and for drones that none of the policies here can fly.
    """
    if not all(map(is_one_time, scenario.services.values())):
        raise UsageError(
            f"{scenario.name}: policies are compared by QoE1 and QoE3 here, so every service must "
            "ask for a time"
        )
    world = build_world(scenario, 0)
    if not (world.free and world.by_event):
        return planner
    if problem := dispatcher.problem_of(world):
        raise UsageError(f"{scenario.name}: {problem}")
    return dispatcher


def policy_of(kind, weights):
    """A policy with these weights, an array."""
    make = dispatcher.Dispatcher if kind is dispatcher else planner.Planner
    return make(weights=named(kind, weights))


def named(kind, weights):
    """The weights by their names."""
    return dict(zip(kind.WEIGHTS, map(float, weights), strict=True))


def flown(world, policy, seed, episodes):
    """The measures of some episodes, and the number of decision epochs."""
    closed, attached_us, crashes, epochs = [], 0, 0, 0
    for log, _ in play(world, policy, "a policy that learns", seed, episodes, engine="batch"):
        for one in log.requests:
            open_us = one.t_end_us - one.t_request_us - one.served_us
            closed.append((100.0 * one.served_us / one.asked_us, open_us / world.step_us))
        attached_us += log.attached_us
        crashes += len(log.crashed)
        epochs += len(log.steps) // len(world.starts)
    if not closed:
        raise UsageError(f"--episodes {episodes}: nobody asks for anything in so many")
    first, second = np.mean(closed, axis=0)
    third = 100.0 * attached_us / (world.horizon_us * len(world.homes) * episodes)
    names = ("qoe1_percent", "qoe2_iterations", "qoe3_percent", "crashes_per_drone_episode")
    crashes /= episodes * len(world.starts)
    return dict(zip(names, map(float, (first, second, third, crashes)), strict=True)), epochs


def worlds_of(scenario, options, generation):
    """The worlds of a generation: that of the scenario, or the next ones of those to train in."""
    if options.worlds == "own":
        return [build_world(scenario, scenario.world_seed or 0)]
    seeds, first = WORLDS["train"], generation * options.many
    return [build_world(scenario, seeds[(first + k) % len(seeds)]) for k in range(options.many)]


def train(scenario, options, save=lambda kind, weights, steps: None, say=lambda line: None):
    """Train for at most so many decision epochs; return the weights."""
    kind, began = kind_of(scenario), time.monotonic()
    rng = np.random.default_rng(options.seed)
    first, generation, steps = FIRST_SEED + options.seed * 2**20, 0, 0
    measures, zero = QOE, {one.name: 0.0 for one in QOE}
    worlds = worlds_of(scenario, options, generation)
    if kind is dispatcher:
        measures = SCORED["dispatch"]
        zero, steps = flown(worlds[0], load_policy("baseline"), first, 4 * options.episodes)
        if steps > options.steps:
            raise UsageError(
                f"--steps {options.steps}: must be at least {steps}, those of baseline's flights"
            )
    scales = np.array([*kind.SCALES.values()])
    mean, deviations = np.array([*kind.WEIGHTS.values()]), options.deviation * scales
    fliers = [policy_of(kind, mean) for _ in worlds]
    longest, chosen = 0, options.population // 2
    shares = np.log(chosen + 0.5) - np.log(np.arange(1, chosen + 1))
    shares /= shares.sum()
    while steps + longest <= options.steps:
        generation, spent, scores = generation + 1, steps, []
        if options.worlds == "train":
            worlds = worlds_of(scenario, options, generation)
        drawn = mean + deviations * rng.standard_normal((options.population, len(mean)))
        for weights in drawn:
            each = []
            for number, (world, policy) in enumerate(zip(worlds, fliers, strict=True)):
                policy.use(named(kind, weights))
                seed = first + generation + number * 2**15
                row, epochs = flown(world, policy, seed, options.episodes)
                each.append(score(measures, row, zero, {}))
                steps += epochs
            scores.append(np.mean(each))
        best = drawn[np.argsort(scores)[::-1][:chosen]]
        mean = 0.5 * mean + 0.5 * shares @ best
        spread = np.sqrt(shares @ (best - mean) ** 2)
        deviations = np.maximum(0.7 * deviations + 0.3 * spread, options.least * scales)
        longest = max(longest, steps - spent)
        say(
            f"{steps:,} steps, {time.monotonic() - began:.0f} s ({time.process_time():.0f} s of "
            f"processor time): score {np.mean(scores):.4f}, of the best {max(scores):.4f}"
        )
        save(kind, mean, steps)
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
    parser.add_argument("--worlds", choices=("own", "train"), default="own", help="to fly in")
    asked = vars(parser.parse_args(arguments))
    told = {"numpy": np.__version__, "commit": commit(), "processor": processor()}
    written = ["no file"]

    def save(kind, weights, steps):
        training = vars(options) | told | {"command": command(sys.argv), "steps_done": steps}
        training["scenario_yaml"] = dump(scenario)
        content = to_bytes(kind.ARRAY, kind.WEIGHTS, weights, {"training": training})
        written.append(write_at(place, content))

    try:
        name, out, changes = (asked.pop(key) for key in ("scenario", "out", "changes"))
        scenario = scenario_of(name, ["observation={kind: local}", *changes])
        options = options_of(**asked)
        place = file_place(out or Path(f"{scenario.name}.npz"), "--out", [".npz"])
        train(scenario, options, save, lambda line: print(line, file=sys.stderr, flush=True))
    except DesimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(f"interrupted; {written[-1]} has the policy of the last generation", file=sys.stderr)
        return 130
    print(f"desim-uav run {name} --policy {place}")
    return 0


if __name__ == "__main__":
    end_politely()
    sys.exit(main())
