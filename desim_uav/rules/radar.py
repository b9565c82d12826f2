"""The observation ``radar``: a raster of what is around a drone, at one or more scales."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

from annotated_types import Ge, Gt, Le

from desim_uav.model.observations import Feature, RowObservation
from desim_uav.model.rules import US
from desim_uav.model.state import Facts
from desim_uav.registry import register
from desim_uav.rowcode.kernels import rule
from desim_uav.rules.battery import is_limited
from desim_uav.rules.note import place
from desim_uav.rules.observations import Local, backlog_of, clear_from, load_of, write_local
from desim_uav.rules.rows import Constants, Drone, Spot, State
from desim_uav.rules.words import CRASHED, FLYING, OPEN

MOST_CELLS, MOST_SCALES = 101, 5
COARSER = 3
"""The cells along a side of a cell of the next coarser raster."""

Cells = Annotated[int, Ge(1), Le(MOST_CELLS)]


class Window(NamedTuple):
    """A raster around a drone: its first cell of the map, its shape, and the sides of its cells.

    ``first_x`` and ``first_y`` may be off the map. ``side`` is the number of the map's cells along
    a side of a cell of the raster; ``at`` is the feature with which the raster begins.
    """

    first_x: int
    first_y: int
    cells_x: int
    cells_y: int
    side: int
    at: int


@register("observation", "radar")
@dataclass(frozen=True)
class Radar(RowObservation):
    """The features of ``local``, and rasters of cells around the drone that count what is there.

    The first raster has the cells of the map, around the cell in which the drone believes itself to
    be. Each further one has cells three times as wide. Users are where they are at the decision
    epoch, and other drones where they believe themselves to be.
    """

    cells_x: Cells = 5
    """The number of a raster's cells from west to east, an odd number."""
    cells_y: Cells = 5
    """The number of a raster's cells from south to north, an odd number."""
    scales: Annotated[int, Ge(1), Le(MOST_SCALES)] = 2
    """The number of rasters."""
    users: bool = True
    """Whether to count users: those attached to nobody, to this drone, and to others."""
    requests: bool = True
    """Whether to count open requests: those that wait, and those that are served."""
    demand: bool = True
    """Whether to add up what open requests still need: of each, the share that is not done yet."""
    blocked: bool = True
    """Whether to show which share of a cell is off the map, or built up at the drone's level."""
    stations: bool = True
    """Whether to count charging stations, with a limited battery."""
    drones: bool = True
    """Whether to count other drones: those that serve; with a battery also those that return,
    queue, charge or have charged.
    """
    full: Annotated[float, Gt(0), Le(1e6)] = 8.0
    """The number of users or requests in a cell that has the value 1; the values are not limited.
    """
    age_s: Annotated[float, Ge(0), Le(1e9)] = 0.0
    """The age of a sensor, in seconds, that counts as one user; the ages of a cell are added up. 0:
    there is no channel for them.
    """
    backlog_s: Annotated[float, Ge(0), Le(1e6)] = 0.0
    """The time for which a drone's backlog counts as 1, as in `local`; those of the drones in a
    cell are added up, this one's own in the middle. 0: there is no channel for them.
    """
    load_mbit: Annotated[float, Ge(0), Le(1e6)] = 0.0
    """The volume for which a drone's load counts as 1, as in `local`; those of the drones in a cell
    are added up, this one's own in the middle. 0: there is no channel for them.
    """
    later: ClassVar = ("age_s", "backlog_s", "load_mbit")

    information = "radar"
    maps_users = True

    def __post_init__(self) -> None:
        """Raise ValueError if there is no cell in the middle."""
        for name in ("cells_x", "cells_y"):
            if getattr(self, name) % 2 == 0:
                raise ValueError(
                    f"{name} {getattr(self, name)}: must be odd, so that the drone is in the middle"
                )

    def channels(self, facts: Facts) -> dict[str, float]:
        """Return the channels of a raster in their order, and the greatest value of each."""
        users, limited = facts.users * (1.0 / self.full), facts.capacity_s is not None
        others = float(max(1, facts.drones - 1))
        greatest: dict[str, float] = {}
        if self.users:
            greatest |= dict.fromkeys(("free", "own", "others"), users)
        if self.requests:
            greatest |= dict.fromkeys(("waiting", "served"), users)
        if self.demand:
            greatest["demand"] = users
        if self.blocked:
            greatest["blocked"] = 1.0
        if self.stations and limited:
            greatest["stations"] = float(len(facts.stations))
        if self.drones:
            greatest["serving"] = others
            if facts.some_charge:
                greatest["away"] = others
        if self.age_s > 0.0:
            greatest["age"] = users * (facts.steps * facts.step_s / self.age_s)
        if self.backlog_s > 0.0:
            greatest["backlog"] = float(facts.drones)
        if self.load_mbit > 0.0:
            greatest["load"] = float(facts.drones)
        return greatest

    def shape(self, facts: Facts) -> tuple[int, int, int, int]:
        """Return the shape of the features behind those of ``local``.

        It is (scales, channels, cells_x, cells_y): cell (0, 0) is the one in the south-west.
        """
        return self.scales, len(self.channels(facts)), self.cells_x, self.cells_y

    def features(self, facts: Facts) -> tuple[Feature, ...]:
        """Return the features, all real numbers."""
        half_x, half_y = self.cells_x // 2, self.cells_y // 2
        channels = [
            Feature(f"{name}{scale}_{x - half_x:+d}_{y - half_y:+d}", 0.0, most, False)
            for scale in range(self.scales)
            for name, most in self.channels(facts).items()
            for x in range(self.cells_x)
            for y in range(self.cells_y)
        ]
        return (*Local().features(facts), *channels)

    def write(self, world: Constants, state: State, drone: Drone) -> None:
        """Write the features, all real numbers, into ``drone.features``."""
        k, side, own = write_local(world, state, drone), 1, state.observations[drone.index]
        clear_from(drone.features, k)
        channels = (self.users, self.requests, self.demand)
        for _ in range(self.scales):
            first_x = own.x - self.cells_x * side // 2
            first_y = own.y - self.cells_y * side // 2
            window = Window(first_x, first_y, self.cells_x, self.cells_y, side, k)
            window = _write_users(world, state, drone, window, channels, self.full)
            if self.blocked:
                window = _write_blocked(world, state, drone, window)
            if self.stations and is_limited(world, drone):
                window = _write_stations(world, drone, window)
            if self.drones:
                window = _write_drones(world, state, drone, window)
            if self.age_s > 0.0:
                window = _write_ages(world, state, drone, window, self.full * self.age_s)
            window = _write_loads(world, state, drone, window, self.backlog_s, self.load_mbit)
            k = window.at
            side *= COARSER

    def expected_features(self, drones: int, services: int) -> int:
        """Return a bound on the number of features of a drone."""
        raster = 13 * self.cells_x * self.cells_y * self.scales
        return super().expected_features(drones, services) + raster


