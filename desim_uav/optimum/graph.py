"""All states that one drone can reach, as arrays in order of their battery.

The battery of a serving drone falls with every step, so no state recurs between two full batteries,
and one sweep over the states by battery, the emptiest first, solves them all. A sweep ends in a
*renewal*: a full battery on a station (after charging), the start (after a crash that ends the
episode), or a state that is never left (after a crash without replacement). A drone that is
replaced begins on one of the stations, each with the same probability: the *lottery*.
"""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from desim_uav.errors import UsageError
from desim_uav.model.motion.planner import Node
from desim_uav.model.rules import Action, Choice, kind_of
from desim_uav.optimum.footprints import flown_to
from desim_uav.optimum.lone_drone import LoneState
from desim_uav.optimum.process import DroneProcess, LoneFlight, LoneOutcome

LARGEST, LARGEST_UNLIMITED = 10**6, 10**5
"""The largest number of states with a battery, and without."""

LOTTERY, NOWHERE, RENEWAL = -1, -2, -3

FORCED = (Action.GOTO_CHARGING_STATION, Action.CHARGE)

Forced = tuple[int, int, list[float]]
"""(state, action, rewards): a command that takes several steps, and the reward of each step."""


@dataclass(frozen=True, eq=False)
class Graph:
    """The result of each of ``actions`` in each of ``states``.

    The first action is hover; among equally good actions a policy takes the first.

    Arrays have the shape (states, actions). ``target`` is a state; or, with n states, n + k for
    renewal k, n + len(renewals) for the lottery, and one more for an action that is not allowed.
    ``steps`` is the number of steps until then, ``reward`` the sum of their rewards, and
    ``attached_us`` the time that users were attached. ``renewals`` are states, of which the first
    is the drone's start; ``lottery`` has the probability of each. ``layers`` are ranges of states
    with the same battery, the emptiest first. ``forced`` are the actions of more than one step.
    """

    states: list[LoneState]
    actions: tuple[Action, ...]
    target: NDArray[np.int64]
    steps: NDArray[np.float64]
    reward: NDArray[np.float64]
    attached_us: NDArray[np.float64]
    renewals: NDArray[np.int64]
    lottery: NDArray[np.float64]
    layers: list[tuple[int, int]]
    forced: list[Forced]


def explore(process: DroneProcess, largest: int = LARGEST) -> Graph:
    """Find all states that can be reached from the start.

    Raises UsageError if there are more than ``largest``, or if a step does not drain the battery.
    """
    return _Explorer(process, largest).graph()


def unlimited(process: DroneProcess) -> Graph:
    """Return the states of a drone without a battery; each is a renewal, and a sweep is one step.

    Raises UsageError if there are too many.
    """
    states: list[LoneState] = [(node, 0) for node in flown_to(process.world)]
    if len(states) > LARGEST_UNLIMITED:
        raise UsageError(_too_many(LARGEST_UNLIMITED))
    begin = states.index(process.start)
    states.insert(0, states.pop(begin))
    number = {state: k for k, state in enumerate(states)}
    actions = _hover_first(process.world.actions)
    shape = (len(states), len(actions))
    target = np.full(shape, 2 * len(states) + 1)
    reward, attached_us = np.zeros(shape), np.zeros(shape)
    arrivals = [process.arrival(state) for state in states]
    for k, state in enumerate(states):
        allowed = process.allowed(state)
        for column, action in enumerate(actions):
            if action in allowed:
                flight = process.flight(state[0], action)
                there = number[flight.to, 0]
                target[k, column] = len(states) + there
                reward[k, column] = arrivals[there]
                attached_us[k, column] = flight.attached_us
    renewals, lottery = np.arange(len(states)), np.zeros(len(states))
    layers = [(0, len(states))]
    return Graph(
        states, actions, target, np.ones(shape), reward, attached_us, renewals, lottery, layers, []
    )


def _too_many(largest: int) -> str:
    return (
        f"map.cells: more than {largest} states (cell, level, battery); "
        f"the best policy can be computed only with fewer"
    )


def _hover_first(choices: tuple[Choice, ...]) -> tuple[Action, ...]:
    actions = map(kind_of, choices)  # without a choice of cruise speeds
    return (Action.HOVER, *(action for action in actions if action is not Action.HOVER))


