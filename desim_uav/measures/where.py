"""Which scenarios have a measure, and what the others lack."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from desim_uav.model.demand.demand import is_sensed
from desim_uav.model.energy.battery import in_joules
from desim_uav.model.services import collecting_of, has_volumes, is_task
from desim_uav.scenario.schema import Scenario


@dataclass(frozen=True)
class Where:
    """Which scenarios have a measure, and what the others lack."""

    holds: Callable[[Scenario], bool]
    lack: str = ""


def _has_tasks(scenario: Scenario) -> bool:
    return any(map(is_task, scenario.services.values()))


def _has_sensors(scenario: Scenario) -> bool:
    return any(map(is_sensed, scenario.demands))


def _has_limit(scenario: Scenario) -> bool:
    kept = filter(None, map(collecting_of, scenario.services.values()))
    return _has_sensors(scenario) and any(each.limit_us is not None for each in kept)


def _is_graded(scenario: Scenario) -> bool:
    return bool(scenario.access_points) or any(each.radio.graded for each in scenario.fleet)


def _all_in_joules(scenario: Scenario) -> bool:
    return all(in_joules(drones.battery) for drones in scenario.fleet)


def _has_own(scenario: Scenario) -> bool:
    return _has_tasks(scenario) and any(users.processor for users in scenario.user_groups)


EVERYWHERE = Where(lambda scenario: True)
NOWHERE = Where(lambda scenario: False)
TASKS = Where(_has_tasks, "no service has tasks")
SENSORS = Where(_has_sensors, "no users are sensors")
LIMITED = Where(_has_limit, "no sensors send a service with age_limit_s")
TASKS_OR_SENSORS = Where(lambda scenario: _has_tasks(scenario) or _has_sensors(scenario))
VOLUMES = Where(
    lambda scenario: any(map(has_volumes, scenario.services.values())),
    "no service asks for a volume",
)
OWN = Where(_has_own, "no user has a processor for tasks")
GRADED = Where(_is_graded, "the radio is the paper's disc")
APART = Where(lambda scenario: scenario.separation_m is not None, "drones have to keep no distance")
IN_JOULES = Where(_all_in_joules, "not all batteries are measured in Wh")
SOME_IN_JOULES = Where(
    lambda scenario: any(in_joules(drones.battery) for drones in scenario.fleet),
    "no battery is measured in Wh",
)
TASKS_IN_JOULES = Where(
    lambda scenario: _has_tasks(scenario) and _all_in_joules(scenario),
    "no service has tasks, or not all batteries are measured in Wh",
)
