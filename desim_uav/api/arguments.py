"""Checks and conversions of the arguments of the Python interface."""

from __future__ import annotations

import inspect
import operator
import sys
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from desim_uav.api.invocation import command_line
from desim_uav.api.parameters import LAST_FIRST_SEED, LAST_SEED, MOST_SEEDS
from desim_uav.errors import DesimWarning, UsageError
from desim_uav.experiment.interrupt import at_once
from desim_uav.policies.base import policy_name
from desim_uav.rowcode.bounds import is_own
from desim_uav.scenario.doubts import warn_of
from desim_uav.scenario.draft import blaming
from desim_uav.scenario.load import Overrides, from_mapping, load, override_texts, to_plain
from desim_uav.scenario.schema import Scenario
from desim_uav.shipped import find_scenario

ScenarioLike = str | Path | Mapping[str, Any] | Scenario
"""A shipped scenario's name, a scenario file, its content as a mapping, or a loaded scenario."""


@dataclass(frozen=True)
class Opened:
    """A scenario, and the file it is from, if it is from one."""

    scenario: Scenario
    path: Path | None
    settings: Sequence[str] = ()
    """The overrides that were given."""

    def located(self) -> AbstractContextManager[None]:
        """Name the override or the file in problems that are found only when a world is drawn."""
        return blaming(self.path, self.settings)


def opened(
    scenario: ScenarioLike,
    overrides: Overrides | None = None,
    seed: int | None = None,
    world_seed: int | None = None,
    further: Mapping[str, Any] | None = None,
) -> Opened:
    """Open a scenario, set keys of it, and print its warnings. Raises ScenarioError, UsageError."""
    settings = override_texts(overrides or ())
    keys = {"seed": seed, "world_seed": world_seed} | dict(further or {})
    settings += override_texts({key: value for key, value in keys.items() if value is not None})
    path: Path | None = None
    if isinstance(scenario, str | Path):
        path = find_scenario(str(scenario))
        loaded = at_once(load, path, settings)
    elif isinstance(scenario, Mapping):
        loaded = at_once(lambda: from_mapping(scenario, overrides=settings))
    elif settings:
        plain, source = to_plain(scenario), f"<{scenario.name}>"
        loaded = at_once(lambda: from_mapping(plain, source=source, overrides=settings))
    else:
        loaded = scenario
    warn_of(loaded)
    return Opened(loaded, path, settings)


def ranges_of(name: str, numbers: int | str | Sequence[int] | None) -> str | None:
    """Return numbers as a text such as ``"0-3,8"``; a text stays as it is. Raises UsageError."""
    if numbers is None or isinstance(numbers, str):
        return numbers
    some = numbers if isinstance(numbers, Iterable) else [numbers]
    return ",".join(str(whole(name, one, 0, LAST_SEED)) for one in some)


def seeds_of(seeds: int | Sequence[int], first_seed: int = 0) -> list[int]:
    """Return the seeds asked for: so many from ``first_seed`` on, or those of a sequence.

    Raises UsageError.
    """
    first_seed = whole("first_seed", first_seed, 0, LAST_FIRST_SEED)
    if isinstance(seeds, str) or not isinstance(seeds, Iterable):
        return list(range(first_seed, first_seed + whole("seeds", seeds, 1, MOST_SEEDS)))
    numbers = [whole("seeds", seed, 0, LAST_SEED) for seed in seeds]
    if first_seed != 0:
        raise UsageError("first_seed goes with a number of seeds, not with a list of them")
    if not numbers or len(set(numbers)) < len(numbers):
        raise UsageError(f"seeds: {numbers}: must name at least one seed, and none twice")
    return numbers


def whole(name: str, value: Any, low: int, high: int) -> int:
    """Return a whole number within its bounds; NumPy's are accepted. Raises UsageError."""
    try:
        number = operator.index(value)
    except TypeError:
        number = low - 1
    if isinstance(value, bool) or not low <= number <= high:
        raise UsageError(f"{name}: {value!r}: must be a whole number from {low} to {high}")
    return number


def warn(text: str) -> None:
    """Warn the caller of the Python interface; the command line prints it."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and not is_own(frame.f_globals["__name__"]):
        frame, level = frame.f_back, level + 1
    warnings.warn(text, DesimWarning, stacklevel=level)


def command_of(function: Callable[..., Any], arguments: Mapping[str, Any]) -> list[str]:
    """Return what a manifest says of how something was made: a command line, or a Python call."""
    typed = command_line()
    if typed:
        return typed
    texts = [
        _argument_text(name, arguments[name], parameter)
        for name, parameter in inspect.signature(function).parameters.items()
    ]
    return [f"desim_uav.{function.__name__}({', '.join(filter(None, texts))})"]


def _argument_text(name: str, value: Any, parameter: inspect.Parameter) -> str:
    """Write an argument as it was given, or nothing for a default."""
    if value is parameter.default or name in ("progress", "callback"):
        return ""
    text = repr(_plain(value))
    if text == repr(parameter.default):
        return ""
    return f"{name}={text}" if parameter.kind is parameter.KEYWORD_ONLY else text


def _plain(value: Any) -> Any:
    """Put names in the place of objects."""
    if isinstance(value, Scenario):
        return value.name
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    is_plain = value is None or isinstance(value, bool | int | float | str | range | list)
    return value if is_plain else policy_name(value)
