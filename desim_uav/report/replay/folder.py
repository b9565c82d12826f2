"""A run folder as a replay reads it: its files, anyone's, are checked before they are used."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from desim_uav.errors import PolicyError, UsageError
from desim_uav.records import EPISODES, EVENTS, LEGS, REQUESTS, STEPS, USERS
from desim_uav.run_folder import read_table
from desim_uav.scenario.load import load
from desim_uav.scenario.schema import Scenario

if TYPE_CHECKING:
    import pandas as pd

Tables = dict[str, "pd.DataFrame"]
"""The tables of one episode, by name: requests, steps, users, events, legs."""

KEPT = {"requests": REQUESTS, "steps": STEPS, "episodes": EPISODES, "users": USERS}
IN_TIME = {"events": EVENTS, "legs": LEGS}
"""What a run keeps with ``--events``."""

MOST_CELLS = 1_000_000


class RunFolder:
    """The folder of a finished run. Raises PolicyError, naming the file, where it is not one."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.tables = {name: read_table(path, name, columns) for name, columns in KEPT.items()}
        self.scenario: Scenario = load(path / "scenario.yaml")
        self.manifest = _checked(path / "manifest.json", _manifest_problem(self.scenario))
        self.world = _checked(path / "world.json", _world_problem)
        cells = [int(number) for number in self.scenario.map.cells]
        if self.world["cells"] != cells:
            raise PolicyError(
                f"{path / 'world.json'}: cells: {self.world['cells']}, "
                f"but scenario.yaml has {cells}"
            )

    @cached_property
    def in_time(self) -> Tables | None:
        """The tables of what happened when; None where the run has not kept them."""
        if not all((self.path / f"{name}.parquet").is_file() for name in IN_TIME):
            return None
        return {name: read_table(self.path, name, columns) for name, columns in IN_TIME.items()}

    @cached_property
    def episodes(self) -> list[int]:
        """The numbers of the episodes there are, warm-up among them."""
        return sorted({int(number) for number in self.tables["episodes"]["episode"]})

    def chosen(self, text: str | None) -> list[int]:
        """The episodes of a text such as ``0-9,12``; without one, the counted ones.

        Raises UsageError for one that is not there.
        """
        if text is None:
            found = [number for number in self.episodes if number >= 0] or self.episodes
            if not found:
                raise PolicyError(f"{self.path / 'episodes.parquet'}: it has no episodes")
            return found
        wanted = sorted({number for part in text.split(",") for number in _numbers(text, part)})
        missing = sorted(set(wanted) - set(self.episodes))
        if missing:
            raise UsageError(
                f"--episodes {text}: there is no episode {missing[0]}; "
                f"there are {self.episodes[0]} to {self.episodes[-1]}"
            )
        return wanted

    def of_episode(self, episode: int) -> Tables:
        """The stored tables of one episode."""
        stored = self.tables | (self.in_time or {})
        return {name: frame[frame["episode"] == episode] for name, frame in stored.items()}


def _numbers(text: str, part: str) -> range:
    sign, part = (-1, part.strip()[1:]) if part.strip().startswith("-") else (1, part.strip())
    first, dash, last = part.partition("-")
    try:
        begin = sign * int(first)
        end = int(last) if dash else begin
    except ValueError:
        raise UsageError(f"--episodes {text}: write 0-9, or 0,4,8") from None
    if end < begin or end - begin > 10**6:
        raise UsageError(f"--episodes {text}: write 0-9, or 0,4,8")
    return range(begin, end + 1)


def _checked(file: Path, problem: Callable[[Any], str | None]) -> dict[str, Any]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or error
        raise PolicyError(f"{file}: not readable as JSON: {reason}") from error
    found = "it is no mapping" if not isinstance(content, dict) else problem(content)
    if found:
        raise PolicyError(f"{file}: {found}")
    return dict(content)


def _manifest_problem(scenario: Scenario) -> Callable[[dict[str, Any]], str | None]:
    tests: dict[str, tuple[Callable[[Any], bool], str]] = {
        "scenario": (_is_text, "a text"),
        "policy": (_is_text, "a text"),
        "seed": (_is_count, "a whole number from 0 on"),
        "world_seed": (_is_count, "a whole number from 0 on"),
        "engine": (lambda v: v in ("des", "batch"), "des or batch"),
        "ceilings": (
            lambda v: (
                isinstance(v, list)
                and len(v) == scenario.drones.count
                and all(word in ("tallest", "none") for word in v)
            ),
            f"'tallest' or 'none' for each of {scenario.drones.count} drones",
        ),
        "carry_over": (lambda v: isinstance(v, bool), "true or false"),
        "warmup": (_is_count, "a whole number from 0 on"),
    }
    return lambda content: _first_problem(content, tests)


def _world_problem(world: dict[str, Any]) -> str | None:
    shape = {
        "size_m": (lambda v: _are_numbers(v, 2) and min(v) > 0, "[width, depth] in metres"),
        "cells": (
            lambda v: _are_counts(v, 2) and min(v) > 0 and v[0] * v[1] <= MOST_CELLS,
            "[nx, ny]",
        ),
    }
    problem = _first_problem(world, shape)
    if problem:
        return problem
    nx, ny = world["cells"]

    def are_cells(value: Any) -> bool:
        return isinstance(value, list) and all(
            _are_counts(cell, 2) and cell[0] < nx and cell[1] < ny for cell in value
        )

    return _first_problem(
        world,
        {
            "cell_height_m": (
                lambda v: (
                    isinstance(v, list)
                    and len(v) == nx
                    and all(_are_numbers(column, ny) and min(column) >= 0 for column in v)
                ),
                f"{nx} lists of {ny} heights",
            ),
            "open_levels_m": (lambda v: _are_numbers(v) and bool(v), "a list of altitudes"),
            "stations": (are_cells, "a list of cells [ix, iy]"),
            "clusters": (
                lambda v: isinstance(v, list) and all(map(_is_cluster, v)),
                "a list of {x_m, y_m, radius_m}",
            ),
            "users": (
                lambda v: isinstance(v, list) and bool(v) and all(_are_numbers(u, 3) for u in v),
                "a list of homes [x, y, z]",
            ),
        },
    )


def _first_problem(
    content: dict[str, Any], tests: dict[str, tuple[Callable[[Any], bool], str]]
) -> str | None:
    for key, (is_one, expected) in tests.items():
        if key not in content:
            return f"no {key}"
        if not is_one(content[key]):
            return f"{key}: must be {expected}"
    return None


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= 10_000


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**63


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < 1e15 and isfinite(value)


def _are_counts(value: Any, length: int) -> bool:
    return isinstance(value, list) and len(value) == length and all(map(_is_count, value))


def _are_numbers(value: Any, length: int | None = None) -> bool:
    if not isinstance(value, list) or (length is not None and len(value) != length):
        return False
    return all(map(_is_number, value))


def _is_cluster(value: Any) -> bool:
    names = {"x_m", "y_m", "radius_m"}
    return (
        isinstance(value, dict) and names <= set(value) and all(_is_number(value[n]) for n in names)
    )
