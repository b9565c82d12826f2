"""Warnings about values of a scenario that are allowed, but probably not intended.

Components yield warnings in a method ``doubts``, and describe a recording in ``summary``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from desim_uav.errors import notice
from desim_uav.model.demand.demand import Trace as RequestTrace
from desim_uav.model.demand.demand import drawn_by
from desim_uav.model.geometry.extents import extent_of, like_degrees
from desim_uav.model.mobility.walks import Area
from desim_uav.model.rules import US
from desim_uav.model.services import (
    MICROBITS,
    PROCESSOR,
    amount_of,
    collecting_of,
    computes,
    largest_bps,
    rate_of,
    terms_of,
)
from desim_uav.scenario.buildings import BuildingsOfItu
from desim_uav.scenario.radio_checks import losses_without_bounds
from desim_uav.scenario.schema import Scenario
from desim_uav.scenario.users import Users
from desim_uav.scenario.yaml12 import KeyPath


def doubts(scenario: Scenario) -> Iterator[str]:
    """Yield warnings about values that are probably not intended, each with its key."""
    for doubt in DOUBTS:
        yield from doubt(scenario)


def warn_of(scenario: Scenario) -> None:
    """Print the warnings about a scenario on stderr, one line each."""
    for doubt in doubts(scenario):
        notice(f"warning: {doubt}")


def recordings(scenario: Scenario) -> Iterator[str]:
    """Yield a description of each recording of a scenario, with its key."""
    components: list[tuple[KeyPath, Any, int]] = [
        ((*key, "mobility"), users.mobility, users.count) for key, users in _groups(scenario)
    ]
    components += [(key, demand, sum(counts)) for key, demand, counts in scenario.asking]
    for key, component, count in components:
        summary = getattr(component, "summary", None)
        if summary:
            yield f"{_text_of(key)}: {summary(count, _horizon_s(scenario))}"


def circles_fit_the_map(scenario: Scenario) -> Iterator[str]:
    """Yield warnings about clusters and stations whose circles do not fit the map."""
    width, depth = scenario.map.size_m
    half, on_map = min(width, depth) / 2.0, f"the map of {width:g} x {depth:g} m"
    stations = scenario.stations
    for key, users in _groups(scenario):
        clusters = users.clusters
        if clusters is not None and clusters.radius_m[1] >= half:
            low, high = clusters.radius_m
            yield (
                f"{_text_of(key)}.clusters.radius_m: [{low:g}, {high:g}]: clusters of {half:g} m "
                f"and more lie in the middle of {on_map} (map.size_m), one upon the other"
            )
    on_circle = stations.count > 0 or any(one.start_cells is None for one in scenario.fleet)
    if stations.cells is None and on_circle and stations.radius_m > half:
        yield (
            f"stations.radius_m: {stations.radius_m:g}: the circle leaves {on_map} (map.size_m); "
            f"what is off it is moved to its edge"
        )


def drones_can_climb(scenario: Scenario) -> Iterator[str]:
    """Yield a warning about a map in 3D that has one level."""
    if scenario.three_d and scenario.map.most_levels == 1:
        lowest_m = scenario.map.levels.min_altitude_m
        yield (
            f"map.dimensions: 3: there is one level, at {lowest_m:g} m, because no building is as "
            "high, so drones do not climb; map.levels.max_altitude_m adds levels above it, and "
            "map.dimensions: 2 leaves out the actions of climbing"
        )


def batteries_are_meant(scenario: Scenario) -> Iterator[str]:
    """Yield warnings about contradicting parameters of batteries, and about energy in wind."""
    wind_mps = math.hypot(*scenario.wind_mps)
    for path, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True):
        own = getattr(drones.battery, "doubts", None)
        for doubt in own(wind_mps) if own else ():
            yield f"{'.'.join(map(str, path))}.battery: {doubt}"


def losses_are_of_the_carrier(scenario: Scenario) -> Iterator[str]:
    """Yield warnings about path losses that were fitted at a carrier far from the radio's."""
    for path, radio in _radios(scenario):
        own = getattr(getattr(radio, "path_loss", None), "doubts", None)
        for doubt in own(radio.carrier_ghz) if own else ():
            yield f"{_text_of(path)}.path_loss: {doubt}"


