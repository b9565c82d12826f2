"""Several sessions in the compiled engine, which one call steps together."""

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
from desim_uav.engine.compiled import BatchSimulation, calls
from desim_uav.env.session import ActionError, Session
from desim_uav.model.state import Snapshot
from desim_uav.spaces import features, observation_space

SEEDS = ("seed", "world_seed", "episode_number")

MEASURED = len(MEASURES)
COUNTED = MEASURED + len(COUNTS)
"""The columns at which measures and counts end in an environment's row (see ``calls.Shown``)."""


class CompiledSession(Session):
    """A session that runs in the compiled engine (see ``Session``).

    Raises ScenarioError if a component of the scenario cannot be compiled.
    """

    engine: BatchSimulation

    def _engine_of(self, settings: RunSettings) -> Engine:
        engine = BatchSimulation(self.world, settings)
        engine.refuse_unseen()
        return engine

    def begin(self, seed: int | None = None) -> None:
        """Begin the next episode as ``reset`` does, without making a snapshot."""
        path = self._next_path(seed)
        self.engine.begin(path)

    @property
    def shown(self) -> Snapshot:
        """The snapshot at the present epoch. Raises ResetNeeded before the first episode."""
        if self.episode < 0:
            raise error.ResetNeeded("call reset first: no episode has begun")
        return self.engine.snapshot()


class Compiled(Independent):
    """The observations, masks and rewards of n sessions of one scenario, in arrays.

    ``values``: (n, drones * features); ``masks``: int8 (n, drones * actions); ``rewards``: (n,),
    each the mean over the drones. One call steps all or some of the sessions.
    """

    def __init__(self, sessions: Sequence[CompiledSession], threads: int = 1) -> None:
        """Take ``sessions``, which ``threads`` threads step, each thread a share of them."""
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
        """Make the addresses and threads, which are valid only in this process."""
        count, threads = len(self.sessions), len(self._shares)
        self._table = np.zeros((count, calls.ADDRESSES), np.int64)
        shown_in = (self.values, self.masks, self.rewards, self._told, self._over)
        for k, session in enumerate(self.sessions):
            self._table[k, -len(shown_in) :] = [array[k:].ctypes.data for array in shown_in]
            if session.episode >= 0:
                self._point_at(k)
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def __getstate__(self) -> dict[str, Any]:
        """Return everything except addresses and threads."""
        return {key: part for key, part in vars(self).items() if key not in ("_table", "_pool")}

    def __setstate__(self, kept: dict[str, Any]) -> None:
        """Make new addresses and threads, for this object's own arrays."""
        for key, part in kept.items():
            setattr(self, key, owned(part) if isinstance(part, np.ndarray) else part)
        self._set_up()

    @property
    def over(self) -> NDArray[np.bool_]:
        """Whether a crash has ended each episode, and whether its time has run out: bool (n, 2)."""
        over: NDArray[np.bool_] = self._over[:, :2]
        return over

    def begin(self, which: NDArray[np.bool_], seeds: Sequence[int | None]) -> None:
        """Begin the next episode of the sessions ``which``; with a seed, the first of a new run."""
        for k in which.nonzero()[0].tolist():
            session = self.sessions[k]
            session.begin(seeds[k])
            self._point_at(k)
            self._seeds_of[k] = session.seed, session.world.seed, session.episode
            self._seeds[k] = self._seeds_of[k]
        self._look(which)

    def step(self, commands: NDArray[np.int64], which: NDArray[np.bool_]) -> None:
        """Give the sessions ``which`` their commands (n, drones), and run each to its next epoch.

        Raises ActionError for a number that is not an action; no session is stepped then.
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
        """Return actions as int64 (n, drones); a single drone's may be (n,). Raises ActionError."""
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
            raise ActionError(f"actions must have the shape {shape}, not {told.shape}")
        commands: NDArray[np.int64] = told.reshape(shape)
        return commands

    def info(self) -> dict[str, NDArray[Any]]:
        """Return the infos of all sessions: for each key, an array of n numbers or masks."""
        told, seeds = self._told.T.copy(), self._seeds.T.copy()
        measures, counts, terms = told[:MEASURED], told[MEASURED:COUNTED], told[COUNTED:]
        columns = (*measures, *seeds, *counts.astype(np.int64), *terms)
        return {**dict(zip(self.keys, columns, strict=True)), "action_mask": self.masks.copy()}

    def info_of(self, k: int) -> dict[str, Any]:
        """Return the info of session k, with Python numbers."""
        row = self._told[k].tolist()
        measures, counts, terms = row[:MEASURED], row[MEASURED:COUNTED], row[COUNTED:]
        values = (*measures, *self._seeds_of[k], *map(int, counts), *terms)
        told: dict[str, Any] = dict(zip(self.keys, values, strict=True))
        told["action_mask"] = self.masks[k].copy()
        return told

    def close(self) -> None:
        """Stop the threads."""
        if self._pool is not None:
            self._pool.shutdown()

    def _look(self, which: NDArray[np.bool_]) -> None:
        self._share(calls.look_at_all, which)

    def _share(self, work: Callable[..., int], *given: NDArray[Any]) -> int:
        """Run a kernel on all environments, each thread on its share of them."""
        if self._pool is None:
            return work(self._table, *given)
        arrays = (self._table, *given)
        parts = [[array[share] for array in arrays] for share in self._shares]
        return sum(self._pool.map(lambda part: work(*part), parts))

    def _make_room(self) -> None:
        """Enlarge the buffers of sessions that ran out of room, and repeat their steps."""
        full = self._over[:, 2].copy()
        for k in full.nonzero()[0].tolist():
            self.sessions[k].engine.drain()  # plays again, with more room
            self._point_at(k)
        self._look(full)

    def _point_at(self, k: int) -> None:
        addresses = self.sessions[k].engine.addresses()
        self._table[k, : len(addresses)] = addresses
