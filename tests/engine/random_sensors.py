"""Random scenarios of everything at once, in which a group of users or two are sensors."""

from __future__ import annotations

from typing import Any

from desim_uav.world import World
from tests.engine import random_groups
from tests.engine.random_parts import Dice, accepted
from tests.engine.random_tasks import with_uplinks


def scenario(seed: int) -> dict[str, Any]:
    """A scenario of ``random_groups``, whose last groups are sensors."""
    return with_sensors(random_groups.scenario(seed), Dice(seed + 1_300_000))


def with_sensors(made: dict[str, Any], dice: Dice) -> dict[str, Any]:
    """Return a scenario of groups, with one group of sensors or two behind them."""
    senders = [*made["drones"], *made["access_points"]]
    held = any(each.get("radio", {}).get("sharing", "held") == "held" for each in senders)
    if "mix" not in made["demand"] and made["demand"]["kind"] != "continuous":
        made["demand"]["mix"] = dict.fromkeys(made["services"], 1)
    for number in range(dice.of(1, 1, 2)):
        name = f"reading{number}"
        group = dict(made["users"][-1]) | {"name": f"meters{number}", "count": dice.of(1, 3, 8)}
        group["demand"] = {"kind": "sensing", "service": name}
        made["users"].append(group)
        made["services"] = {**made["services"], name: updates(dice, held)}
    if dice.of(True, False, False):
        made["users"] = made["users"][-2:]
    grounded = any(each.get("delivered") == "ground" for each in made["services"].values())
    for drones in made["drones"] if grounded else ():
        drones["store_mbit"] = dice.of(None, 2, 9.5)
    for each in senders if grounded and dice.of(True, False) else ():
        each["backhaul"] = {"kind": "capacity", "kbps": dice.of(80, 700, 700, 6000)}
    made["reward"] = dice.of(made["reward"], {"kind": "age"})
    with_uplinks(senders, dice)
    return made


def updates(dice: Dice, held: bool) -> dict[str, Any]:
    """A service whose updates sensors send.

    Those that are taken at will are large, so that few are drawn.
    """
    if dice.of(True, False, False, False, False) and not held:
        at_will = {"kind": "at_will", "wait_s": dice.of(0, 6)}
        return {"kind": "collect", "updates": at_will, "size_mbit": dice.of([8], [2, 30])}
    last = {"keeps": "last", "preempt": dice.of(True, False, "all")}
    return {
        "kind": "collect",
        "updates": dice.of(
            {"kind": "poisson", "mean_s": dice.of(2.5, 20, 90)},
            {"kind": "periodic", "every_s": dice.of(5, 30.25)},
            {"kind": "periodic", "every_s": 15, "offset": 0},
        ),
        "size_mbit": dice.of([0.02, 0.5], [2], [0.3, 6]),
        "buffer": dice.of(1, 2, 3, 10),
        "delivered": dice.of("drone", "ground", "ground"),
        "age_limit_s": dice.of(None, 20, 75),
        **dice.of({"keeps": "newest"}, {"keeps": "oldest"}, last),
        "sends": dice.of("first", "last"),
        **({"bandwidth_kbps": [150, 600]} if held else {}),
    }


def world_of(seed: int) -> World:
    """The world of a random scenario with sensors."""
    return accepted(scenario, seed)
