"""A good schedule of all drones, made with knowledge of the sample paths.

It shows how close a bound is to what drones can reach. The drones are planned one after the other:
each gets the flights that cover most of the users whom the others do not cover. It flies between
the actual cells and levels of the map, by moves and charges only, as in an engine. An engine then
simulates the schedule, so drones can actually reach its QoE3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.drone_type import DroneType
from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.errors import UsageError
from desim_uav.model.rules import IN_QUEUE, MOVES, Action, Mode
from desim_uav.model.state import Observation
from desim_uav.optimum.footprints import flown_to
from desim_uav.optimum.run.alone import (
    CHARGE,
    FORBIDDEN,
    LARGEST,
    Alone,
    LonePlans,
    best_alone,
    charging_steps,
    follow,
    leg_number,
    pay_legs,
)
from desim_uav.optimum.run.battery import FLIGHTS, Charges, careful_charges
from desim_uav.optimum.run.legs import HEADINGS, Shares
from desim_uav.sample_path import SamplePath
from desim_uav.world import World

TURNS = 6
"""The number of times that each drone is given new flights."""


NONE = np.zeros(1, np.int64)
UNLIMITED = Charges(np.zeros(len(FLIGHTS), np.int64), full=0, leg=0, most=NONE, least=NONE)
"""The battery of a drone that needs none."""


def refuse_unscheduled(world: World, kind: DroneType, steps: int) -> None:
    """Refuse a type whose drones cannot be scheduled in so many steps that follow each other.

    Raises UsageError, with the keys, if their states are too many.
    """
    places, levels = len(flown_to(world)), len(_charges_of(kind, world.step_us).most)
    if steps * places * levels > LARGEST:
        carried = world.scenario.episode.carry_over
        afresh = " or begin each anew (carry_over: false)" if carried else ""
        raise UsageError(
            f"map.cells, episode: a schedule of {steps} steps by {places} places by {levels} "
            f"levels of the battery has more than {LARGEST} states; ask for fewer or shorter "
            f"episodes{afresh}, or for the bound alone (schedule=False in Python)"
        )


def _charges_of(kind: DroneType, step_us: int) -> Charges:
    """Return what is known of the battery of a type in a schedule."""
    return careful_charges(kind, step_us) if kind.limited else UNLIMITED


class OwnDrone(NamedTuple):
    """What a drone of a schedule can do, whom its legs cover, and its charge after u units."""

    alone: Alone
    shares: Shares
    most: NDArray[np.int64]


class TeamSchedule:
    """The drones of a world, which begin at their starts, with plans for so many steps.

    The first of them is step ``begin`` of the shares. ``kinds`` are the types that differ, with the
    shares of each.
    """

    def __init__(
        self,
        world: World,
        kinds: Sequence[tuple[DroneType, Shares]],
        begin: int,
        steps: int,
    ) -> None:
        self.world, self.begin, self.steps = world, begin, steps
        self.nodes = flown_to(world)
        self.number = {node: k for k, node in enumerate(self.nodes)}
        self.starts = [self.number[(*cell, 0)] for cell in world.starts]
        own = [self._drone(kind, shares) for kind, shares in kinds]
        numbers = [world.types.index(world.type_of(drone)) for drone in range(len(self.starts))]
        self.drones = [own[number if len(own) > 1 else 0] for number in numbers]
        self.plans: list[LonePlans | None] = [None] * len(self.starts)
        self.covered = np.zeros((len(self.starts), steps, len(world.homes)))
        self.busy = np.zeros((len(self.starts), len(world.stations), steps), np.int64)

    def _drone(self, kind: DroneType, shares: Shares) -> OwnDrone:
        """Return what a drone of a type can do by moves and charges, without a crash."""
        ahead = np.full((len(self.nodes), len(FLIGHTS)), -1)
        for k, (ix, iy, level) in enumerate(self.nodes):
            for leg, action in enumerate(FLIGHTS):
                dx, dy, dlevel = MOVES.get(action, (0, 0, 0))
                ahead[k, leg] = self.number.get((ix + dx, iy + dy, level + dlevel), -1)
        ny = self.world.grid.cells[1]
        over = np.array([ix * ny + iy for ix, iy, _ in self.nodes])
        step_us = self.world.step_us
        charges = _charges_of(kind, step_us)
        stations = [self.number[(*cell, 0)] for cell in kind.stations if kind.limited]
        levels = len(charges.most)
        refuse_unscheduled(self.world, kind, self.steps)
        alone = Alone(
            ahead=ahead,
            over=over,
            drains=charges.drains,
            full=charges.full,
            stations=np.array(stations, np.int64),
            charge=charging_steps(kind, step_us, charges) if kind.limited else charges.most,
            home=np.zeros((len(ahead), len(stations), levels), np.int64),
            crash=np.zeros(levels, np.int64),
            doomed=levels,
            toll=FORBIDDEN,
            limited=kind.limited,
            relaxed=False,
            free=np.zeros((len(stations), 0), np.int64),
        )
        return OwnDrone(alone, shares, charges.most)

    def improve(self, turns: int, on_turn: Callable[[], None]) -> None:
        """Give each drone in turn the best flights beside those of the others."""
        paid = np.empty((self.steps, self.world.grid.height_m.size, len(HEADINGS)))
        best, best_plans = -1.0, list(self.plans)
        for _ in range(turns):
            for drone, start in enumerate(self.starts):
                alone, shares, _ = self.drones[drone]
                missed = np.prod(1.0 - np.delete(self.covered, drone, 0).clip(0.0, 1.0), axis=0)
                pay_legs(shares, self.begin, missed, paid)
                self.covered[drone], self.busy[drone] = 0.0, 0
                own = alone._replace(free=self._free()) if alone.limited else alone
                plan = self.plans[drone] = best_alone(own, paid, self.steps)
                covered, busy = self.covered[drone], self.busy[drone]
                follow(own, plan, shares, self.begin, start, covered, busy)
            on_turn()
            total = float((1.0 - np.prod(1.0 - self.covered, axis=0)).sum())
            if total <= best:
                break
            best, best_plans = total, list(self.plans)
        self.plans = best_plans

    def _free(self) -> NDArray[np.int64]:
        """Return for how many steps from each one on a pad of each station is free."""
        used = self.busy.sum(0) >= self.world.scenario.stations.pads
        free = np.zeros_like(used, np.int64)
        lasts = np.full(len(used), self.steps + 1)
        for t in range(self.steps - 1, -1, -1):
            lasts = np.where(used[:, t], 0, lasts + 1)
            free[:, t] = lasts
        return free

    def play(self, paths: Sequence[SamplePath]) -> tuple[list[float], int]:
        """Play the schedule in the SimPy engine.

        Returns the QoE3 of each episode, in percent, and the number of crashes.
        """
        world = self.world
        carried = world.scenario.episode.carry_over
        engine = make_engine("des", world, RunSettings((True,) * len(self.starts), carried))
        at, qoe3_percent, step, crashes = list(self.starts), [], 0, 0
        for path in paths:
            snapshot = engine.reset(path)
            while not (snapshot.terminated or snapshot.truncated):
                commands = []
                for drone, observation in enumerate(snapshot.observations):
                    action, at[drone] = self._action(drone, at[drone], step, observation)
                    commands.append(world.actions.index(action))
                snapshot, step = engine.step(commands), step + 1
            users_us = len(world.homes) * engine.log.duration_us
            qoe3_percent.append(100.0 * engine.log.attached_us / users_us)
            crashes += engine.log.crashes
        return qoe3_percent, crashes

    def _action(
        self, drone: int, at: int, step: int, observation: Observation
    ) -> tuple[Action, int]:
        """Return the action of a drone at a place, and the place to which it leads."""
        plan, mode, own = self.plans[drone], observation.mode, self.drones[drone]
        if mode in IN_QUEUE:
            return Action.CHARGE, at
        if mode == Mode.CRASHED or plan is None:
            return Action.HOVER, at
        charge = round((observation.battery_s or 0.0) * self.world.type_of(drone).drain_per_s)
        taken = min(int((own.most > charge).sum()), len(own.most) - 1)
        decision = int(plan.decisions[step, at, taken])
        if decision == CHARGE:
            return Action.CHARGE, at
        leg = leg_number(decision)
        return FLIGHTS[leg], int(own.alone.ahead[at, leg])
