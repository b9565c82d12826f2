"""The scenarios with sensors in which the mean age at the ground can be bounded."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from desim_uav.errors import ScenarioError
from desim_uav.model.collecting import Sensing
from desim_uav.model.motion.motion import cruise_of
from desim_uav.model.radio.radio import LinkClasses
from desim_uav.model.services import Collecting, collecting_of
from desim_uav.registry import kind_name
from desim_uav.scenario.schema import Scenario

ONLY = "the mean age can be bounded only"


def gathers(scenario: Scenario) -> bool:
    """Return whether data of sensors are carried to the ground, so that ages are bounded."""
    return any(how.ground for how in _gathered(scenario).values())


def _gathered(scenario: Scenario) -> dict[str, Collecting]:
    """Return how the updates of each service that sensors send are kept."""
    names = {demand.service for demand in scenario.demands if isinstance(demand, Sensing)}
    how = {name: collecting_of(scenario.services[name]) for name in sorted(names)}
    return {name: kept for name, kept in how.items() if kept is not None}


def refuse_other_gathering(scenario: Scenario) -> None:
    """Raise ScenarioError, with all keys that prevent a bound of the mean age."""
    problems = tuple(_problems(scenario))
    if problems:
        raise ScenarioError(*problems)


def _problems(scenario: Scenario) -> Iterator[str]:
    """Yield what prevents a bound: the key, its value, and what is allowed."""
    if scenario.differing:
        yield f"drones: the types {', '.join(scenario.type_names)} differ: {ONLY} for one type"
        return
    drones = scenario.fleet[0]
    radio: Any = drones.radio
    for name, how in _gathered(scenario).items():
        if not how.ground:
            yield f"services.{name}.delivered: drone: {ONLY} with ground, where drones have to land"
    if not scenario.users_stay:
        yield f"users.mobility: {ONLY} with static, where sensors stay where they are"
    if scenario.decisions.by_event:
        yield f"decisions: event: {ONLY} with clock, where all drones are asked at each step"
    if scenario.free or cruise_of(drones.motion):
        yield f"drones.motion: {ONLY} with cells and without a choice of cruise speeds"
    if scenario.three_d:
        yield f"map.dimensions: 3: {ONLY} with 2, where drones keep their height"
    if drones.battery is None:
        yield f"drones.battery: null: {ONLY} with a battery, as drones land to charge it"
    if drones.backhaul is not None or scenario.access_points:
        yield f"drones.backhaul, access_points: {ONLY} where drones alone bring data to the ground"
    if type(radio) is not LinkClasses or radio.line_of_sight != "mean":
        yield (
            f"drones.radio.kind: {kind_name(radio)}: {ONLY} with link_classes and line_of_sight: "
            "mean, where a rate depends on the distance alone"
        )
    if scenario.on_conflict != "log":
        yield f"on_conflict: {scenario.on_conflict}: {ONLY} with log"
