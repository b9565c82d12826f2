"""The components of a scenario as Python functions over rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np

from desim_uav.engine.constants import transits_of
from desim_uav.errors import SimulationError
from desim_uav.model.admission import RowAdmission, Waiting
from desim_uav.model.energy.battery import Energy, RowEnergy
from desim_uav.model.energy.charging import RowCharging
from desim_uav.model.motion.motion import Transit
from desim_uav.model.naming import naming
from desim_uav.model.observations import RowObservation
from desim_uav.model.offloading import RowOffloading
from desim_uav.model.processing import RowProcessing
from desim_uav.model.rewards import RowReward
from desim_uav.model.sharing import RowSharing
from desim_uav.model.state import Observation
from desim_uav.model.sums import in_order
from desim_uav.rowcode.bounds import owner_of
from desim_uav.rowcode.components import over_rows, works_on_rows
from desim_uav.rules.admission import admit, turn_away
from desim_uav.rules.rewards import add_up, clear_terms, give
from desim_uav.rules.rows import Constants, Drone, Path, State, User
from desim_uav.world import World


def own_over_rows(world: World) -> bool:
    """Return whether some component of a world that works on rows is one's own."""
    own = [world.scenario.reward, world.scenario.observation, world.charging]
    own += [world.scenario.offloading]
    own += [part for one in world.scenario.fleet for part in (one.admission, one.battery)]
    own += [links.radio.sharing for links in world.links]
    own += [processor.sharing for processor in world.processors if processor is not None]
    return any(isinstance(one, ROW_BASES) and owner_of(type(one)) for one in own)


ROW_BASES = (
    *(RowReward, RowObservation, RowCharging, RowAdmission, RowEnergy),
    *(RowOffloading, RowProcessing, RowSharing),
)


def _method(component: object, name: str, world: World) -> Callable[..., Any]:
    """Return a method of a component over rows, whose faults name the component."""
    method: Callable[..., Any] = getattr(over_rows(component, world.services.names), name)
    return naming(owner_of(type(component)), method)


def _methods(component: object, base: type, names: Sequence[str], world: World) -> list[Any]:
    """Return methods of a component that may work on rows; if it is one's own, see ``_method``."""
    if owner_of(type(component)) and works_on_rows(component, base):
        return [_method(component, name, world) for name in names]
    return [getattr(component, name) for name in names]


def set_components(constants: Any, world: World) -> None:
    """Set the fields of the constants that are functions to the scenario's components."""
    flights = dict(zip(map(id, constants.transits), transits_of(world), strict=True))
    for own, drones in zip(constants.types, world.scenario.fleet, strict=True):
        own.scan = _scan(drones.admission, world)
        if drones.battery is not None:
            own.drain_of, own.lasts_us = _energy(drones.battery, world, flights)
    for radio, links in zip(constants.radios, world.links, strict=True):
        radio.divide = _method(links.radio.sharing, "divide", world)
    for processor, own in zip(constants.processors, world.processors, strict=False):
        if own is not None:
            processor.process = _method(own.sharing, "process", world)
    if world.services.computes:
        constants.share = _method(world.scenario.offloading, "share", world)
    constants.pay = _pay(world)
    constants.describe = _describe(world)
    if constants.limited:
        constants.charged, constants.until_full_us = _charging(world)


def _scan(rule: Any, world: World) -> Callable[..., None]:
    """Return a function that applies an admission rule to a drone's queue."""
    if works_on_rows(rule, RowAdmission):
        return _method(rule, "scan_rows", world)

    def scan(constants: Constants, path: Path, state: State, drone: Drone, phase: int) -> None:
        if not drone.waiting:
            return
        free_hz = math.inf if constants.radios[drone.radio].bandwidth_hz < 0 else drone.free_hz
        requests = [_waiting(state.users[user]) for user in drone.waiting]
        served, refused = rule.scan(requests, free_hz)
        for request in served:
            admit(constants, state, drone, request.user, phase)
        for request in refused:
            turn_away(constants, path, state, drone, request.user, phase)

    return scan


