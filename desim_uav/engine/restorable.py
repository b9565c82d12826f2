"""Engines that save their states, and go on from those of others."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from copy import deepcopy
from typing import Any, Self

from desim_uav.copies import Independent
from desim_uav.engine import base
from desim_uav.engine.saved import Kept, SavedState, copied
from desim_uav.errors import SimulationError
from desim_uav.model.state import Snapshot
from desim_uav.rules.words import RETURNING
from desim_uav.sample_path import SamplePath
from desim_uav.world import World

Hops = Sequence[tuple[int, int, int]]


class Restorable(Independent, ABC):
    """The part of an engine that saves and restores its state (see ``engine.saved``)."""

    world: World
    settings: base.RunSettings
    drones: Sequence[Any]
    _drawn: SamplePath | Callable[[], SamplePath]
    log: base.EpisodeLog
    latest: Snapshot | None
    _carried: base.Carried | None
    _under_way: bool
    _served_by: dict[int, list[int]]

    @property
    def drawn(self) -> SamplePath:
        """The sample path of the present episode, which is drawn again if only memory has it."""
        if callable(self._drawn):
            self._drawn = self._drawn()
        return self._drawn

    @drawn.setter
    def drawn(self, path: SamplePath | Callable[[], SamplePath]) -> None:
        self._drawn = path

    @abstractmethod
    def snapshot(self) -> Snapshot:
        """Return the snapshot of the present decision epoch."""

    @abstractmethod
    def entries(self, name: str) -> Sequence[Any]:
        """Return the numbers or rows in this table or queue of the state, which are only read."""

    @abstractmethod
    def hops(self, first: int, end: int) -> list[tuple[int, int, int]]:
        """Return the hops with the numbers ``first`` to ``end`` - 1, as (dx, dy, dlevel)."""

    @abstractmethod
    def route(self, hops: Hops) -> tuple[int, int]:
        """Return the number of the first of these hops, and the number after that of the last."""

    @abstractmethod
    def _keep(self) -> tuple[base.Carried | None, Kept]:
        """Return the states in which drones began the episode, and the present state."""

    @abstractmethod
    def _take(self, saved: SavedState) -> None:
        """Put rows and events into a saved state of this world and these settings."""

    @abstractmethod
    def _ready(self) -> bool:
        """Return whether the last step, or the reset, has not failed."""

    def save(self) -> SavedState:
        """Return the state at the present decision epoch, or at the end of the episode.

        It does not change, and ``restore`` of any engine of this world leads back to it. Raises
        SimulationError if no episode has begun, and after a step that has failed.
        """
        self.require_epoch("save")
        before, memory = self._keep()
        log = copied(self.log, self.settings)
        log.crashed[:] = self.entries("crashed")  # which a kernel may not have added yet
        return SavedState(
            self.world,
            self.settings,
            self.drawn,
            before,
            memory,
            log,
            tuple((number, tuple(drones)) for number, drones in self._served_by.items()),
            self.named_terms(),
            self.latest,
        )

    def require_epoch(self, what: str) -> None:
        """Raise SimulationError, which names what cannot be done, if there is no present epoch."""
        if not self._under_way or not self._ready():
            raise SimulationError(f"{what}: no episode has begun, or a step has failed")

    def restore(self, saved: SavedState) -> Snapshot:
        """Go on from a saved state, exactly as the engine that it was saved from would.

        The state may come from another engine of the same world, of either kind, in this process
        or another. Returns the snapshot of its decision epoch. Raises SimulationError if the state
        is of another world, or if these settings do not let the engine go on from it.
        """
        self.take(saved)
        return self.latest or self.snapshot()

    def take(self, saved: SavedState) -> None:
        """Go on from a saved state as ``restore`` does, but without a snapshot."""
        saved.check(self.world, self.settings)
        self.latest, self._under_way = None, False  # which they stay if it fails
        self.drawn = saved.path
        self.log = copied(saved.log, self.settings)
        self._served_by = {number: list(drones) for number, drones in saved.served_by}
        self._take(saved)
        self._carried, self._under_way = None, True

    def fork(self, count: int) -> list[Self]:
        """Return this many copies, which go on independently of this engine and each other."""
        return [deepcopy(self) for _ in range(count)]

    def named_terms(self) -> tuple[tuple[tuple[str, float], ...], ...]:
        """Return the terms of a reward that does not work on rows, by drone and name."""
        return ()

    def routes(self) -> tuple[tuple[tuple[int, int, int], ...], ...]:
        """Return the next hops of each drone's return, as (dx, dy, dlevel)."""
        return tuple(
            [
                tuple(self.hops(drone.route, drone.route_end)) if drone.mode == RETURNING else ()
                for drone in self.drones
            ]
        )

    def set_routes(self, routes: Sequence[Sequence[tuple[int, int, int]]]) -> None:
        """Give each drone the next hops of its return."""
        for drone, hops in zip(self.drones, routes, strict=True):
            drone.route, drone.route_end = self.route(hops) if hops else (0, 0)
