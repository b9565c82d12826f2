"""Sessions in the compiled engine, side by side: one call steps them all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from gymnasium import error
from numpy.typing import NDArray

from desim_uav.copies import Independent, owned
from desim_uav.engine.base import COUNTS, MEASURES, Engine, RunSettings
from desim_uav.engine.batch import BatchSimulation, calls
from desim_uav.env.session import ActionError, Session
from desim_uav.model.state import Snapshot
from desim_uav.spaces import features, observation_space

SEEDS = ("seed", "world_seed", "episode_number")

MEASURED = len(MEASURES)
COUNTED = MEASURED + len(COUNTS)
"""Where the measures and the counts end in what is told of an environment (see ``calls.Shown``)."""


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


class Compiled(Independent):
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
        terms = tuple(f"reward_{name}" for name in first.engine.term_names)
        self.keys = (*MEASURES, *SEEDS, *COUNTS, *terms)
        self.values = np.zeros((count, drones * len(shown)))
        self.masks = np.zeros((count, drones * self.actions), np.int8)
        self.rewards = np.zeros(count)
        self._told = np.zeros((count, COUNTED + len(terms)))
        self._over = np.zeros((count, 3), np.bool_)
        self._seeds = np.zeros((count, len(SEEDS)), np.int64)
        self._seeds_of = [(0, 0, 0)] * count
        bounds = np.linspace(0, count, threads + 1).astype(int).tolist()
        self._shares = [slice(*pair) for pair in pairwise(bounds)]
        self._set_up()

    def _set_up(self) -> None:
        """Make what holds in this process and for these arrays only: addresses and threads."""
        count, threads = len(self.sessions), len(self._shares)
        self._table = np.zeros((count, calls.ADDRESSES), np.int64)
        shown_in = (self.values, self.masks, self.rewards, self._told, self._over)
        for k, session in enumerate(self.sessions):
            self._table[k, -len(shown_in) :] = [array[k:].ctypes.data for array in shown_in]
            if session.episode >= 0:
                self._point_at(k)
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def __getstate__(self) -> dict[str, Any]:
        """Everything but addresses and threads."""
        return {key: part for key, part in vars(self).items() if key not in ("_table", "_pool")}

    def __setstate__(self, kept: dict[str, Any]) -> None:
        """Make addresses and threads anew, for arrays of this object's own."""
        for key, part in kept.items():
            setattr(self, key, owned(part) if isinstance(part, np.ndarray) else part)
        self._set_up()

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
            self._point_at(k)
            self._seeds_of[k] = session.seed, session.world.seed, session.episode
            self._seeds[k] = self._seeds_of[k]
        self._look(which)

    def step(self, commands: NDArray[np.int64], which: NDArray[np.bool_]) -> None:
        """Give ``which`` of them commands (n, drones), and run each to its next decision epoch.

        Raises ActionError, and nothing has happened, where one is no action.
        """
        if self._pool is not None and (commands.min() < 0 or commands.max() >= self.actions):
            full = -1  # before any thread has begun
        else:
            full = self._share(calls.step_all, commands, which)
        if full < 0:
            raise ActionError(f"actions must be from 0 to {self.actions - 1}: {commands.tolist()}")
        if full > 0:
            self._make_room()

    def commands(self, actions: Any) -> NDArray[np.int64]:
        """Actions (n, drones), or (n,) of a single drone. Raises ActionError."""
        try:
            told = np.asarray(actions)
        except ValueError as problem:
            raise ActionError(f"actions must be whole numbers: {problem}") from problem
        shape = len(self.sessions), self.drones
        if told.dtype != np.int64:
            if told.dtype.kind not in "iu":
                raise ActionError(f"actions must be whole numbers, not {told.dtype}")
            told = told.astype(np.int64)
        if told.size != shape[0] * shape[1]:
            raise ActionError(f"actions must be of shape {shape}, not {told.shape}")
        commands: NDArray[np.int64] = told.reshape(shape)
        return commands

    def info(self) -> dict[str, NDArray[Any]]:
        """What is told beside the observations: an array for each key, of n numbers or masks."""
        told, seeds = self._told.T.copy(), self._seeds.T.copy()
        measures, counts, terms = told[:MEASURED], told[MEASURED:COUNTED], told[COUNTED:]
        columns = (*measures, *seeds, *counts.astype(np.int64), *terms)
        return {**dict(zip(self.keys, columns, strict=True)), "action_mask": self.masks.copy()}

    def info_of(self, k: int) -> dict[str, Any]:
        """The same of one of them."""
        row = self._told[k].tolist()
        measures, counts, terms = row[:MEASURED], row[MEASURED:COUNTED], row[COUNTED:]
        values = (*measures, *self._seeds_of[k], *map(int, counts), *terms)
        told: dict[str, Any] = dict(zip(self.keys, values, strict=True))
        told["action_mask"] = self.masks[k].copy()
        return told

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()

    def _look(self, which: NDArray[np.bool_]) -> None:
        self._share(calls.look_at_all, which)

    def _share(self, work: Callable[..., int], *given: NDArray[Any]) -> int:
        """Let a kernel work on all environments, each thread on its share of them."""
        if self._pool is None:
            return work(self._table, *given)
        arrays = (self._table, *given)
        parts = [[array[share] for array in arrays] for share in self._shares]
        return sum(self._pool.map(lambda part: work(*part), parts))

    def _make_room(self) -> None:
        """Play again, with more room, what did not fit."""
        full = self._over[:, 2].copy()
        for k in full.nonzero()[0].tolist():
            self.sessions[k].engine.drain()  # plays again, with more room
            self._point_at(k)
        self._look(full)

    def _point_at(self, k: int) -> None:
        addresses = self.sessions[k].engine.addresses()
        self._table[k, : len(addresses)] = addresses
