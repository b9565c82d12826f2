"""Networks trained with Stable-Baselines3 and its contributed algorithms, without unpickling.

Of a file that ``model.save`` wrote, the settings are read as the JSON they stand in, the pickles
among them are passed over, and the weights are read as plain tensors into the libraries' own
network. Nothing in a file can therefore run code.
"""

from __future__ import annotations

import importlib
import io
import itertools
import json
import re
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from desim_uav.errors import MissingExtraError, PolicyError, in_short
from desim_uav.model.state import Observation
from desim_uav.model.streams import Streams
from desim_uav.policies.network_file import are_widths, is_bool, is_width, reason
from desim_uav.registry import register
from desim_uav.regular_file import opened
from desim_uav.world import World

LARGEST = {"data": 2**26, "policy.pth": 2**30}
"""What is read of a file, and how many bytes of each at most."""

ACTIVATIONS = ("ELU", "GELU", "LeakyReLU", "Mish", "ReLU", "SELU", "SiLU", "Sigmoid", "Tanh")

IN_TRAINING = {"normalize_images", "optimizer_class", "optimizer_kwargs", "ortho_init"}
"""The settings of a policy that do not matter to its decisions here."""

SIZES = {"Box": "_shape", "Discrete": "n", "MultiDiscrete": "nvec"}
"""Where a space keeps what makes it fit."""

Joint = Callable[[Sequence[Observation], Sequence[Sequence[bool]]], list[int]]


class Spaces(NamedTuple):
    """Of what observations and actions a network is, in words that can be compared."""

    observations: str
    actions: str


class Saved(NamedTuple):
    """What a file tells: the class of its policy, the settings of it, spaces and weights."""

    policy: str
    settings: dict[str, Any]
    spaces: Spaces
    weights: dict[str, Any]


@register("policy", "sb3")
class StableBaselines:
    """The best allowed action by a trained network, which commands one drone or all of them.

    One that was trained as the only controller of all drones (``UavEnv``) decides for them
    jointly. One that was trained on a single drone's observations flies each.
    """

    ceiling = True
    file_of = Path
    act_jointly: Joint | None = None

    def __init__(self, file: str = "") -> None:
        if not file:
            raise ValueError("a network needs its file: sb3:FILE.zip")
        self.file = file
        self._world: World | None = None
        try:
            self._saved = _read(Path(file))
        except (PolicyError, MissingExtraError):
            raise
        except Exception as error:  # zipfile, JSON and torch have many ways to refuse a file
            raise PolicyError(f"{file}: not a readable network: {reason(error)}") from error

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Build the network, once for a world. Raises PolicyError where it does not fit."""
        if world is self._world:
            return
        observations, actions, jointly = self._fitting(world)
        try:
            self._network = _network(self._saved, observations, actions)
        except Exception as error:  # torch and the libraries refuse weights in many ways
            raise PolicyError(f"{self.file}: its weights do not fit: {reason(error)}") from error
        self._dtype = observations.dtype
        self.act_jointly = self._decide if jointly else None
        self._world = world

    def _fitting(self, world: World) -> tuple[Any, Any, bool]:
        """The spaces it was trained on, and are they of all drones?"""
        from desim_uav.spaces import action_space, observation_space, widest

        drones, actions = world.scenario.drones.count, len(world.actions)
        encoding, trained = world.scenario.observation, self._saved.spaces
        here: dict[Spaces, None] = {}
        for count, facts in itertools.product((drones, 1), (widest(world), world.facts)):
            seen = observation_space(encoding.features(facts) * count)
            told = action_space(actions, count)
            spaces = Spaces(_described(seen), _described(told))
            if spaces == trained:
                return seen, told, count == drones
            here[spaces] = None
        raise PolicyError(
            f"{self.file}: it was trained on {in_short(_in_words(trained))}; "
            f"{world.scenario.name} has " + ", or ".join(map(_in_words, here))
        )

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """The best allowed action of one drone, by a network that was trained on one."""
        return self._decide([observation], [mask])[0]

    def _decide(
        self, observations: Sequence[Observation], masks: Sequence[Sequence[bool]]
    ) -> list[int]:
        """The best allowed action of each drone that the network commands; of equals the first."""
        assert self._world is not None, "an episode has begun"
        encode, facts = self._world.scenario.observation.encode, self._world.facts
        code = [number for seen in observations for number in encode(seen, facts)]
        batch, _ = self._network.obs_to_tensor(np.array(code, self._dtype))
        scores = NETWORKS[self._saved.policy](self._network, batch).numpy()
        allowed = np.array(masks)
        best = np.where(allowed, scores.reshape(allowed.shape), -np.inf).argmax(axis=1)
        return [int(command) for command in best]


# ---- what the networks say of actions: (1, drones * actions), the higher the better


def _logits(network: Any, batch: Any) -> Any:
    """Of PPO, A2C and MaskablePPO: before the mask."""
    features = network.extract_features(batch)
    if not network.share_features_extractor:
        features, _ = features  # the value function's are its own
    return network.action_net(network.mlp_extractor.forward_actor(features))


def _q_values(network: Any, batch: Any) -> Any:
    """Of DQN."""
    return network.q_net(batch)


def _mean_quantiles(network: Any, batch: Any) -> Any:
    """Of QR-DQN."""
    return network.quantile_net(batch).mean(dim=1)


NETWORKS: dict[str, Callable[[Any, Any], Any]] = {
    "stable_baselines3.common.policies.ActorCriticPolicy": _logits,
    "stable_baselines3.dqn.policies.DQNPolicy": _q_values,
    "sb3_contrib.common.maskable.policies.MaskableActorCriticPolicy": _logits,
    "sb3_contrib.qrdqn.policies.QRDQNPolicy": _mean_quantiles,
}
"""The policies that are known, no other: the MlpPolicy of each algorithm."""


def _network(saved: Saved, observations: Any, actions: Any) -> Any:
    """The network on these spaces, with the weights of the file."""
    torch = importlib.import_module("torch")
    with torch.random.fork_rng(devices=[]):  # its first weights are drawn, and leave no trace
        network = _class(saved.policy)(observations, actions, lambda _: 0.0, **saved.settings)
    network.load_state_dict(saved.weights, strict=True)
    network.set_training_mode(False)
    return network.requires_grad_(False)


# ---- files


def _read(path: Path) -> Saved:
    """What a file tells. Raises PolicyError, MissingExtraError, or whatever finds it unreadable."""
    with opened(path, sum(LARGEST.values())) as file, zipfile.ZipFile(file) as archive:
        data = json.loads(_member(archive, "data"))
        weights = _member(archive, "policy.pth")
    policy = _policy(data)
    if policy not in NETWORKS:
        raise PolicyError(
            f"{path}: its policy is {in_short(policy)}; networks that can be read are the "
            f"MlpPolicy of A2C, DQN, PPO, MaskablePPO and QRDQN"
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
    """The tensors of a network by name; torch is asked for tensors and nothing else."""
    torch = importlib.import_module("torch")
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        _require_small("policy.pth", sum(entry.file_size for entry in archive.infolist()))
    weights = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    for name, tensor in weights.items():
        if not tensor.is_contiguous() or not torch.isfinite(tensor).all():
            raise ValueError(f"policy.pth: {name} has values that are not finite, or not stored")
    return dict(weights)


def _policy(data: dict[str, Any]) -> str:
    """The policy's class by its full name, as it can be read beside its pickle."""
    shown = data["policy_class"]
    name = re.match(r"<function (\w+)\.__init__ at", str(shown.get("__init__")))
    return f"{shown.get('__module__')}.{name[1] if name else '?'}"


