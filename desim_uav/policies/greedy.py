"""The planner that knows where all users are now, and covers as many as batteries allow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

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
    not where its plan says.

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
        self._ground: Ground | None = None
        self._plans: Any = ()
        self._age, self._stale = 0, False

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Make the map of the world. Raises PolicyError if the scenario is too large."""
        from desim_uav.policies.planning.ground import ground_of
        from desim_uav.policies.planning.team import Habits, horizon_of

        self._habits = Habits(*(self.options[name] for name in Habits._fields))
        if self._ground is None or self._ground.world is not world:
            self._ground = ground_of(world)
        horizon_of(self._ground, self._habits)
        self.forget()

    def watch(self, engine: Engine) -> None:
        """Take the engine of the episode; its sample path is not looked at."""
        self._engine = engine

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """Raise TypeError: all drones are commanded at once (see ``act_jointly``)."""
        raise TypeError("greedy commands all drones at once; call act_jointly")

    def act_jointly(
        self, observations: Sequence[Observation], masks: Sequence[Sequence[bool]]
    ) -> list[int]:
        """Return the first action of each drone's plan, or the action that is forced."""
        from desim_uav.policies.planning.sight import look
        from desim_uav.policies.planning.team import TeamPlanner, commands_of

        if self._engine is None or self._ground is None:
            raise RuntimeError("greedy needs the engine; call begin and watch first")
        sight = look(self._engine, self._ground, observations)
        if not self._may_follow(sight):
            team = TeamPlanner(self._ground, sight, self._habits)
            team.begin_with(self._plans, self._age)
            team.improve(self._habits.rounds)
            self._plans, self._age, self._stale = team.plans, 0, False
        age, self._age = self._age, self._age + 1
        return commands_of(self._ground, self._plans[:, age, 0], observations, masks)

    def _may_follow(self, sight: PlanningSight) -> bool:
        """Return whether all drones that decide are where their plans say, if these are to last."""
        if self._stale or len(self._plans) == 0:
            return False
        if self._age >= min(self.options["every"], self._plans.shape[1]):
            return False
        now = self._plans[:, self._age]
        return all(
            one.ready > 0 or (now[d, 0] >= 0 and now[d, 1] == one.place)
            for d, one in enumerate(sight.drones)
        )

    def memory(self) -> dict[str, Any]:
        """Return the present plans and their age."""
        return {"plans": [plan.tolist() for plan in self._plans], "age": self._age}

    def remember(self, memory: dict[str, Any]) -> None:
        """Go on with plans that ``memory`` has returned."""
        self._plans = np.array(memory["plans"], np.int64) if memory["plans"] else ()
        self._age = memory["age"]

    def in_rollouts(self, horizon: int) -> Greedy:
        """Return a policy that does nearly the same in simulations, but plans once in each."""
        plans_for = min(self.options["horizon"], horizon + BEYOND)
        changes = {"horizon": plans_for, "every": horizon, "rounds": 1}
        quick = Greedy(**{**self.options, **changes})
        quick._ground = self._ground
        return quick

    def forget(self) -> None:
        """Make plans anew at the next decision epoch, whatever was planned before."""
        self._plans, self._age = (), 0

    def think_like(self, other: Greedy) -> None:
        """Make plans anew at the next decision epoch, but begin with those of another planner."""
        self._plans, self._age = other._plans, other._age
        self._stale = True