def recordings_fit_an_episode(scenario: Scenario) -> Iterator[str]:
    """Yield warnings about recordings outside of an episode, or not in metres."""
    horizon_s = _horizon_s(scenario)
    for path, users in _groups(scenario):
        own = getattr(users.mobility, "doubts", None)
        for doubt in own(users.count, Area(*scenario.map.size_m), horizon_s) if own else ():
            yield f"{_text_of(path)}.mobility: {doubt}"
    for key, demand, counts in scenario.asking:
        own = getattr(drawn_by(demand, scenario.services), "doubts", None)
        for doubt in own(sum(counts), horizon_s) if own else ():
            yield f"{_text_of(key)}: {doubt}"


def groups_ask_by_the_demand(scenario: Scenario) -> Iterator[str]:
    """Yield a warning about a demand by which nobody asks."""
    if "demand" in scenario.model_fields_set and not scenario.has_common_demand:
        yield "demand: nobody asks by it, because each group of users has a demand of its own"


def places_are_in_metres(scenario: Scenario) -> Iterator[str]:
    """Yield warnings about positions and zones that look like longitudes and latitudes."""
    area = Area(*scenario.map.size_m)
    positions = {
        f"{_text_of(key)}.positions_m": users.positions_m or () for key, users in _groups(scenario)
    }
    for number, zone in enumerate(scenario.map.no_fly):
        positions[f"map.no_fly.{number}.polygon_m"] = zone.polygon_m
    for key, places_m in positions.items():
        if not places_m:
            continue
        extent = extent_of(np.array(places_m))
        if like_degrees(extent, area):
            yield (
                f"{key}: {extent}: these are hardly metres but longitudes and latitudes in "
                "degrees; project them to metres"
            )


def buildings_are_known(scenario: Scenario) -> Iterator[str]:
    """Yield what was assumed of buildings and left out, and what a synthetic city does not give."""
    for words in scenario.map.city_of_file.notices:
        yield f"map.buildings: {words}"
    if isinstance(scenario.map.buildings, BuildingsOfItu):
        yield (
            "map.buildings: kind: itu: the share of links with line of sight does not follow the "
            "curve of al_hourani"
        )


def zones_stand_in_the_way(scenario: Scenario) -> Iterator[str]:
    """Yield warnings about no-fly zones that no drone can meet."""
    width, depth = scenario.map.size_m
    for number, zone in enumerate(scenario.map.no_fly):
        extent = extent_of(np.array(zone.polygon_m))
        if extent.least_x_m >= width or extent.least_y_m >= depth:
            yield (
                f"map.no_fly.{number}.polygon_m: {extent}: it is off the map of {width:g} x "
                f"{depth:g} m (map.size_m)"
            )


def services_fit_the_bandwidth(scenario: Scenario) -> Iterator[str]:
    """Yield warnings about requests for more than the bandwidth of any drone."""
    most_bps = scenario.most_bps or math.inf
    largest = {name: largest_bps(service) for name, service in scenario.services.items()}
    asked: dict[str, float] = {}
    for path, demand, _ in scenario.asking:
        mix = getattr(demand, "mix", None)
        if isinstance(demand, RequestTrace):
            asked |= {
                f"{_text_of(path)}: {demand.file}: {name}": 1000.0 * kbps
                for name, kbps in demand.largest_kbps().items()
            }
            continue
        names = [name for name in largest if not isinstance(mix, Mapping) or mix.get(name, 0.0) > 0]
        asked |= {f"services.{name}": largest[name] for name in names}
    keys = (
        " (its bandwidth and its backhaul)" if any(one.backhaul for one in scenario.fleet) else ""
    )
    for key, bps in asked.items():
        if bps > most_bps:
            yield (
                f"{key}: requests for {bps / 1000:g} kbit/s are never served, because no drone has "
                f"more than {most_bps / 1000:g} kbit/s{keys}"
            )


def something_is_uploaded(scenario: Scenario) -> Iterator[str]:
    """Yield warnings about bands for uploads where no service has any."""
    if any(stage.up for service in scenario.services.values() for stage in service.stages()):
        return
    for path, radio in _radios(scenario):
        if getattr(radio, "uplink_mhz", None) is not None:
            yield (
                f"{_text_of(path)}.uplink_mhz: {radio.uplink_mhz:g}: this band is idle, because no "
                "service has uploads (inputs of kind compute, or updates of kind collect)"
            )


