"""Backhauls at each tick: what they have for links, for results, and for tasks that move."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tests.reference.radio import Disc, Radio

if TYPE_CHECKING:
    from tests.reference.service import Services


class Backhauls:
    """The backhauls of all transmitters, which have an infinite capacity if there is none.

    ``connected``: between which two transmitters anything comes over backhauls. ``left_bps``: what
    held rates leave of each; ``sharers``: how many transfers share it over the links, and
    ``relayed``: how many results and tasks are sent over it from one transmitter to another one.
    ``store_bps``: what all of these leave for stored updates.
    """

    def __init__(self, links: Sequence[Disc | Radio]) -> None:
        self.capacity_bps = [link.backhaul_bps for link in links]
        exists = np.isfinite(self.capacity_bps)
        self.connected = (exists[:, None] & exists) | np.eye(len(links), dtype=bool)
        self.exists = exists
        self.left_bps = list(self.capacity_bps)
        self.sharers = [0] * len(links)
        self.relayed = [0] * len(links)
        self.store_bps: list[float] = [0.0] * len(links)

    def connect(self, site: int, d: int) -> bool:
        """Whether something comes from one transmitter to another one, or is there already."""
        return bool(self.connected[site, d])

    def free_bps(self, services: Services, d: int) -> float:
        """What held rates leave: those over its links, and those of results that it sends on."""
        if not self.exists[d]:
            return math.inf
        server, tasks = services.server, services.tasks
        here = (server >= 0) & (tasks.cycles == 0) & ((server == d) | (tasks.site == d))
        held = [user for user in np.flatnonzero(here) if services.held(int(server[user]))[user]]
        return self.capacity_bps[d] - int(services.wanted_bps[held].sum())

    def count(self, services: Services, elastic: Sequence[np.ndarray]) -> None:
        """Count who shares each backhaul; ``elastic``: who shares the bands of each transmitter."""
        count, tasks = len(self.capacity_bps), services.tasks
        self.left_bps = [self.free_bps(services, d) for d in range(count)]
        self.sharers = [int(some.sum()) for some in elastic]
        self.relayed = [0] * count
        for d, some in enumerate(elastic):
            for user in np.flatnonzero(some):
                site = services.relay(d, user)
                self.relayed[site] += int(site != d)
        for user in np.flatnonzero(services.open & (tasks.target >= 0)):
            self.relayed[tasks.site[user]] += 1
            self.relayed[tasks.target[user]] += 1

    def part_bps(self, d: int) -> int:
        """An equal part of what held rates leave, for each result or task that it sends on."""
        return int(max(self.left_bps[d], 0)) // (self.sharers[d] + self.relayed[d])

    def for_sharing_bps(self, d: int) -> float:
        """The capacity of a backhaul that is left for what its drone sends over radio links."""
        if self.relayed[d] == 0:
            return self.left_bps[d]
        return self.left_bps[d] - self.relayed[d] * self.part_bps(d)
