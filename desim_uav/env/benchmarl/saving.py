"""Writes networks that BenchMARL has trained as policy files, which fly without PyTorch."""

from __future__ import annotations

from dataclasses import asdict
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import torch
from benchmarl.experiment.callback import Callback
from benchmarl.models.mlp import Mlp as Model
from numpy.typing import NDArray
from torch import nn

from desim_uav.disk import file_place, write_at
from desim_uav.env.benchmarl.task import UavTask
from desim_uav.env.torchrl import GROUP
from desim_uav.errors import PolicyError
from desim_uav.policies.mlp import Mlp, description_of, scaling_of
from desim_uav.scenario.load import dump

LIBRARIES = ("benchmarl", "torchrl", "torch")
CLOSE = 1e-3
"""How far the numbers of a saved network may differ from those of the trained one."""

Layers = tuple[tuple[NDArray[np.float32], NDArray[np.float32]], ...]


class SavePolicy(Callback):  # type: ignore[misc]
    """Writes the policy file of an experiment at its beginning and after each update.

    An experiment whose network such a file cannot hold is refused before it begins (``save``).
    """

    def __init__(self, file: str | PathLike[str]) -> None:
        super().__init__()
        self.file = Path(file)

    def on_setup(self) -> None:
        """Write the network as it is before the training."""
        save(self.experiment, self.file)

    def on_train_end(self, training_td: object, group: str) -> None:
        """Write the network as it is now."""
        _write(_converted(self.experiment), self.file)


def save(experiment: object, file: str | PathLike[str]) -> Path:
    """Write the network that an experiment has trained on a ``UavTask`` as a policy file.

    ``desim-uav run … --policy FILE`` flies it. Returns the path. Raises PolicyError for a network
    that such a file cannot hold (see ``network_of``), and DesimError if it cannot be written.
    """
    _write(network_of(experiment), Path(file))
    return Path(file)


def network_of(experiment: object) -> Mlp:
    """Return the network that chooses the actions, as ``desim-uav run`` computes it.

    It must be BenchMARL's ``Mlp`` with ReLU and without normalisation, whose parameters all drones
    share, and the observations must be scaled as ``UavTask`` scales them. This does not depend on
    the algorithm: the best action has the greatest logit (MAPPO, IPPO) or value (QMIX, VDN, IQL).
    The test environments of the experiment are reset, and the seed of PyTorch is set, to compare.
    Raises PolicyError if it is another one.
    """
    network = _converted(experiment)
    _require_same(network, experiment)
    return network


def _write(network: Mlp, file: Path) -> None:
    write_at(file_place(file, "the policy file"), network.to_bytes())


def _converted(experiment: Any) -> Mlp:
    """Return the network with its description."""
    if not isinstance(experiment.task, UavTask):
        raise _refusal("it was not trained on a UavTask")
    session = experiment.test_env.vector.sessions[0]
    world = session.world
    worlds = session.tasks.worlds
    own = world.scenario.world_seed is not None if worlds is None else len(worlds) == 1
    training = {
        "algorithm": experiment.algorithm_name,
        "settings": asdict(experiment.algorithm_config),
        "gamma": experiment.config.gamma,
        "lr": experiment.config.lr,
        "seed": experiment.seed,
        "steps_done": getattr(experiment, "total_frames", 0) * session.drones,
        "libraries": {name: version(name) for name in LIBRARIES},
        "scenario_yaml": dump(world.scenario),
    }
    about = description_of(world, own=own) | {"training": training}
    return Mlp(*scaling_of(world), _layers(_model(experiment)), about)


def _model(experiment: Any) -> Model:
    """Return the model that chooses the actions."""
    models = [part for part in experiment.policy.modules() if isinstance(part, Model)]
    if len(models) != 1 or models[0].in_keys != [(GROUP, "observation")]:
        raise _refusal("its policy must be one Mlp of BenchMARL, of the observation alone")
    if not models[0].share_params:
        raise _refusal("share_policy_params must be true: one network flies all drones")
    return models[0]


def _layers(model: Model) -> Layers:
    """Return the weights (inputs, outputs) and biases of each layer."""
    parts = list(model.mlp.get_stateful_net().children())
    for number, part in enumerate(parts):
        expected = (nn.Linear, nn.ReLU)[number % 2]
        if type(part) is not expected:
            raise _refusal(
                f"part {number} of its network is {type(part).__name__}, not {expected.__name__}: "
                "MlpConfig must have activation_class ReLU and no norm_class"
            )
    with torch.no_grad():
        return tuple(
            tuple(one.cpu().numpy().astype(np.float32) for one in (part.weight.T, part.bias))
            for part in parts[::2]
        )


def _require_same(network: Mlp, experiment: Any) -> None:
    """Raise PolicyError if the network scores what drones observe otherwise than the trained one.

    Both see the same drones, because resets with the same seed give the same observations.
    """
    env, model = experiment.test_env, _model(experiment)
    env.set_seed(0)
    raw = env.base_env.reset()[GROUP, "observation"]
    env.set_seed(0)
    with torch.no_grad():
        scores = model(env.reset())[model.out_key].cpu().numpy()
    here = [[network.scores(row) for row in rows] for rows in raw.tolist()]
    if not np.allclose(here, scores, rtol=CLOSE, atol=CLOSE):
        raise _refusal("its observations are scaled otherwise than those of UavTask")


def _refusal(why: str) -> PolicyError:
    return PolicyError(f"it cannot be saved: {why}")