def _waiting(user: User) -> Waiting:
    """Return what an admission rule may know about a user's request."""
    return Waiting(user.index, *(getattr(user.request, name) for name in Waiting._fields[1:]))


def _pay(world: World) -> Callable[..., None]:
    """Return a function that writes the rewards of all drones for a step."""
    reward: Any = world.scenario.reward
    if works_on_rows(reward, RowReward):
        pay_one = _method(reward, "pay", world)

        def pay(constants: Constants, state: State) -> None:
            for drone in state.drones:
                clear_terms(drone)
                pay_one(constants, state, drone)
                add_up(state, drone)

        return pay

    names: list[str] = []

    def pay_by_observation(constants: Any, state: Any) -> None:
        requests = tuple(state.asked)
        state.named_terms = [
            _terms(reward, world, names, observation, requests) for observation in state.observed()
        ]
        if state.share != 1.0:
            state.named_terms = [
                {name: state.share * term for name, term in terms.items()}
                for terms in state.named_terms
            ]
        for drone, terms in zip(state.drones, state.named_terms, strict=True):
            give(state, drone, in_order(terms.values()))

    return pay_by_observation


def _terms(
    reward: Any, world: World, names: list[str], observation: Observation, asked: tuple[int, ...]
) -> Mapping[str, float]:
    """Return a drone's terms, whose ``names`` are those of the first call.

    Raises SimulationError if they are others, or no numbers.
    """
    terms: Mapping[str, float] = reward.terms(observation, asked, world.facts_of(observation.drone))
    numbers = isinstance(terms, Mapping) and all(isinstance(v, Real) for v in terms.values())
    if not numbers or (names and [*terms] != names):
        expected = f"the terms {names}" if names else "a mapping of terms to numbers"
        raise SimulationError(
            f"reward {type(reward).__name__!r} must return {expected}, and returned {terms!r}"
        )
    names[:] = terms
    return terms


def _describe(world: World) -> Callable[..., None]:
    """Return a function that writes all drones' features, if the observation works on rows."""
    observation: Any = world.scenario.observation
    by_rows = works_on_rows(observation, RowObservation)
    write = _method(observation, "write", world) if by_rows else None

    def describe(constants: Constants, state: State) -> None:
        if write is not None:
            for drone in state.drones:
                write(constants, state, drone)

    return describe


def _energy(
    energy: Energy, world: World, flights: Mapping[int, Transit]
) -> tuple[Callable[..., int], Callable[..., int]]:
    """Return the functions ``drain_of`` and ``lasts_us`` of an energy model.

    One that does not work on rows is given ``flights``: the transits by the identities of their
    rows.
    """
    if works_on_rows(energy, RowEnergy):
        drains, lasts = (_method(energy, name, world) for name in ("drains", "lasts"))
        return (
            lambda own, transit, elapsed_us: drains(transit, elapsed_us),
            lambda own, transit, charge: lasts(transit, charge),
        )

    def flight(transit: Any) -> Transit:
        return flights.get(id(transit)) or transit_of(transit)

    return (
        lambda own, transit, elapsed_us: energy.drain_of(flight(transit), elapsed_us),
        lambda own, transit, charge: energy.lasts_us(flight(transit), charge),
    )


def _charging(world: World) -> tuple[Callable[..., int], Callable[..., int]]:
    """Return the functions ``charged`` and ``until_full_us`` of the stations."""
    names = ("charged", "until_full_us")
    charge, time_to_full = _methods(world.charging, RowCharging, names, world)

    def charged(constants: Constants, battery: int, elapsed_us: int, capacity: int) -> int:
        return int(charge(battery, elapsed_us, capacity))

    def until_full_us(constants: Constants, battery: int, capacity: int) -> int:
        return int(time_to_full(battery, capacity))

    return charged, until_full_us


def transit_of(flight: Any) -> Transit:
    """Return the row of a transit as one."""
    profile = [
        (piece.start_s, piece.from_m, piece.speed_mps, piece.acceleration_mps2)
        for piece in flight.pieces
    ]
    return Transit(
        np.array(profile),
        flight.duration_us,
        flight.distance_m,
        flight.rises,
        flight.tail_mps,
        flight.side_mps,
    )
