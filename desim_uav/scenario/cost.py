"""What an episode will cost, foreseen from the scenario alone: its events and its memory.

The formulas are expectations, without a draw. They are meant to tell a scenario that fits a machine
from one that cannot; tests hold them within a factor of 4 of what engines have used.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from desim_uav.available import available_bytes
from desim_uav.errors import ScenarioError
from desim_uav.model.demand.demand import drawn_by, is_sensed
from desim_uav.model.mobility.walks import Area
from desim_uav.model.services import Service, amount_of, collecting_of, rate_of
from desim_uav.scenario.drones import flies_freely
from desim_uav.scenario.epochs import most_epochs
from desim_uav.scenario.schema import Scenario

MOST_EVENTS = 1e10
"""An episode of more events than this would take the fastest engine more than an hour."""

PROGRAM = 100e6
"""The bytes of memory that a command takes however small its scenario is, more or less."""

BYTES_AN_UPDATE = 130.0
"""The bytes of memory of an update in the buffer of a sensor."""

_LEVELS = ("map.cells", "map.levels.step_m", "map.levels.max_altitude_m", "map.obstacles")
_WALKS = ("users.count", "episode.steps", "episode.step_s", "users.mobility")
_REQUESTS = ("users.count", "episode.steps", "episode.step_s", "demand")
_STEPS = ("episode.steps", "drones.count", "decisions")
_PAIRS = ("users.count", "drones.count")
_LINKS = ("users.count", "drones.count", "access_points", "episode.steps", "drones.radio")

SEARCH = 10.0
"""A search for the changes of one link in a step takes about as long as so many events, and as many
again for each drone or access point that interferes."""


class CostPart(NamedTuple):
    """A part of a cost: what it is of, how much, and the keys that cause it."""

    what: str
    amount: float
    keys: tuple[str, ...]


@dataclass(frozen=True)
class Cost:
    """The cost of an episode, in parts: events, and bytes of memory."""

    events: tuple[CostPart, ...]
    memory: tuple[CostPart, ...]

    @property
    def event_count(self) -> float:
        """The number of events."""
        return math.fsum(part.amount for part in self.events)

    @property
    def memory_bytes(self) -> float:
        """The bytes of memory that it takes at once."""
        return math.fsum(part.amount for part in self.memory)


@dataclass(frozen=True)
class _Counts:
    """How many there are of what an episode is made of."""

    drones: int
    users: int
    cells: int
    places: float
    epochs: int
    legs: float
    draws: float
    requests: float
    crossings: float
    senders: int
    searches: float
    features: float


def cost(scenario: Scenario, engine: str = "des", keep_events: bool = False) -> Cost:
    """Foresee an episode on an engine, des or batch; ``keep_events``: with its event log."""
    n = _counts(scenario)
    logged = (
        CostPart("commands and steps of drones", 3.0 * n.drones * n.epochs, _STEPS),
        CostPart("requests that begin, are served and end", 4.0 * n.requests, _REQUESTS),
        CostPart(
            "users who enter or leave a footprint",
            n.crossings,
            ("users.count", "drones.count", "episode.steps", "episode.step_s"),
        ),
    )
    events = (
        *logged,
        *([CostPart("searches for changes of links", n.searches, _LINKS)] if n.searches else []),
        CostPart("legs of users", n.legs, _WALKS),
        CostPart("draws of requests", n.draws, _REQUESTS),
    )
    memory = (
        CostPart("the map", 80.0 * n.cells + 12.0 * n.places, _LEVELS),
        CostPart("users", 400.0 * n.users, ("users.count",)),
        CostPart("the walks of users", 210.0 * n.legs, _WALKS),
        CostPart("requests", 32.0 * max(16.0 * n.users, n.draws) + 600.0 * n.requests, _REQUESTS),
        CostPart("the log of steps", 900.0 * n.drones * n.epochs, _STEPS),
        *([CostPart("links", 250.0 * n.users * n.senders, _LINKS)] if n.searches else []),
        CostPart("what drones observe", 60.0 * n.features, ("observation", "drones.count")),
        *(_of_batch(scenario, n) if engine == "batch" else _of_des(n)),
        *_pairs(scenario, n),
        *_buffers(scenario),
        *([_event_log(logged, n)] if keep_events else []),
    )
    return Cost(events, memory)


def check_cost(scenario: Scenario, engine: str | None = None, keep_events: bool = False) -> None:
    """Raise ScenarioError, with figures and keys, if an episode would be too long or too large.

    ``engine``: des or batch; None: whichever takes less. ``keep_events``: with its event log.
    """
    engines = (engine,) if engine else ("des", "batch")
    costs = (cost(scenario, name, keep_events) for name in engines)
    least = min(costs, key=lambda cost: cost.memory_bytes)
    there = available_bytes()
    problems = []
    if least.event_count > MOST_EVENTS:
        problems.append(
            f"an episode would have about {least.event_count:.2g} events; at most "
            f"{MOST_EVENTS:.0e} can be simulated: {_named(least.events, _in_numbers)}"
        )
    if PROGRAM < least.memory_bytes > there:
        problems.append(
            f"an episode would take about {_in_bytes(least.memory_bytes)} of memory, but "
            f"{_in_bytes(there)} are available: {_named(least.memory, _in_bytes)}"
        )
    if problems:
        raise ScenarioError(*problems)


def expected_requests(scenario: Scenario) -> float:
    """Return the expected number of requests of an episode if all are served at once; at least 1.

    A demand of one's own that has no ``expected_draws`` counts as one request per user and step.
    """
    return max(1.0, _draws_and_requests(scenario, 0)[1])


def _draws_and_requests(scenario: Scenario, most_bps: int) -> tuple[float, float]:
    """Return how often users are expected to draw a service, and to ask for one, in an episode.

    Volumes take at least the time that they take at ``most_bps``; no time if that is 0.
    """
    steps, draws, requests = scenario.episode.steps, 0.0, 0.0
    for users, demand in zip(scenario.user_groups, scenario.demands, strict=True):
        law = drawn_by(demand, scenario.services)
        draws_of, own = getattr(law, "expected_draws", None), float(users.count * steps)
        if draws_of:
            required_s = _required_s(scenario, demand, most_bps)
            own = draws_of(users.count, required_s, steps * scenario.episode.step_s)
        draws += own
        requests += (1.0 - getattr(law, "none", 0.0)) * own
    return draws, requests


def _counts(scenario: Scenario) -> _Counts:
    users, drones = scenario.user_count, scenario.drone_count
    steps, horizon_s = scenario.episode.steps, scenario.episode.steps * scenario.episode.step_s
    nx, ny = scenario.map.cells
    legs, area = 0.0, Area(*scenario.map.size_m)
    for group in scenario.user_groups:
        legs_of = getattr(group.mobility, "expected_legs", None)
        legs += legs_of(group.count, area, horizon_s) if legs_of else group.count * steps
    draws, requests = _draws_and_requests(scenario, scenario.most_bps)
    return _Counts(
        drones,
        users,
        nx * ny,
        float(nx * ny * scenario.map.most_levels),
        most_epochs(scenario),
        legs,
        draws,
        requests,
        _crossings(scenario, horizon_s),
        drones + len(scenario.access_points),
        _searches(scenario),
        float(drones * _features(scenario)),
    )


def _of_des(n: _Counts) -> Iterable[CostPart]:
    """The SimPy engine: objects of Python's for users, drones and what is due."""
    yield CostPart("users in the engine", 700.0 * n.users, ("users.count",))
    yield CostPart("drones in the engine", 6000.0 * n.drones, ("drones.count",))


