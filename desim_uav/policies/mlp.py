"""Networks of fully connected layers, in a file that holds arrays and text but no code.

One network flies every drone. It is computed with NumPy in an order that does not depend on the
machine, so a run by such a file is the same everywhere, bit for bit, and needs no other package.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav import array_file
from desim_uav.checksums import verify
from desim_uav.commands.given import Command
from desim_uav.errors import PolicyError, ScenarioError, in_short
from desim_uav.model.random.streams import Streams
from desim_uav.model.rules import DECIDES
from desim_uav.model.state import Observation
from desim_uav.policies.network_file import DEEPEST, are_widths
from desim_uav.registry import names, register
from desim_uav.run_folder import world_hash
from desim_uav.scenario.load import component_alone, to_plain
from desim_uav.shipped import find_table
from desim_uav.world import World

FORMAT = 1
MOST_NUMBERS = 2**26
"""The largest number of features, and of weights."""

ABOUT: dict[str, tuple[type, ...]] = {
    "features": (list,),
    "actions": (list,),
    "hidden": (list,),
    "observation": (dict, type(None)),
    "scenario": (str,),
    "world_seed": (int, type(None)),
    "world_hash": (str, type(None)),
    "training": (dict,),
}
"""The entries that the description in a file must have, with their types."""


@dataclass(frozen=True, eq=False)
class Mlp:
    """A network from the features of a drone to one number per action, the higher the better.

    In free flight it has one output for each number of a command, which is that number.
    A feature x enters as (x - ``low``) * ``scale``; both are float32 (features,). ``layers`` holds
    for each layer its weights, float32 (inputs, outputs), and its biases, float32 (outputs,). All
    layers but the last one end with max(0, x). ``about`` is the description (see ``ABOUT``).
    """

    low: NDArray[np.float32]
    scale: NDArray[np.float32]
    layers: tuple[tuple[NDArray[np.float32], NDArray[np.float32]], ...]
    about: dict[str, Any]

    @property
    def observation(self) -> Any:
        """The component that a drone needs, or None if the description names none."""
        return component_of(self.about["observation"])

    def network(self) -> Mlp:
        """Return the network itself, as ``MlpFile`` does that of a file."""
        return self

    def to_bytes(self) -> bytes:
        """Return the bytes of a policy file. The same network always gives the same bytes."""
        weights = np.concatenate([array.reshape(-1) for layer in self.layers for array in layer])
        hidden = [len(biases) for _, biases in self.layers[:-1]]
        about = self.about | {"format": FORMAT, "hidden": hidden}
        return array_file.pack(about, low=self.low, scale=self.scale, weights=weights)

    def scores(self, features: Sequence[float]) -> NDArray[np.float64]:
        """Return the number of each action, float64 (actions,).

        Sums are added up in the order of the inputs, without a library for matrices, whose order
        of additions depends on the machine. Inputs that are 0 add nothing and are left out.
        """
        values = (np.array(features, np.float64) - self.low) * self.scale
        for k, (weights, biases) in enumerate(self.layers):
            inputs = np.maximum(values, 0.0) if k else values
            some = np.flatnonzero(inputs)
            products = inputs[some, np.newaxis] * weights[some]
            values = np.add.reduce(products, axis=0) + biases
        return values


class MlpFile:
    """A file of a network whose description has been read.

    ``observation`` is the component that a drone needs, or None if the file names none. Raises
    PolicyError, which names the file, if it is not such a file, or if it has changed according to
    the checksums of its folder.
    """

    def __init__(self, path: Path) -> None:
        verify(path, strangers=True)
        self._stored = array_file.Stored(path, "policy file", ["low", "scale", "weights"], FORMAT)
        self.about = self._stored.about
        problem = next(iter(_problems(self._stored.forms, self.about)), "")
        if problem:
            raise PolicyError(f"{path}: {problem}")
        try:
            self.observation = component_of(self.about["observation"])
        except (ScenarioError, ValueError) as error:
            raise PolicyError(f"{path}: {str(error).partition(chr(10))[0]}") from error

    def network(self) -> Mlp:
        """Read the network. Raises PolicyError if it is damaged."""
        arrays = self._stored.arrays()
        for name, array in arrays.items():
            if not np.isfinite(array).all():
                raise PolicyError(f"{self._stored.path}: {name} has values that are not finite")
        layers, at = [], 0
        for inputs, outputs in pairwise(_sizes(self.about)):
            end = at + inputs * outputs
            weights = arrays["weights"][at:end].reshape(inputs, outputs)
            layers.append((weights, arrays["weights"][end : end + outputs]))
            at = end + outputs
        return Mlp(arrays["low"], arrays["scale"], tuple(layers), self.about)


def component_of(observation: dict[str, Any] | None) -> Any:
    """Return the observation that a file describes, or None if it describes none.

    Raises ValueError for a kind that is not built in, because a file must not choose which modules
    are imported, and ScenarioError for wrong settings.
    """
    if observation is None:
        return None
    kind = observation.get("kind")
    if kind not in names("observation"):
        kinds = ", ".join(sorted(names("observation")))
        raise ValueError(f"its observation is {in_short(kind)}; must be one of {kinds}")
    return component_alone("observation", observation, source="its description")


def description_of(world: World, own: bool = False) -> dict[str, Any]:
    """Return the entries of a description that tell what a drone in ``world`` sees and does.

    An observation that is not built in is None: it has to be that of the scenario then. ``own``
    says that the network is for this world alone.
    """
    scenario = world.scenario
    observation = to_plain(scenario)["observation"]
    return {
        "features": [feature.name for feature in max(world.features_of_types, key=len)],
        "actions": list(world.commands.of_all("a network").outputs),
        "observation": observation if observation["kind"] in names("observation") else None,
        "scenario": scenario.name,
        "world_seed": world.seed if own else None,
        "world_hash": world_hash(world) if own else None,
    }


def scaling_of(world: World) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return ``low`` and ``scale`` of networks for drones in the worlds of a scenario.

    Whole numbers are mapped to 0 … 1 by their bounds. Other features enter as they are. Where
    episodes carry over, nothing ends with them, so the time that is left does not enter (scale 0).
    """
    from desim_uav.spaces import features  # Gymnasium takes long to import

    columns = features(world)
    low = [feature.low if feature.whole else 0.0 for feature in columns]
    widths = [max(1.0, feature.high - feature.low) if feature.whole else 1.0 for feature in columns]
    scale = 1.0 / np.array(widths)
    if world.scenario.episode.carry_over:
        scale[[feature.name == "time_left" for feature in columns]] = 0.0
    return np.array(low, np.float32), scale.astype(np.float32)


