"""Checks of radio, association and transfers, each of which needs more than one key."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from desim_uav.model.demand.demand import Continuous, Trace
from desim_uav.model.radio.levels import problem_of_bounds, why_not_compiled
from desim_uav.model.radio.path_loss import RowPathLoss
from desim_uav.model.radio.radio import LinkClasses
from desim_uav.model.radio.rings import line_of_sight_ring_m, rings
from desim_uav.model.services import has_volumes, is_one_time, problems_of, rates_bps
from desim_uav.registry import FAULTS, kind_name, what_failed
from desim_uav.rowcode.components import over_rows
from desim_uav.scenario.finding import Finding
from desim_uav.scenario.schema import Scenario
from desim_uav.scenario.yaml12 import KeyPath

"""The largest volume of a request, in millionths of a bit: it fits a 64-bit integer."""

LOWEST: KeyPath = ("map", "levels", "min_altitude_m")
_CLIMBS: tuple[KeyPath, ...] = (("map", "dimensions"), ("map", "obstacles"))


class Sender(NamedTuple):
    """A radio, its key, and what messages call those who have it."""

    path: KeyPath
    radio: Any
    name: str


class RadioLinks(NamedTuple):
    """A radio with classes and its key; the lowest and the highest place of its antenna."""

    path: KeyPath
    radio: LinkClasses
    lowest_m: float
    highest_m: float
    height_key: KeyPath


def drones_and_access_points_have_levels(scenario: Scenario) -> Iterator[Finding]:
    """Association by level, or an access point, with a disc."""
    for index, point in enumerate(scenario.access_points):
        if not isinstance(point.radio, LinkClasses):
            yield Finding(
                ("access_points", index, "radio"),
                "must be kind: link_classes; a disc has no transmitted power",
            )
    discs = [one for one in _of_drones(scenario) if not isinstance(one.radio, LinkClasses)]
    if not discs:
        return
    path, key = discs[0].path, ".".join(map(str, discs[0].path))
    if scenario.association.by_level:
        yield Finding(
            ("association",),
            f"compares levels, which {discs[0].name} disc does not have; "
            f"write {key}: {{kind: link_classes}}, or association: entered_first",
            (path,),
        )
    for one in _senders(scenario):
        if one.radio.reuse:
            yield Finding(
                (*one.path, "interference"),
                f"needs the levels of drones too; write {key}: {{kind: link_classes}}",
                (path,),
            )


def access_points_are_on_the_map(scenario: Scenario) -> Iterator[Finding]:
    """Access points off the map."""
    width, depth = scenario.map.size_m
    for index, point in enumerate(scenario.access_points):
        x, y = point.at_m
        if x > width or y > depth:
            yield Finding(
                ("access_points", index, "at_m"),
                f"off the map, which is {width:g} x {depth:g} m",
                (("map", "size_m"),),
            )


def access_points_admit_as_drones(scenario: Scenario) -> Iterator[Finding]:
    """Access points beside types of drones that admit requests in different ways."""
    if not scenario.access_points:
        return
    first = scenario.fleet[0].admission
    for key, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True):
        if drones.admission != first:
            yield Finding(
                (*key, "admission"),
                "must be that of drones.0 beside access_points, which admit requests as drones do",
                (("drones", 0, "admission"), ("access_points",)),
            )


def bands_are_shared_by_all(scenario: Scenario) -> Iterator[Finding]:
    """Radios that interfere, or share, otherwise than that of the (first type of) drones."""
    (first_path, drones, owner), *others = _senders(scenario)
    key_of_sharing = ".".join(map(str, (*first_path, "sharing")))
    for path, radio, _ in others:
        if radio.sharing.divides != drones.sharing.divides:
            yield Finding(
                (*path, "sharing"),
                f"must {'' if drones.sharing.divides else 'not '}share, as {key_of_sharing} is "
                f"{kind_name(drones.sharing)}: transfers hold rates everywhere or nowhere",
                ((*first_path, "sharing"),),
            )
        if not isinstance(drones, LinkClasses) or not isinstance(radio, LinkClasses):
            continue
        if radio.reuse != drones.reuse:
            yield Finding(
                (*path, "interference"),
                f"must be as {owner}, {_text_of(drones.interference)}: "
                "interference is the same for all",
                ((*first_path, "interference"),),
            )
        elif drones.reuse:
            for key in ("carrier_ghz", "bandwidth_mhz"):
                if getattr(radio, key) != getattr(drones, key):
                    yield Finding(
                        (*path, key),
                        f"must be as {owner}, {getattr(drones, key):g}: "
                        "those who interfere have one carrier and one bandwidth",
                        ((*first_path, key), (*first_path, "interference")),
                    )


def links_fit_the_map(scenario: Scenario) -> Iterator[Finding]:
    """Line of sight that no building or path loss can tell, and drones below their users."""
    for links in _links(scenario):
        path, radio = links.path, links.radio
        if radio.line_of_sight == "buildings" and not _has_buildings(scenario):
            yield Finding(
                (*path, "line_of_sight"),
                "needs buildings: map.dimensions: 3, and map.obstacles or map.buildings",
                _CLIMBS,
            )
        if radio.line_of_sight == "drawn" and _always_sees(radio.path_loss):
            yield Finding(
                (*path, "line_of_sight"),
                "needs a path loss that tells how likely line of sight is: al_hourani, or one of "
                "your own with p_los",
                ((*path, "path_loss"),),
            )
        mean = radio.line_of_sight == "mean" and not _always_sees(radio.path_loss)
        if mean and radio.shadowing is not None:
            yield Finding(
                (*path, "shadowing"),
                "is for links with and without line of sight, which line_of_sight: mean does not "
                "tell apart; write line_of_sight: drawn or buildings",
                ((*path, "line_of_sight"), (*path, "path_loss")),
            )
        tallest_m = _tallest_user_m(scenario)
        if links.lowest_m <= tallest_m:
            yield Finding(
                links.height_key,
                f"must be above the users, who are up to {tallest_m:g} m high, where links have "
                "classes",
                (*_heights_of_users(scenario), path, *_CLIMBS),
            )


def losses_can_be_used(scenario: Scenario) -> Iterator[Finding]:
    """A path loss that falls with the distance, by which links reach too far, or a wrong slope."""
    for links in _links(scenario):
        problem = _problem_of_loss(scenario, links)
        if problem:
            also = (*_CLIMBS, ("association",), links.path)
            yield Finding((*links.path, "path_loss"), problem, also)


def _problem_of_loss(scenario: Scenario, links: RadioLinks) -> str:
    """Return why a path loss cannot be used; one of one's own must keep its bounds, too."""
    lowest_m = links.lowest_m - _tallest_user_m(scenario)
    if lowest_m <= 0.0:
        return ""
    own = over_rows(links.radio.path_loss, ())  # whose indices are checked
    radio = replace(links.radio, path_loss=own)
    for height_m in dict.fromkeys((lowest_m, links.highest_m)):
        problem = _problem_of_rings(radio, height_m)
        if problem:
            return f"at a height of {height_m:g} m: {problem}"
    if radio.path_loss.is_built_in() or not searches(scenario, links):
        return ""
    try:
        return problem_of_bounds(own, float(radio.carrier_ghz)) or why_not_compiled(
            links.radio.path_loss
        )
    except FAULTS as error:
        return what_failed(error)