def _of_batch(scenario: Scenario, n: _Counts) -> Iterable[CostPart]:
    """The compiled engine: tables of users by drones, and the ways back from every place."""
    yield CostPart("users in footprints", 8.0 * n.users * (10.0 * n.drones + 110.0), _PAIRS)
    yield CostPart("commands so far", 16.0 * n.drones * n.epochs, _STEPS)
    if ways := _ways_back(scenario):
        nx, ny = scenario.map.cells
        hops = (nx + ny) / (2.0 * math.sqrt(scenario.stations.count)) + n.places / n.cells / 2.0
        size = n.places * (80.0 + 72.0 * hops)
        yield CostPart("ways back to the stations", ways * size, _LEVELS)


def _pairs(scenario: Scenario, n: _Counts) -> Iterable[CostPart]:
    """The pairs of drones, if these have to keep a distance."""
    if scenario.separation_m is not None:
        keys = ("separation_m", "drones.count")
        yield CostPart("pairs of drones", 700.0 * n.drones * n.drones / 2.0, keys)


def _buffers(scenario: Scenario) -> Iterable[CostPart]:
    """The buffers of sensors, each of which has a place for one update more than it keeps."""
    for group, demand in zip(scenario.user_groups, scenario.demands, strict=True):
        name = getattr(demand, "service", "")
        keeps = collecting_of(scenario.services.get(name)) if is_sensed(demand) else None
        if keeps is not None:
            keys = ("users.count", f"services.{name}.buffer")
            places = float(group.count * (keeps.buffer + 1))
            yield CostPart("the buffers of sensors", BYTES_AN_UPDATE * places, keys)


def _ways_back(scenario: Scenario) -> int:
    """How many tables of ways back there are: one for all types that fly them in the same way.

    Drones that fly freely look for their ways while they fly.
    """
    fleets: list[tuple[object, object]] = []
    for drones in scenario.fleet:
        flown = drones.motion, drones.battery
        if drones.battery is not None and not flies_freely(drones) and flown not in fleets:
            fleets.append(flown)
    return len(fleets)