def _problems(forms: dict[str, array_file.Form], about: dict[str, Any]) -> Iterable[str]:
    """Yield why the content of a file cannot be a network; the first one tells enough."""
    for key, types in ABOUT.items():
        if not isinstance(about.get(key), types) or isinstance(about[key], bool):
            yield f"its description has no valid {key!r}"
    seed = about["world_seed"]
    if seed is not None and not 0 <= seed < 2**63:
        yield f"world_seed: {in_short(seed, 40)}: must be from 0 to 2^63 - 1"
    for key in ("features", "actions"):
        if not about[key] or not all(isinstance(name, str) for name in about[key]):
            yield f"{key} must be a list of names"
    if not are_widths(about["hidden"]):
        yield f"hidden must be a list of at most {DEEPEST} numbers of units"
    sizes = _sizes(about)
    expected = sum((inputs + 1) * outputs for inputs, outputs in pairwise(sizes))
    if max(expected, sizes[0]) > MOST_NUMBERS:
        yield f"it has more than {MOST_NUMBERS:,} weights"
    shapes = {"low": (sizes[0],), "scale": (sizes[0],), "weights": (expected,)}
    for name, shape in shapes.items():
        form = forms[name]
        if form.dtype != np.float32 or form.shape != shape:
            yield (
                f"{name} must be float32 of shape {shape}, as its description says, "
                f"not {form.dtype} of shape {form.shape}"
            )


def _sizes(about: dict[str, Any]) -> list[int]:
    """Return the number of inputs, those of the units of each layer, and that of actions."""
    return [len(about["features"]), *about["hidden"], len(about["actions"])]


@register("policy", "mlp")
class NetworkPolicy:
    """Chooses the best allowed action by a network; of equally good ones, the first.

    In free flight, the outputs of the network are the command, cut off at -1 and 1.
    ``observation`` is what its drones need to observe: runs replace that of the scenario by it.
    """

    ceiling = True
    file_of = staticmethod(find_table)

    def __init__(self, file: str = "") -> None:
        if not file:
            raise ValueError("a network needs its file: mlp:policy.npz, or just policy.npz")
        self._use(file, MlpFile(find_table(file)))

    @classmethod
    def of_model(cls, model: Mlp, name: str) -> NetworkPolicy:
        """Act by a network that is in memory; tables and messages call the policy ``name``.

        Raises PolicyError if its description is not complete.
        """
        lacking = ", ".join(sorted(ABOUT.keys() - {"hidden"} - model.about.keys()))
        if lacking:
            raise PolicyError(
                f"policy {name!r}: its description has no {lacking}; "
                "desim_uav.policies.mlp.description_of(world) makes one"
            )
        policy = cls.__new__(cls)
        policy._use(name, model)
        return policy

    def _use(self, name: str, stored: MlpFile | Mlp) -> None:
        self.name = name
        self._stored = stored
        self.about = stored.about
        self.observation = stored.observation
        self.world_seed: int | None = self.about["world_seed"]
        self._network: Mlp | None = None

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Check and read the network. Raises PolicyError if it does not fit the scenario."""
        self._fit(world)

    def _fit(self, world: World) -> None:
        """Check that the network fits the world, and read it."""
        self._commands = world.commands.of_all("a network")
        self._world = world
        self._encode = world.scenario.observation.encode
        here = description_of(world)
        if self.observation not in (None, world.scenario.observation):
            self._require("observation", self.about["observation"], here["observation"])
        self._require("features", self.about["features"], here["features"])
        self._require("actions", self.about["actions"], here["actions"])
        if self._network is None:
            self._network = self._stored.network()

    def _require(self, what: str, trained: Any, here: Any) -> None:
        if trained != here:
            if isinstance(trained, list):
                trained, here = f"{len(trained)}: {trained}", f"{len(here)}: {here}"
            raise PolicyError(
                f"{self.name}: the network was trained with {what} {in_short(trained)}; "
                f"the scenario has {in_short(here)}"
            )

    def notice(self, world: World) -> str:
        """Return a warning if the network is of another world, or "". Raises as ``begin`` does."""
        self._fit(world)
        about = self.about
        if about["world_hash"] is None or world_hash(world) == about["world_hash"]:
            return ""
        return (
            f"{self.name} was trained in another world: {in_short(about['scenario'])}, world seed "
            f"{about['world_seed']}"
        )

    def act(self, observation: Observation, mask: Sequence[bool]) -> Command:
        """Return the forced action if there is one, else the best allowed action or the command."""
        if observation.mode not in DECIDES:
            return list(mask).index(True)
        assert self._network is not None, "begin comes first"
        code = self._encode(observation, self._world.facts_of(observation.drone))
        more = len(self.about["features"]) - len(code)  # where other types observe more
        scores = self._network.scores((*code, *(0.0,) * more))
        return self._commands.best(scores[np.newaxis], [mask])[0]
