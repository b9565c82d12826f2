"""The components of a scenario as Python functions over rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from desim_uav.engine.constants import transits_of
from desim_uav.engine.des.free import transit_of
from desim_uav.model.admission import RowAdmission
from desim_uav.model.battery import Energy
from desim_uav.model.components import over_rows, works_on_rows
from desim_uav.model.motion import Transit
from desim_uav.model.observations import RowObservation
from desim_uav.model.rewards import RowReward
from desim_uav.model.sums import in_order
from desim_uav.rules.admission import admit, turn_away
from desim_uav.rules.rewards import add_up, clear_terms, give
from desim_uav.world import World


def set_components(constants: Any, world: World) -> None:
    """Set the fields of the constants that are functions to the scenario's components."""
    flights = dict(zip(map(id, constants.transits), transits_of(world), strict=True))
    for own, drones in zip(constants.types, world.scenario.fleet, strict=True):
        own.scan = _scan(drones.admission, world.services.names)
        if drones.battery is not None:
            own.drained_us, own.lasts_us = _energy(drones.battery, flights)
    for radio, links in zip(constants.radios, world.links, strict=True):
        radio.divide = over_rows(links.radio.sharing, world.services.names).divide
    constants.pay = _pay(world)
    constants.describe = _describe(world)
    if constants.limited:
        constants.charged, constants.until_full_us = _charging(world)


def _scan(rule: Any, services: tuple[str, ...]) -> Callable[..., None]:
    """Return a function that applies an admission rule to a drone's queue."""
    if works_on_rows(rule, RowAdmission):
        scan_rows: Callable[..., None] = over_rows(rule, services).scan_rows
        return scan_rows

    def scan(constants: Any, path: Any, state: Any, drone: Any, phase: int) -> None:
        if not drone.waiting:
            return
        free_hz = math.inf if constants.radios[drone.radio].bandwidth_hz < 0 else drone.free_hz
        requests = tuple(state.users[user].request for user in drone.waiting)
        served, refused = rule.scan(requests, free_hz)
        for request in served:
            admit(constants, state, drone, request.user, phase)
        for request in refused:
            turn_away(constants, path, state, drone, request.user, phase)

    return scan


def _pay(world: World) -> Callable[..., None]:
    """Return a function that writes the rewards of all drones for a step."""
    reward: Any = world.scenario.reward
    if works_on_rows(reward, RowReward):
        by_rows = over_rows(reward, world.services.names)

        def pay(constants: Any, state: Any) -> None:
            for drone in state.drones:
                clear_terms(drone)
                by_rows.pay(constants, state, drone)
                add_up(state, drone)

        return pay

    def pay_by_observation(constants: Any, state: Any) -> None:
        asked = tuple(state.asked)
        state.named_terms = [
            reward.terms(seen, asked, world.facts_of(seen.drone)) for seen in state.observed()
        ]
        if state.share != 1.0:
            state.named_terms = [
                {name: state.share * term for name, term in terms.items()}
                for terms in state.named_terms
            ]
        for drone, terms in zip(state.drones, state.named_terms, strict=True):
            give(state, drone, in_order(terms.values()))

    return pay_by_observation


def _describe(world: World) -> Callable[..., None]:
    """Return a function that writes all drones' features, if the observation works on rows."""
    observation: Any = world.scenario.observation
    by_rows = works_on_rows(observation, RowObservation)
    if by_rows:
        observation = over_rows(observation, world.services.names)

    def describe(constants: Any, state: Any) -> None:
        if by_rows:
            for drone in state.drones:
                observation.write(constants, state, drone)

    return describe


def _energy(
    energy: Energy, flights: Mapping[int, Transit]
) -> tuple[Callable[..., int], Callable[..., int]]:
    """Return the functions ``drained_us`` and ``lasts_us`` of an energy model.

    ``flights`` are the transits by the identities of their rows.
    """

    def drained_us(own: Any, transit: Any, elapsed_us: int) -> int:
        return energy.drained_us(flights.get(id(transit)) or transit_of(transit), elapsed_us)

    def lasts_us(own: Any, transit: Any, battery_us: int) -> int:
        return energy.lasts_us(flights.get(id(transit)) or transit_of(transit), battery_us)

    return drained_us, lasts_us


def _charging(world: World) -> tuple[Callable[..., int], Callable[..., int]]:
    """Return the functions ``charged`` and ``until_full_us`` of the stations."""
    charging: Any = world.charging

    def charged(constants: Any, battery: int, elapsed_us: int, capacity: int) -> int:
        return int(charging.charged(battery, elapsed_us, capacity))

    def until_full_us(constants: Any, battery: int, capacity: int) -> int:
        return int(charging.until_full_us(battery, capacity))

    return charged, until_full_us
