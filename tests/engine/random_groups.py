"""Random scenarios of everything at once, whose users are groups that walk and ask differently."""

from __future__ import annotations

from typing import Any

from desim_uav.world import World
from tests.engine import random_all
from tests.engine.random_all import CONTINUOUS, DEMANDS, WALKS
from tests.engine.random_parts import Dice, accepted


def scenario(seed: int) -> dict[str, Any]:
    """A scenario of ``random_all``, to whose users other groups are added."""
    return with_groups(random_all.one_of_all(seed), Dice(seed + 900_000))


def with_groups(made: dict[str, Any], dice: Dice) -> dict[str, Any]:
    """Return a scenario, to whose users up to three other groups are added."""
    volumes = any(each["kind"] == "transfer" for each in made["services"].values())
    groups = [{"name": "group0", **made["users"]}]
    for k in range(1, dice.of(1, 2, 3, 4)):
        walks = dice.of(made["users"]["mobility"], *WALKS)
        own = {"name": f"group{k}", "count": dice.of(1, 2, 5), "mobility": walks}
        own["clusters"] = {"count": dice.of(1, 3), "radius_m": [60, 200]}
        if dice.of(True, True, False):
            allowed = [each for each in DEMANDS if not volumes or each != CONTINUOUS]
            own["demand"] = dict(dice.of(*allowed))
            if own["demand"]["kind"] != "continuous":
                own["demand"]["mix"] = {name: dice.of(1, 2, 5) for name in made["services"]}
        groups.append(own)
    made["users"] = groups
    return made


def world_of(seed: int) -> World:
    """The world of a random scenario."""
    return accepted(scenario, seed)
