"""Which drones can fly in the wind of a scenario."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from desim_uav.model.energy.battery import in_joules, time_of_hover_problems
from desim_uav.model.motion.limits import CALM, Wind
from desim_uav.model.motion.wind import motion_in
from desim_uav.registry import FAULTS, kind_name, what_failed
from desim_uav.scenario.drones import Drones
from desim_uav.scenario.finding import Finding
from desim_uav.scenario.schema import Scenario


def drones_can_fly_in_the_wind(scenario: Scenario) -> Iterator[Finding]:
    """Drones that cannot hover in the wind, and motions and batteries that know of none."""
    wind, key = scenario.wind_mps, ("wind_mps",)
    if wind == CALM:
        return
    for path, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True):
        problem = problem_in_wind(drones, wind)
        if problem:
            yield Finding(key, problem, ((*path, "motion"),))
        battery: Any = drones.battery
        if getattr(battery, "needs_calm", False):
            kind = kind_name(battery)
            yield Finding(key, f"not beside drones.battery: {kind!r}", ((*path, "battery"),))
        elif in_joules(battery) and hasattr(battery, "level_w"):
            hover_w = battery.level_w(math.hypot(*wind))
            lasts_min = battery.capacity_uj / (hover_w * 60e6)
            for reason in time_of_hover_problems(battery.capacity_wh, hover_w, lasts_min):
                yield Finding(key, reason, ((*path, "battery"),))


def problem_in_wind(drones: Drones, wind: Wind) -> str:
    """Return why drones cannot hover in the wind, or nothing if they can."""
    try:
        motion_in(drones.motion, wind, (0, 0, 1))
    except ValueError as error:
        return str(error)
    except FAULTS as error:
        return what_failed(error)
    return ""
