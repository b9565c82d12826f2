"""Random scenarios with everything at once: groups of users, tasks at processors, and sensors.

What ``random_tasks`` draws (fleets of all kinds, energy, free flight, decisions, radio, access
points, backhauls, processors) is drawn first; then groups of users, shares that are commanded, and
sensors are added.
"""

from __future__ import annotations

from typing import Any

from desim_uav.world import World
from tests.engine import random_tasks
from tests.engine.random_groups import with_groups
from tests.engine.random_parts import Dice, accepted
from tests.engine.random_sensors import with_sensors


def scenario(seed: int) -> dict[str, Any]:
    """A random scenario; in one of four, results come over backhauls of their own."""
    dice = Dice(seed + 1_700_000)
    made = dice.of(*[random_tasks.scenario] * 3, random_tasks.relaying)(seed)
    processor = made["users"]["processor"]
    made = with_groups(made, dice)
    for group in made["users"][1:]:
        group["processor"] = processor | {"ghz": dice.of(0.02, 0.5)}
    if dice.of(True, False, False, False):
        shares = dice.of([0, 0.5, 1], [0.25, 0.75])
        made["offloading"] = {"kind": "commanded", "shares": shares}
    return with_sensors(made, dice)


def world_of(seed: int) -> World:
    """The world of a random scenario."""
    return accepted(scenario, seed)
