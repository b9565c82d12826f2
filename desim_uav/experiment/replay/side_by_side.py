"""Checks that two runs can be played in step: they may differ in their policies only."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from desim_uav.errors import PolicyError
from desim_uav.report.run import Run

SEEDS = ("seed", "world_seed")
MOST_NAMED = 3
"""The largest number of keys that the message names."""


def common_episodes(first: Run, second: Run, text: str | None) -> list[int]:
    """Return the episodes that two runs on common seeds are shown for.

    ``text`` is a text such as ``0-9``; by default all counted episodes. Raises PolicyError, with
    the values of both, if the runs differ in scenario, seed, world or episodes.
    """
    for what, one, other in _differences(first, second):
        raise _unlike(first, second, f"{what}: {one} and {other}")
    numbers, others = first.chosen(text), second.chosen(text)
    if numbers != others:
        raise _unlike(
            first,
            second,
            f"episodes: {_span(numbers)} and {_span(others)}; name common ones",
        )
    return numbers


def _differences(first: Run, second: Run) -> Iterator[tuple[str, Any, Any]]:
    """Yield the name and both values of each difference, the most important first."""
    one, other = (_flat(run.scenario.model_dump(mode="json")) for run in (first, second))
    keys = sorted(key for key in one.keys() | other.keys() if one.get(key) != other.get(key))
    unlike = [key for key in keys if key not in SEEDS]
    if unlike:
        keys_in_words = ", ".join(unlike[:MOST_NAMED]) + (", …" if len(unlike) > MOST_NAMED else "")
        key = unlike[0]
        yield f"scenario ({keys_in_words}): {key}", one.get(key), other.get(key)
    if first.settings.seed != second.settings.seed:
        yield "seed", first.settings.seed, second.settings.seed
    if first.settings.world_seed != second.settings.world_seed:
        yield "world_seed", first.settings.world_seed, second.settings.world_seed
    if first.map != second.map:
        yield "world.json", "one world", "another"


def _flat(content: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Return the keys of a nested mapping with their paths, such as ``users.count``."""
    paths: dict[str, Any] = {}
    for key, value in content.items():
        if isinstance(value, Mapping):
            paths |= _flat(value, f"{above}{key}.")
        else:
            paths[f"{above}{key}"] = value
    return paths


def _span(episodes: list[int]) -> str:
    return f"{episodes[0]} to {episodes[-1]} ({len(episodes)})"


def _unlike(first: Run, second: Run, reason: str) -> PolicyError:
    return PolicyError(
        f"{first.folder} and {second.folder} cannot be played side by side, because they differ "
        f"in {reason}"
    )
