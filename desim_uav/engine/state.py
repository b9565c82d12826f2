"""The state of an engine before its first episode, as rows (see ``rules.rows.State``)."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

from desim_uav.engine.base import RunSettings
from desim_uav.engine.constants import term_names
from desim_uav.model.rows import Queue, Table, blank
from desim_uav.rules import rows
from desim_uav.world import World


class Buffers(NamedTuple):
    """The number of entries for which queues in compiled code have memory.

    ``log`` limits the events, and the closed requests, of a step; ``crossings`` those of a leg.
    """

    log: int = 0
    crossings: int = 0


S = TypeVar("S", bound=rows.State)


def state_of(world: World, settings: RunSettings, buffers: Buffers, kind: type[S]) -> S:
    """Return a new state, whose queues have buffers for this many entries in compiled code."""
    made = blank(kind)
    drones, users = world.scenario.drones.count, len(world.homes)
    services, steps = len(world.services.names), world.scenario.episode.steps
    made.keeps_events, made.keeps_requests = int(settings.keep_events), int(settings.keep_steps)
    made.drones = Table(_drone(world, index, buffers) for index in range(drones))
    made.users = Table(_user(index, drones) for index in range(users))
    made.stations = Table(blank(rows.Station) for _ in world.stations)
    for station in made.stations:
        station.queue.buffer = drones
    made.loose.buffer = users * (2 * drones + 2)
    made.open_requests, made.asked = _zeros(services), _zeros(services)
    made.observations = Table(blank(rows.Observation) for _ in range(drones))
    made.records = Table(blank(rows.Record) for _ in range(drones))
    made.counts = _zeros(2 * services * drones)
    made.masks = _zeros(drones * len(world.actions))
    made.rewards = Table([0.0] * drones)
    made.crashed.buffer = drones * (steps + 2)
    made.history = _zeros(steps * drones)
    made.events = Queue(of=rows.Event, buffer=buffers.log * settings.keep_events)
    made.closed = Queue(of=rows.Closed, buffer=buffers.log * settings.keep_steps)
    made.handovers = Queue(of=rows.Handover, buffer=2 * buffers.log * settings.keep_steps)
    return made


def _zeros(count: int) -> Table[int]:
    """Return a table of zeros."""
    return Table([0] * count)


def _drone(world: World, index: int, buffers: Buffers) -> rows.Drone:
    """Return a blank drone with this index."""
    made = blank(rows.Drone)
    made.index = index
    made.waiting.buffer = len(world.homes)
    made.ahead = Queue(of=rows.Crossing, buffer=buffers.crossings)
    services = len(world.services.names)
    made.served, made.asking = _zeros(services), _zeros(services)
    made.terms = Table([0.0] * len(term_names(world)))
    made.features = Table([0.0] * len(world.scenario.observation.features(world.facts)))
    return made


def _user(index: int, drones: int) -> rows.User:
    """Return a user without a request, whom none of the drones covers."""
    made = blank(rows.User)
    made.index = made.request.user = index
    made.holder = made.request.number = made.request.server = -1
    made.covering = Table([-1] * drones)
    return made
