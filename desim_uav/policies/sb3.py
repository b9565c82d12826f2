"""Networks trained with Stable-Baselines3 and its contributed algorithms, without unpickling.

From a file that ``model.save`` wrote, only the JSON part of the settings and the weights are read.
The pickles are skipped, and the weights are loaded as plain tensors into the libraries' own
network. Nothing in a file can therefore run code.
"""

from __future__ import annotations

import importlib
import io
import json
import re
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.commands.given import Command
from desim_uav.errors import MissingExtraError, PolicyError, in_short
from desim_uav.model.random.streams import Streams
from desim_uav.model.state import Observation
from desim_uav.policies.network_file import are_widths, is_bool, is_width, reason
from desim_uav.policies.trainings import WRAPPERS, Training, trainings
from desim_uav.registry import register
from desim_uav.rowcode.regular_file import opened
from desim_uav.world import World

LARGEST = {"data": 2**26, "policy.pth": 2**30}
"""The members of a file that are read, with the largest size of each in bytes."""

ACTIVATIONS = ("ELU", "GELU", "LeakyReLU", "Mish", "ReLU", "SELU", "SiLU", "Sigmoid", "Tanh")

IN_TRAINING = {"normalize_images", "optimizer_class", "optimizer_kwargs", "ortho_init"}
"""The settings that matter in training only, not for a trained policy's decisions."""

SIZES = {"Box": "_shape", "Discrete": "n", "MultiDiscrete": "nvec"}
"""The attribute of each kind of space that must fit the scenario's."""

Joint = Callable[[Sequence[Observation], Sequence[Sequence[bool]]], list[Command]]


class Spaces(NamedTuple):
    """The observation and action spaces of a network, as texts that can be compared."""

    observations: str
    actions: str


class Saved(NamedTuple):
    """The content of a file: the class of its policy, its settings, spaces and weights."""

    policy: str
    settings: dict[str, Any]
    spaces: Spaces
    weights: dict[str, Any]


