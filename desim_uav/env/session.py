"""Successive episodes of one scenario: the common basis of all environments."""

from __future__ import annotations

import operator
import secrets
from collections.abc import Callable, Sequence
from functools import cache, cached_property
from itertools import chain
from typing import Any, TypeVar

import numpy as np
from gymnasium import error
from numpy.typing import NDArray

from desim_uav.commands.given import CommandError
from desim_uav.copies import Independent
from desim_uav.engine.base import COUNTS, MEASURES, OF_STEP, RunSettings
from desim_uav.engine.constants import term_names
from desim_uav.engine.des import Simulation
from desim_uav.engine.episode import Engine
from desim_uav.env.alone import OneThread
from desim_uav.env.tasks import Tasks
from desim_uav.model.decisions import discount_of
from desim_uav.model.rules import US
from desim_uav.model.state import Snapshot
from desim_uav.model.sums import in_order
from desim_uav.rules.whole_state import names_of
from desim_uav.sample_path import SamplePath, SamplePaths, at_once, draw_all
from desim_uav.spaces import features, flat_mask, observation_space, padded
from desim_uav.world import World

WHICH = ("seed", "world_seed", "episode_number", "compiled")
"""The names of what an info says of its episode: seeds, number, and whether it is compiled."""
MOST_SEEDS = 2**63

Read = TypeVar("Read")


class ActionError(error.InvalidAction, ValueError):
    """An action is outside the action space. A masked action is inside it, so it is no error."""