class _Explorer:
    """Numbers states in the order of discovery and notes the result of each action in each.

    Until all states are known, a target is a state's number, LOTTERY, NOWHERE, or RENEWAL - k for
    renewal k. The state of a drone that is never replaced has a battery below 0; it is paid one of
    ``last`` for ever.
    """

    def __init__(self, process: DroneProcess, largest: int) -> None:
        self.process = process
        self.world = process.world
        self.actions = _hover_first(self.world.actions)
        self.largest = largest
        self.number: dict[LoneState, int] = {}
        self.last: list[float] = []
        self.renewals: list[LoneState] = []
        self.flights: dict[tuple[Node, Action], LoneFlight] = {}
        self.target, self.steps = array("q"), array("q")
        self.reward, self.attached_us = array("d"), array("q")
        self.forced: list[tuple[int, list[float]]] = []

    def graph(self) -> Graph:
        """Explore all states and return the graph."""
        self._renew(self.process.start)
        states: list[LoneState] = []
        while len(states) < len(self.number):
            for state in list(self.number)[len(states) :]:
                self._expand(state)
                states.append(state)
        return self._in_order(states)

    def _find(self, state: LoneState) -> int:
        """Return the number of a state, perhaps a new one."""
        if state not in self.number:
            if len(self.number) == self.largest:
                raise UsageError(_too_many(self.largest))
            self.number[state] = len(self.number)
        return self.number[state]

    def _renew(self, state: LoneState) -> int:
        """Return a state's target as a renewal, perhaps a new one."""
        if state not in self.renewals:
            self.renewals.append(state)
            self._find(state)
        return RENEWAL - self.renewals.index(state)

    def _expand(self, state: LoneState) -> None:
        """Append the results of all actions in a state."""
        nothing_more = state[1] < 0
        allowed = (Action.HOVER,) if nothing_more else self.process.allowed(state)
        for action in self.actions:
            target, steps, reward, attached_us = NOWHERE, 1, 0.0, 0
            if action in allowed and nothing_more:
                target, reward = self._renew(state), self.last[state[0][0]]
            elif action in allowed:
                target, steps, reward, attached_us = self._follow(state, action)
            self.target.append(target)
            self.steps.append(steps)
            self.reward.append(reward)
            self.attached_us.append(attached_us)

    def _follow(self, state: LoneState, action: Action) -> tuple[int, int, float, int]:
        """Return target, steps, reward and attached time of an allowed action.

        The reward of a flight, which is 0 here, is that of being in its target.
        """
        node, charge = state
        if action not in FORCED:
            flight = self._flight(node, action)
            if flight.drain < charge:
                there = self._find((flight.to, charge - flight.drain))
                return there, 1, 0.0, flight.attached_us
        outcome = self.process.outcome(state, action)
        rewards = [step.reward for step in outcome.steps]
        if len(rewards) > 1:
            self.forced.append((len(self.target), rewards))
        attached_us = sum(step.attached_us for step in outcome.steps)
        return self._after(outcome), len(rewards), math.fsum(rewards), attached_us

    def _flight(self, node: Node, action: Action) -> LoneFlight:
        if (node, action) not in self.flights:
            flight = self.process.flight(node, action)
            if flight.drain <= 0:
                raise UsageError(
                    "drones.battery: a step drains nothing; the best policy can be computed only "
                    "if every step drains the battery"
                )
            self.flights[node, action] = flight
        return self.flights[node, action]

    def _after(self, outcome: LoneOutcome) -> int:
        """Return the target after a landing or a crash."""
        if outcome.state is not None:
            return self._renew(outcome.state)
        if self.world.only_type.on_crash == "end_episode":
            return self._renew(self.process.start)
        if self.world.only_type.on_crash == "respawn":
            full = self.world.only_type.capacity
            places = [self._renew(((*cell, 0), full)) for cell in self.world.stations]
            return places[0] if len(places) == 1 else LOTTERY
        last = outcome.steps[-1].reward
        if last not in self.last:
            self.last.append(last)
        return self._renew(((self.last.index(last), -1, -1), -1))

    def _in_order(self, listing: list[LoneState]) -> Graph:
        """Return the graph with its states in order of their battery."""
        charge = np.array([battery for _, battery in listing], np.int64)
        order = np.argsort(charge, kind="stable")
        place = np.empty(len(listing), np.int64)
        place[order] = np.arange(len(listing))
        shape = (len(listing), len(self.actions))
        target = np.array(self.target, np.int64).reshape(shape)
        reward = np.array(self.reward).reshape(shape)
        gained = np.zeros(len(listing))
        for state in sorted(state for state in listing if state[1] >= 0):  # by node
            gained[self.number[state]] = self.process.arrival(state)
        reward = np.where(target >= 0, gained[np.maximum(target, 0)], reward)
        renewals, states = len(self.renewals), len(listing)
        target = np.select(
            [target >= 0, target == LOTTERY, target == NOWHERE],
            [place[np.maximum(target, 0)], states + renewals, states + renewals + 1],
            states + RENEWAL - target,
        )
        full = {(*cell, 0) for cell in self.world.stations}
        lottery = np.array([node in full for node, _ in self.renewals], float)
        ends = np.flatnonzero(np.diff(charge[order], append=-2)) + 1
        return Graph(
            [listing[k] for k in order.tolist()],
            self.actions,
            target[order],
            np.array(self.steps, float).reshape(shape)[order],
            reward[order],
            np.array(self.attached_us, float).reshape(shape)[order],
            place[[self.number[state] for state in self.renewals]],
            lottery / max(1.0, lottery.sum()),
            list(pairwise([0, *ends.tolist()])),
            [(int(place[at // shape[1]]), at % shape[1], rewards) for at, rewards in self.forced],
        )