@register("policy", "sb3")
class StableBaselines:
    """Chooses the best allowed actions by a network trained with Stable-Baselines3.

    A network that was trained as the controller of all drones (``UavEnv``) chooses their actions
    jointly, or drone by drone if it was trained so (``InTurn``). A network that was trained on a
    single drone's observations flies each drone.
    """

    ceiling = True
    file_of = Path
    act_jointly: Joint | None = None

    def __init__(self, file: str = "") -> None:
        if not file:
            raise ValueError("a network needs its file: sb3:FILE.zip")
        with _readable(file), opened(Path(file), sum(LARGEST.values())) as content:
            self._use(file, _read(content, file))

    @classmethod
    def of_model(cls, model: Any, name: str) -> StableBaselines:
        """Act by a model that is in memory, as by the file that it would be saved to.

        Raises PolicyError if it was trained on normalized observations, or cannot be read.
        """
        if getattr(model.get_vec_normalize_env(), "norm_obs", False):
            raise PolicyError(
                f"policy {name!r}: it was trained on observations that VecNormalize changed, and "
                "drones here do not have them"
            )
        policy, content = cls.__new__(cls), io.BytesIO()
        model.save(content)
        with _readable(name):
            policy._use(name, _read(content, name))
        return policy

    def _use(self, file: str, saved: Saved) -> None:
        self.file = file
        self._saved = saved
        self._world: World | None = None

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Build the network, once per world. Raises PolicyError if it does not fit."""
        if world is self._world:
            return
        world.require_one_type("a network of stable-baselines3")
        training = self._fitting(world)
        observations, actions = training.observations, training.actions
        try:
            self._network = _network(self._saved, observations, actions)
        except Exception as error:  # torch and the libraries refuse weights in many ways
            raise PolicyError(f"{self.file}: its weights do not fit: {reason(error)}") from error
        self._dtype = observations.dtype
        self._scores = (CONTINUOUS if world.free else NETWORKS)[self._saved.policy]
        self._choose = training.choose
        self.act_jointly = self._decide if training.jointly else None
        self._world = world

    def _fitting(self, world: World) -> Training:
        """Return the training whose spaces are those of the file. Raises PolicyError."""
        plain: dict[Spaces, None] = {}
        for training in trainings(world):
            spaces = Spaces(_described(training.observations), _described(training.actions))
            if spaces == self._saved.spaces:
                return training
            if not training.wrapper:
                plain[spaces] = None
        raise PolicyError(
            f"{self.file}: the network was trained on {in_short(_in_words(self._saved.spaces))}; "
            f"{world.scenario.name} has "
            + ", or ".join(map(_in_words, plain))
            + f", or what {WRAPPERS} make of these"
        )

    def act(self, observation: Observation, mask: Sequence[bool]) -> Command:
        """Return the best allowed action of one drone, by a network trained on a single drone."""
        return self._decide([observation], [mask])[0]

    def _decide(
        self, observations: Sequence[Observation], masks: Sequence[Sequence[bool]]
    ) -> list[Command]:
        """Return the best allowed action of each drone; of equally good ones, the first.

        In free flight, return the command of each drone: the mean, or the best one.
        """
        assert self._world is not None, "an episode has begun"
        encode, facts = self._world.scenario.observation.encode, self._world.facts
        code = [number for observation in observations for number in encode(observation, facts)]
        return self._choose(self._scored, np.array(code), masks)

    def _scored(self, observed: NDArray[Any]) -> NDArray[np.float64]:
        """Return what the network makes of an observation, as numbers in a row."""
        batch, _ = self._network.obs_to_tensor(observed.astype(self._dtype))
        scores: NDArray[Any] = self._scores(self._network, batch).numpy().reshape(-1)
        return scores.astype(float)


# ---- what the networks say of actions: (1, drones * actions), the higher the better


def _logits(network: Any, batch: Any) -> Any:
    """Return the logits of PPO, A2C and MaskablePPO before the mask is applied."""
    features = network.extract_features(batch)
    if not network.share_features_extractor:
        features, _ = features  # the value function's are its own
    return network.action_net(network.mlp_extractor.forward_actor(features))


def _q_values(network: Any, batch: Any) -> Any:
    """Return the Q-values of DQN."""
    return network.q_net(batch)


def _mean_quantiles(network: Any, batch: Any) -> Any:
    """Return the means over the quantiles of QR-DQN."""
    return network.quantile_net(batch).mean(dim=1)


def _action(network: Any, batch: Any) -> Any:
    """Return the action of DDPG, SAC and TD3, without noise."""
    return network._predict(batch, deterministic=True)


NETWORKS: dict[str, Callable[[Any, Any], Any]] = {
    "stable_baselines3.common.policies.ActorCriticPolicy": _logits,
    "stable_baselines3.dqn.policies.DQNPolicy": _q_values,
    "sb3_contrib.common.maskable.policies.MaskableActorCriticPolicy": _logits,
    "sb3_contrib.qrdqn.policies.QRDQNPolicy": _mean_quantiles,
}
"""The only policy classes that can be read: the MlpPolicy of each algorithm."""

CONTINUOUS: dict[str, Callable[[Any, Any], Any]] = {
    "stable_baselines3.common.policies.ActorCriticPolicy": _logits,  # which are means here
    "stable_baselines3.sac.policies.SACPolicy": _action,
    "stable_baselines3.td3.policies.TD3Policy": _action,
}
"""The same for commands of free flight."""


def _network(saved: Saved, observations: object, actions: object) -> Any:
    """Build the network on these spaces, with the weights of the file."""
    torch = importlib.import_module("torch")
    with torch.random.fork_rng(devices=[]):  # its first weights are drawn, and leave no trace
        network = _class(saved.policy)(observations, actions, lambda _: 0.0, **saved.settings)
    network.load_state_dict(saved.weights, strict=True)
    network.set_training_mode(False)
    return network.requires_grad_(False)


# ---- files


@contextmanager
def _readable(name: str) -> Iterator[None]:
    """Raise PolicyError, which names the file, for an error of the libraries."""
    try:
        yield
    except (PolicyError, MissingExtraError):
        raise
    except Exception as error:  # zipfile, JSON and torch have many ways to refuse a file
        raise PolicyError(f"{name}: not a readable network: {reason(error)}") from error


def _read(file: IO[bytes], path: str) -> Saved:
    """Read a file. Raises PolicyError, MissingExtraError, or an error of the libraries."""
    with zipfile.ZipFile(file) as archive:
        data = json.loads(_member(archive, "data"))
        weights = _member(archive, "policy.pth")
    policy = _policy(data)
    if policy not in NETWORKS | CONTINUOUS:
        raise PolicyError(
            f"{path}: its policy is {in_short(policy)}; networks that can be read are the "
            f"MlpPolicy of A2C, DQN, PPO, MaskablePPO and QRDQN and, in free flight, of A2C, DDPG, "
            f"PPO, SAC and TD3"
        )
    try:
        _class(policy)
    except ModuleNotFoundError as error:
        raise MissingExtraError(f"policy 'sb3:{path}'", "sb3") from error
    spaces = Spaces(_space(data["observation_space"]), _space(data["action_space"]))
    return Saved(policy, _settings(data["policy_kwargs"]), spaces, _weights(weights))


def _member(archive: zipfile.ZipFile, name: str) -> bytes:
    _require_small(name, archive.getinfo(name).file_size)
    return archive.read(name)


def _require_small(name: str, size: int) -> None:
    if size > LARGEST[name]:
        raise ValueError(f"{name} is larger than {LARGEST[name] >> 20} MiB")


def _weights(content: bytes) -> dict[str, Any]:
    """Return the tensors of a network by name; torch loads nothing but tensors."""
    torch = importlib.import_module("torch")
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        _require_small("policy.pth", sum(entry.file_size for entry in archive.infolist()))
    weights = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    for name, tensor in weights.items():
        if not tensor.is_contiguous() or not torch.isfinite(tensor).all():
            raise ValueError(f"policy.pth: {name} has values that are not finite, or not stored")
    return dict(weights)


def _policy(data: dict[str, Any]) -> str:
    """Return the full name of the policy's class, from the readable text beside its pickle."""
    about = data["policy_class"]
    name = re.match(r"<function (\w+)\.__init__ at", str(about.get("__init__")))
    return f"{about.get('__module__')}.{name[1] if name else '?'}"


