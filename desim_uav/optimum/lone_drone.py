"""The flights of the only drone of a world, from any state, by the rules that engines run.

Users stand still and their requests stay open, so a run depends on the drone's state alone. There
are few events, so a dictionary is their event queue, which is several times faster than SimPy's.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import UsageError
from desim_uav.model.demand.demand import Continuous, requests_of
from desim_uav.model.motion.planner import Node
from desim_uav.model.rules import Action
from desim_uav.model.state import Observation
from desim_uav.rules import words
from desim_uav.rules.charging import await_full, begin_charging, end_charging
from desim_uav.rules.coverage import on_crossing, silence, track
from desim_uav.rules.crash import crash
from desim_uav.rules.decide import observe, on_arrival
from desim_uav.rules.due import arrival_slot, crossing_slot, depletion_slot, settle_slot
from desim_uav.rules.episode import command, end_step, show_first
from desim_uav.rules.flight import appear, hover_at, station_under
from desim_uav.rules.orientation import orient
from desim_uav.rules.rewards import Coverage, CoverageBattery, MultiService
from desim_uav.rules.rows import Drone
from desim_uav.rules.settle import settle
from desim_uav.sample_path import SamplePath
from desim_uav.world import World

LoneState = tuple[Node, int]
"""The state of a drone that can be commanded: its node, and its battery (0: unlimited)."""

BUILT_IN = (Coverage, CoverageBattery, MultiService)
"""Rewards that do not depend on the step of the episode."""


class LoneStep(NamedTuple):
    """The end of a step: the reward, the observation, and the time that users were attached."""

    reward: float
    observation: Observation
    attached_us: int


class Events:
    """The event queue of the rules (see ``rules.due``): the (time, key) of each slot in use."""

    def __init__(self) -> None:
        self._end = 0, 0
        self._at: dict[int, tuple[int, int]] = {}

    def due(self, slot: int, t_us: int, key: int) -> None:
        """Schedule the event of a slot for a time; ``key`` is its rank in that instant."""
        self._at[slot] = t_us, key

    def undo(self, slot: int) -> None:
        """Cancel the event of a slot, if one is scheduled."""
        self._at.pop(slot, None)

    def clear(self) -> None:
        """Cancel all events."""
        self._at.clear()

    def nothing_before(self, key: int) -> bool:
        """Return whether no event is scheduled, whatever its time and its key."""
        return not self._at

    def run_until(self, t_us: int, key: int) -> None:
        """Let ``next`` return only events before this place in an instant."""
        self._end = t_us, key

    def next(self) -> tuple[int, int] | None:
        """Remove the next event, if it is before the end; return its slot and its time."""
        slot = min(self._at, key=self._at.__getitem__, default=None)
        if slot is None or self._at[slot] >= self._end:
            return None
        return slot, self._at.pop(slot)[0]


class LoneDrone:
    """The only drone of a world, in the rows of a SimPy engine (see ``rules.rows``)."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._engine = Simulation(world, RunSettings((True,), carry_over=False))
        requests = requests_of(Continuous(), len(world.homes), world.services, 0, [0], words.NEVER)
        respawn = np.zeros((1, 1), np.int64)
        path = SamplePath(0, world.walks(world.seed, 0), requests[0], None, respawn)
        self._engine.reset(path)  # opens all requests
        self.constants: Any = self._engine.constants
        self.state: Any = self._engine.state
        self.drone: Drone = self.state.drones[0]
        self._path = self._engine.own_path
        self._events = self.state.clock = Events()
        self.state.keeps_requests = 0
        if world.only_type.on_crash == "end_episode":  # which would close all requests
            self.constants.types[0].on_crash = words.REMOVES
        self._pay, self.constants.pay = self.constants.pay, self._note
        self._rules = {
            arrival_slot(self.state, 0): on_arrival,
            crossing_slot(self.state, 0): on_crossing,
            depletion_slot(self.state, 0): crash,
            settle_slot(self.state): _attach,
        }
        reward, last = world.scenario.reward, max(1, world.scenario.episode.steps - 1)
        self._paid_in = (0,) if type(reward) in BUILT_IN else (0, 1, last)
        self._steps: list[LoneStep] = []
        self._hovers_over: Node | None = None

    def put(self, state: LoneState) -> None:
        """Put the drone at rest in a state, at a decision epoch at time 0, and allow commands."""
        (x, y, level), charge = state
        world, path, rows, drone = self.constants, self._path, self.state, self.drone
        silence(world, path, rows, drone, words.COVERAGE)
        self._events.clear()
        self._hovers_over = None
        rows.now_us = rows.epoch_us = rows.step = rows.attached_us = rows.crashes = 0
        rows.crashed.clear()
        appear(world, rows, drone, x, y)
        hover_at(drone, x, y, level)
        drone.charge, drone.waits, drone.respawns = charge, 1, 0
        orient(world, path, rows, drone)
        show_first(world, path, rows)

    def run(
        self, state: LoneState, action: Action
    ) -> tuple[tuple[LoneStep, ...], LoneState | None]:
        """Give a command in a state; run steps until the next one, or until nothing more happens.

        Return the steps, and the state of the drone then: None if it has crashed.
        """
        self.put(state)
        drone, rows, self._steps = self.drone, self.state, []
        drone.command = self.world.actions.index(action)
        over = False
        while not over:
            self._run_step()
            gone = rows.crashes and self.constants.types[0].on_crash == words.REMOVES
            over = bool(drone.waits or gone)
        there = (drone.x, drone.y, drone.level), rows.observations[0].charge
        return tuple(self._steps), None if rows.crashes else there

    def reward(self, state: LoneState) -> float:
        """Return the drone's reward for a step of serving flight that ends in a state."""
        node, self.drone.charge = state
        if node != self._hovers_over:
            self.put(state)
            track(self.constants, self._path, self.state, self.drone, 0, words.ENTRY)
            _attach(self.constants, self._path, self.state, self.drone)
            self._hovers_over = node
        observe(self.constants, self.state)
        return self._reward()

    def _reward(self) -> float:
        """Return the drone's reward now.

        Raises UsageError if its reward depends on the step of the episode.
        """
        rewards = {self._reward_in(step) for step in self._paid_in}
        if len(rewards) > 1:
            raise UsageError(
                f"reward: {type(self.world.scenario.reward).__name__} depends on the step of the "
                "episode; the best policy can be computed only if it does not"
            )
        return rewards.pop()

    def _reward_in(self, step: int) -> float:
        """Return the drone's reward now if everything had happened this many steps later."""
        rows, drone, later_us = self.state, self.drone, step * self.world.step_us
        rows.step, rows.now_us = step, rows.now_us + later_us
        drone.since_us += later_us
        self._pay(self.constants, rows)
        self._engine.check_components()
        rows.step, rows.now_us = 0, rows.now_us - later_us
        drone.since_us -= later_us
        reward: float = rows.rewards[0]
        return reward

    def _run_step(self) -> None:
        """Run a step, in which each event calls its rule."""
        world, path, rows, drone = self.constants, self._path, self.state, self.drone
        rows.step = 0
        command(world, path, rows)
        self._charge()
        while event := self._events.next():
            slot, rows.now_us = event
            self._rules[slot](world, path, rows, drone)
            self._charge()
        rows.step, rows.now_us = -1, rows.next_us  # so it ends as step 0, which ends no episode
        end_step(world, path, rows)

    def _charge(self) -> None:
        """Let the drone begin to charge if it has landed, because all pads are free."""
        world, rows, drone = self.constants, self.state, self.drone
        if drone.mode == words.QUEUED:
            station = station_under(world, drone)
            phase = begin_charging(world, rows, drone, station)
            if not await_full(world, rows, drone):
                end_charging(world, rows, drone, station, phase)

    def _note(self, constants: Any, rows: Any) -> None:
        """Pay the drone and note the end of a step, which is before a drone is replaced."""
        attached_us = rows.attached_us - rows.attached_from_us
        attached_us += self.drone.attached_users * rows.now_us
        rows.attached_us -= attached_us  # so that the next step counts from here
        self._steps.append(LoneStep(self._reward(), self._engine.observations()[0], attached_us))


def _attach(world: Any, path: Any, state: Any, drone: Any) -> None:
    """Attach users and admit their requests, at the end of an instant."""
    settle(world, path, state, words.ATTACHMENT, words.ATTACHMENT)
