"""The file beside an RLlib checkpoint: a network with its connectors, as arrays and text.

RLlib's own checkpoints are pickles, which can run code when they are read. This file only names
known classes to build and holds the numbers for them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav import array_file
from desim_uav.errors import PolicyError, in_short
from desim_uav.policies.network_file import are_widths, is_bool, is_width

NAME = "desim_uav.npz"
FORMAT = 1
WHAT = "network of RLlib"

LONGEST_TEXT = 2**20
"""The largest size of the description in a file, in bytes."""

MOST_WEIGHTS, MOST_CONNECTORS = 2**26, 8
"""The largest number of weights of all networks, and of connectors of the training."""

SMALL, DENSEST = 2**20, 50
"""A file above ``SMALL`` bytes unpacked is refused if it was compressed by more than ``DENSEST``.

Trained weights can hardly be compressed; zeros can be compressed a thousandfold.
"""

MOST_SEED, MOST_FLOAT = 2**63 - 1, float(np.finfo(np.float32).max)

ABOUT: dict[str, type | tuple[type, ...]] = {
    "ray": str,
    "scenario": str,
    "scenario_hash": str,
    "world_seed": (int, type(None)),
    "world_hash": (str, type(None)),
    "features": list,
    "actions": list,
    "agents": list,
    "modules": dict,
    "connectors": list,
    "pipelines": list,
}
"""The entries that the description in a file must have, with their types."""

MODULES = {
    "DefaultPPOTorchRLModule": "ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module",
    "MaskedModule": "desim_uav.policies.rllib.masking",
}
"""The known networks, each with its module."""

CONNECTORS = {
    "AddActionMask": "desim_uav.policies.rllib.masking",
    "EncodeObservation": "desim_uav.policies.rllib.masking",
    "FlattenObservations": "ray.rllib.connectors.common.flatten_observations",
    "MeanStdFilter": "ray.rllib.connectors.env_to_module.mean_std_filter",
}
"""The known connectors, each with its module, apart from those that RLlib adds itself."""


def _is_activation(value: object) -> bool:
    return value in ("tanh", "relu", "swish", "silu", "linear", None)


def _is_bound(value: object) -> bool:
    return value is None or (isinstance(value, float | int) and 0 < value <= MOST_FLOAT)


SETTINGS = {
    "fcnet_hiddens": are_widths,
    "fcnet_activation": _is_activation,
    "fcnet_use_layernorm": is_bool,
    "head_fcnet_hiddens": are_widths,
    "head_fcnet_activation": _is_activation,
    "head_fcnet_use_layernorm": is_bool,
    "vf_share_layers": is_bool,
    "use_lstm": is_bool,
    "max_seq_len": is_width,
    "lstm_cell_size": is_width,
}
"""The settings that shape a network, with a check of each value."""

OF_CONNECTORS: dict[str, dict[str, Any]] = {
    "AddActionMask": {},
    "EncodeObservation": {},
    "FlattenObservations": {},
    "MeanStdFilter": {
        "de_mean_to_zero": is_bool,
        "de_std_to_one": is_bool,
        "clip_by_value": _is_bound,
    },
}
"""The settings of connectors, with a check of each value."""


@dataclass(frozen=True, eq=False)
class Saved:
    """The content of a file: its description, and the numbers of its networks and filters.

    Weights and statistics are rows of numbers, in the order that ``about`` gives.
    """

    about: dict[str, Any]
    weights: NDArray[np.float32]
    statistics: NDArray[np.float64]

    def to_bytes(self) -> bytes:
        """Return the bytes of a file. Raises PolicyError if they could not be read again."""
        content = array_file.pack(
            self.about | {"format": FORMAT}, weights=self.weights, statistics=self.statistics
        )
        unpacked = self.weights.nbytes + self.statistics.nbytes
        problem = _misfit(self.about, self.weights.size) or _too_dense(unpacked, len(content))
        if problem:
            raise PolicyError(problem)
        return content


class NetworkFile:
    """The file in a checkpoint's folder, with its description and array shapes read."""

    def __init__(self, folder: Path) -> None:
        """Raise PolicyError, which names the file, if it is missing or of another form."""
        self.path = folder / NAME
        if not folder.is_dir():
            reason = "it is not a folder" if folder.exists() else "no such folder"
            raise PolicyError(f"{folder}: not a checkpoint: {reason}")
        if not self.path.exists():
            raise PolicyError(
                f"{folder}: the folder has no {NAME}, and RLlib's own files are pickles, which "
                f"are not read. desim_uav.policies.rllib.save(algorithm, folder) adds {NAME}"
            )
        names = ["weights", "statistics"]
        self._stored = array_file.Stored(self.path, WHAT, names, FORMAT, LONGEST_TEXT)
        self.about = self._stored.about
        forms = self._stored.forms
        for name, dtype in (("weights", np.float32), ("statistics", np.float64)):
            form = forms[name]
            if form.dtype != dtype or len(form.shape) != 1:
                self._refuse(
                    f"{name} must be a row of numbers, not {in_short(form.dtype)} "
                    f"of shape {form.shape}"
                )
        weights, self.statistics = (forms[name].shape[0] for name in names)
        unpacked = 4 * weights + 8 * self.statistics
        self._refuse(_misfit(self.about, weights))
        self._refuse(_too_dense(unpacked, self.path.stat().st_size))

    def saved(self) -> Saved:
        """Read the whole file. Raises PolicyError if it is damaged."""
        arrays = self._stored.arrays()
        for name, values in arrays.items():
            if not np.isfinite(values).all():
                self._refuse(f"{name} has values that are not finite")
        return Saved(self.about, arrays["weights"], arrays["statistics"])

    def _refuse(self, problem: str) -> None:
        if problem:
            raise PolicyError(f"{self.path}: {problem}")