def _class(policy: str) -> Any:
    """Return the class of a known policy."""
    module, _, name = policy.rpartition(".")
    return getattr(importlib.import_module(module), name)


def _space(about: dict[str, Any]) -> str:
    """Return a text that describes a space, from the readable text beside its pickle."""
    kind = about[":type:"].strip("<>'").rpartition(".")[2]
    return _in_brackets(kind, about.get(SIZES.get(kind, "")))


def _described(space: object) -> str:
    """Return a space's description in the same form as ``_space``."""
    kind = type(space).__name__
    return _in_brackets(kind, getattr(space, SIZES[kind]))


def _in_brackets(kind: str, sizes: object) -> str:
    return f"{kind}[{', '.join(re.findall(r'[0-9]+', str(sizes)))}]"


def _in_words(spaces: Spaces) -> str:
    return f"observations {spaces.observations} and actions {spaces.actions}"


# ---- settings of a policy


def _settings(about: dict[str, Any]) -> dict[str, Any]:
    """Return the policy's settings, from the readable text beside their pickle.

    Raises ValueError for a setting that cannot be read so, or is not known to be harmless.
    """
    pickled = {":type:", ":serialized:"}
    return {key: _setting(key, about[key]) for key in sorted(about.keys() - pickled - IN_TRAINING)}


def _setting(key: str, value: object) -> Any:
    if key == "activation_fn":
        name = re.fullmatch(r"<class 'torch\.nn\.modules\.activation\.(\w+)'>", str(value))
        if name and name[1] in ACTIVATIONS:
            return getattr(importlib.import_module("torch.nn"), name[1])
    if key in SETTINGS and SETTINGS[key](value):
        return value
    raise ValueError(f"policy_kwargs: {key}: {str(value)[:80]} cannot be read without unpickling")


def _is_architecture(value: object) -> bool:
    """Return whether ``value`` is a list of layer widths, or two for policy and value function."""
    if isinstance(value, dict):
        return value.keys() <= {"pi", "vf", "qf"} and all(map(are_widths, value.values()))
    return are_widths(value)


SETTINGS: dict[str, Callable[[Any], bool]] = {
    "n_critics": is_width,
    "n_quantiles": is_width,
    "net_arch": _is_architecture,
    "share_features_extractor": is_bool,
    "use_sde": lambda value: value is False,
}
"""The settings that are used, apart from the activation, with a check of each value."""
