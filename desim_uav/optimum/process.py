"""One drone as a decision process: the result of each decision, exactly as in an engine.

The drone gets the same commands as in an engine, but is alone in the world: no other drone waits at
a station, and every user in its footprint is attached to it. Episodes have no end, requests stay
open, and nothing depends on the time. A decision in a state always leads to the same steps, except
that a crashed drone returns on a random station.
"""

from __future__ import annotations

from typing import NamedTuple

from desim_uav.errors import UsageError
from desim_uav.model.demand.demand import Continuous
from desim_uav.model.motion.planner import Node
from desim_uav.model.rules import MOVES, Action, kind_of
from desim_uav.optimum.footprints import refuse_walks
from desim_uav.optimum.lone_drone import LoneDrone, LoneState, LoneStep
from desim_uav.optimum.paper_model import refuse_other_models
from desim_uav.registry import kind_name
from desim_uav.rules.admission import FirstCome
from desim_uav.rules.flight import can_enter
from desim_uav.rules.rewards import Coverage, CoverageBattery
from desim_uav.world import World

NO_REQUESTS = (Coverage, CoverageBattery)
"""Rewards that do not depend on requests."""


class LoneFlight(NamedTuple):
    """A step of serving flight in which the battery does not run empty."""

    to: Node
    drain: int
    attached_us: int


class LoneOutcome(NamedTuple):
    """The result of a decision: the steps until the next decision, and the state at that time.

    ``state`` is None after a crash, because this drone decides nothing more. The steps are then
    those until it is replaced, or until the crash if it is not.
    """

    steps: tuple[LoneStep, ...]
    state: LoneState | None


class DroneProcess:
    """The decisions of the one drone of a world, under the ceiling.

    Raises UsageError, with the key, if the scenario cannot be solved exactly, and ScenarioError if
    its model is not the paper's.
    """

    def __init__(self, world: World) -> None:
        refuse_other_models(world.scenario)
        refuse_what_is_random(world)
        refuse_walks(world)
        self.world = world
        self._actions = [kind_of(choice) for choice in world.actions]
        self.start: LoneState = ((*world.starts[0], 0), world.only_type.capacity)
        self._lone = LoneDrone(world)

    def allowed(self, state: LoneState) -> tuple[Action, ...]:
        """Return the allowed commands, without blocked moves, which are the same as hover."""
        self._lone.put(state)
        return tuple(
            action
            for action, allowed in zip(self._actions, self._lone.state.masks, strict=True)
            if allowed and (action not in MOVES or self.neighbour(state[0], action) != state[0])
        )

    def neighbour(self, node: Node, action: Action) -> Node:
        """Return the place to which a move leads, which is the same place if it is blocked."""
        world = self._lone.constants
        move = world.moves[self._actions.index(action)]
        there = (node[0] + move.dx, node[1] + move.dy, node[2] + move.dlevel)
        return there if can_enter(world, self._lone.drone, *there) else node

    def arrival(self, state: LoneState) -> float:
        """Return the reward of a step of serving flight that ends in a state."""
        return self._lone.reward(state)

    def outcome(self, state: LoneState, action: Action) -> LoneOutcome:
        """Return the result of ``action``, which must be allowed."""
        return LoneOutcome(*self._lone.run(state, action))

    def flight(self, node: Node, action: Action) -> LoneFlight:
        """Return the result of a move or a hover that begins with a full battery.

        If the battery does not outlast the step, ``drain`` is all of it.
        """
        full = self.world.only_type.capacity
        steps, state = self.outcome((node, full), action)
        there, left_us = state or (node, 0)
        return LoneFlight(there, full - left_us, steps[0].attached_us)


def refuse_what_is_random(world: World) -> None:
    """Raise UsageError, with the key, unless there is one drone and nothing random but crashes."""
    scenario = world.scenario
    admission = scenario.fleet[0].admission
    only = "the best policy can be computed only"
    if scenario.drone_count > 1:
        raise UsageError(f"drones.count: {only} for one drone, not for {scenario.drone_count}")
    if scenario.position_noise is not None:
        raise UsageError(f"position_noise: {only} without position noise (null)")
    if getattr(scenario.reward, "keeps_credit", False):
        raise UsageError(
            f"reward.kind: {only} for a reward of what there is when a step ends, not for "
            f"{kind_name(scenario.reward)!r}, which pays for what happens during the step"
        )
    if type(scenario.reward) in NO_REQUESTS:
        return
    for key, demand, _ in scenario.asking:
        if type(demand) is not Continuous:
            raise UsageError(
                f"{'.'.join(map(str, key))}.kind: {only} with continuous demand, not "
                f"{kind_name(demand)!r}, unless the reward is coverage or coverage_battery"
            )
    if type(admission) is not FirstCome:
        raise UsageError(f"drones.admission: {only} with first_come, not {kind_name(admission)!r}")
