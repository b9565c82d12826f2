"""Sessions in the compiled engine, side by side: one call steps them all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from gymnasium import error
from numpy.typing import NDArray

from desim_uav.engine.base import Engine, RunSettings
from desim_uav.engine.batch import BatchSimulation, calls
from desim_uav.env.session import ActionError, Session
from desim_uav.model.state import Snapshot
from desim_uav.spaces import features, observation_space

ADDRESSES = 6
SEEDS = ("seed", "world_seed", "episode_number")
COUNTS = ("attached_users", "crashes")
"""What is told as whole numbers."""


class CompiledSession(Session):
    """A session whose engine is the compiled one (see ``Session``).

    Raises ScenarioError where a component of the scenario has no kernel.
    """

    engine: BatchSimulation

    def _engine_of(self, settings: RunSettings) -> Engine:
        engine = BatchSimulation(self.world, settings)
        engine.refuse_unseen()
        return engine

    def begin(self, seed: int | None = None) -> None:
        """``reset`` without looking."""
        path = self._next_path(seed)
        self.engine.begin(path)

    @property
    def shown(self) -> Snapshot:
        """The state at the present decision epoch. Raises ResetNeeded before the first episode."""
        if self.episode < 0:
            raise error.ResetNeeded("call reset first: no episode has begun")
        return self.engine.snapshot()


class Compiled:
    """What n sessions of one scenario show, in arrays, and a step of all or some of them.

    ``values`` (n, drones * features); ``masks`` (n, drones * actions), int8; ``rewards`` (n,),
    means over the drones.
    """

    def __init__(self, sessions: Sequence[CompiledSession], threads: int = 1) -> None:
        """``threads`` step them, each its share."""
        self.sessions = sessions
        first, count = sessions[0], len(sessions)
        world, drones = first.world, first.scenario.drones.count
        shown = features(world)
        self.drones, self.actions = drones, len(world.actions)
        self.dtype = observation_space(shown).dtype
        self.names = (*calls.TOLD, *(f"reward_{name}" for name in first.engine.term_names))
        self.values = np.zeros((count, drones * len(shown)))
        self.masks = np.zeros((count, drones * self.actions), np.int8)
        self.rewards = np.zeros(count)
        self._told = np.zeros((count, len(self.names)))
        self._over = np.zeros((count, 3), np.bool_)
        self._seeds = np.zeros((count, len(SEEDS)), np.int64)
        self._table = np.zeros((count, ADDRESSES), np.int64)
        bounds = np.linspace(0, count, threads + 1).astype(int).tolist()
        self._shares = [slice(*pair) for pair in pairwise(bounds)]
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    @property
    def over(self) -> NDArray[np.bool_]:
        """(n, 2): has a crash ended the episode, has its time run out?"""
        over: NDArray[np.bool_] = self._over[:, :2]
        return over

    def begin(self, which: NDArray[np.bool_], seeds: Sequence[int | None]) -> None:
        """Begin the next episode of some; with a seed, the first of a new run."""
        for k in which.nonzero()[0].tolist():
            session = self.sessions[k]
            session.begin(seeds[k])
            self._table[k] = session.engine.addresses()
            self._seeds[k] = session.seed, session.world.seed, session.episode
        self._look(which)

    def step(self, commands: NDArray[np.int64], which: NDArray[np.bool_]) -> None:
        """Give ``which`` of them commands (n, drones), and run each to its next decision epoch."""
        self._share(lambda part: calls.step_all(self._table[part], commands[part], which[part]))
        self._look(which)
        if self._over[:, 2].any():
            self._make_room()

    def commands(self, actions: Any) -> NDArray[np.int64]:
        """Actions (n, drones), or (n,) of a single drone. Raises ActionError."""
        try:
            told = np.asarray(actions)
        except ValueError as problem:
            raise ActionError(f"actions must be whole numbers: {problem}") from problem
        shape = (len(self.sessions), self.drones)
        if told.dtype.kind not in "iu" or told.size != shape[0] * shape[1]:
            raise ActionError(
                f"actions must be whole numbers, shape {shape}, not {told.dtype} {told.shape}"
            )
        if told.min() < 0 or told.max() >= self.actions:
            raise ActionError(f"actions must be from 0 to {self.actions - 1}")
        return np.ascontiguousarray(told.reshape(shape), np.int64)

    def info(self) -> dict[str, NDArray[Any]]:
        """What is told beside the observations: an array for each key, of n numbers or masks."""
        told = dict(zip(self.names, self._told.T.copy(), strict=True))
        found = {name: told.pop(name) for name in calls.TOLD if name not in COUNTS}
        found |= dict(zip(SEEDS, self._seeds.T.copy(), strict=True))
        found |= {name: told.pop(name).astype(np.int64) for name in COUNTS}
        return {**found, **told, "action_mask": self.masks.copy()}

    def info_of(self, k: int) -> dict[str, Any]:
        """The same of one of them."""
        told = dict(zip(self.names, self._told[k].tolist(), strict=True))
        found = {name: told.pop(name) for name in calls.TOLD if name not in COUNTS}
        found.update(zip(SEEDS, self._seeds[k].tolist(), strict=True))
        for name in COUNTS:
            found[name] = int(told.pop(name))
        return {**found, **told, "action_mask": self.masks[k].copy()}

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()

    def _look(self, which: NDArray[np.bool_]) -> None:
        shown: tuple[Any, ...] = (
            self._table,
            self.values,
            self.masks,
            self.rewards,
            self._told,
            self._over,
            which,
        )
        self._share(lambda part: calls.look_at_all(*(array[part] for array in shown)))

    def _share(self, work: Callable[[slice], None]) -> None:
        if self._pool is None:
            work(self._shares[0])
        else:
            list(self._pool.map(work, self._shares))

    def _make_room(self) -> None:
        """Play again, with more room, what did not fit."""
        full = self._over[:, 2].copy()
        for k in full.nonzero()[0].tolist():
            engine = self.sessions[k].engine
            engine.drain()
            self._table[k] = engine.addresses()
        self._look(full)
