"""The state of an engine before its first episode, as rows (see ``rules.rows.State``)."""

from __future__ import annotations

import math
from itertools import combinations
from typing import NamedTuple, TypeVar

from desim_uav.engine.base import RunSettings
from desim_uav.engine.constants import term_names
from desim_uav.engine.courses import set_course, set_memory
from desim_uav.engine.sky import most_pieces
from desim_uav.rowcode.rows import Queue, Table, blank
from desim_uav.rules import rows, words
from desim_uav.sky.separation import most_turns
from desim_uav.world import World


def most_loose(users: int, senders: int) -> int:
    """Return the most entries that the queue of loose users can have in an instant."""
    return users * (2 * senders + 2)


class Buffers(NamedTuple):
    """The number of entries for which queues in compiled code have memory.

    ``log`` limits the events, and the closed requests, of a step; ``crossings`` those of a leg; and
    ``loose`` the users who become loose in an instant.
    """

    log: int = 0
    crossings: int = 0
    loose: int = 0

    def doubled(self) -> Buffers:
        """Return twice as many of each."""
        return Buffers(*(2 * number for number in self))


S = TypeVar("S", bound=rows.State)


def state_of(world: World, settings: RunSettings, buffers: Buffers, kind: type[S]) -> S:
    """Return a new state, whose queues have buffers for this many entries in compiled code."""
    state = blank(kind)
    scenario = world.scenario
    drones, users = scenario.drone_count, len(world.homes)
    senders = drones + len(scenario.access_points)
    services, epochs = len(world.services.names), world.most_epochs
    _set_flags(state, world, settings)
    observation = scenario.observation
    _set_senders(state, world, buffers)
    if world.services.to_ground:
        logs = settings.keep_steps or settings.keep_events or state.uploads
        _set_stores(state, users, buffers.log * logs)
    if scenario.separation_m is not None:
        pieces = most_pieces(world)
        pairs = combinations(range(drones), 2)
        state.pairs = Table(_pair(*both, pieces) for both in pairs)
    _set_users(state, world, users, senders)
    state.stations = Table(blank(rows.Station) for _ in world.stations)
    for station in state.stations:
        station.queue.buffer = drones
    state.loose.buffer = min(most_loose(users, senders), buffers.loose)
    state.by_level = int(scenario.association.by_level)
    state.renews = int(world.by_event and len(scenario.access_points) > 0)
    state.unsettled.buffer = users * state.by_level
    state.open_requests, state.asked = _zeros(services), _zeros(services)
    state.observations = Table(blank(rows.ObservationRow) for _ in range(drones))
    if state.keeps_requests:
        state.records = Table(blank(rows.Record) for _ in range(drones))
        state.point_records = Table(blank(rows.PointRecord) for _ in range(senders - drones))
    state.counts = _zeros(2 * services * drones)
    if getattr(observation, "maps_users", False):
        state.spots = Table(blank(rows.Spot) for _ in range(users))
        state.firsts = _zeros(math.prod(world.grid.cells))
    state.masks = _zeros(drones * len(world.actions))
    state.rewards = Table([0.0] * drones)
    state.crashed.buffer = drones * (epochs + 2)
    state.history = _zeros(epochs * drones)
    set_memory(state, world, buffers.log * settings.keep_events)
    state.events = Queue(of=rows.EventRow, buffer=buffers.log * settings.keep_events)
    _set_logs(state, buffers.log * settings.keep_steps)
    return state


def _set_flags(state: rows.State, world: World, settings: RunSettings) -> None:
    """Set what a new state keeps, and how many users are sensors."""
    state.keeps_links = int(world.graded)
    state.keeps_credit = int(getattr(world.scenario.reward, "keeps_credit", False))
    state.keeps_events, state.keeps_requests = int(settings.keep_events), int(settings.keep_steps)
    state.keeps_tasks = int(world.services.has_tasks)
    state.relays = int(world.services.computes and any(world.backhauls))
    state.uploads = int(world.services.to_ground and any(world.backhauls))
    state.keeps_sensors = int(len(world.senses) > 0)
    state.sensing = sum(service >= 0 for service in world.senses)


