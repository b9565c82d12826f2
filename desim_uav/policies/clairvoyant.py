"""The search that knows the sample path: it shows what is possible with this knowledge."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.rules import DECIDES
from desim_uav.model.state import Observation, Snapshot
from desim_uav.policies.planning.options import Option, options_of
from desim_uav.registry import register
from desim_uav.world import World

if TYPE_CHECKING:
    from desim_uav.engine.episode import Engine
    from desim_uav.policies.planning.ground import Ground
    from desim_uav.sample_path import SamplePath

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
        self._ground: Ground | None = None

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Make the engine of the search. Raises PolicyError if it cannot run the scenario."""
        from desim_uav.policies.planning.ground import ground_of
        from desim_uav.policies.planning.inner import inner_engine
        from desim_uav.policies.planning.team import Habits, horizon_of

        if self._ground is None or self._ground.world is not world:
            self._ground = ground_of(world)
            self._inner = inner_engine("clairvoyant", world, world.scenario.episode.carry_over)
        horizon_of(self._ground, Habits(HORIZON, 0.0, FADE, ROUNDS))
        self._rng = Streams(streams.seed, Purpose.PLANNER, streams.episode).generator(0)

    def watch(self, engine: Engine) -> None:
        """Search the rest of the episode for its commands."""
        from desim_uav.policies.planning.team import Habits

        self._places_m = self._walked(engine.drawn)
        self._inner.take(engine.save())
        self._epochs: list[Any] = []
        self._commands: list[list[int]] = []
        self._value = 0.0
        snapshot = self._inner.restore(self._inner.save())
        self._first = snapshot.step
        for self._knows, waiting in STARTS:
            self._habits = Habits(HORIZON, waiting, FADE, ROUNDS)
            self._play(snapshot, [], [])
            snapshot = self._inner.restore(self._epochs[0][0])
        for _ in range(self.options["tries"]):
            self._try()

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """Return the command that was found for this step and drone."""
        return self._commands[observation.step - self._first][observation.drone]

    def _walked(self, path: SamplePath) -> Any:
        """Return the users' places at all decision epochs: (steps + 1, users, 2)."""
        import numpy as np

        from desim_uav.model.geometry.coverage import all_walked

        assert self._ground is not None
        world = self._ground.world
        times_us = range(0, world.horizon_us + 1, world.step_us)
        return np.array([all_walked(*path.walks, t_us) for t_us in times_us])

    def _play(self, snapshot: Snapshot, first: list[list[int]], then: list[list[int]]) -> float:
        """Play to the end of the episode by plans, and return the score.

        ``first`` are the commands of the next steps, ``then`` those of the steps after that, to
        which drones keep as far as they are allowed. If it is the best so far, it is kept.
        """
        from desim_uav.policies.planning.inner import score

        script, epochs, plans = [*first, *then], [], ((), 0)
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

        assert self._ground is not None
        world = self._ground.world
        if not world.scenario.episode.carry_over or snapshot.terminated:
            return 0.0
        team = TeamPlanner(
            self._ground, look(self._inner, self._ground, snapshot.observations), self._habits
        )
        team.improve(self._habits.rounds)
        share = team.covered() / (len(world.homes) * world.scenario.episode.steps)
        weight: float = 1.0 - self.options["qoe1"]
        return weight * 100.0 * share

    def _planned(self, snapshot: Snapshot, before: Any) -> tuple[list[int], Any]:
        """Return the commands of plans for the true places of users, and these plans."""
        from desim_uav.policies.planning.sight import look
        from desim_uav.policies.planning.team import TeamPlanner, commands_of

        assert self._ground is not None
        sight = look(self._inner, self._ground, snapshot.observations)
        if self._knows:
            sight = sight._replace(future_m=self._places_m[snapshot.step : -1])
        team = TeamPlanner(self._ground, sight, self._habits)
        team.begin_with(*before)
        team.improve(self._habits.rounds)
        commands = commands_of(
            self._ground, team.plans[:, 0, 0], snapshot.observations, snapshot.masks
        )
        return commands, (team.plans, 1)

    def _try(self) -> None:
        """Change one command of one drone at one step, and keep it if the episode is better."""
        step = int(self._rng.integers(len(self._epochs)))
        saved, snapshot = self._epochs[step]
        drone = int(self._rng.integers(len(snapshot.masks)))
        draw = int(self._rng.integers(2**30))
        keeps_on = bool(self._rng.integers(2))
        allowed = [k for k, may in enumerate(snapshot.masks[drone]) if may]
        command = allowed[draw % len(allowed)]
        choices = list(self._commands[step])
        if snapshot.observations[drone].mode not in DECIDES or command == choices[drone]:
            return
        choices[drone] = command
        then = self._commands[step + 1 :] if keeps_on else []
        self._play(self._inner.restore(saved), [choices], then)
