"""Training: the drones of a scenario learn independently, episode after episode."""

from __future__ import annotations

import math
from collections.abc import Sequence
from math import isnan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.base import Carried, RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.errors import PolicyError, UsageError
from desim_uav.learning import fused
from desim_uav.learning.initial_q import initial_q
from desim_uav.learning.learner import Decision, Learner, load_algorithm
from desim_uav.model.observations import Feature, table_row, table_sizes
from desim_uav.model.rules import DECIDES, Mode
from desim_uav.model.state import Observation, Snapshot
from desim_uav.model.streams import Purpose, Streams, uniforms_of
from desim_uav.registry import naming_plug_ins
from desim_uav.rules.observations import Position
from desim_uav.sample_path import at_once, draw, draw_all
from desim_uav.world import World

FIRST_PATH = 2**24
"""The first episode number of training. Runs with the same seed never reach these numbers."""

LARGEST_TABLE = 2**29
DRAWS = 3


class Progress(NamedTuple):
    """The results of one drone in one episode of a training (see ``records.TRAINING``)."""

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
    """The state of a training between two episodes, on which all later episodes depend.

    ``q``: (drones, tables, states, actions), with each drone's sum of its values. ``pending``: the
    decision that each drone has still to learn from, or None: state, action, discounted reward and
    discount so far.
    """

    episode: int
    q: NDArray[np.float32]
    sums: tuple[float, ...]
    pending: tuple[Decision | None, ...]
    carried: Carried | None


