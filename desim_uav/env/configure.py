"""The scenario of an environment: a file, a shipped name, a mapping or a Scenario, with changes."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from os import PathLike, fspath
from typing import Any, Literal

from desim_uav.errors import ScenarioError
from desim_uav.scenario.load import from_mapping, load, to_plain
from desim_uav.scenario.schema import Scenario
from desim_uav.shipped import find_scenario

Source = str | PathLike[str] | Mapping[str, Any] | Scenario

WorldSeed = int | Literal["scenario"] | None
"""The seed of the world that an environment flies in. None: each seed draws a world of its own.
"scenario": the world seed of the scenario."""


def configured(
    source: Source, config: Mapping[str, Any] | None = None, world_seed: WorldSeed = "scenario"
) -> Scenario:
    """Return the scenario of ``source``, with the keys of ``config`` changed.

    ``config`` is nested as a scenario is, or its keys are paths: ``{"drones.count": 5}``. A
    component with a ``kind`` replaces the present one as a whole; all other keys that are not
    mentioned keep their values. ``world_seed`` replaces the scenario's, unless ``config`` has one.
    Raises ScenarioError with every problem found, and UsageError for a key that is not a path.
    """
    if config is not None and not isinstance(config, Mapping):
        raise ScenarioError(f"config: must be a mapping of keys to values, not {config!r}")
    changes = dict(config or {})
    if world_seed != "scenario":
        changes.setdefault("world_seed", world_seed)
    overrides = list(_overrides("", changes))
    if isinstance(source, Scenario):
        return from_mapping(_given(source), overrides=overrides) if overrides else source
    if isinstance(source, Mapping):
        return from_mapping(source, overrides=overrides)
    return load(find_scenario(fspath(source)), overrides)


def _given(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as plain data, with its seed only if one was given."""
    plain = to_plain(scenario)
    if "seed" not in scenario.model_fields_set:
        del plain["seed"]
    return plain


def _overrides(path: str, config: Mapping[str, Any]) -> Iterator[str]:
    """Yield ``key.path=value`` for every value, in the form of the command line."""
    for key, value in config.items():
        if not isinstance(key, str) or "=" in key:
            raise ScenarioError(
                f"config: key {key!r}: must be a key of a scenario, or a path of keys"
            )
        if isinstance(value, Mapping) and value and "kind" not in value:
            yield from _overrides(f"{path}{key}.", value)
        else:
            yield f"{path}{key}={_yaml(f'{path}{key}', value)}"


def _yaml(path: str, value: Any) -> str:
    """Return a value as JSON, which is also YAML."""
    try:
        return json.dumps(value, ensure_ascii=False, default=_plain)
    except (TypeError, ValueError) as error:
        raise ScenarioError(f"config: {path}: {error}") from error


def _plain(value: Any) -> Any:
    """Turn values that JSON lacks into plain data: mappings, paths, NumPy's numbers and arrays."""
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, PathLike):
        return fspath(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"a value of type {type(value).__name__} cannot be written in YAML")