class Session(Independent):
    """A scenario that the SimPy engine simulates one decision epoch at a time.

    ``seed`` is the seed of the run. It also draws the world, unless the scenario has a
    ``world_seed``; ``tasks`` may give each episode another world, in which the drones begin afresh,
    or change the scenario. ``episode`` counts from 0; it is -1 before the first ``reset``, and
    ``steps`` counts the steps of earlier episodes. ``terms`` are the keys of the reward's terms in
    an info, by name. If ``chooses``, a session in the compiled engine may take its place between
    two episodes (see ``compiled.faster``).
    """

    world: World
    engine: Engine
    terms: dict[str, str]
    chooses: bool = False
    compiled = 0

    def __init__(self, tasks: Tasks, world: World | None = None, draws_ahead: bool = True) -> None:
        """Begin with the scenario's own seed if it has one, else with a random seed.

        With a ``world``, which may be of another seed, the run begins with the first ``reset``
        only, and keeps this world if its seed is the right one. ``draws_ahead``: several episodes
        are drawn at once, which is faster than one by one but takes more memory. Raises
        ScenarioError if the engine cannot run the scenario.
        """
        self.tasks, self.guard = tasks, OneThread()
        self.scenario = scenario = tasks.stages[0][1]
        self.drones = scenario.drone_count
        has_seed = "seed" in scenario.model_fields_set
        self.seed = scenario.seed if has_seed else secrets.randbits(32)
        self.episode, self.steps = -1, 0
        self._stage = 0
        self._over = True
        self._draws_ahead = draws_ahead and tasks.worlds is None
        self._paths: SamplePaths | None = None
        self._started = False
        if world is None:
            self.start(self.seed)
        else:
            self.world = world

    def start(self, seed: int | None) -> bool:
        """Prepare the next episode: its scenario, its world, and an engine for them.

        With a ``seed``, or if no run has begun, a new run begins. Returns whether the engine may
        have moved in memory.
        """
        if seed is not None or not self._started:
            self.seed = self.seed if seed is None else _checked(seed)
            self.episode, self.steps, self._paths = -1, 0, None
            if self._started:
                self.engine.carry(None)
        elif self.episode >= 0:
            self.steps += int(self.engine.state.step)
        stage = self.tasks.stage(self.episode + 1, self.steps)
        world_seed = self.tasks.world_seed(stage, self.seed, self.episode + 1)
        if self._started and (stage, world_seed) == (self._stage, self.world.seed):
            return False
        world: World | None = vars(self).get("world") if stage == 0 and not self._started else None
        if world is None or world.seed != world_seed:
            world = self.tasks.world(stage, world_seed)
        self.enter(stage, world)
        return True

    def enter(self, stage: int, world: World) -> None:
        """Go to a world of a stage, in which the drones begin at their starts, with an engine."""
        self.world = world
        self._stage, self.scenario, self._paths = stage, self.tasks.stages[stage][1], None
        ceilings = (True,) * self.drones
        carry_over = self.scenario.episode.carry_over and self.tasks.worlds is None
        self.engine = self._new_engine(RunSettings(ceilings, carry_over, keep_steps=False))
        self._started = True

    def _new_engine(self, settings: RunSettings) -> Engine:
        return Simulation(self.world, settings)

    def __getstate__(self) -> dict[str, Any]:
        """Return everything except the sample paths of later episodes, which a copy draws again."""
        return {**vars(self), "_paths": None}

    # ---- saved states (see ``env.saving``)

    @property
    def started(self) -> bool:
        """Whether there is an engine, in the world of the run."""
        return self._started

    @property
    def stage(self) -> int:
        """The index of the stage of the tasks that applies."""
        return self._stage

    def go_on_from(self, seed: int, episode: int, steps: int) -> None:
        """Continue an episode, in whose state the engine has been put, in the run of a seed.

        ``steps`` counts the steps of earlier episodes of the run.
        """
        self.seed, self.episode, self.steps, self._paths = seed, episode, steps, None
        self._over = self.engine.terminated or self.engine.truncated
        self._resume()

    def _resume(self) -> None:
        self._show(self.engine.latest or self.engine.snapshot(), self.episode)

    # ---- episodes and steps

    def reset(self, seed: int | None = None) -> None:
        """Begin the next episode; with a ``seed``, the first episode of a new run.

        If the scenario says so, drones continue from where the previous episode left them, unless
        that episode was ended early. Raises gymnasium's Error for a seed outside 0 … 2**63 - 1.
        """
        self.start(seed)
        self._begin(self._path(self.episode + 1))
        self.episode += 1
        self._over = False

    def _path(self, episode: int) -> SamplePath:
        """Return the sample path of the next episode, which is drawn with some later ones."""
        if self._paths is None:
            so_far = episode + 1  # the longer a run, the more paths are drawn ahead
            count = min(so_far, at_once(self.world)) if self._draws_ahead else 1
            self._paths = draw_all(self.world, self.seed, range(episode, episode + count))
        paths = self._paths
        if episode == paths.episodes[-1]:
            self._paths = None
        return paths[episode - paths.episodes[0]]

    def which(self, episode: int) -> tuple[int, int, int, int]:
        """Return the values of WHICH for an episode of this run."""
        return self.seed, self.world.seed, episode, self.compiled

    def _begin(self, path: SamplePath) -> None:
        """Begin an episode on its sample path, and an info for its steps."""
        self._show(self.engine.reset(path), path.episode)

    def _show(self, snapshot: Snapshot, episode: int) -> None:
        """Begin the infos of an episode with a snapshot."""
        self._snapshot = snapshot
        first, requests = snapshot.observations[0], snapshot.open_requests
        facts = self.world.facts_of(0)
        names = term_names(self.world) or self.scenario.reward.terms(first, requests, facts)
        self.terms = {name: f"reward_{name}" for name in names}
        self._blank: dict[str, Any] = dict.fromkeys(info_keys(tuple(names)), 0)
        self._blank |= zip(WHICH, self.which(episode), strict=True)

    def step(self, action: object) -> tuple[float, bool, bool]:
        """Give each drone its action and run to the next decision epoch.

        ``action``: one whole number per drone; for a single drone it is that number. In free
        flight, it is the numbers of the drones' commands, one after the other. If some drones fly
        freely and others from cell to cell, it is what ``Commands.joined`` returns. Returns the
        mean reward, and whether a crash or the end of its time ended the episode. Raises
        ResetNeeded outside an episode, and ActionError for an invalid action.
        """
        if self._over:
            self.require_episode()
            raise error.ResetNeeded("call reset first: the episode is over")
        reward, terminated, truncated = self._step(action)
        self._over = terminated or truncated
        return reward, terminated, truncated

    def _step(self, action: object) -> tuple[float, bool, bool]:
        commands: Any = as_commands(self.world.commands.split, action)
        snapshot = self._snapshot = self.engine.step(commands)
        return in_order(snapshot.rewards) / self.drones, snapshot.terminated, snapshot.truncated

    # ---- the outputs of a decision epoch

    def require_episode(self) -> None:
        """Raise ResetNeeded before the first episode."""
        if self.episode < 0:
            raise error.ResetNeeded("call reset first: no episode has begun")

    @property
    def snapshot(self) -> Snapshot:
        """The snapshot at the present epoch. Raises ResetNeeded before the first episode."""
        self.require_episode()
        return self._snapshot

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """int64 if all features of an observation are whole numbers, else float32."""
        return observation_space(features(self.world)).dtype

    def encoded(self) -> list[tuple[float, ...]]:
        """Return the observation of each drone, encoded as numbers (see ``spaces.features``)."""
        encode, world = self.scenario.observation.encode, self.world
        return padded(
            world, (encode(o, world.facts_of(o.drone)) for o in self._snapshot.observations)
        )

    def observation(self) -> NDArray[Any]:
        """Return the encoded observations of all drones, one after the other."""
        return np.array(list(chain.from_iterable(self.encoded())), self.dtype)

    def observations(self) -> NDArray[Any]:
        """Return the encoded observation of each drone, in a new array (drones, features)."""
        return np.array(self.encoded(), self.dtype)

    def rewards(self) -> Sequence[float]:
        """Return the reward of each drone in the last step."""
        return self._snapshot.rewards

    @cached_property
    def state_names(self) -> list[str]:
        """The names of the numbers of a state (see ``rules.whole_state``)."""
        return names_of(self.drones, self.world.services.names, self.world.grid.cells)

    def state(self) -> NDArray[np.float32]:
        """Return the whole state, float32 (see ``rules.whole_state``).

        Raises ResetNeeded before the first episode.
        """
        self.require_episode()
        return self._whole_state().astype(np.float32)

    def _whole_state(self) -> NDArray[np.float64]:
        return self.engine.whole_state()

    def mask(self) -> NDArray[np.int8]:
        """Return the masks of all drones, one after the other, in a new array."""
        return flat_mask(self._snapshot.masks)

    def action_masks(self) -> NDArray[np.bool_]:
        """Return the masks of all drones as bool. Raises ResetNeeded before the first episode."""
        self.require_episode()
        return self.mask().view(np.bool_)

    def reward_terms(self) -> tuple[dict[str, float], ...]:
        """Return the terms of each drone's reward by name; they are 0 before the first step."""
        return self._snapshot.reward_terms or (dict.fromkeys(self.terms, 0.0),) * self.drones

    def info_of_all(self) -> dict[str, Any]:
        """Return an info in which the counts and the reward terms of single drones are still 0."""
        qoe1, qoe2, qoe3 = self.engine.measures()
        info = self._blank.copy()
        info["sim_time_s"] = self._snapshot.t_us / US
        info["qoe1_percent"] = qoe1 or 0.0
        info["qoe2_iterations"] = qoe2 or 0.0
        info["qoe3_percent"] = qoe3 or 0.0
        info["requests"] = self.engine.requests_made()
        steps = self.engine.state.share if self._snapshot.step > 0 else 0.0
        info["duration_steps"] = steps
        info["discount"] = discount_of(self.scenario.learning.gamma, steps)
        return info

    def info(self) -> dict[str, Any]:
        """Return the info: time, quality of experience so far, seeds, counts, terms, and masks.

        The terms of the reward are means over the drones, and counts are over all of them. If at
        least one drone has a choice, ``forced`` is 0, and ``elapsed_steps`` counts the steps since
        the last earlier decision epoch at which it was 0 (see ``rules.rows.Observation``).
        ``duration_steps`` is the time that the last step lasted, in steps, and ``discount`` the
        scenario's ``learning.gamma`` to this power; they are 0 and 1 before the first step.
        ``compiled`` is 1 if the compiled engine plays the episode, and 0 if SimPy does. A
        measure that does not exist yet is 0: QoE1 and QoE2, which are means over requests, while
        ``requests`` is 0, and QoE3, a mean over time, while ``sim_time_s`` is 0. No key is
        "episode", which Gymnasium and stable-baselines3 keep for their statistics.
        """
        info, drones = self.info_of_all(), self.reward_terms()
        each = self.engine.entries("observations")
        info["attached_users"] = sum(one.attached_users for one in each)
        info["crashes"] = self.engine.log.crashes
        info["elapsed_steps"] = self._steps(min(one.elapsed_us for one in each))
        info["forced"] = min(int(one.forced) for one in each)
        for name, key in self.terms.items():
            info[key] = in_order([float(terms[name]) for terms in drones]) / self.drones
        info["action_mask"] = self.mask()
        return info

    def _steps(self, time_us: int) -> float:
        """Return a time in steps: a whole number, unless drones are asked by event."""
        steps = int(time_us) / self.world.step_us
        return steps if self.world.by_event else int(steps)

    def infos(self) -> list[dict[str, Any]]:
        """Return the info of each drone: the counts OWN_COUNTS and the terms are its own.

        The masks are not in it.
        """
        of_all, crashed, infos = self.info_of_all(), self.engine.log.crashed, []
        each, keys = self.engine.entries("observations"), self.terms.items()
        for drone, own in enumerate(self.reward_terms()):
            info, one = of_all.copy(), each[drone]
            info["attached_users"] = int(one.attached_users)
            info["crashes"] = crashed.count(drone)
            info["elapsed_steps"], info["forced"] = self._steps(one.elapsed_us), int(one.forced)
            for name, key in keys:
                info[key] = float(own[name])
            infos.append(info)
        return infos


@cache
def info_keys(terms: tuple[str, ...]) -> tuple[str, ...]:
    """Return the keys of an info in their order; ``terms`` are those of the reward."""
    return *MEASURES, *WHICH, *COUNTS, *OF_STEP, *(f"reward_{name}" for name in terms)


def _checked(seed: int) -> int:
    try:
        number = operator.index(seed)
    except TypeError:
        number = -1
    if not 0 <= number < MOST_SEEDS:
        raise error.Error(f"seed {seed!r}: must be a whole number from 0 to 2**63 - 1")
    return number


def as_commands(read: Callable[..., Read], *actions: Any) -> Read:
    """Return what a function makes of given actions. Raises ActionError if they are not such."""
    try:
        return read(*actions)
    except CommandError as problem:
        raise ActionError(str(problem)) from problem
