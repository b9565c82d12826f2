"""The file beside an RLlib checkpoint: a network with its connectors, as arrays and text.

RLlib's own checkpoints are pickles, which run the code they hold as they are read. This file says
which known classes to build, and with what numbers; nothing else can be in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav import array_file
from desim_uav.errors import PolicyError

NAME = "desim_uav.npz"
FORMAT = 1
WHAT = "network of RLlib"

WIDEST, DEEPEST, MOST = 4096, 32, 4096
"""The units of a layer, the layers of a network, and the networks of a file, at most."""

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
"""What a file says, at least."""

MODULES = {
    "DefaultPPOTorchRLModule": "ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module",
    "MaskedModule": "desim_uav.policies.rllib.masking",
}
"""The networks that are known, and where."""

CONNECTORS = {
    "AddActionMask": "desim_uav.policies.rllib.masking",
    "EncodeObservation": "desim_uav.policies.rllib.masking",
    "FlattenObservations": "ray.rllib.connectors.common.flatten_observations",
    "MeanStdFilter": "ray.rllib.connectors.env_to_module.mean_std_filter",
}
"""The connectors that are known beside those RLlib adds itself, and where."""


def _is_bool(value: Any) -> bool:
    return isinstance(value, bool)


def _is_width(value: Any) -> bool:
    return type(value) is int and 1 <= value <= WIDEST


def _are_widths(value: Any) -> bool:
    return isinstance(value, list) and len(value) <= DEEPEST and all(map(_is_width, value))


def _is_activation(value: Any) -> bool:
    return value in ("tanh", "relu", "swish", "silu", "linear", None)


def _is_bound(value: Any) -> bool:
    return value is None or (isinstance(value, float | int) and 0 < value < math.inf)


SETTINGS = {
    "fcnet_hiddens": _are_widths,
    "fcnet_activation": _is_activation,
    "fcnet_use_layernorm": _is_bool,
    "head_fcnet_hiddens": _are_widths,
    "head_fcnet_activation": _is_activation,
    "head_fcnet_use_layernorm": _is_bool,
    "vf_share_layers": _is_bool,
    "use_lstm": _is_bool,
    "max_seq_len": _is_width,
    "lstm_cell_size": _is_width,
}
"""The settings of a network that shape it, and how they must look."""

OF_CONNECTORS: dict[str, dict[str, Any]] = {
    "AddActionMask": {},
    "EncodeObservation": {},
    "FlattenObservations": {},
    "MeanStdFilter": {
        "de_mean_to_zero": _is_bool,
        "de_std_to_one": _is_bool,
        "clip_by_value": _is_bound,
    },
}
"""Likewise of connectors."""


@dataclass(frozen=True, eq=False)
class Saved:
    """What a file holds: what it says, the weights of its networks, the numbers of its filters.

    Both one after the other, networks by name, in the order that ``about`` gives.
    """

    about: dict[str, Any]
    weights: NDArray[np.float32]
    statistics: NDArray[np.float64]

    def to_bytes(self) -> bytes:
        """The file. Raises PolicyError where it could not be read again."""
        problem = _misfit(self.about, self.weights.size)
        if problem:
            raise PolicyError(f"it cannot be saved: {problem}")
        about = self.about | {"format": FORMAT}
        return array_file.pack(about, weights=self.weights, statistics=self.statistics)


def read(folder: Path) -> Saved:
    """What a checkpoint's folder holds. Raises PolicyError, naming it, if nothing that is ours."""
    file = folder / NAME
    if not folder.is_dir():
        reason = "it is no folder" if folder.exists() else "no such folder"
        raise PolicyError(f"{folder}: not a checkpoint: {reason}")
    if not file.exists():
        raise PolicyError(
            f"{folder}: it has no {NAME}; a checkpoint of RLlib alone is pickles, which are not "
            f"read. Of an algorithm, desim_uav.policies.rllib.save(algorithm, folder) adds it"
        )
    stored = array_file.Stored(file, WHAT, ["weights", "statistics"], FORMAT)
    forms = [(name, form.dtype, len(form.shape)) for name, form in stored.forms.items()]
    if forms != [("weights", np.float32, 1), ("statistics", np.float64, 1)]:
        raise PolicyError(f"{file}: weights must be float32, statistics float64, in one row each")
    problem = _misfit(stored.about, stored.forms["weights"].shape[0])
    if problem:
        raise PolicyError(f"{file}: {problem}")
    arrays = stored.arrays()
    for name, values in arrays.items():
        if not np.isfinite(values).all():
            raise PolicyError(f"{file}: {name} has values that are not finite")
    return Saved(stored.about, arrays["weights"], arrays["statistics"])


def _misfit(about: Mapping[str, Any], weights: int) -> str:
    """What keeps a file from being built, or nothing."""
    for key, of_type in ABOUT.items():
        if not isinstance(about.get(key), of_type):
            return f"it says no {key}"
    agents, modules = about["agents"], about["modules"]
    if not agents or not all(isinstance(a, str) and a in modules for a in agents):
        return "agents must name one of the modules for each drone"
    if len(modules) > MOST or not all(isinstance(m, dict) for m in modules.values()):
        return f"modules must be mappings, {MOST} at most"
    for name, module in modules.items():
        problem = _wrong("module", module, MODULES, dict.fromkeys(MODULES, SETTINGS))
        if problem:
            return f"{name}: {problem}"
    for connector in about["connectors"]:
        problem = _wrong("connector", connector, CONNECTORS, OF_CONNECTORS)
        if problem:
            return problem
    pipelines = about["pipelines"]
    if len(pipelines) != 2 or not all(isinstance(names, list) for names in pipelines):
        return "pipelines must be two lists of names"
    shapes = [shape for m in modules.values() for _, shape in m["weights"]]
    if sum(map(math.prod, shapes)) != weights:
        return f"it has {weights:,} weights, which are not those of its modules"
    return ""


def _wrong(what: str, told: Any, known: Mapping[str, str], settings: Mapping[str, Any]) -> str:
    """Why a class is not to be built, or nothing."""
    if not isinstance(told, dict) or not isinstance(told.get("settings"), dict):
        return f"a {what} must be a mapping with class and settings"
    name = told.get("class")
    if not isinstance(name, str) or name not in known:
        return f"its {what} is {name}; known are {', '.join(known)}"
    for key, value in told["settings"].items():
        if key not in settings[name] or not settings[name][key](value):
            return f"{name}: {key}: {str(value)[:80]} is not known to do no harm"
    if what == "module" and not _are_shapes(told.get("weights")):
        return "its weights must be [name, shape]"
    return ""


def _are_shapes(told: Any) -> bool:
    return isinstance(told, list) and all(
        isinstance(one, list)
        and len(one) == 2
        and isinstance(one[0], str)
        and isinstance(one[1], list)
        and len(one[1]) <= 2
        and all(type(length) is int and length >= 0 for length in one[1])
        for one in told
    )
