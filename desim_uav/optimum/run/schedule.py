"""A good schedule of all drones, made with knowledge of the sample paths.

It shows how close a bound is to what drones can reach. The drones are planned one after the other:
each gets the flights that cover most of the users whom the others do not cover. It flies between
the actual cells and levels of the map, by moves and charges only, as in an engine. An engine then
simulates the schedule, so drones can actually reach its QoE3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.errors import UsageError
from desim_uav.model.rules import IN_QUEUE, MOVES, US, Action, Mode
from desim_uav.model.state import Observation
from desim_uav.optimum.footprints import flown_to
from desim_uav.optimum.run.alone import (
    CHARGE,
    LARGEST,
    Alone,
    LonePlans,
    best_alone,
    follow,
    leg_number,
    pay_legs,
)
from desim_uav.optimum.run.legs import HEADINGS, Shares
from desim_uav.sample_path import SamplePath
from desim_uav.world import World

FLIGHTS = (*HEADINGS, Action.UP, Action.DOWN)
"""The actions that are legs, by their number."""

TURNS = 6
"""The number of times that each drone is given new flights."""


class TeamSchedule:
    """The drones of a world, which begin at their starts, with plans for so many steps.

    The first of them is step ``begin`` of the shares.
    """

    def __init__(
        self, world: World, relaxed: Alone, shares: Shares, begin: int, steps: int
    ) -> None:
        self.world, self.shares, self.begin, self.steps = world, shares, begin, steps
        self.nodes = flown_to(world)
        self.number = {node: k for k, node in enumerate(self.nodes)}
        self.starts = [self.number[(*cell, 0)] for cell in world.starts]
        self.alone = self._alone(relaxed)
        self.plans: list[LonePlans | None] = [None] * len(self.starts)
        self.covered = np.zeros((len(self.starts), steps, len(world.homes)))

    def _alone(self, relaxed: Alone) -> Alone:
        """Return what a drone can do by moves and charges; a crash lasts for ever."""
        levels = len(relaxed.charge)
        if self.steps * len(self.nodes) * levels > LARGEST:
            raise UsageError("map.cells: too many places for a schedule")
        ahead = np.full((len(self.nodes), len(FLIGHTS)), -1)
        for k, (ix, iy, level) in enumerate(self.nodes):
            for leg, action in enumerate(FLIGHTS):
                dx, dy, dlevel = MOVES.get(action, (0, 0, 0))
                ahead[k, leg] = self.number.get((ix + dx, iy + dy, level + dlevel), -1)
        ny = self.world.grid.cells[1]
        over = np.array([ix * ny + iy for ix, iy, _ in self.nodes])
        stations = [self.number[(*cell, 0)] for cell in self.world.stations]
        return Alone(
            ahead,
            over,
            np.array(stations if relaxed.limited else [], np.int64),
            relaxed.charge,
            np.zeros((len(ahead), len(stations) if relaxed.limited else 0, levels), np.int64),
            np.full(levels, self.steps + 1) if relaxed.limited else relaxed.crash,
            relaxed.doomed,
            relaxed.limited,
            may_wait=False,
        )

    def improve(self, turns: int, on_turn: Callable[[], None]) -> None:
        """Give each drone in turn the best flights beside those of the others."""
        paid = np.empty((self.steps, self.world.grid.height_m.size, len(HEADINGS)))
        best, best_plans = -1.0, list(self.plans)
        for _ in range(turns):
            for drone, start in enumerate(self.starts):
                missed = np.prod(1.0 - np.delete(self.covered, drone, 0).clip(0.0, 1.0), axis=0)
                pay_legs(self.shares, self.begin, missed, paid)
                plan = self.plans[drone] = best_alone(self.alone, paid, self.steps)
                self.covered[drone] = 0.0
                follow(self.alone, plan, self.shares, self.begin, start, self.covered[drone])
            on_turn()
            total = float((1.0 - np.prod(1.0 - self.covered, axis=0)).sum())
            if total <= best:
                break
            best, best_plans = total, list(self.plans)
        self.plans = best_plans

    def play(self, paths: Sequence[SamplePath]) -> list[float]:
        """Play the schedule in the SimPy engine; return the QoE3 of each episode, in percent."""
        world = self.world
        carried = world.scenario.episode.carry_over
        engine = make_engine("des", world, RunSettings((True,) * len(self.starts), carried))
        at, qoe3_percent, step = list(self.starts), [], 0
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
        return qoe3_percent

    def _action(
        self, drone: int, at: int, step: int, observation: Observation
    ) -> tuple[Action, int]:
        """Return the action of a drone at a place, and the place to which it leads."""
        plan, mode = self.plans[drone], observation.mode
        if mode in IN_QUEUE:
            return Action.CHARGE, at
        if mode == Mode.CRASHED or plan is None:
            return Action.HOVER, at
        j = 0
        if self.alone.limited:
            left_us = round((observation.battery_s or 0.0) * US)
            j = (self.world.only_type.capacity - left_us) // self.world.step_us
        decision = int(plan.decisions[step, at, j])
        if decision == CHARGE:
            return Action.CHARGE, at
        if decision > CHARGE:
            return Action.HOVER, at
        leg = leg_number(decision)
        return FLIGHTS[leg], int(self.alone.ahead[at, leg])