@rule
def _behind(window: Window, channels: int) -> Window:
    """Return a window whose raster begins behind so many channels."""
    first_x, first_y, cells_x, cells_y, side, at = window
    return Window(first_x, first_y, cells_x, cells_y, side, at + channels * cells_x * cells_y)


@rule
def _cell_of(window: Window, x: int, y: int) -> int:
    """Return the number of the raster's cell in which a cell of the map is, or -1."""
    x, y = x - window.first_x, y - window.first_y
    if not (0 <= x < window.cells_x * window.side and 0 <= y < window.cells_y * window.side):
        return -1
    return x // window.side * window.cells_y + y // window.side


@rule
def _write_users(
    world: Constants,
    state: State,
    drone: Drone,
    window: Window,
    channels: tuple[bool, bool, bool],
    full: float,
) -> Window:
    """Count in each cell, for the ``channels`` there are: users, requests, what these need."""
    first_x, first_y, cells_x, cells_y, side, at = window
    after = _behind(window, 3 * int(channels[0]) + 2 * int(channels[1]) + int(channels[2]))
    if after.at == at:
        return after
    for x in range(max(first_x, 0), min(first_x + cells_x * side, world.nx)):
        for y in range(max(first_y, 0), min(first_y + cells_y * side, world.ny)):
            number = state.firsts[x * world.ny + y]
            if number >= 0:
                cell = at + (x - first_x) // side * cells_y + (y - first_y) // side
                while number >= 0:
                    spot = state.spots[number]
                    _count(drone, spot, cell, cells_x * cells_y, channels)
                    number = spot.following
    out, one = drone.features, 1.0 / full
    for k in range(at, after.at):
        out[k] *= one
    return after