def _event_log(logged: Sequence[CostPart], n: _Counts) -> CostPart:
    """The rows of the event log and the flights of drones, while they are put into tables."""
    rows = math.fsum(part.amount for part in logged)
    keys = tuple(dict.fromkeys(key for part in logged for key in part.keys))
    return CostPart("the event log that is kept", 330.0 * rows + 700.0 * n.drones * n.epochs, keys)


def _required_s(scenario: Scenario, demand: object, most_bps: int) -> float:
    """The mean time of a request in all of its stages, over the mix; of volumes, the least."""
    mix = getattr(demand, "mix", None) or dict.fromkeys(scenario.services, 1.0)
    clock = scenario.most_clock
    means = {name: _mean_us(one, most_bps, clock) for name, one in scenario.services.items()}
    total = math.fsum(mix.values())
    return math.fsum(mix[name] / total * means[name] for name in mix) / 1e6


def _mean_us(service: Service, most_bps: int, clock: int) -> float:
    """The mean time that the stages of a service take together.

    Volumes take that at ``most_bps``, and cycles that at ``clock``; none at 0.
    """
    rates = [(stage, rate_of(stage, most_bps, clock)) for stage in service.stages()]
    return math.fsum(amount_of(service, stage).mean / rate for stage, rate in rates if rate)


def _crossings(scenario: Scenario, horizon_s: float) -> float:
    """How often users enter or leave footprints, or the rings of classes within them.

    A disc of radius R that moves at a speed v among users of an even density is entered at a rate
    of 2 R v times the density, and left as often. Drones move at the speed of a commanded hop.
    """
    width, depth = scenario.map.size_m
    hop = max(scenario.map.cell_m) / scenario.episode.step_s
    walk = max(_walking_mps(users.mobility) for users in scenario.user_groups)
    speed = math.hypot(min(hop, max(width, depth) / scenario.episode.step_s), walk)
    lowest_m = scenario.map.levels.min_altitude_m
    senders = [
        (drones.count, drones.radio, drones.footprint_radius_m, lowest_m, speed)
        for drones in scenario.fleet
    ]
    senders += [(1, point.radio, 0.0, point.height_m, walk) for point in scenario.access_points]
    total = 0.0
    for count, radio, disc_m, height_m, speed_mps in senders:
        for radius_m in radio.radii_m(height_m, disc_m):
            across = min(2.0 * max(radius_m, 0.0), width + depth)
            rate = 2.0 * across * speed_mps * scenario.user_count / (width * depth)
            total += count * (2.0 * scenario.user_count * (across > 0.0) + rate * horizon_s)
    return total


def _walking_mps(mobility: object) -> float:
    """The mean speed of users: that which a model says, or its only speed; 0 if it has none."""
    speed = getattr(mobility, "mean_speed_mps", getattr(mobility, "speed_mps", 0.0))
    return float(speed) if isinstance(speed, int | float) else 0.0


def _searches(scenario: Scenario) -> float:
    """How many events the searches for changes of links take as long as, if they are no rings'."""
    points, reuse = scenario.access_points, scenario.fleet[0].radio.reuse
    radios = [*(drones.radio for drones in scenario.fleet), *(point.radio for point in points)]
    marked = any(radio.marked for radio in radios)
    if not (marked or reuse or scenario.association.by_level):
        return 0.0
    senders = scenario.drone_count + len(points)
    others = (senders - 1) / reuse if reuse else 0.0
    return SEARCH * _looks(scenario) * scenario.user_count * (1.0 + others)


def _looks(scenario: Scenario) -> float:
    """How often a drone or an access point is looked at for a step or a leg, all of them together.

    If drones interfere and are asked by event, all are looked at anew with each leg of one of them.
    """
    points, steps = len(scenario.access_points), scenario.episode.steps
    senders = scenario.drone_count + points
    if not scenario.decisions.by_event:
        return float(senders * steps)
    legs = (most_epochs(scenario) - 1) / 2.0
    if scenario.fleet[0].radio.reuse:
        return senders * (legs + steps * min(points, 1))
    return legs + points * steps


def _features(scenario: Scenario) -> int:
    """Return the number of features in a drone's observation."""
    features_of = getattr(scenario.observation, "expected_features", None)
    if features_of is None:
        return 100
    return int(features_of(scenario.drone_count, len(scenario.services)))


def _named(parts: Iterable[CostPart], text_of: Callable[[float], str]) -> str:
    """The parts that make up most of a cost, the largest first, with their keys."""
    largest = sorted(parts, key=lambda part: -part.amount)
    most = [part for part in largest if part.amount > 0.1 * math.fsum(p.amount for p in largest)]
    return "; ".join(f"{text_of(p.amount)} for {p.what} ({', '.join(p.keys)})" for p in most)


def _in_numbers(amount: float) -> str:
    return f"{amount:.2g}"


def _in_bytes(amount: float) -> str:
    for unit, size in (("TB", 1e12), ("GB", 1e9)):
        if amount >= size:
            return f"{amount / size:.3g} {unit}"
    return f"{amount / 1e6:.3g} MB"