class Training:
    """A training of independent learners without communication, on one seed.

    Raises UsageError if a table cannot have the states of the scenario's observation.
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
        self.engine = make_engine(engine, world, settings)
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
        self.sums = self.settings.algorithm in fused.ALGORITHMS
        self.together = at_once(world)
        self.fuses = (
            isinstance(self.engine, BatchSimulation)
            and self.sums
            and type(scenario.observation) is Position
        )

    @naming_plug_ins()
    def play(self, most: int = 1) -> list[Progress]:
        """Learn in the next episode, or in up to ``most``; return a row per episode and drone."""
        if self.fuses:
            return self._play_fused(min(most, self.together))
        epsilon, alpha = self._law(self.episode)
        number = FIRST_PATH + self.episode
        shown = self.engine.reset(draw(self.world, self.seed, number))
        draws = self._draws(number)
        rewards = [0.0] * len(self.learners)
        while not (shown.terminated or shown.truncated):
            shown = self.engine.step(self._decide(shown, draws[shown.step], epsilon, alpha))
            for drone, reward in enumerate(shown.rewards):
                self.learners[drone].gain(reward)
                rewards[drone] += reward
        measures, crashed = self.engine.measures(), self.engine.log.crashed
        self.episode += 1
        if shown.terminated or not self._goes_on(self.episode):
            self._close(shown, draws[shown.step], epsilon, alpha)
            self.engine.carry(None)
        gained = [(reward, self._mean_q(drone)) for drone, reward in enumerate(rewards)]
        fallen = [crashed.count(drone) for drone in range(len(rewards))]
        return _rows([number - FIRST_PATH], [(epsilon, alpha)], [gained], [measures], [fallen])

    def _play_fused(self, count: int) -> list[Progress]:
        """Learn in ``count`` episodes in compiled code; return a row per episode and drone."""
        engine, drones = self.engine, len(self.learners)
        assert isinstance(engine, BatchSimulation)
        episodes = range(self.episode, self.episode + count)
        numbers = [FIRST_PATH + episode for episode in episodes]
        paths, starts = engine.prepare(draw_all(self.world, self.seed, numbers))
        waiting = [learner.open_decision() or (-1, -1, 0.0, 1.0) for learner in self.learners]
        pending = np.array([decision[:2] for decision in waiting], np.int64)
        sums = [(learner.sum,) for learner in self.learners]
        due = np.array([(*decision[2:], *s) for decision, s in zip(waiting, sums, strict=True)])
        laws = [self._law(episode) for episode in episodes]
        told, crashes = np.zeros((count, drones, 5)), np.zeros((count, drones), np.int64)
        fused.play(
            engine.fixed.at,
            paths.ctypes.data + 8 * starts,
            engine.state.ctypes.data,
            fused.ALGORITHMS.index(self.settings.algorithm),
            self.q,
            self._sizes(),
            np.array(laws),
            self.settings.gamma,
            self._drawn(numbers),
            pending,
            due,
            np.array([not self._goes_on(episode + 1) for episode in episodes]),
            told,
            crashes,
            np.empty(len(self.world.actions), np.bool_),
        )
        engine.check()
        for learner, decision, (*worth, total) in zip(
            self.learners, pending.tolist(), due.tolist(), strict=True
        ):
            state, action = decision
            learner.reopen(None if state < 0 else (state, action, *worth))
            learner.sum = total
        self.episode += count
        if engine.terminated or not self._goes_on(self.episode):
            engine.carry(None)
        told[:, :, 1] /= self.q[0].size
        gained, qoe = told[:, :, :2].tolist(), told[:, 0, 2:].tolist()
        return _rows(episodes, laws, gained, qoe, crashes.tolist())

    def _law(self, episode: int) -> tuple[float, float]:
        """Return ε and α of an episode."""
        return self.settings.epsilon.at(episode), self.settings.alpha.at(episode)

    def _sizes(self) -> NDArray[np.int64]:
        """Return the numbers of levels and minutes in the paper's state, 0 if it has none."""
        sizes = {feature.name: int(feature.high) + 1 for feature in self.features}
        return np.array([sizes.get("level", 0), sizes.get("battery_min", 0)])

    def _goes_on(self, episode: int) -> bool:
        """Return whether an episode begins with the drones where the previous one left them."""
        restart_every = self.settings.restart_every
        restarts = restart_every is not None and episode % restart_every == 0
        return self.carries_over and not restarts

    def remember(self) -> Memory:
        """Return the state on which all later episodes depend."""
        return Memory(
            self.episode,
            self.q.copy(),
            tuple(learner.sum for learner in self.learners),
            tuple(learner.open_decision() for learner in self.learners),
            self.engine.carried(),
        )

    def recall(self, memory: Memory) -> None:
        """Continue from the state of another training in the same world on the same seed.

        Raises ValueError if the state does not fit.
        """
        learners = len(self.learners)
        if memory.q.shape != self.q.shape or {len(memory.pending), len(memory.sums)} != {learners}:
            raise PolicyError(f"the table must have the shape {self.q.shape}, not {memory.q.shape}")
        states, actions = self.q.shape[2:]
        for decision in memory.pending:
            if decision is not None and not (
                0 <= decision[0] < states and 0 <= decision[1] < actions
            ):
                raise PolicyError(
                    f"the table does not have the state and action of the decision {decision[:2]}"
                )
        self.episode = memory.episode
        self.q[:] = memory.q
        for learner, decision, total in zip(
            self.learners, memory.pending, memory.sums, strict=True
        ):
            learner.reopen(decision)
            learner.sum = total
        self.engine.carry(memory.carried)

    def _decide(
        self, shown: Snapshot, draws: list[list[float]], epsilon: float, alpha: float
    ) -> list[int]:
        """Return a command for each drone: its own choice, or the only one that is allowed."""
        commands = []
        for learner, seen, mask, drawn in zip(
            self.learners, shown.observations, shown.masks, draws, strict=True
        ):
            if seen.mode in DECIDES:
                state = self._state(seen)
                commands.append(learner.act(state, mask, epsilon, alpha, drawn))
            else:
                commands.append(mask.index(True))
                if self._is_lost(seen):
                    learner.conclude(mask, alpha, drawn[-1])
        return commands

    def _is_lost(self, seen: Observation) -> bool:
        """Return whether this drone has crashed and will not be replaced."""
        return seen.mode is Mode.CRASHED and self.world.on_crash == "remove"

    def _close(
        self, shown: Snapshot, draws: list[list[float]], epsilon: float, alpha: float
    ) -> None:
        """Learn from open decisions at the end of an episode whose drones are not carried over.

        A drone that could choose an action now learns with the value of its last state. Nothing is
        learned from the decision of a drone that returns, charges or waits to be replaced, because
        its gain is not known.
        """
        for learner, seen, mask, drawn in zip(
            self.learners, shown.observations, shown.masks, draws, strict=True
        ):
            if shown.terminated or self._is_lost(seen):
                learner.conclude(mask, alpha, drawn[-1])
            elif seen.mode in DECIDES:
                learner.bootstrap(self._state(seen), mask, epsilon, alpha, drawn)
            else:
                learner.forget()

    def _state(self, seen: Observation) -> int:
        return table_row(self.encode(seen, self.world.facts), self.sizes)

    def _draws(self, number: int) -> list[list[list[float]]]:
        """Draw the numbers of an episode's choices: (epochs, drones, 3), uniform in [0, 1)."""
        draws: list[list[list[float]]] = self._drawn([number])[0].swapaxes(0, 1).tolist()
        return draws

    def _drawn(self, numbers: Sequence[int]) -> NDArray[np.float64]:
        """Draw the numbers of several episodes' choices: (episodes, drones, epochs, 3)."""
        count, epochs = len(self.learners), self.world.scenario.episode.steps + 1
        drawn = uniforms_of(self.seed, Purpose.LEARNER, numbers, count, epochs * DRAWS)
        return drawn.reshape(-1, count, epochs, DRAWS)

    def _mean_q(self, drone: int) -> float:
        q = self.q[drone]
        return self.learners[drone].sum / q.size if self.sums else float(q.mean(dtype=np.float64))


