"""The model whose optimum is known: the paper's, with a disc around each drone and times to serve.

Bounds and best policies depend on which users are in a footprint, and on nothing else about links.
In other models they would be wrong, so scenarios with one are refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from desim_uav.errors import ScenarioError
from desim_uav.model.motion.motion import cruise_of
from desim_uav.model.radio.radio import Disc
from desim_uav.model.services import has_volumes, is_one_time
from desim_uav.registry import kind_name
from desim_uav.scenario.schema import Scenario

ONLY = "the optimum can be computed only"


def refuse_other_models(scenario: Scenario, several_types: bool = False) -> None:
    """Raise ScenarioError, with all keys that prevent it, unless the model is the paper's.

    Types of drones that differ are refused too, unless there may be ``several_types``.
    """
    problems = tuple(_problems(scenario, several_types))
    if problems:
        raise ScenarioError(*problems)


def _problems(scenario: Scenario, several_types: bool) -> Iterator[str]:
    """Yield what is not the paper's model: the key, its value, and what is allowed."""
    if scenario.differing and not several_types:
        yield (
            f"drones: the types {', '.join(scenario.type_names)} differ in "
            f"{', '.join(scenario.differing)}: {ONLY} for drones of one type"
        )
        return
    if scenario.decisions.by_event:
        yield f"decisions: event: {ONLY} with clock, where all drones are asked at each step"
    if scenario.free:
        yield f"drones.motion.space: free: {ONLY} with cells, of which there are finitely many"
    if any(drones.shielded for drones in scenario.fleet):
        yield (
            f"drones.shielded: true: {ONLY} with false, because shielded drones may return above "
            "return_below"
        )
    if cruise_of(scenario.fleet[0].motion):
        yield (
            f"drones.motion.cruise: {list(cruise_of(scenario.fleet[0].motion))}: {ONLY} without a "
            "choice of cruise speeds (null)"
        )
    association = scenario.association
    radios: list[Any] = [drones.radio for drones in scenario.fleet]
    for kind in dict.fromkeys(kind_name(radio) for radio in radios if type(radio) is not Disc):
        yield (
            f"drones.radio.kind: {kind}: {ONLY} with disc, where a user is covered within "
            "drones.footprint_radius_m"
        )
    if association.by_level:
        yield (
            f"association.kind: {kind_name(association)}: {ONLY} with entered_first, which "
            "compares no levels"
        )
    if scenario.access_points:
        count = len(scenario.access_points)
        yield f"access_points: {count} given: {ONLY} without access points ([])"
    if scenario.on_conflict != "log":
        yield (
            f"on_conflict: {scenario.on_conflict}: {ONLY} with log, where no move of a drone is "
            "blocked by another"
        )
    for name, service in scenario.services.items():
        if not is_one_time(service):
            other = "a volume" if has_volumes(service) else "several times"
            yield (
                f"services.{name}.kind: {kind_name(service)}: {ONLY} with services that ask for "
                f"a time (hold), not for {other}"
            )
