"""The scenario of an environment: a file, a shipped name, a mapping or a Scenario, with changes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from os import PathLike, fspath
from typing import Any, Literal

from desim_uav.errors import ScenarioError
from desim_uav.scenario.load import from_mapping, load, override_texts, to_plain
from desim_uav.scenario.schema import Scenario
from desim_uav.shipped import find_scenario

Source = str | PathLike[str] | Mapping[str, Any] | Scenario

WorldSeed = int | Literal["scenario", "train", "validation", "test"] | range | None
"""The seed of the world that an environment flies in. None: each seed draws a world of its own.
"scenario": the world seed of the scenario. A range, or the name of one (``tasks.WORLDS``): each
episode draws a world of it."""


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
    overrides = _overrides(changes)
    if isinstance(source, Scenario):
        return from_mapping(_mapping_of(source), overrides=overrides) if overrides else source
    if isinstance(source, Mapping):
        return from_mapping(source, overrides=overrides)
    return load(find_scenario(fspath(source)), overrides)


def _mapping_of(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as plain data, with its seed only if one was given."""
    plain = to_plain(scenario)
    if "seed" not in scenario.model_fields_set:
        del plain["seed"]
    return plain


def _overrides(changes: Mapping[str, Any]) -> list[str]:
    """Return ``key.path=value`` for every value, in the form of the command line."""
    try:
        return [override_texts({path: value})[0] for path, value in _values("", changes)]
    except ScenarioError as problem:
        raise ScenarioError(f"config: {problem}") from None


def _values(path: str, changes: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the path of keys and the new value of every change."""
    for key, value in changes.items():
        if not isinstance(key, str) or "=" in key:
            raise ScenarioError(f"key {key!r}: must be a key of a scenario, or a path of keys")
        if isinstance(value, Mapping) and value and "kind" not in value:
            yield from _values(f"{path}{key}.", value)
        else:
            yield f"{path}{key}", value
