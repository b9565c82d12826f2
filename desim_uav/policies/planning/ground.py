"""Where drones can be and go, and what batteries and stations allow, in ticks and parts of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.coverage import all_walked
from desim_uav.model.mobility.walks import joined_walks
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.policies.planning.best_plan import Ways
from desim_uav.policies.planning.flights import CellFlights, Flights, Flown
from desim_uav.policies.planning.free_flights import FreeFlights
from desim_uav.world import World

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

NO_WAY = 2**40
"""The ticks to a station from where there is no way to any."""

DRAWN_WALKS = 8
"""The number of episodes of walks from which the users' spread is estimated."""


@dataclass(frozen=True, eq=False)
class Ground:
    """The map of a planner for drones of one type, made once per world. ``flights`` has its places.

    Plans count time in ticks of ``tick_us``: a step or, if drones decide by event, the shortest
    flight to a neighbouring place or the patience. Batteries are counted in units of
    ``charge_unit``, rounded down. ``after`` (moves, places) is the place to which each move leads,
    or -1, hovering first; ``drains`` (moves,) the units that it takes, rounded up, and ``lasts``
    (moves,) the ticks, rounded. ``station_of`` (places,) is the station on which a drone lands, or
    -1, and ``charges_at`` (places,) that at which it can charge without a return. ``returns``
    (places, 4) has the station's place, the flight in µs, the units that it drains, and 1 if there
    is a way. ``return_at`` are the units with which a drone may return at most. ``needs``
    (places,) are the units without which a drone comes too late to every station. ``charge_us``
    (units + 1,) is the time to a full battery. ``rings`` (places,) is the row of ``radii_m``
    (rings, users) that holds at a place, and ``cells`` (places,) its point, with its position
    ``centres_m`` (points, 2). ``spread_m`` (ticks + 1,) is the standard deviation, along an axis,
    of where a user walks in so many ticks.
    """

    world: World
    flights: Flights
    tick_us: int
    after: Ints
    drains: Ints
    lasts: Ints
    charge_unit: int
    station_of: Ints
    charges_at: Ints
    returns: Ints
    return_at: int
    needs: Ints
    charge_us: Ints
    rings: Ints
    cells: Ints
    centres_m: Floats
    radii_m: Floats
    spread_m: Floats

    @cached_property
    def ways(self) -> Ways:
        """The tables with which plans are made."""
        tick_us, units = self.tick_us, len(self.charge_us)
        lands, rest_us = divmod(self.returns[:, 1], tick_us)
        left = np.maximum(np.arange(units) - self.returns[:, 2:3], 0)
        return Ways(
            self.after,
            self.lasts,
            self.drains,
            self.rings,
            self.cells,
            self.charges_at,
            -(-self.charge_us // tick_us),
            self.station_of,
            np.column_stack([self.returns[:, 0], lands, self.returns[:, 2:]]),
            -(-(rest_us[:, None] + self.charge_us[left]) // tick_us),
            int(self.return_at),
        )

    @property
    def full(self) -> int:
        """The units of a full battery; 1 if it is unlimited."""
        return len(self.charge_us) - 1

    @property
    def limited(self) -> bool:
        """Whether its drones have limited batteries and there is a station to charge at."""
        return self.flights.own.limited and bool(self.world.stations)

    def ticks(self, time_us: float) -> int:
        """Return a time in ticks, rounded up."""
        return int(-(-time_us // self.tick_us))

    def units_after(self, charge: int, flown: Flown) -> int:
        """Return the whole units of a battery that a command leaves."""
        return charge // self.charge_unit - -(-flown.drain // self.charge_unit)

    def is_safe(self, place: int, units: int) -> bool:
        """Return whether a drone with so much battery at a place reaches a station from there."""
        _, _, takes, exists = self.returns[place].tolist()
        by_return = bool(exists) and min(units, self.return_at) > takes
        return by_return or bool(units >= self.needs[place])


def grounds_of(world: World) -> tuple[Ground, ...]:
    """Return the map of a planner for each drone, which flies below the ceiling.

    Drones of a type have the same one.
    """
    kinds = (CellFlights, FreeFlights)
    flights = [kinds[own.free](world, own) for own in world.types]
    tick_us = _tick_us(world, flights)
    spread_m = _spread_m(world, tick_us)
    of_types = [
        _ground_of(world, number, own, tick_us, spread_m) for number, own in enumerate(flights)
    ]
    return tuple(of_types[number] for number in world.type_numbers)


def _tick_us(world: World, flights: Sequence[Flights]) -> int:
    """Return the unit of time in plans: the shortest time between two commands of a drone.

    Climbs and descents do not count, and it is at least a tenth of a step.
    """
    lasts_us = [own.flown(move).lasts_us for own in flights for move in own.moves]
    levels = [
        own.flown(move).lasts_us for own in flights for move in own.moves if own.is_level(move)
    ]
    return max(min(levels or lasts_us), world.step_us // 10)


def _ground_of(
    world: World, number: int, flights: Flights, tick_us: int, spread_m: Floats
) -> Ground:
    """Return the map of a planner for the drones of a type."""
    own, after = flights.own, flights.after()
    count = after.shape[1]
    flown = [flights.flown(move) for move in flights.moves]
    charge_unit = _charge_unit(flights, flown)
    drains = np.array([-(-each.drain // charge_unit) for each in flown], np.int64)
    lasts = np.array([max(1, round(each.lasts_us / tick_us)) for each in flown], np.int64)
    points, stations = len(flights.points_m), len(world.stations) if own.limited else 0
    station_of = np.full(count, -1)
    for station in range(len(world.stations)):
        station_of[flights.station_point(station)] = station
    full = max(1, own.capacity // charge_unit) if own.limited else 1
    charges = [min(unit * charge_unit, own.capacity) for unit in range(full + 1)]
    returns = _returns(flights, count, charge_unit) if stations else np.zeros((count, 4), np.int64)
    return_at = flights.return_at // charge_unit
    rings, radii_m = _radii(world, number, flights.levels)
    home = _home(flights, station_of, returns, return_at)
    return Ground(
        world,
        flights,
        tick_us,
        after,
        drains,
        lasts,
        charge_unit,
        station_of,
        station_of if flights.lands else np.full(count, -1),
        returns,
        return_at,
        _needs(after, drains, home) if own.limited else np.zeros(count, np.int64),
        np.array([own.until_full_us(charge) for charge in charges], np.int64),
        np.repeat(rings, points),
        np.tile(np.arange(points), flights.levels),
        flights.points_m,
        radii_m,
        spread_m,
    )


def _charge_unit(flights: Flights, flown: Sequence[Flown]) -> int:
    """Return the unit of batteries: what a step of hovering takes.

    If drones decide by event, it is what that command takes in whose units all take the least when
    they are rounded up.
    """
    if not flights.own.limited:
        return 1
    drains = [max(1, each.drain) for each in flown]
    if len({each.lasts_us for each in flown}) == 1:
        return drains[0]
    return min(drains, key=lambda unit: (sum(-(-one // unit) * unit / one for one in drains), unit))


def _returns(flights: Flights, count: int, charge_unit: int) -> Ints:
    """Return the planned return from each place (see ``Ground.returns``)."""
    returns = np.zeros((count, 4), np.int64)
    for place in range(count):
        back = flights.back(place)
        if back.exists:
            at = flights.station_point(back.station)
            returns[place] = (at, back.flight_us, -(-back.drain // charge_unit), 1)
    return returns


def _home(flights: Flights, station_of: Ints, returns: Ints, return_at: int) -> Ints:
    """Return the units with which a drone reaches a station from each place without a move.

    A drone that cannot charge at once over a station has to return; a unit is left for the way to
    the place, from beside which it may begin.
    """
    if flights.lands:
        return np.where(station_of >= 0, 1, NO_WAY)
    may = (returns[:, 3] == 1) & (returns[:, 2] < return_at)
    return np.where(may, returns[:, 2] + 2, NO_WAY)


def _needs(after: Ints, drains: Ints, home: Ints) -> Ints:
    """Return the units of battery that moves to the nearest station take from each place, plus 1.

    ``home`` (places,) are the units that the way from a place to a station takes without a move.
    Without any station it is 0, because no drone can be saved.
    """
    needs = home
    if (needs >= NO_WAY).all():
        return np.zeros(len(needs), np.int64)
    while True:
        led = np.where(after >= 0, needs[after] + drains[:, None], NO_WAY)
        nearer = np.minimum(needs, led.min(axis=0))
        if (nearer == needs).all():
            units: Ints = nearer
            return units
        needs = nearer


def _radii(world: World, number: int, levels: int) -> tuple[Ints, Floats]:
    """Return the row of radii that holds on each level, and the radii (rings, users).

    They are those of the widest class of the links of a type of drones.
    """
    radii_m = np.maximum(world.links[number].rings_m[:levels, :, 0], 1e-6)[:, world.groups]
    rows, numbers = np.unique(radii_m, axis=0, return_inverse=True)
    return numbers.reshape(-1).astype(np.int64), np.ascontiguousarray(rows)


def _spread_m(world: World, tick_us: int) -> Floats:
    """Return the spread of users who walk for so many ticks, which is estimated from some walks.

    A mobility that draws nothing, such as a trace, is not asked, because its walks are the future.
    """
    steps, homes = world.horizon_us // tick_us, np.ascontiguousarray(world.homes[:, :2])
    if not any(getattr(group.mobility, "draws", True) for group in world.user_groups):
        return np.zeros(steps + 1)
    squares = np.zeros(steps + 1)
    for episode in range(DRAWN_WALKS):
        streams = Streams(world.seed, Purpose.PLANNER, episode)
        walks = joined_walks([group.onward(homes, streams) for group in world.user_groups])
        for step in range(steps + 1):
            away_m = all_walked(walks.legs, walks.offsets, step * tick_us) - homes
            squares[step] += (away_m * away_m).mean() / DRAWN_WALKS
    return np.array([math.sqrt(each) for each in squares])
