"""Missions of drones that gather the data of devices between buildings, and land in time.

A mission is drawn as Bayerlein et al. 2021 draw theirs, and flown in the compiled engine. It takes
the place of what the scenario draws itself: who begins where with which battery, where devices
stand, and how much data they have.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import shortest_path

from desim_uav.engine.base import CarriedDrone, RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.engine.episode import Engine
from desim_uav.experiment.papers.simulated import scenario_of
from desim_uav.model.demand.requests import DRAWN, Requests
from desim_uav.model.mobility.walks import Walks, in_rows
from desim_uav.model.radio.functions import log10, slant_range_m
from desim_uav.model.radio.path_loss import NLOS, Rates, RowPathLoss
from desim_uav.model.radio.slopes import logistic_rates
from desim_uav.model.rules import DECIDES, MOVES, US, Action, Mode
from desim_uav.model.services import MICROBITS
from desim_uav.model.state import Observation
from desim_uav.sample_path import draw
from desim_uav.world import World, build_world

SCENARIO = "bayerlein_2021.yaml"
STEP_US = 4 * US
DRONES, DEVICES, UNITS, STEPS = (1, 3), (3, 10), (5.0, 20.0), (50, 150)
"""The ranges from which a mission is drawn, with both ends: drones, devices, units of data of a
device, and steps that a battery lasts."""

UP = frozenset({Mode.FLYING, Mode.RETURNING})
DOWN = frozenset({Mode.QUEUED, Mode.CHARGING})

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Streets(RowPathLoss):
    """Falls with another power of the distance behind buildings than with line of sight."""

    los: float = 2.27
    """The path-loss exponent with line of sight."""
    nlos: float = 3.64
    """The path-loss exponent without."""

    def los_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        """Return the loss with line of sight, which is 0 at 1 m."""
        return 10.0 * self.los * log10(slant_range_m(distance_m, height_m))

    def nlos_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        """Return the loss without line of sight, which is 0 at 1 m."""
        return 10.0 * self.nlos * log10(slant_range_m(distance_m, height_m))

    def p_los(self, elevation: float) -> float:
        """Return 1: buildings say where there is line of sight."""
        return 1.0

    def rates(self, branch: int, distance_m: float, height_m: float, within_m: float) -> Rates:
        """Return the bounds for the change of a level over a power of the distance."""
        exponent = float(self.nlos) if branch == NLOS else float(self.los)
        return logistic_rates(exponent, 0.0, 1.0, 1.0, distance_m, height_m, within_m)


class Town:
    """The free cells of a world by number, and the lengths of the shortest ways between them.

    ``cells`` (free, 2): where they are. ``number`` (nx, ny): their numbers, -1 for a building.
    ``steps`` (free, free): the steps of a shortest way. ``beside`` (free, 4): the neighbours, or
    the cell itself. ``home`` (free,): the steps to the nearest station.
    """

    def __init__(self, world: World) -> None:
        free = world.grid.height_m < world.grid.levels_m[0]
        self.cells: Ints = np.argwhere(free)
        self.number = np.full(free.shape, -1)
        self.number[free] = np.arange(len(self.cells))
        padded = np.pad(self.number, 1, constant_values=-1)
        ways = [self.cells + 1 + move[:2] for move in list(MOVES.values())[:4]]
        beside = np.stack([padded[tuple(way.T)] for way in ways], axis=1)
        own = np.arange(len(self.cells))[:, np.newaxis]
        self.beside: Ints = np.where(beside < 0, own, beside)
        links = (np.ones(beside.size), (np.repeat(own, 4), self.beside.ravel()))
        graph = csr_array(links, shape=(len(own), len(own)))
        self.steps: Floats = shortest_path(graph, unweighted=True)
        stations = [self.number[cell] for cell in world.stations]
        self.home: Floats = self.steps[:, stations].min(1)
        self.zone: Ints = np.sort(stations)
        self.ground: Ints = np.setdiff1d(np.arange(len(own)), self.zone)

    def middle_m(self, cell: int) -> tuple[float, float]:
        """Return the middle of a cell, in m."""
        x, y = (10.0 * self.cells[cell] + 5.0).tolist()
        return x, y


class Mission(NamedTuple):
    """Where devices stand and what they have, and where drones begin and how long they last.

    ``devices`` and ``starts`` are numbers of free cells, ``units`` are in Mbit, and ``steps`` of a
    drone include the one in which it lands.
    """

    devices: Ints
    units: Floats
    starts: Ints
    steps: Ints


def drawn(town: Town, seed: int) -> Mission:
    """Return a mission: its numbers are uniform, and no two devices, or drones, share a cell."""
    rng = np.random.default_rng(seed)
    drones, devices = (int(rng.integers(*ends, endpoint=True)) for ends in (DRONES, DEVICES))
    return Mission(
        rng.choice(town.ground, devices, replace=False),
        rng.uniform(*UNITS, devices),
        rng.choice(town.zone, drones, replace=False),
        rng.integers(*STEPS, drones, endpoint=True),
    )


class Sight(NamedTuple):
    """What all drones see between two steps.

    ``at`` are the cells of drones, ``steps`` those that their batteries last, ``flies`` whether a
    drone has not landed yet, and ``units`` what each device still has.
    """

    at: Ints
    steps: Ints
    flies: NDArray[np.bool_]
    units: Floats


LAND = -1
"""The answer of a drone that lands where it is."""

Choose = Callable[[Sight], Sequence[int]]
"""Returns the cell to which each drone goes: its own, one beside it, or LAND."""


class Outcome(NamedTuple):
    """How a mission ended: whether all drones have landed, and the share of data that is there."""

    landed: bool
    collected: float


class Ground:
    """The town of a scenario, and an engine for each number of drones, which ``kind`` names."""

    def __init__(self, changes: Mapping[str, Any], kind: str = "batch") -> None:
        self.changes, self.kind = dict(changes), kind
        self._engines: dict[int, Engine] = {}

    @cached_property
    def town(self) -> Town:
        """The free cells."""
        return Town(self.engine(1).world)

    def engine(self, drones: int) -> Engine:
        """Return the engine for so many drones, which is made once."""
        if drones not in self._engines:
            changes = self.changes | {"drones.count": drones}
            world = build_world(scenario_of(SCENARIO, changes), 0)
            settings = RunSettings((True,) * drones, False, keep_steps=False)
            self._engines[drones] = make_engine(self.kind, world, settings)
        return self._engines[drones]

    def flown(self, mission: Mission, seed: int, choose: Choose) -> Outcome:
        """Fly a mission until no drone is in the air; ``seed`` draws the shadowing."""
        engine, town = self.engine(len(mission.starts)), self.town
        world, devices = engine.world, len(mission.devices)
        snapshot = self._begun(engine, mission, seed)
        while not (snapshot.terminated or snapshot.truncated):
            modes = [Mode(drone.mode) for drone in engine.drones]
            if UP.isdisjoint(modes):
                break
            sight = Sight(
                np.array([town.number[drone.x, drone.y] for drone in engine.drones]),
                np.array([steps_left(one) for one in snapshot.observations]),
                np.array([mode in DECIDES for mode in modes]),
                units_left(engine, devices),
            )
            commands = [
                self._action(world, int(at), to)
                for at, to in zip(sight.at, choose(sight), strict=True)
            ]
            snapshot = engine.step(commands)
        down = all(Mode(drone.mode) in DOWN for drone in engine.drones)
        left = units_left(engine, devices).sum()
        return Outcome(down, float(1.0 - left / mission.units.sum()))

    def _begun(self, engine: Engine, mission: Mission, seed: int) -> Any:
        """Begin an episode with the drones, devices and data of a mission."""
        town, users = self.town, len(engine.world.homes)
        places = [town.middle_m(cell) for cell in mission.devices]
        places += places[:1] * (users - len(places))  # who asks for nothing may stand anywhere
        legs = np.array([(0.0, *place, 0.0, 0.0) for place in places])
        rows = np.zeros((len(mission.units), DRAWN + 2), np.int64)
        rows[:, DRAWN] = np.round(mission.units * MICROBITS)
        offsets = np.minimum(np.arange(users + 1), len(rows))
        path = replace(
            draw(engine.world, seed, 0),
            walking=in_rows(Walks(legs, np.arange(users + 1))),
            requests=Requests(rows, offsets, after_previous=True),
        )
        engine.carry(
            tuple(
                CarriedDrone(Mode.FLYING, (*cell, 0), charge, 0, None, (), 0.0, 0, None)
                for cell, charge in zip(
                    town.cells[mission.starts].tolist(),
                    (mission.steps * STEP_US).tolist(),
                    strict=True,
                )
            )
        )
        return engine.reset(path)

    def _action(self, world: World, at: int, to: int) -> int:
        """Return the index of the action that leads from a cell to another one."""
        if to == LAND:
            return world.actions.index(Action.GOTO_CHARGING_STATION)
        if to == at:
            return world.actions.index(Action.HOVER)
        dx, dy = (self.town.cells[to] - self.town.cells[at]).tolist()
        return world.actions.index(next(a for a, move in MOVES.items() if move == (dx, dy, 0)))


def blocks(side: int) -> list[list[int]]:
    """Return 25 blocks of so many cells by as many, as buildings of 30 m."""
    corners, inside = range(5, 30, 5), range(side)
    return [[x + i, y + j, 30] for y in corners for j in inside for x in corners for i in inside]


CORNER = [[x, y] for x in range(3) for y in range(29, 32)]

GROUNDS: dict[str, dict[str, Any]] = {
    "our map": {},
    "streets of 3 cells": {"map.obstacles.cells": blocks(2)},
    "streets of 1 cell": {"map.obstacles.cells": blocks(4)},
    "one landing corner": {"stations.cells": CORNER},
    "no shadowing": {"drones.radio.shadowing": None},
}
"""Variants of the scenario by name: the keys that are changed, and their values."""


@cache
def ground_of(name: str = "our map") -> Ground:
    """Return one of the grounds, which is made once."""
    return Ground(GROUNDS[name])


def steps_left(observation: Observation) -> int:
    """Return how many whole steps the battery of a drone lasts."""
    return round((observation.battery_s or 0.0) * US) // STEP_US


def units_left(engine: Engine, devices: int) -> Floats:
    """Return what the first devices still have now, in Mbit."""
    now_us, left = int(engine.state.now_us), np.zeros(devices)
    for number in range(devices):
        request = engine.state.users[number].request
        if request.number >= 0:
            sent = request.rate * (now_us - request.counted_us) if request.server >= 0 else 0
            left[number] = max(request.required - request.done - sent, 0) / MICROBITS
    return left
