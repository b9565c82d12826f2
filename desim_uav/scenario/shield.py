"""What shielded drones do not go with, because no station would be sure to be reached."""

from __future__ import annotations

import math
from collections.abc import Iterator

from desim_uav.model.energy.battery import capacity_of, in_joules
from desim_uav.model.motion.needs import drawn_uj
from desim_uav.model.motion.planner import MOST_PLANNING
from desim_uav.model.motion.wind import rest_in
from desim_uav.model.rules import US
from desim_uav.registry import FAULTS
from desim_uav.scenario.drones import Drones, flies_freely
from desim_uav.scenario.finding import Finding
from desim_uav.scenario.schema import Scenario
from desim_uav.scenario.yaml12 import KeyPath


def shields_hold(scenario: Scenario) -> Iterator[Finding]:
    """Shielded drones that could not be kept from a crash."""
    for path, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True):
        if drones.shielded:
            yield from what_is_unsure(scenario, drones, path)


def what_is_unsure(scenario: Scenario, drones: Drones, path: KeyPath) -> Iterator[Finding]:
    """What keeps a shield from holding for a type of drones, whose key is ``path``."""
    if drones.battery is not None:
        key = (*path, "shielded")
        yield from _battery_lasts(scenario, drones, key, (*path, "battery"))
        if not flies_freely(drones):
            yield from _ways_are_sure(scenario, key)
            yield from _ways_are_few(scenario, key)


def _battery_lasts(
    scenario: Scenario, drones: Drones, key: KeyPath, battery: KeyPath
) -> Iterator[Finding]:
    """A full battery with which a drone could not leave a station for one command."""
    energy, charging = drones.battery, scenario.charging
    assert energy is not None and charging is not None
    try:
        drain = drain_of_hover(scenario, drones)
        full = charging.full(capacity_of(energy))
    except FAULTS:
        return  # which another check reports
    if full <= drain:
        yield Finding(
            key,
            f"a full battery does not last longer than a hover of {_hover_s(scenario):g} s, "
            "so that a drone could never leave a station",
            (battery, ("stations", "charging"), ("episode", "step_s"), ("decisions",)),
        )


def drain_of_hover(scenario: Scenario, drones: Drones) -> int:
    """Return what a hover takes of a battery until the next command, with its processor."""
    energy, span_us = drones.battery, round(_hover_s(scenario) * US)
    if energy is None:
        return 0
    drain = energy.drain_of(rest_in(scenario.wind_mps), span_us)
    if drones.processor is not None and in_joules(energy):
        drain += drawn_uj(drones.processor.most_uw, span_us)
    return drain


def _hover_s(scenario: Scenario) -> float:
    decisions, step_s = scenario.decisions, scenario.episode.step_s
    return decisions.patience_s if decisions.by_event else step_s


def _ways_are_sure(scenario: Scenario, key: KeyPath) -> Iterator[Finding]:
    """Drones that may err on their way home, and be blocked by others."""
    if scenario.position_noise is not None and scenario.on_conflict == "hover_higher_index":
        yield Finding(
            key,
            "not beside position_noise and on_conflict: hover_higher_index, where returns may lead "
            "astray and moves may be blocked, so that no way to a station is sure",
            (("position_noise",), ("on_conflict",)),
        )


def _ways_are_few(scenario: Scenario, key: KeyPath) -> Iterator[Finding]:
    """More places than returns can be planned from in some minutes."""
    places = math.prod(scenario.map.cells) * scenario.map.most_levels
    if places * places > MOST_PLANNING:
        yield Finding(
            key,
            f"ways back from {places:,} places take too long to plan; a map for shielded drones "
            f"has at most {math.isqrt(MOST_PLANNING):,} places (cells times levels)",
            (("map", "cells"), ("map", "levels"), ("map", "obstacles")),
        )