def _class(policy: str) -> Any:
    """The class of a known policy."""
    module, _, name = policy.rpartition(".")
    return getattr(importlib.import_module(module), name)


def _space(shown: dict[str, Any]) -> str:
    """A space in words, as it can be read beside its pickle."""
    kind = shown[":type:"].strip("<>'").rpartition(".")[2]
    return _in_brackets(kind, shown.get(SIZES.get(kind, "")))


def _described(space: Any) -> str:
    """A space in the same words."""
    kind = type(space).__name__
    return _in_brackets(kind, getattr(space, SIZES[kind]))


def _in_brackets(kind: str, sizes: Any) -> str:
    return f"{kind}[{', '.join(re.findall(r'[0-9]+', str(sizes)))}]"


def _in_words(spaces: Spaces) -> str:
    return f"observations {spaces.observations} and actions {spaces.actions}"


# ---- settings of a policy


def _settings(shown: dict[str, Any]) -> dict[str, Any]:
    """The policy's settings, as they can be read beside their pickle.

    Raises ValueError for one that cannot, or is not known to do no harm.
    """
    pickled = {":type:", ":serialized:"}
    return {key: _setting(key, shown[key]) for key in sorted(shown.keys() - pickled - IN_TRAINING)}


def _setting(key: str, shown: Any) -> Any:
    if key == "activation_fn":
        name = re.fullmatch(r"<class 'torch\.nn\.modules\.activation\.(\w+)'>", str(shown))
        if name and name[1] in ACTIVATIONS:
            return getattr(importlib.import_module("torch.nn"), name[1])
    if key in SETTINGS and SETTINGS[key](shown):
        return shown
    raise ValueError(f"policy_kwargs: {key}: {str(shown)[:80]} cannot be read without unpickling")


def _is_architecture(value: Any) -> bool:
    """Widths of layers; or of those of the policy and the value function."""
    if isinstance(value, dict):
        return value.keys() <= {"pi", "vf"} and all(map(are_widths, value.values()))
    return are_widths(value)


SETTINGS: dict[str, Callable[[Any], bool]] = {
    "n_quantiles": is_width,
    "net_arch": _is_architecture,
    "share_features_extractor": is_bool,
}
"""The settings that are taken over, beside the activation, and how they must look."""
