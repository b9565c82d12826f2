"""Saves the networks of an RLlib algorithm, so that ``--policy rllib:DIR`` can fly them."""

from __future__ import annotations

import importlib
from dataclasses import asdict, is_dataclass
from itertools import takewhile
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.disk import write_whole
from desim_uav.errors import DesimError, MissingExtraError, PolicyError
from desim_uav.policies.rllib.adapter import described, spaces
from desim_uav.policies.rllib.file import (
    CONNECTORS,
    MODULES,
    NAME,
    OF_CONNECTORS,
    SETTINGS,
    Saved,
)
from desim_uav.run_folder import world_hash
from desim_uav.scenario.load import scenario_hash, seedless
from desim_uav.world import World

RLLIBS_OWN = "AddObservationsFromEpisodesToBatch"
"""The first of the connectors that RLlib adds itself."""


def save(algorithm: object, folder: str | PathLike[str]) -> Path:
    """Save an algorithm's networks and connectors in a folder, as a file without code.

    The algorithm must have been trained on ``UavParallelEnv`` through RLlib's
    ``ParallelPettingZooEnv``, with PPO's default networks (``DefaultPPOTorchRLModule``) or
    ``MaskedModule``, and with the connectors of ``CONNECTORS`` only. The folder is made if it does
    not exist. Returns the path of the file. Raises PolicyError, which names it, for an algorithm
    that could not be rebuilt, and DesimError if the file cannot be written.
    """
    try:
        content = content_of(algorithm)
    except PolicyError as error:
        raise PolicyError(f"it cannot be saved: {error}") from error
    file = Path(folder) / NAME
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DesimError(f"cannot make {file.parent}: {error.strerror or error}") from error
    write_whole(file, content)
    return file


def content_of(algorithm: object) -> bytes:
    """Return the content of the file of an algorithm that is in memory.

    Raises PolicyError, which says why, for an algorithm that could not be rebuilt.
    """
    try:
        network = importlib.import_module("desim_uav.policies.rllib.network")
    except ModuleNotFoundError as error:
        raise MissingExtraError("saving a network of RLlib", "rllib") from error
    flown = _flown(algorithm)
    world, to_module, to_env = flown.world, flown.to_module, flown.to_env
    agents = _agents(algorithm, world)
    modules, weights = _modules({name: flown.modules[name] for name in sorted(set(agents))})
    about = {
        "ray": network.ray_version(),
        "scenario": world.scenario.name,
        "scenario_hash": scenario_hash(seedless(world.scenario)),
        "world_seed": world.scenario.world_seed,
        "world_hash": None if world.scenario.world_seed is None else world_hash(world),
        "features": described(spaces().features(world)),
        "actions": [action.name.lower() for action in world.actions],
        "agents": agents,
        "modules": modules,
        "connectors": [_connector(piece) for piece in _own(to_module)],
        "pipelines": [network.pipelines_of(to_module), network.pipelines_of(to_env)],
    }
    saved = Saved(about, weights, network.statistics_of(to_module))
    content = saved.to_bytes()
    try:
        network.Network(about, world).fill(saved)
    except Exception as error:  # RLlib refuses in many ways
        raise PolicyError(f"it cannot be built again: {error}") from error
    return content


class Flown(NamedTuple):
    """The facts that an EnvRunner knows after it has stepped a ``UavParallelEnv``."""

    world: World
    to_module: Any
    to_env: Any
    modules: Any


def _flown(algorithm: Any) -> Flown:
    """Return the facts of the first EnvRunner that has stepped one of our environments.

    The local one has not if there are others. Raises PolicyError if none has.
    """
    facts: list[Flown | None] = algorithm.env_runner_group.foreach_env_runner(_facts_of)
    for flown in facts:
        if flown is not None:
            return flown
    raise PolicyError("it was not trained on a UavParallelEnv")


def _facts_of(runner: Any) -> Flown | None:
    """Return the facts that an EnvRunner knows; this runs in the EnvRunner's process."""
    env = getattr(runner.env, "envs", [None])[0]
    session = getattr(getattr(getattr(env, "unwrapped", None), "par_env", None), "session", None)
    if session is None:
        return None
    parts = dict(runner.get_checkpointable_components())
    pipelines = parts["env_to_module_connector"], parts["module_to_env_connector"]
    return Flown(session.world, *pipelines, runner.module)


def _agents(algorithm: Any, world: World) -> list[str]:
    """Return the module of each drone."""
    of = algorithm.config.policy_mapping_fn
    try:
        return [str(of(f"drone_{d}", None)) for d in range(world.scenario.drone_count)]
    except Exception as error:  # a user's function
        raise PolicyError(f"policy_mapping_fn must depend on the agent alone: {error}") from error


def _modules(modules: dict[str, Any]) -> tuple[dict[str, Any], NDArray[np.float32]]:
    """Return the description of the networks, and their weights in one row."""
    about, weights = {}, []
    for name, module in modules.items():
        class_name, state = _class_name_of(module, MODULES), module.get_state(inference_only=True)
        weights += [np.asarray(values, np.float32).ravel() for values in state.values()]
        about[name] = {
            "class": class_name,
            "settings": _settings(module.model_config),
            "weights": [[key, list(values.shape)] for key, values in state.items()],
        }
    return about, np.concatenate(weights)


def _settings(config: Any) -> dict[str, Any]:
    """Return the settings that shape a network; those of its first weights no longer matter."""
    settings = asdict(config) if is_dataclass(config) and not isinstance(config, type) else config
    for key in ("lstm_use_prev_action", "lstm_use_prev_reward"):
        if settings.get(key):
            raise PolicyError(f"{key}: a policy here receives no rewards")
    return {key: settings[key] for key in SETTINGS if key in settings}


def _own(pipeline: Any) -> list[Any]:
    """Return the connectors of a training that RLlib has not added itself."""
    return list(takewhile(lambda piece: type(piece).__name__ != RLLIBS_OWN, pipeline.connectors))


def _connector(piece: object) -> dict[str, Any]:
    name = _class_name_of(piece, CONNECTORS)
    if getattr(piece, "_keys_to_remove", None) or getattr(piece, "_agent_ids", None):
        raise PolicyError(f"its {name} leaves out keys or agents")
    return {
        "class": name,
        "settings": {key: getattr(piece, key) for key in OF_CONNECTORS[name]},
    }


def _class_name_of(one: object, module_of: dict[str, str]) -> str:
    """Return the name of an object's class, which must be one of the known classes."""
    name, module = type(one).__name__, type(one).__module__
    if module_of.get(name) != module:
        raise PolicyError(f"{module}.{name} is not one of {', '.join(module_of)}")
    return name