def _set_senders(state: rows.State, world: World, buffers: Buffers) -> None:
    """Set the drones, and the access points after them."""
    drones = world.scenario.drone_count
    senders = drones + len(world.scenario.access_points)
    state.senders = Table(_sender(world, index, buffers) for index in range(senders))
    for sender in state.senders if state.keeps_credit else ():
        sender.credit = blank(rows.Credit)
    for drone in state.senders[:drones]:
        drone.features = Table([0.0] * len(world.features_of_types[drone.type]))
    state.drones = Table(state.senders[:drones])


def _set_users(state: rows.State, world: World, users: int, senders: int) -> None:
    """Set the users, and what is kept of them as sensors, of their links and of their tasks."""
    state.sensors = Table(_sensor(world, service) for service in world.senses)
    state.users = Table(_user(index, senders) for index in range(users))
    state.credited = _zeros(users * state.keeps_credit)
    if world.services.several_stages or world.services.has_tasks or world.senses:
        state.drawn = _zeros(users * world.services.draws)
    if state.keeps_links:
        state.links = Table(_links(senders) for _ in range(users))
    if state.keeps_tasks:
        state.tasks = Table(blank(rows.Task) for _ in range(users))


def _set_stores(state: rows.State, users: int, buffer: int) -> None:
    """Set the stores of all senders, with memory for so many updates, which may be none."""
    for sender in state.senders:
        sender.freight = Table(blank(rows.Freight) for _ in range(users))
        sender.store = Queue(of=rows.Update, buffer=buffer)


def _set_logs(state: rows.State, buffer: int) -> None:
    """Set the memory for the log of a step: its closed requests, handovers and updates."""
    state.closed = Queue(of=rows.Closed, buffer=buffer)
    state.handovers = Queue(of=rows.Handover, buffer=2 * buffer)
    state.updates = Queue(of=rows.UpdateRow, buffer=buffer * state.keeps_sensors)


def _zeros(count: int) -> Table[int]:
    """Return a table of zeros."""
    return Table([0] * count)


def _sender(world: World, index: int, buffers: Buffers) -> rows.Drone:
    """Return a blank drone with this index, or an access point if no drone has it."""
    drone = blank(rows.Drone)
    drone.index = index
    drone.point = max(index - len(world.type_numbers), -1)
    drone.type = 0 if drone.point >= 0 else world.type_numbers[index]
    drone.radio = drone.type if drone.point < 0 else len(world.types) + drone.point
    drone.mode = words.FLYING
    set_course(drone, world)
    links = world.links[drone.radio]
    for band in (drone, drone.aside)[: 1 + (links.uplink_hz is not None)]:
        band.waiting.buffer = len(world.homes)
        band.sharing.buffer = len(world.homes) * links.radio.sharing.divides
    drone.computing.buffer = len(world.homes) * world.services.computes
    drone.moving.buffer = len(world.homes) * world.services.migrates
    drone.ahead = Queue(of=rows.Change, buffer=buffers.crossings)
    services = len(world.services.names)
    drone.served, drone.asking = _zeros(services), _zeros(services)
    drone.terms = Table([0.0] * len(term_names(world)))
    return drone


def _pair(one: int, other: int, pieces: int) -> rows.Pair:
    """Return a pair of drones, on transits of so many pieces, that are not near to each other."""
    pair = blank(rows.Pair)
    pair.one, pair.other = one, other
    pair.turns.buffer = most_turns(pieces)
    return pair


def _user(index: int, senders: int) -> rows.User:
    """Return a user without a request, whom none of the senders covers."""
    user = blank(rows.User)
    user.index = index
    user.holder = user.request.number = user.request.server = -1
    user.covering, user.classes = Table([-1] * senders), _zeros(senders)
    return user


def _sensor(world: World, service: int) -> rows.Sensor:
    """Return a sensor of a service with an empty buffer, which has no memory for -1 (none)."""
    sensor = blank(rows.Sensor)
    keeps = world.services.collecting[service] if service >= 0 else None
    if keeps is not None:
        sensor.buffer = Table(blank(rows.Update) for _ in range(keeps.buffer + 1))
    for update in sensor.buffer:
        update.number = -1
    return sensor


def _links(senders: int) -> rows.UserLinks:
    """Return what is kept of the links of a user, for whom no sender is better than its own."""
    links = blank(rows.UserLinks)
    links.better_since = Table([-1] * senders)
    return links
