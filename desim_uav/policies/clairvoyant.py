"""The search that knows the sample path: it shows what is possible with this knowledge."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from desim_uav.commands.given import Command
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.rules import DECIDES
from desim_uav.model.state import Observation, Snapshot
from desim_uav.policies.planning.options import Option, options_of
from desim_uav.registry import register
from desim_uav.world import World

if TYPE_CHECKING:
    from desim_uav.engine.episode import Engine
    from desim_uav.policies.planning.ground import Ground
    from desim_uav.policies.planning.sight import PlanningSight

OPTIONS = {"tries": Option(100, 0, 1_000_000), "qoe1": Option(0.5, 0.0, 1.0)}

HORIZON = 40
"""The number of steps for which drones plan; the next episode, of which nothing is known, counts
in it as it does for ``greedy``."""


FADE, ROUNDS = 5.0, 2
"""See ``Greedy``, whose defaults these are."""

STARTS = ((False, 1.0), (True, 0.0), (True, 1.0), (True, 4.0))
"""How the episode is played first: whether with the future, and how much open requests count."""


@register("policy", "clairvoyant")
class Clairvoyant:
    """Searches each episode, whose future it knows, for good commands: not a competitor.

    Its result is a lower bound of the optimum with knowledge of the future. At the beginning of an
    episode it simulates the episode with the method of ``greedy``: once with the expected positions
    of users, and three times with their true positions. Starting from the best of these, it tries
    ``tries`` changes, each of one command of one drone, after which all drones plan anew or, every
    second time, continue as before. It keeps a change if this raises the mean of QoE1 (with the
    weight ``qoe1``) and QoE3 at the end of the episode.
    """

    ceiling = True
    clairvoyant = True
    information = "the future: all walks and requests of the episode; not a competitor"

    def __init__(self, options: str = "", **settings: float) -> None:
        """Take options as text (``tries=1000``) or by their names. Raises ValueError."""
        self.options = options_of("clairvoyant", options, settings, OPTIONS)
        self.name = f"clairvoyant:{options}" if options else "clairvoyant"
        self._grounds: tuple[Ground, ...] = ()

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Make the engine of the search. Raises PolicyError if it cannot run the scenario."""
        from desim_uav.policies.planning.ground import grounds_of
        from desim_uav.policies.planning.inner import inner_engine
        from desim_uav.policies.planning.team import Habits, horizon_of

        if not self._grounds or self._grounds[0].world is not world:
            self._grounds = grounds_of(world)
            self._inner = inner_engine("clairvoyant", world, world.scenario.episode.carry_over)
        horizon_of(self._grounds, Habits(HORIZON, 0.0, FADE, ROUNDS))
        self._rng = Streams(streams.seed, Purpose.PLANNER, streams.episode).generator(0)

    def watch(self, engine: Engine) -> None:
        """Search the rest of the episode for its commands."""
        from desim_uav.policies.planning.team import Habits

        self._engine, self._path = engine, engine.drawn
        self._inner.take(engine.save())
        self._epochs: list[Any] = []
        self._commands: list[list[Command]] = []
        self._value = 0.0
        snapshot = self._inner.restore(self._inner.save())
        self._first = snapshot.step
        for self._knows, waiting in STARTS:
            self._habits = Habits(HORIZON, waiting, FADE, ROUNDS)
            self._play(snapshot, [], [])
            snapshot = self._inner.restore(self._epochs[0][0])
        for _ in range(self.options["tries"]):
            self._try()

    def act(self, observation: Observation, mask: Sequence[bool]) -> Command:
        """Return the command that was found for this decision epoch and drone."""
        return self._commands[int(self._engine.state.step) - self._first][observation.drone]

    def _walked(self, sight: PlanningSight, now_us: int) -> Any:
        """Return the users' places in all ticks that are left: (ticks, users, 2)."""
        import numpy as np

        from desim_uav.model.geometry.coverage import all_walked

        tick_us = self._grounds[0].tick_us
        times_us = range(now_us, now_us + sight.left * tick_us, tick_us)
        return np.array([all_walked(*self._path.walks, t_us) for t_us in times_us])

    def _play(
        self, snapshot: Snapshot, first: list[list[Command]], then: list[list[Command]]
    ) -> float:
        """Play to the end of the episode by plans, and return the score.

        ``first`` are the commands of the next epochs, ``then`` those of the epochs after that, to
        which drones keep as far as they are allowed. If it is the best so far, it is kept.
        """
        from desim_uav.policies.planning.inner import score

        script, epochs, plans = [*first, *then], [], ((), snapshot.t_us)
        begins, commands = snapshot.step - self._first, []
        while not (snapshot.terminated or snapshot.truncated):
            epochs.append((self._inner.save(), snapshot))
            step = snapshot.step - self._first - begins
            if step < len(script):
                choices = script[step]
            else:
                choices, plans = self._planned(snapshot, plans)
            commands.append(choices)
            snapshot = self._inner.step(choices)
        value = score(self._inner, self.options["qoe1"], charged=False) + self._later(snapshot)
        if not self._commands or value > self._value:
            self._value = value
            self._commands[begins:] = commands
            self._epochs[begins:] = epochs
        return self._value

    def _later(self, snapshot: Snapshot) -> float:
        """Return what the drones' places and batteries are worth at the end of the episode.

        It is what they cover by plans for the steps after it, in percent of the users for the time
        of an episode. Without carry-over it is nothing.
        """
        from desim_uav.policies.planning.sight import look
        from desim_uav.policies.planning.team import TeamPlanner

        world = self._grounds[0].world
        if not world.scenario.episode.carry_over or snapshot.terminated:
            return 0.0
        team = TeamPlanner(
            self._grounds, look(self._inner, self._grounds, snapshot.observations), self._habits
        )
        team.improve(self._habits.rounds)
        lasts = world.scenario.episode.steps * (world.step_us / self._grounds[0].tick_us)
        share = team.covered() / (len(world.homes) * lasts)
        weight: float = 1.0 - self.options["qoe1"]
        return weight * 100.0 * share

    def _planned(self, snapshot: Snapshot, before: Any) -> tuple[list[Command], Any]:
        """Return the commands of plans for the true places of users, and these plans."""
        from desim_uav.policies.planning.sight import look
        from desim_uav.policies.planning.team import TeamPlanner, commands_of

        sight = look(self._inner, self._grounds, snapshot.observations)
        if self._knows:
            sight = sight._replace(future_m=self._walked(sight, snapshot.t_us))
        team = TeamPlanner(self._grounds, sight, self._habits)
        (plans, made_us), now_us = before, snapshot.t_us
        team.begin_with(plans, round((now_us - made_us) / self._grounds[0].tick_us))
        team.improve(self._habits.rounds)
        commands = commands_of(
            self._grounds, self._inner, team.plans[:, 0], snapshot.observations, snapshot.masks
        )
        return commands, (team.plans, now_us)

    def _try(self) -> None:
        """Change one command of one drone at one step, and keep it if the episode is better."""
        step = int(self._rng.integers(len(self._epochs)))
        saved, snapshot = self._epochs[step]
        drone = int(self._rng.integers(len(snapshot.masks)))
        draw = int(self._rng.integers(2**30))
        keeps_on = bool(self._rng.integers(2))
        now = self._inner.restore(saved)
        flights, row = self._grounds[drone].flights, self._inner.drones[drone]
        allowed = flights.options(row, snapshot.masks[drone])
        command = allowed[draw % len(allowed)]
        choices = list(self._commands[step])
        if snapshot.observations[drone].mode not in DECIDES or command == choices[drone]:
            return
        choices[drone] = command
        then = self._commands[step + 1 :] if keeps_on else []
        self._play(now, [choices], then)
