"""Where drones can be and go, and what batteries and stations allow, in steps and parts of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.coverage import all_walked
from desim_uav.model.mobility.walks import joined_walks
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.rules import MOVES, Action, Choice, fastest_of, kind_of, move_of
from desim_uav.world import World

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

NO_WAY = 2**40
"""The steps to a station from where there is no way to any."""

DRAWN_WALKS = 8
"""The number of episodes of walks from which the users' spread is estimated."""


@dataclass(frozen=True, eq=False)
class Ground:
    """The map of a planner, made once per world. A place has the number (level * nx + x) * ny + y.

    Batteries are counted in units of ``charge_unit``, which a step of hovering drains, rounded
    down. ``actions`` are the moves, hovering first, at the cruise speed that takes least of a
    battery, or else at the highest; ``after`` (moves, places) is the place to which each leads, or
    -1; ``drains`` (moves,) the units that it takes, rounded up, and ``takes`` (commands,) those
    that each command to move takes, at any speed. ``station_of`` (places,) is the station on which
    a drone lands, or -1. ``returns`` (places, 4) has the station's place, the flight in µs, the
    units that it drains, and 1 if there is a way. ``needs`` (places,) are the units without which a
    drone comes too late to every station. ``charge_us`` (units + 1,) is the time to a full battery.
    ``rings`` (places,) is the row of ``radii_m`` (rings, users) that holds at a place, and
    ``cells`` (places,) its cell, with its centre ``centres_m`` (cells, 2). ``spread_m`` (steps +
    1,) is the standard deviation, along an axis, of where a user walks in so many steps.
    """

    world: World
    actions: tuple[Choice, ...]
    after: Ints
    drains: Ints
    takes: Ints
    charge_unit: int
    station_of: Ints
    returns: Ints
    return_at: int
    needs: Ints
    charge_us: Ints
    rings: Ints
    cells: Ints
    centres_m: Floats
    radii_m: Floats
    spread_m: Floats

    @property
    def full(self) -> int:
        """The units of a full battery; 1 if it is unlimited."""
        return len(self.charge_us) - 1

    def move(self, choice: Choice) -> int:
        """Return the number of the move to the same side, at any speed; -1 if it is no move."""
        kinds = [kind_of(each) for each in self.actions]
        return kinds.index(kind_of(choice)) if kind_of(choice) in kinds else -1

    def number(self, x: int, y: int, level: int) -> int:
        """Return the number of a place."""
        nx, ny = self.world.grid.cells
        return (level * nx + x) * ny + y