def _rows(
    episodes: Sequence[int],
    laws: Sequence[tuple[float, float]],
    gains: Sequence[Sequence[tuple[float, float]]],
    measures: Sequence[Sequence[float | None]],
    crashes: Sequence[Sequence[int]],
) -> list[Progress]:
    """Return a row per episode and drone; ``gains`` (episodes, drones, 2): reward, mean of Q."""
    rows = []
    for episode, law, gained, qoe, fallen in zip(
        episodes, laws, gains, measures, crashes, strict=True
    ):
        one, two, three = map(_known, qoe)
        for drone, (reward, mean_q) in enumerate(gained):
            rows.append(
                Progress(episode, drone, reward, *law, mean_q, one, two, three, fallen[drone])
            )
    return rows


def _known(measure: float | None) -> float | None:
    """Return a measure, or None if it is NaN."""
    return None if measure is None or isnan(measure) else measure


def table_features(world: World, tables: int = 1) -> tuple[Feature, ...]:
    """Return the features of an observation that can be the state of a Q-table.

    ``tables`` is the number of tables per drone. Raises UsageError if the observation has real
    numbers, or if the tables would be too large.
    """
    features = world.scenario.observation.features(world.facts)
    kind = getattr(world.scenario.observation, "kind", "it")
    if not all(feature.whole and feature.low == 0 for feature in features):
        raise UsageError(
            f"observation: {kind!r} does not consist of whole numbers from 0, as a Q-table needs; "
            "use {kind: position}"
        )
    states = math.prod(table_sizes(features))
    entries = states * len(world.actions) * world.scenario.drones.count * tables
    if entries > LARGEST_TABLE:
        raise UsageError(
            f"observation: {states:,} states for {world.scenario.drones.count} drones make tables "
            f"of {entries * 4 / 2**30:.1f} GiB; at most {LARGEST_TABLE * 4 >> 30} are allowed"
        )
    return features
