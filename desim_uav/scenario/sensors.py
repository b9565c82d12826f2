"""Checks of sensors: whether they find their service, and nobody else asks for it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any

from desim_uav.errors import did_you_mean
from desim_uav.model.demand.demand import drawn_by, is_sensed
from desim_uav.model.services import collecting_of, computes
from desim_uav.model.updates import UpdatesAtWill
from desim_uav.scenario.components import place_of_problem
from desim_uav.scenario.finding import Finding
from desim_uav.scenario.schema import Scenario

MOST_PROBLEMS = 10
"""How many problems of a recording are reported."""


def sensors_find_their_service(scenario: Scenario) -> Iterator[Finding]:
    """Sensors without a service whose updates they send, and updates that do not fit the users."""
    collects = _collecting(scenario)
    for key, demand, counts in scenario.asking:
        if not is_sensed(demand):
            continue
        path, name = (*key, "service"), demand.service  # type: ignore[attr-defined]
        if name in collects:
            law = drawn_by(demand, scenario.services)
            problems = getattr(law, "problems", None)
            own = problems(min(counts), collects) if problems else []
            where = ("services", name, "updates", *place_of_problem(law))
            yield from (Finding(where, one, (path,)) for one in islice(own, MOST_PROBLEMS))
        elif name in scenario.services:
            yield Finding(
                path, "is not of kind collect, so that it has no updates", (("services",),)
            )
        else:
            allowed = ", ".join(collects) or "the scenario has none of kind collect"
            hint = did_you_mean(name, collects)
            yield Finding(path, f"no such service{hint}; allowed: {allowed}", (("services",),))


def only_sensors_send_updates(scenario: Scenario) -> Iterator[Finding]:
    """Demands of users who are no sensors, in whose mix there is a service that collects."""
    collects = _collecting(scenario)
    for key, demand, _ in scenario.asking:
        mix = getattr(demand, "mix", None)
        if is_sensed(demand) or not isinstance(mix, Mapping):
            continue
        for name in collects:
            if mix.get(name, 0.0) > 0.0:
                yield Finding(
                    (*key, "mix", name),
                    "its updates are for users whose demand is sensing: write "
                    f"{{kind: sensing, service: {name}}}",
                    (("services", name),),
                )


def what_needs_sensors_has_some(scenario: Scenario) -> Iterator[Finding]:
    """Rewards and observations of sensors, or stores for their updates, though there are none."""
    sensed = [demand for _, demand, _ in scenario.asking if is_sensed(demand)]
    for path, needed in (
        (("reward", "kind"), getattr(scenario.reward, "needs_sensors", False)),
        (("reward", "age"), getattr(scenario.reward, "age", 0.0)),
        (("observation", "age_s"), getattr(scenario.observation, "age_s", 0.0)),
        (("observation", "load_mbit"), getattr(scenario.observation, "load_mbit", 0.0)),
    ):
        if needed and not sensed:
            message = "is for users whose demand is sensing, and there are none"
            yield Finding(path, message, (("demand",), ("users",)))
    yield from _stores_are_used(scenario, sensed)
    for name in dict.fromkeys(getattr(demand, "service", "") for demand in sensed):
        one = collecting_of(scenario.services.get(name))
        lands = scenario.stations.count and scenario.limited_battery
        lands = lands or any(drones.backhaul is not None for drones in scenario.fleet)
        if one is not None and one.ground and not (lands or scenario.access_points):
            yield Finding(
                ("services", name, "delivered"),
                "no update can be delivered: drones land to charge, for which they need a battery "
                "and a station, they have no backhaul, and there are no access points",
                (("stations", "count"), *((*key, "battery") for key in scenario.fleet_keys)),
            )


def _stores_are_used(scenario: Scenario, sensed: list[Any]) -> Iterator[Finding]:
    """Stores of drones into which no updates come, and loads of such stores as observations."""
    own = [scenario.services.get(getattr(demand, "service", "")) for demand in sensed]
    kept = [one for one in map(collecting_of, own) if one is not None]
    stored = any(one.ground for one in kept)
    if getattr(scenario.observation, "load_mbit", 0.0) and kept and not stored:
        message = "shows nothing: updates are delivered: drone"
        yield Finding(("observation", "load_mbit"), message, (("services",),))
    for key, drones in zip(scenario.fleet_keys, scenario.fleet, strict=True):
        if drones.store_mbit is not None and kept and not stored:
            yield Finding(
                (*key, "store_mbit"),
                "stores nothing: updates are delivered: drone",
                (("services",),),
            )
        elif drones.store_mbit is not None and not kept:
            yield Finding(
                (*key, "store_mbit"), "stores nothing: no users are sensors", (("users",),)
            )


def updates_at_will_take_time(scenario: Scenario) -> Iterator[Finding]:
    """Updates that are taken when the last one is delivered, if that might take no time."""
    alone = scenario.offloading.alone and any(map(computes, scenario.services.values()))
    for name, service in scenario.services.items():
        if collecting_of(service) is None:
            continue
        if isinstance(getattr(service, "updates", None), UpdatesAtWill) and (
            alone or scenario.most_bps == 0
        ):
            yield Finding(
                ("services", name, "updates"),
                "at_will needs a highest rate of links, which is not known here: bandwidth is "
                "unlimited, radio or sharing is one of your own, or users may compute themselves",
            )


def _collecting(scenario: Scenario) -> list[str]:
    """Return the names of the services whose updates sensors send."""
    return [name for name, one in scenario.services.items() if collecting_of(one) is not None]
