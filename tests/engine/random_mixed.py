"""Random scenarios of drones that fly freely beside drones that fly from cell to cell."""

from __future__ import annotations

from typing import Any

from desim_uav.world import World
from tests.engine import random_all
from tests.engine.random_parts import accepted


def scenario(seed: int) -> dict[str, Any]:
    """A random scenario of everything at once, with one or two types of each kind."""
    return random_all.scenario(seed, mixed=True)


def world_of(seed: int) -> World:
    """The world of a random scenario."""
    return accepted(scenario, seed, lambda found: found.mixed)
