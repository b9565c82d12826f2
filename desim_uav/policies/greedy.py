"""The planner that knows where all users are now, and covers as many as batteries allow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from desim_uav.commands.given import Command
from desim_uav.model.random.streams import Streams
from desim_uav.model.state import Observation
from desim_uav.policies.planning.options import Option, options_of
from desim_uav.registry import register
from desim_uav.world import World

if TYPE_CHECKING:
    from desim_uav.engine.episode import Engine
    from desim_uav.policies.planning.ground import Ground
    from desim_uav.policies.planning.sight import PlanningSight

OPTIONS = {
    "horizon": Option(40, 1, 1000),
    "waiting": Option(1.0, 0.0, 1000.0),
    "fade": Option(5.0, 0.01, 1e6),
    "rounds": Option(2, 1, 100),
    "every": Option(1, 1, 1000),
    "age": Option(1.0, 0.0, 1000.0),
    "discount": Option(0.0, 0.0, 10.0),
    "share": Option(1.0, 0.0, 2.0),
    "charge": Option(1.0, 0.0, 10.0),
    "spread": Option(1.0, 0.0, 10.0),
    "margin": Option(0.0, -0.9, 1.0),
    "starts": Option(1, 1, 100),
}

BEYOND = 8
"""The steps after the end of a simulation for which plans in it are made."""


@register("policy", "greedy")
class Greedy:
    """Plans drone after drone; each covers as many users as it can whom the others do not cover.

    A plan is made for ``horizon`` steps, in which users are expected to walk away from where they
    are now. An open request, or each update in the buffer of a sensor, adds ``waiting`` to the
    weight 1 of a user; the addition decreases by a factor e in ``fade`` steps. A task adds it only
    while it waits for a link, and its result only for the drone that has it. A sensor's weight is
    larger by ``age`` times its age over the mean age of all sensors. All drones revise their plans
    up to ``rounds`` times. New plans are made after ``every`` decision epochs, and when a drone is
    not where its plan says. If drones decide by event, ``every`` counts the shortest times between
    two commands instead.

    Each type of drones has places, moves, footprints and batteries of its own (``Ground``). Drones
    that fly freely plan over a lattice of points, and charge by returns.

    With several ``starts``, plans are also made from nothing, and those worth most are kept. All
    weights fall at the rate ``discount`` per step. The cover by another drone takes the ``share``
    of a user's weight. ``charge``, ``spread`` and 1 + ``margin`` are factors of the worth of the
    charge that is left, of the error of users' expected places, and of the radii of footprints.

    Plans contain when and where drones charge, and no plan lets a battery run empty.
    """

    ceiling = True
    information = "all users and drones now: places, open requests, batteries; no future"

    def __init__(self, options: str = "", **settings: float) -> None:
        """Take options as text (``horizon=20+waiting=2``) or by their names.

        Raises ValueError for an unknown option or a bad value.
        """
        self.options = options_of("greedy", options, settings, OPTIONS)
        self.name = f"greedy:{options}" if options else "greedy"
        self._engine: Engine | None = None
        self._grounds: tuple[Ground, ...] = ()
        self._plans: Any = ()
        self._made_us, self._stale = 0, False

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Make the maps of the world. Raises PolicyError if the scenario is too large."""
        from desim_uav.policies.planning.ground import grounds_of
        from desim_uav.policies.planning.team import Habits, horizon_of

        self._habits = Habits(*(self.options[name] for name in Habits._fields))
        if not self._grounds or self._grounds[0].world is not world:
            self._grounds = grounds_of(world)
        horizon_of(self._grounds, self._habits)
        self.forget()

    def watch(self, engine: Engine) -> None:
        """Take the engine of the episode; its sample path is not looked at."""
        self._engine = engine

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """Raise TypeError: all drones are commanded at once (see ``act_jointly``)."""
        raise TypeError("greedy commands all drones at once; call act_jointly")

    def act_jointly(
        self, observations: Sequence[Observation], masks: Sequence[Sequence[bool]]
    ) -> list[Command]:
        """Return the first action of each drone's plan, or the action that is forced."""
        from desim_uav.policies.planning.sight import look
        from desim_uav.policies.planning.team import TeamPlanner, commands_of

        if self._engine is None or not self._grounds:
            raise RuntimeError("greedy needs the engine; call begin and watch first")
        sight = look(self._engine, self._grounds, observations)
        now_us = int(self._engine.state.now_us)
        age = round((now_us - self._made_us) / self._grounds[0].tick_us)
        if not self._may_follow(sight, age):
            team = TeamPlanner(self._grounds, sight, self._habits)
            team.begin_with(self._plans, age)
            team.improve(self._habits.rounds)
            self._plans, self._made_us, self._stale, age = team.plans, now_us, False, 0
        plans = self._plans[:, age]
        return commands_of(self._grounds, self._engine, plans, observations, masks)

    def _may_follow(self, sight: PlanningSight, age: int) -> bool:
        """Return whether all drones that decide are where their plans say, if these are to last."""
        if self._stale or len(self._plans) == 0:
            return False
        if age >= min(self.options["every"], self._plans.shape[1]):
            return False
        now = self._plans[:, age]
        return all(
            one.ready > 0 or (now[d, 0] >= 0 and now[d, 1:].tolist() == [one.place, 0])
            for d, one in enumerate(sight.drones)
        )

    def memory(self) -> dict[str, Any]:
        """Return the present plans and when they were made, in microseconds."""
        return {"plans": [plan.tolist() for plan in self._plans], "made_us": self._made_us}

    def remember(self, memory: dict[str, Any]) -> None:
        """Go on with plans that ``memory`` has returned."""
        self._plans = np.array(memory["plans"], np.int64) if memory["plans"] else ()
        self._made_us = memory["made_us"]

    def in_rollouts(self, horizon: int) -> Greedy:
        """Return a policy that does nearly the same in simulations, but plans once in each."""
        plans_for = min(self.options["horizon"], horizon + BEYOND)
        changes = {"horizon": plans_for, "every": horizon, "rounds": 1, "starts": 1}
        quick = Greedy(**{**self.options, **changes})
        quick._grounds = self._grounds
        return quick

    def forget(self) -> None:
        """Make plans anew at the next decision epoch, whatever was planned before."""
        self._plans, self._made_us = (), 0

    def think_like(self, other: Greedy) -> None:
        """Make plans anew at the next decision epoch, but begin with those of another planner."""
        self._plans, self._made_us = other._plans, other._made_us
        self._stale = True