def losses_without_bounds(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield the keys of path losses whose bounds have to be sampled, and why they are needed."""
    for links in _links(scenario):
        if not links.radio.path_loss.is_bounded():
            reasons = searches(scenario, links)
            if reasons:
                yield ".".join(map(str, (*links.path, "path_loss"))), " and ".join(reasons)


def searches(scenario: Scenario, links: RadioLinks) -> list[str]:
    """Return why changes of the classes of links are searched for, if they are."""
    reasons = {
        "drones climb (map.dimensions: 3, map.obstacles)": links.highest_m > links.lowest_m,
        "drones interfere (interference)": links.radio.reuse > 0,
        "line of sight changes (line_of_sight)": links.radio.line_of_sight != "mean",
        "links have shadowing (shadowing)": links.radio.shadowing is not None,
        "association compares levels": scenario.association.by_level,
    }
    return [reason for reason, holds in reasons.items() if holds]


def transfers_get_a_rate(scenario: Scenario) -> Iterator[Finding]:
    """Transfers that hold no rate under ``held``, or one under another sharing."""
    radio_path, radio, _ = next(_of_drones(scenario))
    divides, path = bool(radio.sharing.divides), (*radio_path, "sharing")
    volumes = [
        (name, service, stage)
        for name, service in scenario.services.items()
        if not problems_of(service)
        for stage in service.stages()
        if stage.of_bits
    ]
    for name, service, stage in volumes:
        rates = rates_bps(service, stage)
        if not divides and np.min(rates) < 1:
            yield Finding(
                ("services", name),
                "needs bandwidth_kbps, the rates that requests hold under the sharing held; or "
                "write drones.radio: {kind: link_classes, sharing: equal}",
                (path, radio_path),
            )
        if divides and np.any(rates):
            yield Finding(
                ("services", name, "bandwidth_kbps"),
                f"is for the sharing held; drones.radio.sharing: {kind_name(radio.sharing)} gives "
                "the rates itself",
                (path,),
            )
    if not (volumes and divides):
        return
    for key, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True):
        if math.isinf(drones.radio.bandwidth_hz(drones.bandwidth_kbps)):
            yield Finding(
                (*key, "bandwidth_kbps"),
                f"must be a number where transfers share it: {kind_name(drones.radio.sharing)}",
                ((*key, "radio", "sharing"), (*key, "radio")),
            )


def demand_knows_volumes(scenario: Scenario) -> Iterator[Finding]:
    """Demand that asks for times, for services that ask for volumes or have several stages."""
    others = {
        name: "a volume" if has_volumes(service) else "several times"
        for name, service in scenario.services.items()
        if not is_one_time(service)
    }
    first = next(iter(scenario.services))
    for key, demand, _ in scenario.asking:
        if isinstance(demand, Continuous) and first in others:
            yield Finding(
                key,
                f"asks for the whole episode; the first service, {first}, asks for {others[first]}",
                (("services",),),
            )
        if isinstance(demand, Trace) and others:
            yield Finding(
                key,
                f"has service times (required_s); {', '.join(others)} would ask for "
                f"{'volumes' if 'a volume' in others.values() else 'several times'}",
                (("services",),),
            )


def _of_drones(scenario: Scenario) -> Iterator[Sender]:
    """The radios of the types of drones."""
    for key, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True):
        owner = "the drones'" if len(key) == 1 else f"{'.'.join(map(str, key))}'s"
        yield Sender((*key, "radio"), drones.radio, owner)


def _senders(scenario: Scenario) -> Iterator[Sender]:
    """The radios of the types of drones, and those of access points."""
    yield from _of_drones(scenario)
    for index, point in enumerate(scenario.access_points):
        yield Sender(("access_points", index, "radio"), point.radio, "")


def _links(scenario: Scenario) -> Iterator[RadioLinks]:
    """The radios with classes: those of drones, and those of access points."""
    lowest_m, highest_m = _levels_m(scenario)
    for path, radio, _ in _of_drones(scenario):
        if isinstance(radio, LinkClasses):
            yield RadioLinks(path, radio, lowest_m, highest_m, LOWEST)
    for index, point in enumerate(scenario.access_points):
        if isinstance(point.radio, LinkClasses):
            own: KeyPath = ("access_points", index)
            height_m, key = point.height_m, (*own, "height_m")
            yield RadioLinks((*own, "radio"), point.radio, height_m, height_m, key)


def _levels_m(scenario: Scenario) -> tuple[float, float]:
    """The lowest and the highest level of drones in metres (see ``grid.altitudes``)."""
    levels = scenario.map.levels
    lowest_m = levels.min_altitude_m
    return lowest_m, lowest_m + (scenario.map.most_levels - 1) * levels.step_m


def _has_buildings(scenario: Scenario) -> bool:
    return scenario.map.tallest_m > 0.0


def _tallest_user_m(scenario: Scenario) -> float:
    """The greatest height that a user can have, in metres: on the ground, or in a building."""
    if not _has_buildings(scenario):
        return 0.0
    highest_m = max(users.max_height_m for users in scenario.user_groups)
    return min(highest_m, scenario.map.tallest_m)


def _heights_of_users(scenario: Scenario) -> Iterator[KeyPath]:
    """Yield the keys of the heights of users."""
    for key in scenario.user_keys:
        yield (*key, "max_height_m")


def _always_sees(path_loss: Any) -> bool:
    return type(path_loss).p_los is RowPathLoss.p_los


def _problem_of_rings(radio: LinkClasses, height_m: float) -> str:
    try:
        rings(radio.path_loss, radio.carrier_ghz, height_m, radio.budget, radio.ladder)
        if radio.line_of_sight == "drawn":
            line_of_sight_ring_m(radio.path_loss, height_m, 0.5)
    except ValueError as error:
        return str(error)
    except FAULTS as error:
        return what_failed(error)
    return ""


def _text_of(interference: Any) -> str:
    return interference if isinstance(interference, str) else f"{{reuse: {interference.reuse}}}"


CHECKS = (
    drones_and_access_points_have_levels,
    access_points_are_on_the_map,
    access_points_admit_as_drones,
    bands_are_shared_by_all,
    links_fit_the_map,
    losses_can_be_used,
    transfers_get_a_rate,
    demand_knows_volumes,
)