def _too_dense(unpacked: int, packed: int) -> str:
    """Return why a file with these sizes in bytes cannot hold a network, or ""."""
    if unpacked <= max(SMALL, DENSEST * packed):
        return ""
    return f"its {packed:,} bytes become {unpacked:,} when unpacked, too many for a network"


def _misfit(about: Mapping[str, Any], weights: int) -> str:
    """Return why a network cannot be built from a description, or ""."""
    return next(_problems(about, weights), "")


def _problems(about: Mapping[str, Any], weights: int) -> Iterator[str]:
    """Yield the problems in an order in which each check may rely on those before it."""
    for key, of_type in ABOUT.items():
        if not isinstance(about.get(key), of_type):
            yield f"its description has no valid {key!r}"
    seed = about["world_seed"]
    if seed is not None and not 0 <= seed <= MOST_SEED:
        yield f"world_seed: {in_short(seed, 40)}: must be from 0 to 2^63 - 1"
    if not re.fullmatch(r"\d+\.\d+[\w.]{0,30}", about["ray"], re.ASCII):
        yield f"ray: {in_short(about['ray'], 40)} is not a version"
    modules, pipelines = about["modules"], about["pipelines"]
    if not all(isinstance(name, str) and name in modules for name in about["agents"]):
        yield "agents must name one of the modules for each drone"
    unused = modules.keys() - about["agents"]
    if unused:
        yield f"it has {len(unused):,} modules that no drone uses"
    if len(about["connectors"]) > MOST_CONNECTORS:
        count = len(about["connectors"])
        yield f"it has {count:,} connectors; at most {MOST_CONNECTORS} are allowed"
    of_modules = dict.fromkeys(MODULES, SETTINGS)
    yield from filter(None, (_wrong("module", m, MODULES, of_modules) for m in modules.values()))
    yield from filter(
        None, (_wrong("connector", c, CONNECTORS, OF_CONNECTORS) for c in about["connectors"])
    )
    if len(pipelines) != 2 or not all(isinstance(names, list) for names in pipelines):
        yield "pipelines must be two lists of names"
    shapes = [shape for module in modules.values() for _, shape in module["weights"]]
    if weights > MOST_WEIGHTS:
        yield f"it has {weights:,} weights; at most {MOST_WEIGHTS:,} are allowed"
    if sum(map(math.prod, shapes)) != weights:
        yield f"it has {weights:,} weights, which is not the number of its modules' weights"


def _wrong(
    what: str, about: object, classes: Mapping[str, str], settings: Mapping[str, Any]
) -> str:
    """Return why a class must not be built, or ""."""
    if not isinstance(about, dict) or not isinstance(about.get("settings"), dict):
        return f"a {what} must be a mapping with class and settings"
    name = about.get("class")
    if not isinstance(name, str) or name not in classes:
        return f"its {what} is {in_short(name)}; must be one of {', '.join(classes)}"
    for key, value in about["settings"].items():
        if key not in settings[name] or not settings[name][key](value):
            return (
                f"{name}: {in_short(key)}: {in_short(value, 80)} is not among the allowed settings"
            )
    if what == "module" and not _are_shapes(about.get("weights")):
        return "its weights must be [name, shape]"
    return ""


def _are_shapes(shapes: object) -> bool:
    return isinstance(shapes, list) and all(
        isinstance(one, list)
        and len(one) == 2
        and isinstance(one[0], str)
        and isinstance(one[1], list)
        and len(one[1]) <= 2
        and all(type(length) is int and length >= 0 for length in one[1])
        for one in shapes
    )
