"""One drone as a decision process: the result of each decision, exactly as in an engine.

The drone gets the same commands as in an engine, but is alone in the world: no other drone waits at
a station, and every user in its footprint is attached to it. Episodes have no end, requests stay
open, and nothing depends on the time. A decision in a state always leads to the same steps, except
that a crashed drone returns on a random station.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import UsageError
from desim_uav.model.battery import charged_us, time_to_full_us
from desim_uav.model.demand import Continuous
from desim_uav.model.motion import REST, Leg, Transit
from desim_uav.model.planner import Node
from desim_uav.model.rules import MOVES, US, Action, Mode
from desim_uav.model.state import Observation
from desim_uav.optimum.footprints import Footprints
from desim_uav.rules.admission import FirstCome
from desim_uav.rules.decide import mask
from desim_uav.rules.note import place
from desim_uav.rules.rewards import Coverage, CoverageBattery, MultiService
from desim_uav.world import World

State = tuple[Node, int]
"""The state of a drone that can be commanded: its node, and its battery (0: unlimited)."""

NO_REQUESTS = (Coverage, CoverageBattery)
"""Rewards that do not depend on requests."""

BUILT_IN = (*NO_REQUESTS, MultiService)


class Stage(NamedTuple):
    """A drone's leg, or rest at a place, that begins at ``start_us`` in one mode."""

    start_us: int
    mode: Mode
    node: Node
    leg: Leg
    battery_us: int


class Step(NamedTuple):
    """The end of a step: the reward, the observation, and the time that users were attached."""

    reward: float
    seen: Observation
    attached_us: int


class Flight(NamedTuple):
    """A step of serving flight in which the battery does not run empty."""

    to: Node
    drained_us: int
    attached_us: int


class Outcome(NamedTuple):
    """The result of a decision: the steps until the next decision, and the state at that time.

    ``state`` is None after a crash, because this drone decides nothing more. The steps are then
    those until it is replaced, or until the crash if it is not.
    """

    steps: tuple[Step, ...]
    state: State | None


