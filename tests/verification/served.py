"""Tasks and sensors against the simulator with fixed time steps, which shares no code with them.

The scenarios are those of ``links.py``. Tasks are those of ``random_tasks`` at processors of all
disciplines, which may migrate; sensors send the updates of ``random_sensors``, beside users who ask
for files, and what is stored may come to the ground over backhauls.

Amounts are uneven. Whole amounts, rates and steps would let many things end within microseconds of
each other, or of a decision, and the order of such things would not depend on dt.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from tests.engine import random_sensors, random_tasks
from tests.engine.random_parts import Dice
from tests.verification.convergence import DTS_S
from tests.verification.figure import Figure
from tests.verification.links import linked_scenario_of
from tests.verification.parting import OF_SENSORS, OF_TASKS, orders

AMOUNTS = ("volume_mbit", "input_mbit", "output_mbit", "size_mbit", "duration_min")


def figures(quick: bool = False) -> Iterator[Figure]:
    """The slope of the error over dt, log over log."""
    few, dts_s = (range(8), DTS_S[:3]) if quick else (range(64), DTS_S)
    tasks = ("delay_s",) if quick else OF_TASKS
    yield from orders(few, 0.15, dts_s, computing_scenario_of, tasks)
    yield from orders(few, 0.15, dts_s, sensing_scenario_of, OF_SENSORS)


def uneven(mapping: dict[str, Any], dice: Dice) -> dict[str, Any]:
    """The same scenario, with amounts that are no multiples of each other."""
    for service in mapping["services"].values():
        for key in AMOUNTS:
            if key in service:
                service[key] = [round(each * dice.between(0.9, 1.1), 6) for each in service[key]]
    return mapping


def with_backhauls(mapping: dict[str, Any], dice: Dice, *kbps: float) -> None:
    """Give all drones and access points a backhaul each."""
    for each in [mapping["drones"], *mapping["access_points"]]:
        each["backhaul"] = {"kind": "capacity", "kbps": dice.of(*kbps)}


def computing_scenario_of(seed: int) -> dict[str, Any]:
    """A random scenario whose drones and access points compute tasks, as users may."""
    mapping, dice = linked_scenario_of(seed), Dice(seed + 2_100_000)
    held = mapping["drones"]["radio"]["sharing"] == "held"
    discipline = dice.of(*random_tasks.DISCIPLINES)
    for each in [mapping["drones"], *mapping["access_points"]]:
        each["processor"] = {
            "cores": dice.of(1, 1, 2),
            "ghz": dice.of(0.05, 0.3),
            "sharing": discipline,
            "on_ground": dice.of(True, False),
        }
    mapping["users"]["processor"] = {"ghz": dice.of(0.02, 0.3)}
    mapping["offloading"] = dice.of("always", "always", "never", "shortest", "split")
    mapping["services"]["vision"] = random_tasks.task(dice, held)
    mix = {"vision": 3.0, **dice.of({}, {"file": 1.0})}
    mapping["demand"] = dice.of(
        {"kind": "poisson", "rate_per_hour": 90.0, "mix": mix},
        {"kind": "dynamic", "think_time_s": 20.0, "mix": mix},
    )
    if dice.of(True, False):
        with_backhauls(mapping, dice, 350.5, 1007.3, 5903.1)
        mapping["services"]["vision"]["handover"] = dice.of("resume", "migrate", "migrate")
    return uneven(mapping, dice)


def migrating_scenario_of(seed: int) -> dict[str, Any]:
    """One of the scenarios of tasks, with queues at slow processors, whose tasks follow users."""
    mapping, dice = computing_scenario_of(seed), Dice(seed + 2_400_000)
    for each in [mapping["drones"], *mapping["access_points"]]:
        each["processor"] |= {"cores": 1, "ghz": dice.of(0.05, 0.1)}
        each["processor"]["sharing"] = random_tasks.ORDERS[seed % 3]
    with_backhauls(mapping, dice, 1007.3, 5903.1)
    mapping["offloading"] = "always"
    vision = mapping["services"]["vision"]
    vision |= {"input_mbit": [0.31, 0.9], "cycles_per_bit": [700.125, 2000]}
    vision |= {"handover": "migrate", "deadline_s": 300, "on_deadline": "count"}
    return mapping


def uplinked_scenario_of(seed: int) -> dict[str, Any]:
    """One of the scenarios of tasks or of sensors, with bands for uploads alone."""
    mapping = (computing_scenario_of, sensing_scenario_of)[seed % 2](seed // 2)
    dice = Dice(seed + 2_300_000)
    for each in [mapping["drones"], *mapping["access_points"]]:
        each["radio"] = each["radio"] | {"uplink_mhz": dice.of(0.3, 0.3, 1.0, 2.5)}
    return mapping


def sensing_scenario_of(seed: int) -> dict[str, Any]:
    """A random scenario whose last users are sensors.

    Unless they take updates at will, these are no more than three a minute. Where a buffer always
    has one, each is sent later than the one before by a part of dt more, and which one is kept
    depends on that.
    """
    mapping, dice = linked_scenario_of(seed), Dice(seed + 2_200_000)
    held = mapping["drones"]["radio"]["sharing"] == "held"
    phones, sensors = {"name": "phones", **mapping["users"]}, dict(mapping["users"])
    phones["count"] = 6
    demand = {"kind": "sensing", "service": "reading"}
    sensors |= {"name": "meters", "count": dice.of(5, 10), "demand": demand}
    mapping["services"]["reading"] = service = random_sensors.updates(dice, held)
    often = {"mean_s": (2.5, 20), "every_s": (5, 30.25)}
    for key, (quick_s, slow_s) in often.items():
        if service["updates"].get(key) == quick_s:
            service["updates"][key] = slow_s
    if dice.of(True, False):
        with_backhauls(mapping, dice, 80.7, 703.9, 5903.1)
    elif not mapping["drones"]["battery"] and not mapping["access_points"]:
        service["delivered"] = "drone"
    if service.get("delivered") == "ground":
        mapping["drones"]["store_mbit"] = dice.of(None, 9.5)
    mapping["users"] = [phones, sensors]
    return uneven(mapping, dice)