@rule
def _count(drone: Drone, spot: Spot, k: int, cells: int, channels: tuple[bool, bool, bool]) -> None:
    """Count a user in a cell, which is feature ``k`` of the first channel."""
    out = drone.features
    users, requests, demand = channels
    if users:
        channel = 0
        if spot.holder >= 0:
            channel = 1 if spot.holder == drone.index else 2
        out[k + channel * cells] += 1.0
        k += 3 * cells
    if requests:
        if spot.doing >= OPEN:
            out[k + (spot.doing - OPEN) * cells] += 1.0
        k += 2 * cells
    if demand:
        out[k] += spot.left


@rule
def _write_blocked(world: Constants, state: State, drone: Drone, window: Window) -> Window:
    """Write which share of each cell is off the map, or built up at the level of the drone."""
    first_x, first_y, cells_x, cells_y, side, at = window
    level = state.observations[drone.index].level
    for i in range(cells_x):
        from_x, to_x = _on_map(first_x + i * side, side, world.nx)
        for j in range(cells_y):
            from_y, to_y = _on_map(first_y + j * side, side, world.ny)
            free = 0
            for x in range(from_x, to_x):
                for y in range(from_y, to_y):
                    free += 1 - world.blocked[place(world, x, y, level)]
            drone.features[at + i * cells_y + j] = (side * side - free) / (side * side)
    return _behind(window, 1)


@rule
def _on_map(first: int, side: int, cells: int) -> tuple[int, int]:
    """Return the part of a range of cells along an axis that is on the map: first and end."""
    return max(first, 0), min(first + side, cells)


@rule
def _write_stations(world: Constants, drone: Drone, window: Window) -> Window:
    """Count the charging stations in each cell."""
    for k in range(len(world.stations)):
        cell = _cell_of(window, world.stations[k].x, world.stations[k].y)
        if cell >= 0:
            drone.features[window.at + cell] += 1.0
    return _behind(window, 1)


@rule
def _write_drones(world: Constants, state: State, drone: Drone, window: Window) -> Window:
    """Count the other drones in each cell: those that serve, and those that are away to charge."""
    away = window.cells_x * window.cells_y
    for d in range(len(state.drones)):
        observation = state.observations[d]
        cell = _cell_of(window, observation.x, observation.y)
        if d != drone.index and cell >= 0 and observation.mode != CRASHED:
            channel = 0 if observation.mode == FLYING else away
            drone.features[window.at + cell + channel] += 1.0
    return _behind(window, 1 + int(world.limited))


@rule
def _write_ages(
    world: Constants, state: State, drone: Drone, window: Window, full_s: float
) -> Window:
    """Add up the ages of the sensors in each cell, over ``full_s``."""
    for u in range(len(state.spots)):
        sensor, at = state.sensors[u], state.spots[u].cell
        cell = _cell_of(window, at // world.ny, at % world.ny)
        if len(sensor.buffer) > 0 and cell >= 0:
            age_us = float(state.now_us - sensor.fresh_us)
            drone.features[window.at + cell] += age_us / (full_s * US)
    return _behind(window, 1)


@rule
def _write_loads(
    world: Constants,
    state: State,
    drone: Drone,
    window: Window,
    backlog_s: float,
    load_mbit: float,
) -> Window:
    """Add up what the drones in each cell have to compute and to carry, if it is asked for."""
    channels = int(backlog_s > 0.0) + int(load_mbit > 0.0)
    after = _behind(window, channels)
    for d in range(len(state.drones) if channels > 0 else 0):
        observation, one = state.observations[d], state.drones[d]
        cell = _cell_of(window, observation.x, observation.y)
        if cell >= 0 and observation.mode != CRASHED:
            k = window.at + cell
            if backlog_s > 0.0:
                drone.features[k] += backlog_of(world, state, one, backlog_s)
                k += window.cells_x * window.cells_y
            if load_mbit > 0.0:
                drone.features[k] += load_of(one, load_mbit)
    return after