def ground_of(world: World) -> Ground:
    """Return the map of a planner whose drones fly below the ceiling.

    Raises ScenarioError if there are drones of types that differ, or that decide by event.
    """
    world.require_one_type("a planner (greedy, rollout or clairvoyant)")
    world.scenario.require_clock("a planner (greedy, rollout or clairvoyant)")
    world.scenario.require_cells("a planner (greedy, rollout or clairvoyant)")
    grid, limited = world.grid, world.scenario.limited_battery
    (nx, ny), levels = grid.cells, grid.levels(True)
    count = levels * nx * ny
    actions = (world.actions[fastest_of(world.actions)[Action.HOVER]], *_thriftiest(world))
    after = np.array([_led_to(world, action, levels) for action in actions])
    charge_unit, takes = _drains(world, world.actions)
    drains = takes[[world.actions.index(action) for action in actions]]
    station_of = np.full(count, -1)
    for station, (x, y) in enumerate(world.stations):
        station_of[x * ny + y] = station
    full = max(1, world.only_type.capacity // charge_unit) if limited else 1
    charges = [min(unit * charge_unit, world.only_type.capacity) for unit in range(full + 1)]
    noisy = world.scenario.position_noise is not None
    rings, radii_m = _radii(world, levels)
    return Ground(
        world,
        actions,
        after,
        drains,
        takes,
        charge_unit,
        station_of,
        _returns(world, levels, charge_unit),
        -1 if noisy or not limited else world.only_type.return_charge // charge_unit,
        _needs(after, drains, station_of) if limited else np.zeros(count, np.int64),
        np.array([world.only_type.until_full_us(charge) for charge in charges], np.int64),
        np.repeat(rings, nx * ny),
        np.tile(np.arange(nx * ny), levels),
        np.array([grid.centre(x, y) for x in range(nx) for y in range(ny)]),
        radii_m,
        _spread_m(world),
    )


def _thriftiest(world: World) -> list[Choice]:
    """Return the moves, each at the speed with which a step takes least of a battery.

    Of equally thrifty speeds it is the highest one.
    """
    best: dict[Action, Choice] = {}
    for choice in reversed(world.actions):
        kind = kind_of(choice)
        if kind in MOVES and (
            kind not in best or _drain_of(world, choice) < _drain_of(world, best[kind])
        ):
            best[kind] = choice
    return [best[kind] for kind in MOVES if kind in best]


def _led_to(world: World, action: Choice, levels: int) -> Ints:
    """Return the place to which an action leads from each place, or -1 if it is blocked."""
    grid = world.grid
    (nx, ny), (dx, dy, up) = grid.cells, move_of(action)
    led = np.full(levels * nx * ny, -1)
    for place in range(len(led)):
        level, x, y = place // (nx * ny), place // ny % nx, place % ny
        if grid.can_enter(x + dx, y + dy, level + up):
            led[place] = ((level + up) * nx + x + dx) * ny + y + dy
    return led


def _drain_of(world: World, action: Choice) -> int:
    """Return what a step of an action drains, in units of the battery; 0 without one."""
    energy = world.only_type.drones.battery
    if energy is None:
        return 0
    rest = world.only_type.rest
    transit = world.only_type.epoch_transits.get(action, rest)
    rest_us = world.step_us - transit.duration_us
    drain = energy.drain_of(rest, max(rest_us, 0))
    if transit.duration_us:
        drain += energy.drain_of(transit, transit.duration_us)
    return drain


def _drains(world: World, actions: tuple[Choice, ...]) -> tuple[int, Ints]:
    """Return the battery that a step of hovering takes, and what each action takes in this unit."""
    energy = world.only_type.drones.battery
    if energy is None:
        return world.step_us, np.zeros(len(actions), np.int64)
    charge_unit = max(1, energy.drain_of(world.only_type.rest, world.step_us))
    return charge_unit, np.array(
        [-(-_drain_of(world, action) // charge_unit) for action in actions]
    )


def _returns(world: World, levels: int, charge_unit: int) -> Ints:
    """Return the planned return from each place (see ``Ground.returns``)."""
    nx, ny = world.grid.cells
    returns = np.zeros((levels * nx * ny, 4), np.int64)
    if not world.scenario.limited_battery or not world.stations:
        return returns
    for place in range(len(returns)):
        back = world.only_type.planner.plan((place // ny % nx, place % ny, place // (nx * ny)))
        if back is not None:
            x, y = world.stations[back.station]
            returns[place] = (x * ny + y, back.duration_us, -(-back.drain // charge_unit), 1)
    return returns


def _needs(after: Ints, drains: Ints, station_of: Ints) -> Ints:
    """Return the units of battery that moves to the nearest station take from each place, plus 1.

    Without any station it is 0, because no drone can be saved.
    """
    needs = np.where(station_of >= 0, 1, NO_WAY)
    if not (station_of >= 0).any():
        return np.zeros(len(needs), np.int64)
    while True:
        led = np.where(after >= 0, needs[after] + drains[:, None], NO_WAY)
        nearer = np.minimum(needs, led.min(axis=0))
        if (nearer == needs).all():
            units: Ints = nearer
            return units
        needs = nearer


def _radii(world: World, levels: int) -> tuple[Ints, Floats]:
    """Return the row of radii that holds on each level, and the radii (rings, users).

    They are those of the widest class of the drones' links.
    """
    radii_m = np.maximum(world.links[0].rings_m[:levels, :, 0], 1e-6)[:, world.groups]
    rows, numbers = np.unique(radii_m, axis=0, return_inverse=True)
    return numbers.reshape(-1).astype(np.int64), np.ascontiguousarray(rows)


def _spread_m(world: World) -> Floats:
    """Return the spread of users who walk for so many steps, which is estimated from some walks.

    A mobility that draws nothing, such as a trace, is not asked, because its walks are the future.
    """
    steps, homes = world.scenario.episode.steps, np.ascontiguousarray(world.homes[:, :2])
    if not any(getattr(group.mobility, "draws", True) for group in world.user_groups):
        return np.zeros(steps + 1)
    squares = np.zeros(steps + 1)
    for episode in range(DRAWN_WALKS):
        streams = Streams(world.seed, Purpose.PLANNER, episode)
        walks = joined_walks([group.onward(homes, streams) for group in world.user_groups])
        for step in range(steps + 1):
            away_m = all_walked(walks.legs, walks.offsets, step * world.step_us) - homes
            squares[step] += (away_m * away_m).mean() / DRAWN_WALKS
    return np.array([math.sqrt(each) for each in squares])