class DroneProcess:
    """The decisions of the one drone of a world, under the ceiling.

    Raises UsageError, with the key, if the scenario cannot be solved exactly.
    """

    def __init__(self, world: World) -> None:
        refuse_what_is_random(world)
        self.world = world
        self.energy = world.scenario.drones.battery
        self.footprints = Footprints(world)
        self.stations = {(*cell, 0) for cell in world.stations}
        self.start: State = ((*world.starts[0], 0), world.capacity_us)
        self._engine = Simulation(world, RunSettings((True,), carry_over=False))
        self._attached: dict[tuple[int, int], int] = {}
        self._masks: dict[tuple[bool, bool], tuple[Action, ...]] = {}

    # ---- decisions

    def allowed(self, state: State) -> tuple[Action, ...]:
        """Return the allowed commands, without blocked moves, which are the same as hover."""
        node, battery_us = state
        limited = self.energy is not None
        may_return = limited and battery_us <= self.world.return_below_us
        may_charge = limited and node in self.stations and battery_us < self.world.capacity_us
        key = may_return, may_charge
        if key not in self._masks:
            known = self.world.actions
            legal = mask(known, Mode.FLYING, *key)
            self._masks[key] = tuple(a for a, yes in zip(known, legal, strict=True) if yes)
        return tuple(
            action
            for action in self._masks[key]
            if action not in MOVES or self.neighbour(node, action) != node
        )

    def neighbour(self, node: Node, action: Action) -> Node:
        """Return the place to which a move leads, which is the same place if it is blocked."""
        dx, dy, dz = MOVES.get(action, (0, 0, 0))
        there = (node[0] + dx, node[1] + dy, node[2] + dz)
        return there if self.world.grid.can_enter(*there) else node

    def outcome(self, state: State, action: Action) -> Outcome:
        """Return the result of ``action``, which must be allowed."""
        node, battery_us = state
        if action is Action.GOTO_CHARGING_STATION:
            stages = list(self._return(node, battery_us))
        elif action is Action.CHARGE:
            stages = list(self._charge(0, node, battery_us))
        else:
            stages = list(self._fly(node, battery_us, action))
        return Outcome(tuple(self._steps(stages)), self._next(stages[-1]))

    def flight(self, node: Node, action: Action) -> Flight:
        """Return the result of a move or a hover in which the battery does not run empty."""
        there, flown_us, step_us = self.neighbour(node, action), 0, self.world.step_us
        drained_us, leg = 0, self._leg(node, node, REST)
        if there != node:
            leg = self._leg(node, there, self.world.epoch_transits[action])
            flown_us = leg.transit.duration_us
            drained_us = self._drained(leg.transit, flown_us)
        drained_us += self._drained(REST, step_us - flown_us)
        return Flight(there, drained_us, self.footprints.attached_us(leg, step_us, step_us))

    def arrival(self, state: State) -> Step:
        """Return the end of a step of serving flight in ``state``, with no time attached."""
        node, battery_us = state
        there = Stage(0, Mode.FLYING, node, self._leg(node, node, REST), battery_us)
        return Step(*self._paid(there, 0), 0)

    def _next(self, last: Stage) -> State | None:
        if last.mode is Mode.CRASHED:
            return None
        if last.mode is Mode.FLYING:
            left_us = self.world.step_us - last.start_us
            return last.node, last.battery_us - self._drained(REST, left_us)
        return last.node, last.battery_us

    # ---- the stages of a drone after a decision, which is at 0

    def _fly(self, node: Node, battery_us: int, action: Action) -> Iterator[Stage]:
        """Yield the stages of a move or a hover until the end of the step."""
        there, arrival_us, step_us = self.neighbour(node, action), 0, self.world.step_us
        if there != node:
            transit = self.world.epoch_transits[action]
            leg, arrival_us = self._leg(node, there, transit), transit.duration_us
            yield Stage(0, Mode.FLYING, node, leg, battery_us)
            if self._lasts(transit, battery_us) < arrival_us:
                yield self._crash(0, leg, battery_us)
                return
            battery_us -= self._drained(transit, arrival_us)
        rest = self._leg(there, there, REST)
        yield Stage(arrival_us, Mode.FLYING, there, rest, battery_us)
        if self._lasts(REST, battery_us) <= step_us - arrival_us:
            yield self._crash(arrival_us, rest, battery_us)

    def _return(self, node: Node, battery_us: int) -> Iterator[Stage]:
        """Yield the hops to the nearest station; the battery may be empty on arrival."""
        planned = None if node in self.stations else self.world.planner.plan(node)
        now_us = 0
        for hop in () if planned is None else planned.hops:
            there = (node[0] + hop[0], node[1] + hop[1], node[2] + hop[2])
            transit = self.world.return_transits[hop]
            leg = self._leg(node, there, transit)
            yield Stage(now_us, Mode.RETURNING, node, leg, battery_us)
            if self._lasts(transit, battery_us) < transit.duration_us:
                yield self._crash(now_us, leg, battery_us)
                return
            battery_us -= self._drained(transit, transit.duration_us)
            now_us += transit.duration_us
            node = there
        yield from self._charge(now_us, node, battery_us)

    def _charge(self, now_us: int, node: Node, battery_us: int) -> Iterator[Stage]:
        """Yield charging until the battery is full, and the wait for the next decision."""
        world, leg = self.world, self._leg(node, node, REST)
        rest_us = time_to_full_us(battery_us, world.capacity_us, world.full_charge_us)
        yield Stage(now_us, Mode.CHARGING, node, leg, battery_us)
        yield Stage(now_us + rest_us, Mode.CHARGED, node, leg, world.capacity_us)

    def _crash(self, start_us: int, leg: Leg, battery_us: int) -> Stage:
        """Return the crash of a drone whose battery runs empty in the air."""
        lasts_us = int(self._lasts(leg.transit, battery_us))
        x_m, y_m, _ = leg.position_m(lasts_us / US)
        fallen = Leg(REST, (x_m, y_m), (x_m, y_m), 0.0, 0.0)
        node = (*self.world.grid.cell_of(x_m, y_m), 0)
        battery_us -= self._drained(leg.transit, lasts_us)
        return Stage(start_us + lasts_us, Mode.CRASHED, node, fallen, battery_us)

    def _leg(self, node: Node, there: Node, transit: Transit) -> Leg:
        grid = self.world.grid
        return Leg(
            transit,
            grid.centre(*node[:2]),
            grid.centre(*there[:2]),
            grid.levels_m[node[2]],
            grid.levels_m[there[2]],
        )

    def _drained(self, transit: Transit, elapsed_us: int) -> int:
        return 0 if self.energy is None else self.energy.drained_us(transit, elapsed_us)

    def _lasts(self, transit: Transit, battery_us: int) -> float:
        return math.inf if self.energy is None else self.energy.lasts_us(transit, battery_us)

    # ---- observations and rewards

    def _steps(self, stages: list[Stage]) -> Iterator[Step]:
        """Yield the steps from a decision to the next one."""
        step_us, last = self.world.step_us, stages[-1]
        count = 1 if last.mode is Mode.FLYING else max(1, -(-self._free_us(last) // step_us))
        at = 0
        for end_us in range(step_us, (count + 1) * step_us, step_us):
            while at + 1 < len(stages) and stages[at + 1].start_us <= end_us:
                at += 1
            paid = self._paid(stages[at], end_us - stages[at].start_us)
            yield Step(*paid, self._attached_us(stages) if end_us == step_us else 0)

    def _free_us(self, last: Stage) -> int:
        """Return the time from which the drone, or its replacement, can be commanded."""
        replaced = last.mode is Mode.CRASHED and self.world.on_crash == "respawn"
        return last.start_us + (self.world.respawn_after_us if replaced else 0)

    def _attached_us(self, stages: list[Stage]) -> int:
        """Return the time that users are attached in the step that begins with a decision.

        No user is attached in the further steps until the next decision.
        """
        first, last = stages[0], stages[-1]
        if first.mode is not Mode.FLYING:
            return 0
        until_us = last.start_us if last.mode is Mode.CRASHED else self.world.step_us
        return self.footprints.attached_us(first.leg, self.world.step_us, until_us)

    def _paid(self, now: Stage, elapsed_us: int) -> tuple[float, Observation]:
        """Return the reward and the observation of a step that ends at a time of a stage.

        All requests are open. Raises UsageError if the reward depends on the step of the episode.
        """
        self._write(now, elapsed_us)
        reward, scenario = self._reward(0), self.world.scenario
        if type(scenario.reward) not in BUILT_IN:
            for step in (1, max(1, scenario.episode.steps - 1)):
                if self._reward(step) != reward:
                    raise UsageError(
                        f"reward: {type(scenario.reward).__name__} depends on the step of the "
                        "episode; the best policy can be computed only if it does not"
                    )
        return reward, self._engine.observations()[0]

    def _reward(self, step: int) -> float:
        """Return what the drone of the rows is paid at the end of a step."""
        world, state = self._engine.constants, self._engine.state
        state.step, state.now_us = step, step * self.world.step_us
        world.pay(world, state)
        self._engine.check_components()
        state.step = 0
        reward: float = state.rewards[0]
        return reward

    def _write(self, now: Stage, elapsed_us: int) -> None:
        """Write what the drone knows at a time of a stage into the engine's rows."""
        grid, state = self.world.grid, self._engine.state
        drone, seen, services = state.drones[0], state.seen[0], len(state.asked)
        believed = now.node
        if now.leg.transit is not REST:
            x_m, y_m, z_m = now.leg.position_m(elapsed_us / US)
            believed = (*grid.cell_of(x_m, y_m), grid.level_of(z_m))
        held = self.attached(now.node) if now.mode is Mode.FLYING else 0
        drone.mode = seen.mode = int(now.mode)
        seen.x, seen.y, seen.level = believed
        seen.believed = place(self._engine.constants, *believed)
        drone.battery_us = seen.battery_us = self._battery_us(now, elapsed_us)
        drone.attached_users = seen.attached_users = seen.served_requests = held
        drone.served[0] = drone.asking[0] = state.counts[0] = state.counts[services] = held
        state.asked[0] = len(self.world.homes)

    def _battery_us(self, now: Stage, elapsed_us: int) -> int:
        if now.mode in (Mode.FLYING, Mode.RETURNING):
            return now.battery_us - self._drained(now.leg.transit, elapsed_us)
        if now.mode is Mode.CHARGING:
            world = self.world
            capacity_us, full_us = world.capacity_us, world.full_charge_us
            return charged_us(now.battery_us, elapsed_us, capacity_us, full_us)
        return now.battery_us

    def attached(self, node: Node) -> int:
        """Return the number of users in the footprint over a cell."""
        cell = node[:2]
        if cell not in self._attached:
            self._attached[cell] = len(self.footprints.held(self.world.grid.centre(*cell)))
        return self._attached[cell]


def refuse_what_is_random(world: World) -> None:
    """Raise UsageError, with the key, unless there is one drone and nothing random but crashes."""
    scenario = world.scenario
    drones, demand, admission = scenario.drones, scenario.demand, scenario.drones.admission
    only = "the best policy can be computed only"
    if drones.count > 1:
        raise UsageError(f"drones.count: {only} for one drone, not for {drones.count}")
    if scenario.position_noise is not None:
        raise UsageError(f"position_noise: {only} without position noise (null)")
    if type(scenario.reward) in NO_REQUESTS:
        return
    if type(demand) is not Continuous:
        kind = type(demand).kind  # type: ignore[attr-defined]
        raise UsageError(
            f"demand.kind: {only} with continuous demand, not {kind!r}, unless the reward is "
            f"coverage or coverage_battery"
        )
    if type(admission) is not FirstCome:
        kind = type(admission).kind  # type: ignore[attr-defined]
        raise UsageError(f"drones.admission: {only} with first_come, not {kind!r}")
