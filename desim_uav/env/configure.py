"""The scenario an environment is asked for: a file, a name, a mapping or a Scenario; changes."""

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
"""Which world an environment flies in: the world of this seed; None, with each seed a world of its
own; "scenario", whatever the scenario says."""


def configured(
    source: Source, config: Mapping[str, Any] | None = None, world_seed: WorldSeed = "scenario"
) -> Scenario:
    """The scenario of a file, a shipped name or a mapping, with the keys of ``config`` changed.

    ``config`` is nested as a scenario is, or has paths for keys: ``{"drones.count": 5}``. A
    component with its ``kind`` replaces the one that stands there; whatever else is not mentioned
    stays. ``world_seed`` replaces the scenario's, unless ``config`` names one. Raises ScenarioError
    with every problem found, UsageError for a key that is no path.
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
    """A scenario as plain data; its seed only where one was given."""
    plain = to_plain(scenario)
    if "seed" not in scenario.model_fields_set:
        del plain["seed"]
    return plain


def _overrides(path: str, config: Mapping[str, Any]) -> Iterator[str]:
    """``key.path=value`` for every leaf, as the command line would have it."""
    for key, value in config.items():
        if not isinstance(key, str) or "=" in key:
            raise ScenarioError(f"config: key {key!r}: must be a key of a scenario, or a path")
        if isinstance(value, Mapping) and value and "kind" not in value:
            yield from _overrides(f"{path}{key}.", value)
        else:
            yield f"{path}{key}={_yaml(f'{path}{key}', value)}"


def _yaml(path: str, value: Any) -> str:
    """A value as JSON, which is YAML."""
    try:
        return json.dumps(value, ensure_ascii=False, default=_plain)
    except (TypeError, ValueError) as error:
        raise ScenarioError(f"config: {path}: {error}") from error


def _plain(value: Any) -> Any:
    """What JSON does not know: mappings, paths, and NumPy's numbers and arrays."""
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, PathLike):
        return fspath(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"a {type(value).__name__} is not plain data")
