"""Gymnasium's spaces for what is observed, and masks as arrays (actions: ``commands``)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from gymnasium.spaces import Box, MultiDiscrete
from numpy.typing import NDArray

from desim_uav.model.geometry.grid import altitudes
from desim_uav.model.observations import Feature, common_features
from desim_uav.model.state import Facts
from desim_uav.world import World

Mask = tuple[bool, ...]


def features(world: World) -> tuple[Feature, ...]:
    """Return the features of any drone's observation in an array, with bounds that hold for all.

    They hold in all possible worlds. If drones differ, each has as many numbers as the one with the
    most, with zeros behind its own, and bounds are those of all.
    """
    return common_features([_features_of_type(world, number) for number in range(len(world.types))])


def features_of(world: World, drone: int) -> tuple[Feature, ...]:
    """Return the features of a drone's own observation, with bounds as ``features`` does."""
    return _features_of_type(world, world.type_numbers[drone])


def _features_of_type(world: World, number: int) -> tuple[Feature, ...]:
    """Return the features of a type; with a ``world_seed``, the only possible world is this one."""
    scenario, facts = world.scenario, world.facts_of_types[number]
    if scenario.world_seed is None:
        facts = widest(world, facts)
    return scenario.observation.features(facts)


def padded(world: World, encoded: Iterable[tuple[float, ...]]) -> list[tuple[float, ...]]:
    """Return drones' encoded observations, each with as many numbers as ``features``."""
    more = [world.most_features - len(own) for own in world.features_of_types]
    numbered = zip(world.type_numbers, encoded, strict=True)
    return [(*own, *(0.0,) * more[number]) for number, own in numbered]


def widest(world: World, facts: Facts | None = None) -> Facts:
    """Return facts of a world, with the largest number of levels its scenario can draw.

    They are those of its only type of drones unless others are given.
    """
    scenario, facts = world.scenario, facts or world.facts
    tallest_m = scenario.map.drawn_up_to_m
    if tallest_m is None:
        return facts
    levels = scenario.map.levels
    levels_m, under_ceiling = altitudes(
        levels.min_altitude_m, levels.step_m, tallest_m, levels.max_altitude_m
    )
    grid = replace(facts.grid, levels_m=levels_m, levels_under_ceiling=under_ceiling)
    return facts._replace(grid=grid)


def observation_space(shown: Iterable[Feature]) -> MultiDiscrete[Any] | Box:
    """Return a MultiDiscrete (int64) if all features are whole numbers, else a Box (float32)."""
    shown = tuple(shown)
    low, high = [feature.low for feature in shown], [feature.high for feature in shown]
    if all(feature.whole for feature in shown):
        start, last = np.array(low, np.int64), np.array(high, np.int64)
        return MultiDiscrete(last - start + 1, start=start)
    return Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)


def state_space(numbers: int) -> Box:
    """Return the space of the whole state (see ``rules.whole_state``)."""
    return Box(0.0, 1.0, (numbers,), np.float32)


def flat_mask(masks: tuple[Mask, ...]) -> NDArray[np.int8]:
    """Return all drones' masks one after the other, 1 for allowed actions, in a new array."""
    return _array(masks).flatten()


@lru_cache(maxsize=1024)
def _array(masks: tuple[Mask, ...]) -> NDArray[np.int8]:
    return np.array(masks, np.int8)
