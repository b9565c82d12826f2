"""Train a network to act as a policy did, from a data set of ``bench export`` (behaviour cloning).

desim-uav bench export uav-v1/multi-service --policy greedy --observation radar --out greedy_data
python policies/clone.py greedy_data --out clone.npz

The network learns to give the actions of the policy a high probability, from the steps at which a
drone had a choice. Minari reads the data set (pip install -e ".[minari]"); NumPy does the rest.
"""

import argparse
import os
import sys
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # several would only wait for each other
import numpy as np

from desim_uav.disk import file_place, write_at
from desim_uav.errors import DesimError, MissingExtraError, PolicyError, UsageError, require_within
from desim_uav.experiment.bench.export import MANIFEST
from desim_uav.experiment.bench.tasks import find_task, find_track
from desim_uav.learning.actor_critic import Adam, Cells, Network
from desim_uav.policies.mlp import Mlp, component_of, description_of, scaling_of
from desim_uav.report.json_file import Form, read_json
from desim_uav.world import build_world

try:
    from minari import MinariDataset
except ModuleNotFoundError:
    print(MissingExtraError("policies/clone.py", "minari"), file=sys.stderr)
    sys.exit(MissingExtraError.exit_code)

HIDDEN, BATCH = 128, 256


class Manifest(Form):
    """The entries that the manifest of a data set must have."""

    task: str
    track: str
    scenario_hash: str
    observation: dict[str, Any]


def world_of(folder, about):
    """The world of a data set. Raises PolicyError if its manifest is not of a task as it is now."""
    try:
        task, track = find_task(about["task"]), find_track(about["track"])
        observation = component_of(about["observation"])
    except (DesimError, ValueError) as error:
        raise PolicyError(f"{folder / MANIFEST}: {error}") from error
    if about["scenario_hash"] != task.scenario_hash:
        raise PolicyError(
            f"{folder / MANIFEST}: scenario_hash: it is of another version of {task.name}, whose "
            f"hash is {task.scenario_hash}"
        )
    scenario = task.scenario(track).model_copy(update={"observation": observation})
    return build_world(scenario, 0)


def steps_of(folder, features, outputs):
    """The observations, masks and actions at which a drone had a choice.

    Raises PolicyError if they cannot be read, or are not of so many features and of actions that
    were allowed.
    """
    try:
        episodes = list(MinariDataset(folder).iterate_episodes())
        seen = np.concatenate([one.observations[:-1] for one in episodes])
        masks = np.concatenate([one.infos["action_mask"][:-1] for one in episodes]) != 0
        actions = np.concatenate([one.actions for one in episodes])
        free = masks.sum(-1) > 1
        if (*seen.shape[1:], *masks.shape[1:]) != (features, outputs) or not free.any():
            raise ValueError(f"no steps of {features} features and {outputs} actions")
        if not masks[np.arange(len(actions)), actions].all():
            raise ValueError("an action was not allowed")
        return seen[free], masks[free], actions[free]
    except Exception as error:  # Minari and h5py raise errors of any kind for bad data
        reason = str(error) or type(error).__name__
        raise PolicyError(f"{folder}: not a readable data set: {reason}") from error


def train(seen, masks, actions, *, epochs, rate, seed):
    """The network that has learned the actions."""
    rng = np.random.default_rng(seed)
    network = Network([seen.shape[1], HIDDEN, HIDDEN, masks.shape[1]], 0.01, rng)
    adam, batches = Adam([network]), max(1, len(seen) // BATCH)
    for epoch in range(epochs):
        right = 0
        for batch in np.array_split(rng.permutation(len(seen)), batches):
            layers = network.forward(seen[batch])
            _, of_logs, _ = Cells().slopes(layers[-1], masks[batch], actions[batch])
            best = np.where(masks[batch], layers[-1], -np.inf).argmax(-1)
            right += (best == actions[batch]).sum()
            network.back(layers, -of_logs / np.float32(len(batch)))
            adam.step(rate * (1 - epoch / epochs))
        print(f"epoch {epoch + 1}: {right / len(seen):.1%} as the policy", file=sys.stderr)
    return network


def main(arguments=None):
    """Train, and write the policy file."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("data", type=Path, help="the folder of the data set")
    parser.add_argument("--out", type=Path, default=Path("clone.npz"), help="the policy file")
    parser.add_argument("--epochs", type=int, default=20, help="passes through the data")
    parser.add_argument("--rate", type=float, default=1e-3, help="of Adam; it falls linearly to 0")
    parser.add_argument("--seed", type=int, default=0, help="what is drawn at random")
    asked = parser.parse_args(arguments)
    try:
        require_within(vars(asked), {"epochs": (1, 4096), "rate": (1e-9, 1.0), "seed": (0, 2**20)})
        place = file_place(asked.out, "--out", [".npz"])
        if not (asked.data / MANIFEST).is_file():
            raise UsageError(f"{asked.data}: no such data set; desim-uav bench export writes one")
        about = read_json(asked.data / MANIFEST, Manifest, "the manifest of a data set")
        world = world_of(asked.data, about)
        if world.commands.of_all("cloning").space_of(1).shape:
            raise UsageError("commands of free flight cannot be cloned by this script")
        low, scale = scaling_of(world)
        seen, masks, actions = steps_of(asked.data, len(low), len(world.actions))
        settings = {"epochs": asked.epochs, "rate": asked.rate, "seed": asked.seed}
        network = train((seen - low) * scale, masks, actions, **settings)
        layers = tuple((one[:-1].copy(), one[-1].copy()) for one in network.layers)
        training = {"clone_of": about, **settings}
        clone = Mlp(low, scale, layers, description_of(world) | {"training": training})
        write_at(place, clone.to_bytes())
    except DesimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    print(place)
    return 0


if __name__ == "__main__":
    sys.exit(main())