def deadlines_can_be_met(scenario: Scenario) -> Iterator[str]:
    """Yield warnings about deadlines that even the fastest task misses if it has all it needs."""
    most_bps, clock = scenario.most_bps, scenario.most_clock
    for name, service in scenario.services.items():
        deadline_us, stages = terms_of(service).deadline_us, service.stages()
        rates = [rate_of(stage, most_bps, clock) for stage in stages]
        if deadline_us is None or not all(rates):
            continue
        amounts = [amount_of(service, stage).least for stage in stages]
        least_us = sum(one / rate for one, rate in zip(amounts, rates, strict=True))
        own = [users.processor.clock for users in scenario.user_groups if users.processor]
        if scenario.offloading.alone and own and computes(service):
            cycles = [
                one for one, at in zip(amounts, stages, strict=True) if at.resource == PROCESSOR
            ]
            own_us = sum(cycles) / max(own)
            least_us *= own_us / (own_us + least_us)  # both do a part at once
        if least_us > deadline_us:
            yield (
                f"services.{name}: each request is late: its deadline is {deadline_us / US:g} s, "
                f"and the least that it can take is {least_us / US:g} s"
            )


def tasks_can_migrate(scenario: Scenario) -> Iterator[str]:
    """Yield warnings about tasks that shall follow their users without a way to do so."""
    joined = sum(drones.count for drones in scenario.fleet if drones.backhaul)
    joined += sum(point.backhaul is not None for point in scenario.access_points)
    for name, service in scenario.services.items():
        if terms_of(service).migrates and joined < 2:
            yield (
                f"services.{name}: its tasks never migrate from one processor to another, which "
                f"takes two drones or access points with a backhaul; the scenario has {joined}"
            )


def updates_fit_in_stores(scenario: Scenario) -> Iterator[str]:
    """Yield warnings about updates for which the stores of all drones are too small."""
    stores = [drones.store_mbit for drones in scenario.fleet if drones.store_mbit is not None]
    if len(stores) < len(scenario.fleet) or scenario.access_points:
        return
    for name, service in scenario.services.items():
        keeps = collecting_of(service)
        most_mbit = max(amount_of(service, one).most for one in service.stages()) / MICROBITS
        if keeps is not None and keeps.ground and most_mbit > max(stores):
            yield (
                f"services.{name}: updates of {most_mbit:g} Mbit are never sent, because no drone "
                f"can store more than {max(stores):g} Mbit (store_mbit)"
            )


def losses_have_bounds(scenario: Scenario) -> Iterator[str]:
    """Yield warnings about path losses of one's own whose bounds have to be sampled."""
    for key, why in losses_without_bounds(scenario):
        yield (
            f"{key}: it has no method slope, so how fast a level can change is computed from "
            f"samples, which is slower and no proof; it is needed because {why}"
        )


DOUBTS: tuple[Callable[[Scenario], Iterator[str]], ...] = (
    circles_fit_the_map,
    drones_can_climb,
    batteries_are_meant,
    losses_are_of_the_carrier,
    recordings_fit_an_episode,
    groups_ask_by_the_demand,
    places_are_in_metres,
    buildings_are_known,
    zones_stand_in_the_way,
    services_fit_the_bandwidth,
    something_is_uploaded,
    deadlines_can_be_met,
    tasks_can_migrate,
    updates_fit_in_stores,
    losses_have_bounds,
)


def _groups(scenario: Scenario) -> Iterator[tuple[KeyPath, Users]]:
    """Yield the groups of users, each with its key."""
    yield from zip(scenario.user_keys, scenario.user_groups, strict=True)


def _radios(scenario: Scenario) -> Iterator[tuple[KeyPath, Any]]:
    """Yield the radios of drones and of access points, each with its key."""
    for path, one in zip(scenario.fleet_keys, scenario.fleet, strict=True):
        yield (*path, "radio"), one.radio
    for k, point in enumerate(scenario.access_points):
        yield ("access_points", k, "radio"), point.radio


def _text_of(key: KeyPath) -> str:
    return ".".join(map(str, key))


def _horizon_s(scenario: Scenario) -> float:
    return scenario.episode.steps * scenario.episode.step_s
