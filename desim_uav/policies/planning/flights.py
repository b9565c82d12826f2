"""How the drones of a type move in plans: from cell to cell, or over the points of free flight."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from desim_uav.commands.given import Command
from desim_uav.drone_type import DroneType
from desim_uav.model.rules import MOVES, US, Action, Choice, fastest_of, kind_of, move_of
from desim_uav.world import World

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

NO_RETURN = (0, 0, 0, False)
"""The return from a place from which there is no way to a station."""


class Flown(NamedTuple):
    """The time from a command to the next one, and what it takes of the battery."""

    lasts_us: int
    drain: int


class PlannedReturn(NamedTuple):
    """The station of a return, the flight in µs, what it drains, and whether there is a way."""

    station: int
    flight_us: int
    drain: int
    exists: bool


class Flights(Protocol):
    """The places and the moves of a type of drones, as planners see them.

    The places of a level are ``points_m`` (points, 2), and ``levels`` are those below the ceiling.
    Place number level * points + point is over a point. ``moves`` are the moves, hovering first;
    ``lands`` says that a drone can charge at once over a station, without a return.
    """

    own: DroneType
    points_m: Floats
    levels: int
    lands: bool
    word: str
    """The word for the points in error messages: cells, or points."""
    return_at: int
    """The greatest charge with which a drone may return, or -1 if plans must not do so."""

    @property
    def moves(self) -> Sequence[Any]:
        """Return the moves; the first one is to hover."""

    def after(self) -> Ints:
        """Return the place (moves, places) to which each move leads; -1 if it is blocked."""

    def flown(self, move: Any) -> Flown:
        """Return what a move takes."""

    def is_level(self, move: Any) -> bool:
        """Return whether a move does not lead up or down."""

    def back(self, place: int) -> PlannedReturn:
        """Return the return from a place."""

    def station_point(self, station: int) -> int:
        """Return the point of a station."""

    def place(self, drone: Any, end: bool = False) -> int:
        """Return the place of a drone or, at the ``end`` of its flight, the one at which it is."""

    def lands_at(self, engine: Any, drone: Any, battery_s: float) -> tuple[int, int, float]:
        """Return when a drone that returns lands, in µs from now, where, and its battery then."""

    def command(self, drone: Any, move: int, to: int) -> Command:
        """Return the command of a move of a drone, which leads to a place."""

    def options(self, drone: Any, mask: Sequence[bool]) -> list[Command]:
        """Return the commands that a search tries."""

    def leads(self, drone: Any, command: Command, after: Ints) -> tuple[int, Flown]:
        """Return the place to which a command leads (-1: none), and what it takes."""


class CellFlights:
    """Moves from cell to cell: the points are the centres of cells.

    The cruise speed of a move is the one that takes least of a battery, or else the highest.
    """

    lands, word = True, "cells"

    def __init__(self, world: World, own: DroneType) -> None:
        self.world, self.own, self.grid = world, own, world.grid
        self.levels = world.grid.levels(True)
        nx, ny = self.grid.cells
        self.points_m = np.array([self.grid.centre(x, y) for x in range(nx) for y in range(ny)])
        noisy = world.scenario.position_noise is not None
        self.return_at = -1 if noisy or not own.limited else own.return_charge
        self._hover = world.actions[fastest_of(world.actions)[Action.HOVER]]
        self.moves: tuple[Choice, ...] = (self._hover, *self._thriftiest())
        self._kinds = [kind_of(each) for each in self.moves]

    def _thriftiest(self) -> list[Choice]:
        """Return the moves, each at the speed with which a step takes least of a battery.

        Of equally thrifty speeds it is the highest one.
        """
        best: dict[Action, Choice] = {}
        for choice in reversed(self.world.actions):
            kind = kind_of(choice)
            if kind in MOVES and (
                kind not in best or self.flown(choice).drain < self.flown(best[kind]).drain
            ):
                best[kind] = choice
        return [best[kind] for kind in MOVES if kind in best]

    def after(self) -> Ints:
        """Return the place (moves, places) to which each move leads; -1 if it is blocked."""
        return np.array([self._led_to(action) for action in self.moves])

    def _led_to(self, action: Choice) -> Ints:
        (nx, ny), (dx, dy, up) = self.grid.cells, move_of(action)
        led = np.full(self.levels * nx * ny, -1)
        for place in range(len(led)):
            level, x, y = place // (nx * ny), place // ny % nx, place % ny
            if self.grid.can_enter(x + dx, y + dy, level + up):
                led[place] = ((level + up) * nx + x + dx) * ny + y + dy
        return led

    def flown(self, move: Choice) -> Flown:
        """Return what a move takes: a step or, if drones decide by event, until it has arrived."""
        transit = self.own.epoch_transits.get(move, self.own.rest)
        lasts_us = self.world.step_us
        if self.world.by_event:
            lasts_us = transit.duration_us or self.world.patience_us
        return Flown(lasts_us, self.own.taken_by(transit, lasts_us))

    def is_level(self, move: Choice) -> bool:
        """Return whether a move does not lead up or down."""
        return move_of(move)[2] == 0

    def back(self, place: int) -> PlannedReturn:
        """Return the return from a place, from cell to cell."""
        nx, ny = self.grid.cells
        back = self.own.planner.plan((place // ny % nx, place % ny, place // (nx * ny)))
        if back is None:
            return PlannedReturn(*NO_RETURN)
        return PlannedReturn(back.station, back.duration_us, back.drain, True)

    def station_point(self, station: int) -> int:
        """Return the point of a station, which is the number of its cell."""
        x, y = self.world.stations[station]
        return x * self.grid.cells[1] + y

    def number(self, x: int, y: int, level: int) -> int:
        """Return the number of a place."""
        nx, ny = self.grid.cells
        return (min(level, self.levels - 1) * nx + x) * ny + y

    def place(self, drone: Any, end: bool = False) -> int:
        """Return the place of a drone, or the one to which it flies."""
        if end:
            return self.number(int(drone.to_x), int(drone.to_y), int(drone.to_level))
        return self.number(int(drone.x), int(drone.y), int(drone.level))

    def lands_at(self, engine: Any, drone: Any, battery_s: float) -> tuple[int, int, float]:
        """Return when a drone that returns lands, hop by hop, at which station, and its battery."""
        lands_us = 0
        hop = (drone.to_x - drone.x, drone.to_y - drone.y, drone.to_level - drone.level)
        if hop != (0, 0, 0):
            ends_us = drone.since_us + self.own.return_transits[hop].duration_us
            lands_us += max(0, ends_us - int(engine.state.now_us))
        x, y = drone.to_x, drone.to_y
        for dx, dy, up in engine.hops(drone.route, drone.route_end):
            lands_us += self.own.return_transits[int(dx), int(dy), int(up)].duration_us
            x, y = x + dx, y + dy
        away = [abs(int(x) - sx) + abs(int(y) - sy) for sx, sy in self.world.stations]
        left = (battery_s * 1e6 - lands_us) * (self.own.drain_per_s / US)
        return lands_us, away.index(min(away)), left  # the nearest one, if it has lost its way

    def command(self, drone: Any, move: int, to: int) -> Command:
        """Return the index of a move."""
        return self.world.actions.index(self.moves[move])

    def options(self, drone: Any, mask: Sequence[bool]) -> list[Command]:
        """Return all commands that the mask allows."""
        return [command for command, may in enumerate(mask) if may]

    def leads(self, drone: Any, command: Command, after: Ints) -> tuple[int, Flown]:
        """Return the place to which a command leads (-1: none), at any speed, and what it takes."""
        assert isinstance(command, int)
        choice, place = self.world.actions[command], self.place(drone)
        move = self.move(choice)
        return (int(after[move, place]) if move >= 0 else place), self.flown(choice)

    def move(self, choice: Choice) -> int:
        """Return the number of the move to the same side, at any speed; -1 if it is no move."""
        return self._kinds.index(kind_of(choice)) if kind_of(choice) in self._kinds else -1
