"""Successive episodes of one scenario: the common basis of all environments."""

from __future__ import annotations

import operator
import secrets
from collections.abc import Callable, Iterable, Mapping
from itertools import repeat
from typing import Any

import numpy as np
from gymnasium import error
from numpy.typing import NDArray

from desim_uav.copies import Independent
from desim_uav.engine.base import COUNTS, MEASURES, Engine, RunSettings
from desim_uav.engine.constants import term_names
from desim_uav.engine.des import Simulation
from desim_uav.env.configure import Source, configured
from desim_uav.model.rules import US
from desim_uav.model.state import Snapshot
from desim_uav.sample_path import SamplePath, SamplePaths, at_once, draw_all
from desim_uav.scenario.schema import Scenario
from desim_uav.spaces import flat_mask
from desim_uav.world import World, build_world

SEEDS = 2**63


class ActionError(error.InvalidAction, ValueError):
    """An action is outside the action space. A masked action is inside it, so it is no error."""


class Session(Independent):
    """A scenario that is simulated one decision epoch at a time.

    ``seed`` is the seed of the run. It also draws the world, unless the scenario has a
    ``world_seed``. ``episode`` counts from 0; it is -1 before the first ``reset``. ``blank`` holds
    every key of an info in its order, with the values that do not change in an episode.
    """

    world: World
    engine: Engine

    def __init__(
        self,
        scenario: Source,
        config: Mapping[str, Any] | None = None,
        worlds: Callable[[Scenario, int], World] = build_world,
        starts: bool = True,
        ahead: bool = True,
    ) -> None:
        """Begin with the scenario's own seed if it has one, else with a random seed.

        ``worlds`` builds the world of a seed, at once or (``starts``) before the first episode.
        ``ahead``: several episodes are drawn at once, which is faster than one by one but takes
        more memory. Raises ScenarioError, and UsageError for a ``config`` of another form.
        """
        self.scenario = configured(scenario, config)
        self._world_of = worlds
        self.encode = self.scenario.observation.encode
        self._drones = self.scenario.drones.count
        given = "seed" in self.scenario.model_fields_set
        self.seed = self.scenario.seed if given else secrets.randbits(32)
        self.episode = -1
        self._shown: Snapshot | None = None
        self._paths: SamplePaths | None = None
        self._started = False
        self._ahead = ahead
        if starts:
            self._start_over(self.seed)

    def _start_over(self, seed: int) -> None:
        """Begin a new run."""
        scenario = self.scenario
        fixed = scenario.world_seed
        self.world = self._world_of(scenario, seed if fixed is None else fixed)
        ceilings = (True,) * scenario.drones.count
        settings = RunSettings(ceilings, scenario.episode.carry_over, keep_steps=False)
        self.engine = self._engine_of(settings)
        self._commands = frozenset(range(len(self.world.actions)))
        self.seed, self.episode = seed, -1
        self._shown = None
        self._started = True
        self._paths = None

    def _engine_of(self, settings: RunSettings) -> Engine:
        return Simulation(self.world, settings)

    def __getstate__(self) -> dict[str, Any]:
        """Return everything except the sample paths of later episodes, which a copy draws again."""
        return {**vars(self), "_paths": None}

    @property
    def shown(self) -> Snapshot:
        """The snapshot at the present epoch. Raises ResetNeeded before the first episode."""
        if self._shown is None:
            raise error.ResetNeeded("call reset first: no episode has begun")
        return self._shown

    def reset(self, seed: int | None = None) -> Snapshot:
        """Begin the next episode; with a ``seed``, the first episode of a new run.

        If the scenario says so, drones continue from where the previous episode left them, unless
        that episode was ended early. Raises gymnasium's Error for a seed outside 0 … 2**63 - 1.
        """
        path = self._next_path(seed)
        shown = self.engine.reset(path)
        terms = self._term_names(shown)
        self.term_keys = {name: f"reward_{name}" for name in terms}
        self.blank: dict[str, Any] = {
            **dict.fromkeys(MEASURES, 0.0),
            "seed": self.seed,
            "world_seed": self.world.seed,
            "episode_number": self.episode,
            **dict.fromkeys((*COUNTS, *self.term_keys.values()), 0),
        }
        self._no_terms = (dict.fromkeys(terms, 0.0),) * len(shown.observations)
        self._shown = shown
        return shown

    def _term_names(self, shown: Snapshot) -> tuple[str, ...]:
        """Return the names of the reward's terms."""
        reward, facts = self.scenario.reward, self.world.facts
        if names := term_names(self.world):
            return names
        return tuple(reward.terms(shown.observations[0], shown.open_requests, facts))

    def _next_path(self, seed: int | None) -> SamplePath:
        """Return the sample path of the next episode, or of the first of a new run."""
        if seed is not None:
            self._start_over(_checked(seed))
        elif not self._started:
            self._start_over(self.seed)
        self.episode += 1
        paths = self._paths
        if paths is None:
            so_far = self.episode + 1  # who plays on for long, looks far ahead
            count = min(so_far, at_once(self.world)) if self._ahead else 1
            numbers = range(self.episode, self.episode + count)
            paths = self._paths = draw_all(self.world, self.seed, numbers)
        if self.episode == paths.episodes[-1]:
            self._paths = None
        return paths[self.episode - paths.episodes[0]]

    def step(self, actions: Iterable[Any]) -> Snapshot:
        """Give each drone its action and run to the next decision epoch.

        Raises ResetNeeded outside an episode, and ActionError for an invalid action.
        """
        shown = self.shown
        if shown.terminated or shown.truncated:
            raise error.ResetNeeded("call reset first: the episode is over")
        shown = self._shown = self.engine.step(self.commands(actions))
        return shown

    def commands(self, actions: Iterable[Any]) -> list[int]:
        """Return actions as a list of commands, in the order of the drones."""
        commands = []
        try:
            for action in actions:
                commands.append(operator.index(action))
        except TypeError as problem:
            raise ActionError(f"actions must be whole numbers, not {actions!r}") from problem
        if len(commands) != self._drones:
            raise ActionError(f"there are {len(commands)} action(s) for {self._drones} drone(s)")
        if not self._commands.issuperset(commands):
            drone = next(d for d, command in enumerate(commands) if command not in self._commands)
            last = len(self._commands) - 1
            raise ActionError(f"drone {drone}: action {commands[drone]} is not one of 0 … {last}")
        return commands

    # ---- what is told at a decision epoch

    def encoded(self, shown: Snapshot) -> list[tuple[float, ...]]:
        """Return the observation of each drone, encoded as numbers."""
        return list(map(self.encode, shown.observations, repeat(self.world.facts)))

    def action_masks(self) -> NDArray[np.bool_]:
        """Return the masks of all drones, one after the other: bool (drones * actions,)."""
        return flat_mask(self.shown.masks).view(np.bool_)

    def info(self, shown: Snapshot) -> dict[str, Any]:
        """Return the info: time, quality of experience so far, seeds, and counts of requests.

        A measure that does not exist yet is 0: QoE1 and QoE2, which are means over requests, while
        ``requests`` is 0, and QoE3, a mean over time, while ``sim_time_s`` is 0. No key is
        "episode", which Gymnasium and stable-baselines3 keep for their statistics.
        """
        qoe1, qoe2, qoe3 = self.engine.measures()
        info = self.blank.copy()
        info["sim_time_s"] = shown.t_us / US
        info["qoe1_percent"] = 0.0 if qoe1 is None else qoe1
        info["qoe2_iterations"] = 0.0 if qoe2 is None else qoe2
        info["qoe3_percent"] = 0.0 if qoe3 is None else qoe3
        info["requests"] = self.engine.requests_made()
        return info

    def terms(self, shown: Snapshot) -> tuple[dict[str, float], ...]:
        """Return the terms of each drone's reward by name; they are 0 before the first step."""
        return shown.reward_terms or self._no_terms


def _checked(seed: int) -> int:
    if not 0 <= operator.index(seed) < SEEDS:
        raise error.Error(f"seed {seed}: must be a whole number from 0 to 2**63 - 1")
    return operator.index(seed)
