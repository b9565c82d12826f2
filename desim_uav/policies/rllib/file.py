"""The file beside an RLlib checkpoint: a network with its connectors, as arrays and text.

RLlib's own checkpoints are pickles, which run the code they hold as they are read. This file says
which known classes to build, and with what numbers; nothing else can be in it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
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
    for name, dtype in (("weights", np.float32), ("statistics", np.float64)):
        form = stored.forms[name]
        if form.dtype != dtype or len(form.shape) != 1:
            raise PolicyError(f"{file}: {name} is {form.dtype} of shape {form.shape}, not a row")
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
    return next(_problems(about, weights), "")


def _problems(about: Mapping[str, Any], weights: int) -> Iterator[str]:
    """What does, one after the other: a later one may take for granted what an earlier one asks."""
    for key, of_type in ABOUT.items():
        if not isinstance(about.get(key), of_type):
            yield f"it says no {key}"
    modules, pipelines = about["modules"], about["pipelines"]
    if not all(isinstance(name, str) and name in modules for name in about["agents"]):
        yield "agents must name one of the modules for each drone"
    if len(modules) > MOST:
        yield f"it has {len(modules):,} modules; {MOST:,} are the most"
    of_modules = dict.fromkeys(MODULES, SETTINGS)
    yield from filter(None, (_wrong("module", m, MODULES, of_modules) for m in modules.values()))
    yield from filter(
        None, (_wrong("connector", c, CONNECTORS, OF_CONNECTORS) for c in about["connectors"])
    )
    if len(pipelines) != 2 or not all(isinstance(names, list) for names in pipelines):
        yield "pipelines must be two lists of names"
    shapes = [shape for module in modules.values() for _, shape in module["weights"]]
    if sum(map(math.prod, shapes)) != weights:
        yield f"it has {weights:,} weights, which are not those of its modules"


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
