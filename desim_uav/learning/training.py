"""Training: the drones of a scenario learn independently, episode after episode."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.base import Carried, RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.engine.compiled.scratch import scratch
from desim_uav.errors import PolicyError, SimulationError, UsageError, notice
from desim_uav.learning import fused
from desim_uav.learning.algorithm import load_algorithm
from desim_uav.learning.initial_q import initial_q
from desim_uav.learning.learner import Parameters, forget, play
from desim_uav.learning.readable import Readable
from desim_uav.learning.rows import BoundedValues, EpisodeRow, Learner, QValues, bounded_update
from desim_uav.model.naming import naming
from desim_uav.model.observations import Feature, common_features, table_row, table_sizes
from desim_uav.model.random.streams import Purpose, Streams, uniforms_of
from desim_uav.registry import naming_plug_ins
from desim_uav.rowcode.bounds import owner_of
from desim_uav.rowcode.components import NOT_COMPILED, cause_of, check_unchanged
from desim_uav.rowcode.packing import packed
from desim_uav.rowcode.rows import Table, blank, fill
from desim_uav.rowcode.views import View
from desim_uav.sample_path import at_once, draw, draw_all
from desim_uav.world import World

FIRST_PATH = 2**24
"""The first episode number of training. Runs with the same seed never reach these numbers."""

LARGEST_TABLE = 2**29
"""The largest number of entries of all tables together."""

DRAWS = 3
"""The number of random numbers for a drone at a decision epoch."""


class Decision(NamedTuple):
    """A decision that a drone has still to learn from (see ``Lesson``); none by default."""

    state: int = -1
    action: int = -1
    gained: float = 0.0
    discount: float = 1.0


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


TrainingColumns = Sequence[Sequence[Any]]
"""The results of ``fused.RESULTS``: each has one of every drone in every episode, in this order."""

made = partial(tuple.__new__, Progress)
"""Make a Progress of a tuple of all its fields."""


class Memory(NamedTuple):
    """The state of a training between two episodes, on which all later episodes depend.

    ``q`` has the shape (drones, tables, states, actions), and ``sums`` holds the sum of the values
    of each drone. ``pending`` is the decision from which each drone has still to learn.
    """

    episode: int
    q: NDArray[np.float32]
    sums: tuple[float, ...]
    pending: tuple[Decision, ...]
    carried: Carried | None


class Training:
    """A training of independent learners without communication, on one seed.

    Learners, engine and decisions are compiled into one kernel (``fuses``) if engine, observation
    and algorithm are; else Python runs the learners. Raises UsageError if a table cannot have the
    states of the scenario's observation.
    """

    def __init__(self, world: World, seed: int, engine: str = "des") -> None:
        scenario = world.scenario
        scenario.require_cells("a learner with a table")
        self.world = world
        self.seed = seed
        self.settings = scenario.learning
        algorithm = load_algorithm(self.settings.algorithm)
        self.features = table_features(world, algorithm.tables)
        self.sizes = table_sizes(self.features)
        self.episode = 0
        self.carries_over = scenario.episode.carry_over
        count = scenario.drone_count
        settings = RunSettings((True,) * count, self.carries_over, keep_steps=False)
        self.engine = make_engine(engine, world, settings)
        states, actions = math.prod(self.sizes), len(world.actions)
        self.q = np.empty((count, algorithm.tables, states, actions), np.float32)
        streams = Streams(seed, Purpose.LEARNER)
        for drone in range(count):
            rng = streams.generator(drone)
            for table in self.q[drone]:
                facts = world.facts_of(drone)
                table[:] = initial_q(
                    self.settings.initial_q, self.features, world.actions, facts, rng
                )
        self.together = at_once(world)
        update = self._compiled(algorithm)
        self.fuses = update != 0
        self.episode_row: Any = self._episode_row(update, algorithm)
        if self.fuses:
            assert isinstance(self.engine, BatchSimulation)
            self.engine.make_room_at_once()
            self.memory = packed(self.episode_row)
            self.episode_row = View(self.memory, EpisodeRow)
        self.learners = self.episode_row.learners

    def _compiled(self, algorithm: Any) -> int:
        """Return the address of the algorithm if it is compiled with the engine, or 0."""
        engine = self.engine
        if not isinstance(engine, BatchSimulation) or "observation" not in engine.fixed.components:
            return 0
        try:
            check_unchanged(algorithm)
            return fused.compiled_update(algorithm)
        except NOT_COMPILED as error:
            name, why = self.settings.algorithm, cause_of(error, None)
            notice(f"learning.algorithm: {name!r} is not compiled, so training is slower: {why}")
            return 0

    def _episode_row(self, compiled: int, algorithm: Any) -> EpisodeRow:
        """Return an episode before the first one; ``compiled``: the update's address, or 0."""
        owner, values, update = owner_of(algorithm), QValues, compiled or algorithm.update
        if owner and not compiled:
            values, update = BoundedValues, naming(owner, bounded_update(algorithm.update))
        episode = blank(EpisodeRow)
        episode.sizes = Table(self.sizes)
        for q in self.q:
            learner: Any = blank(Learner)
            entries = q.ctypes.data if self.fuses else q.data
            learner.q = fill(values, (entries, *q.shape, float(q.sum(dtype=np.float64))))
            learner.lesson.allowed = Table([0] * q.shape[2])
            learner.gamma, learner.update = self.settings.gamma, update
            forget(learner)
            episode.learners.append(learner)
        return episode

    @naming_plug_ins()
    def play(self, most: int = 1) -> list[Progress]:
        """Learn in the next episode, or in up to ``most``; return a row per episode and drone."""
        count = min(most, self.together) if self.fuses else 1
        episodes = range(self.episode, self.episode + count)
        parameters = self._parameters(episodes)
        learn = self._learn_compiled if self.fuses else self._learn
        results = learn([FIRST_PATH + episode for episode in episodes], parameters)
        self.episode += count
        if self.engine.terminated or parameters[-1][2]:
            self.engine.carry(None)
        if any(math.isnan(learner.q.sum) for learner in self.learners):
            raise SimulationError(
                f"learning.algorithm: {self.settings.algorithm!r} has learned values that are not "
                "finite, or used values outside its tables"
            )
        return self._rows(episodes, parameters, results)

    def _rows(
        self, episodes: range, parameters: list[Parameters], results: TrainingColumns
    ) -> list[Progress]:
        """Return a row per episode and drone, made of columns, which is faster than one by one."""
        drones, size = range(len(self.learners)), self.q[0].size
        rewards, totals, *qoe, crashes = results
        numbers, epsilons, alphas = (
            [value for value in column for _ in drones]
            for column in (episodes, *list(zip(*parameters, strict=True))[:2])
        )
        means = [total / size for total in totals]
        which = [*drones] * len(episodes)
        columns = (numbers, which, rewards, epsilons, alphas, means, *qoe, map(int, crashes))
        return list(map(made, zip(*columns, strict=True)))

    def _learn(self, numbers: list[int], parameters: list[Parameters]) -> TrainingColumns:
        """Learn in an episode; return the results of each drone (see ``TrainingColumns``)."""
        (number,), draws = numbers, self._draws(numbers)[0].swapaxes(0, 1).tolist()
        engine = Readable(self.engine, draw(self.world, self.seed, number), draws)
        play(engine, self.episode_row, parameters[0])
        measures, crashed = self.engine.measures(), self.engine.log.crashed
        of_drones = [
            (learner.rewards, learner.q.sum, *measures, crashed.count(drone))
            for drone, learner in enumerate(self.learners)
        ]
        return list(zip(*of_drones, strict=True))

    def _learn_compiled(self, numbers: list[int], parameters: list[Parameters]) -> TrainingColumns:
        """Learn in episodes in compiled code; return the results (see ``TrainingColumns``)."""
        engine = self.engine
        assert isinstance(engine, BatchSimulation)
        drawn = draw_all(self.world, self.seed, numbers)
        engine.make_room_for_stores(drawn)
        paths, starts = engine.prepare(drawn)
        results = np.zeros((len(numbers), len(self.learners), fused.RESULTS))
        fused.play(
            engine.fixed.at,
            paths.ctypes.data + 8 * starts,
            engine.memory.ctypes.data,
            self.memory.ctypes.data,
            np.array(parameters),
            self._draws(numbers),
            results,
            scratch(),
        )
        engine.check()
        if self.episode_row.lost:
            for drone, code in enumerate(engine.features()):
                table_row(code, self.sizes, len(self.world.features_of(drone)))
        missing = np.isnan(results)
        if missing.any():
            results = results.astype(object)
            results[missing] = None  # of measures
        return results.reshape(-1, fused.RESULTS).T.tolist()

    def _parameters(self, episodes: range) -> list[Parameters]:
        """Return the parameters of each episode (see ``learner.Parameters``)."""
        epsilon, alpha = self.settings.epsilon, self.settings.alpha
        every = self.settings.restart_every if self.carries_over else 1
        last = [float(every is not None and (k + 1) % every == 0) for k in episodes]
        return list(zip(epsilon.over(episodes), alpha.over(episodes), last, strict=True))

    def _draws(self, numbers: Sequence[int]) -> NDArray[np.float64]:
        """Return the random numbers of episodes, in [0, 1): (episodes, drones, epochs, DRAWS)."""
        count, epochs = len(self.learners), self.world.most_epochs + 1
        uniforms = uniforms_of(self.seed, Purpose.LEARNER, numbers, count, epochs * DRAWS)
        return uniforms.reshape(-1, count, epochs, DRAWS)

    def remember(self) -> Memory:
        """Return the state on which all later episodes depend."""
        lessons = [learner.lesson for learner in self.learners]
        return Memory(
            self.episode,
            self.q.copy(),
            tuple(learner.q.sum for learner in self.learners),
            tuple(Decision(one.state, one.action, one.gained, one.discount) for one in lessons),
            self.engine.carried(),
        )

    def recall(self, memory: Memory) -> None:
        """Continue from the state of another training in the same world on the same seed.

        Raises PolicyError if the state does not fit.
        """
        learners = len(self.learners)
        if memory.q.shape != self.q.shape or {len(memory.pending), len(memory.sums)} != {learners}:
            raise PolicyError(f"the table must have the shape {self.q.shape}, not {memory.q.shape}")
        states, actions = self.q.shape[2:]
        for state, action, *_ in memory.pending:
            if state != -1 and not (0 <= state < states and 0 <= action < actions):
                raise PolicyError(
                    f"the table does not have the state and action of the decision {state, action}"
                )
        self.episode = memory.episode
        self.q[:] = memory.q
        for learner, decision, total in zip(
            self.learners, memory.pending, memory.sums, strict=True
        ):
            lesson, learner.q.sum = learner.lesson, total
            lesson.state, lesson.action, lesson.gained, lesson.discount = decision
        self.engine.carry(memory.carried)


def table_features(world: World, tables: int = 1) -> tuple[Feature, ...]:
    """Return the features of an observation that can be the state of a Q-table.

    ``tables`` is the number of tables per drone. Raises UsageError if the observation has real
    numbers, or if the tables would be too large.
    """
    features = common_features(world.features_of_types)
    kind = getattr(world.scenario.observation, "kind", "it")
    if not all(feature.whole and feature.low == 0 for feature in features):
        raise UsageError(
            f"observation: {kind!r} does not consist of whole numbers from 0, as a Q-table needs; "
            "use {kind: position}"
        )
    states = math.prod(table_sizes(features))
    entries = states * len(world.actions) * world.scenario.drone_count * tables
    if entries > LARGEST_TABLE:
        raise UsageError(
            f"observation: {states:,} states for {world.scenario.drone_count} drones make tables "
            f"of {entries * 4 / 2**30:.1f} GiB; at most {LARGEST_TABLE * 4 >> 30} are allowed"
        )
    return features
