"""Training: a scenario's drones learn, each by itself, episode after episode."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.base import Carried, Engine, RunSettings
from desim_uav.engine.batch import BatchSimulation
from desim_uav.engine.des import Simulation
from desim_uav.errors import PolicyError, UsageError
from desim_uav.learning import fused
from desim_uav.learning.initial_q import initial_q
from desim_uav.learning.learner import Decision, Learner, load_algorithm
from desim_uav.model.observations import Feature, Position, table_row, table_sizes
from desim_uav.model.rules import DECIDES, Mode
from desim_uav.model.state import Observation, Snapshot
from desim_uav.model.streams import Purpose, Streams, uniforms
from desim_uav.sample_path import draw
from desim_uav.world import World

FIRST_PATH = 2**24
"""Training draws its sample paths from this number on: no run under the same seed meets them."""

LARGEST_TABLE = 2**29
DRAWS = 3


class Progress(NamedTuple):
    """One drone in one episode of a training (see ``records.TRAINING``)."""

    episode: int
    drone: int
    reward: float
    epsilon: float
    alpha: float
    mean_q: float
    qoe1_percent: float | None
    qoe2_iterations: float | None
    qoe3_percent: float | None
    crashes: int


class Memory(NamedTuple):
    """All that the rest of a training depends on, between two episodes.

    ``q`` (drones, tables, states, actions); ``pending`` holds for each drone the decision it still
    has to learn from, if any: state, action, what it has gained, and the discount so far.
    """

    episode: int
    q: NDArray[np.float32]
    pending: tuple[Decision | None, ...]
    carried: Carried | None


class Training:
    """Independent learners without communication, on one seed.

    Raises UsageError where a table cannot hold what the scenario's observation says.
    """

    def __init__(self, world: World, seed: int, engine: str = "des") -> None:
        scenario = world.scenario
        self.world = world
        self.seed = seed
        self.settings = scenario.learning
        algorithm = load_algorithm(self.settings.algorithm)
        self.features = table_features(world, algorithm.tables)
        self.sizes = table_sizes(self.features)
        self.episode = 0
        self.carries_over = scenario.episode.carry_over
        count = scenario.drones.count
        settings = RunSettings((True,) * count, self.carries_over, keep_steps=False)
        kind = BatchSimulation if engine == "batch" else Simulation
        self.engine: Engine = kind(world, settings)
        self.encode = scenario.observation.encode
        states, actions = math.prod(self.sizes), len(world.actions)
        self.q = np.empty((count, algorithm.tables, states, actions), np.float32)
        streams = Streams(seed, Purpose.LEARNER)
        for drone in range(count):
            rng = streams.generator(drone)
            for table in self.q[drone]:
                table[:] = initial_q(
                    self.settings.initial_q, self.features, world.actions, world.facts, rng
                )
        self.learners = [Learner(algorithm, self.settings.gamma, tables) for tables in self.q]
        self.fuses = (
            isinstance(self.engine, BatchSimulation)
            and self.settings.algorithm in fused.ALGORITHMS
            and type(scenario.observation) is Position
        )

    def play(self) -> list[Progress]:
        """Learn in the next episode; a row a drone."""
        self.epsilon = self.settings.epsilon.at(self.episode)
        self.alpha = self.settings.alpha.at(self.episode)
        if self.fuses:
            return self._play_fused()
        number = FIRST_PATH + self.episode
        shown = self.engine.reset(draw(self.world, self.seed, number))
        draws = self._draws(number)
        rewards = [0.0] * len(self.learners)
        while not (shown.terminated or shown.truncated):
            shown = self.engine.step(self._decide(shown, draws[shown.step]))
            for drone, reward in enumerate(shown.rewards):
                self.learners[drone].gain(reward)
                rewards[drone] += reward
        self.episode += 1
        if shown.terminated or not self._goes_on():
            self._close(shown, draws[shown.step])
            self.engine.carry(None)
        return self._progress(rewards)

    def _play_fused(self) -> list[Progress]:
        """The same without Python in between."""
        engine = self.engine
        assert isinstance(engine, BatchSimulation)
        number = FIRST_PATH + self.episode
        packed = engine.prepare(draw(self.world, self.seed, number))
        draws = self._drawn(number)
        waiting = [learner.open_decision() or (-1, -1, 0.0, 1.0) for learner in self.learners]
        pending = np.array([decision[:2] for decision in waiting], np.int64)
        due = np.array([decision[2:] for decision in waiting])
        rewards = np.zeros(len(waiting))
        self.episode += 1
        fused.play(
            engine.fixed,
            packed,
            engine.state,
            fused.ALGORITHMS.index(self.settings.algorithm),
            self.q,
            self._sizes(),
            self.epsilon,
            self.alpha,
            self.settings.gamma,
            draws,
            pending,
            due,
            not self._goes_on(),
            rewards,
            np.empty(len(waiting), np.int64),
            np.empty(len(self.world.actions), np.bool_),
        )
        engine.check()
        for learner, decision, worth in zip(self.learners, pending, due, strict=True):
            state, action = decision.tolist()
            learner.reopen(None if state < 0 else (state, action, *worth.tolist()))
        if engine.terminated or not self._goes_on():
            engine.carry(None)
        return self._progress(rewards.tolist())

    def _sizes(self) -> NDArray[np.int64]:
        """How many levels and minutes the paper's state has (0: it does not have them)."""
        sizes = {feature.name: int(feature.high) + 1 for feature in self.features}
        return np.array([sizes.get("level", 0), sizes.get("battery_min", 0)])

    def _goes_on(self) -> bool:
        """Will the next episode begin with the drones of this one?"""
        restart_every = self.settings.restart_every
        restarts = restart_every is not None and self.episode % restart_every == 0
        return self.carries_over and not restarts

    def remember(self) -> Memory:
        """All that the episodes to come depend on."""
        return Memory(
            self.episode,
            self.q.copy(),
            tuple(learner.open_decision() for learner in self.learners),
            self.engine.carried(),
        )

    def recall(self, memory: Memory) -> None:
        """Go on from what another training of the same world and seed remembers."""
        if memory.q.shape != self.q.shape or len(memory.pending) != len(self.learners):
            raise PolicyError(f"a table of shape {memory.q.shape}, not {self.q.shape}")
        states, actions = self.q.shape[2:]
        for decision in memory.pending:
            if decision is not None and not (
                0 <= decision[0] < states and 0 <= decision[1] < actions
            ):
                raise PolicyError(f"a decision {decision[:2]} that the table does not have")
        self.episode = memory.episode
        self.q[:] = memory.q
        for learner, decision in zip(self.learners, memory.pending, strict=True):
            learner.reopen(decision)
        self.engine.carry(memory.carried)

    def _decide(self, shown: Snapshot, draws: list[list[float]]) -> list[int]:
        """A command for each drone: its own where it decides, else the one it is forced to."""
        commands = []
        for learner, seen, mask, drawn in zip(
            self.learners, shown.observations, shown.masks, draws, strict=True
        ):
            if seen.mode in DECIDES:
                state = self._state(seen)
                commands.append(learner.act(state, mask, self.epsilon, self.alpha, drawn))
            else:
                commands.append(mask.index(True))
                if self._is_lost(seen):
                    learner.conclude(mask, self.alpha, drawn[-1])
        return commands

    def _is_lost(self, seen: Observation) -> bool:
        """Has this drone crashed for ever?"""
        return seen.mode is Mode.CRASHED and self.world.on_crash == "remove"

    def _close(self, shown: Snapshot, draws: list[list[float]]) -> None:
        """Learn from what an episode leaves open whose drones nobody carries over.

        A drone that decides is cut off where it is. Of one on its way home, on a pad or waiting to
        be replaced nobody knows what its decision will have been worth: nothing is learned from it.
        """
        for learner, seen, mask, drawn in zip(
            self.learners, shown.observations, shown.masks, draws, strict=True
        ):
            if shown.terminated or self._is_lost(seen):
                learner.conclude(mask, self.alpha, drawn[-1])
            elif seen.mode in DECIDES:
                learner.bootstrap(self._state(seen), mask, self.epsilon, self.alpha, drawn)
            else:
                learner.forget()

    def _state(self, seen: Observation) -> int:
        return table_row(self.encode(seen, self.world.facts), self.sizes)

    def _draws(self, number: int) -> list[list[list[float]]]:
        """What chance says at each decision epoch: (epochs, drones, 3), uniform in [0, 1)."""
        draws: list[list[list[float]]] = self._drawn(number).swapaxes(0, 1).tolist()
        return draws

    def _drawn(self, number: int) -> NDArray[np.float64]:
        """The same as an array: (drones, epochs, 3)."""
        count, epochs = len(self.learners), self.world.scenario.episode.steps + 1
        states = Streams(self.seed, Purpose.LEARNER, number).states(count)
        return uniforms(states, epochs * DRAWS).reshape(count, epochs, DRAWS)

    def _progress(self, rewards: list[float]) -> list[Progress]:
        measures = self.engine.measures()
        crashed = self.engine.log.crashed
        return [
            Progress(
                self.episode - 1,
                drone,
                reward,
                self.epsilon,
                self.alpha,
                float(self.q[drone].mean()),
                *measures,
                crashed.count(drone),
            )
            for drone, reward in enumerate(rewards)
        ]


def table_features(world: World, tables: int = 1) -> tuple[Feature, ...]:
    """The features of a scenario whose observations are states of a table. Raises UsageError.

    ``tables`` of a drone are held in memory at once.
    """
    features = world.scenario.observation.features(world.facts)
    kind = getattr(world.scenario.observation, "kind", "it")
    if not all(feature.whole and feature.low == 0 for feature in features):
        raise UsageError(
            f"observation: {kind!r} is not made of whole numbers from 0, which a table of values "
            "needs; use {kind: position}"
        )
    states = math.prod(table_sizes(features))
    entries = states * len(world.actions) * world.scenario.drones.count * tables
    if entries > LARGEST_TABLE:
        raise UsageError(
            f"observation: {states:,} states for {world.scenario.drones.count} drones make tables "
            f"of {entries * 4 / 2**30:.1f} GiB; at most {LARGEST_TABLE * 4 >> 30} are allowed"
        )
    return features
