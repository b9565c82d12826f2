"""Tasks and sensors against the simulator with fixed time steps, which shares no code with them.

The scenarios are those of ``links.py``. Tasks are those of ``random_tasks`` at processors of all
disciplines; sensors send the updates of ``random_sensors``, beside users who ask for files.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from tests.engine import random_sensors, random_tasks
from tests.engine.random_parts import Dice
from tests.verification.convergence import DTS_S, slopes
from tests.verification.figure import Figure
from tests.verification.links import linked_scenario_of

OF_TASKS = ("delay_s", "computing_s", "own_s")
"""QoE1 is left out: it jumps where a task that is done in one simulator is late in the other."""
DTS_OF_SERVICES = (1.0, *DTS_S[:3])
OF_SENSORS = ("age_s", "delivered_s")


def figures(quick: bool = False) -> Iterator[Figure]:
    """The slope of the error over dt, log over log."""
    seeds, tolerance = (range(16), 0.4) if quick else (range(128), 0.15)
    dts_s = DTS_S[:3] if quick else DTS_OF_SERVICES
    yield from slopes(seeds, tolerance, dts_s, computing_scenario_of, OF_TASKS)
    yield from slopes(seeds, tolerance, dts_s, sensing_scenario_of, OF_SENSORS)


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

    They take no more than some updates a minute: where buffers are always full, it depends on the
    microsecond of each completion which update is kept, and all that follows depends on that.
    """
    mapping, dice = linked_scenario_of(seed), Dice(seed + 2_200_000)
    held = mapping["drones"]["radio"]["sharing"] == "held"
    phones, sensors = {"name": "phones", **mapping["users"]}, dict(mapping["users"])
    phones["count"] = 6
    demand = {"kind": "sensing", "service": "reading"}
    sensors |= {"name": "meters", "count": dice.of(5, 10), "demand": demand}
    mapping["services"]["reading"] = service = random_sensors.updates(dice, held)
    if service["updates"].get("mean_s") == 2.5:
        service["updates"]["mean_s"] = 20
    if not mapping["drones"]["battery"] and not mapping["access_points"]:
        service["delivered"] = "drone"
    if service.get("delivered") == "ground":
        mapping["drones"]["store_mbit"] = dice.of(None, 9.5)
    mapping["users"] = [phones, sensors]
    return mapping
