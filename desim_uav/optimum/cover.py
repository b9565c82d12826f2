"""The best cells for drones that hover: most users covered, and most reward by R1.

Users stand still and batteries are unlimited; two drones may share a cell. The footprint does not
depend on the level, so a cell counts if drones can get there at any level under the ceiling.

R1 is for where a step ends, over a cell, so no policy is paid more than the best cells are. Users
are attached in between, too, and between two cells a footprint may hold more of them than over
either: there is a policy that flies to and fro and has a higher QoE3 than any that hovers. What no
policy exceeds is the most users that footprints anywhere on the drones' ways can hold at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.grid import Cell
from desim_uav.optimum.footprints import Footprints, flown_to, moves
from desim_uav.optimum.search import (
    as_bits,
    best_cover,
    best_shares,
    greedy_cover,
    sizes,
    undominated,
    union_of,
)
from desim_uav.world import World

BUDGET = 5 * 10**7
"""Footprints a search looks at before it gives up: some seconds."""

MOST_IN_TURN = 10**7
"""Drones times footprints beyond which the cover is not searched for at all."""

MOST_SHARING = 8
"""Drones beyond which the fair shares are not searched for: the search is over their subsets."""

GUARANTEE = 1.0 - math.exp(-1.0)
"""The share of the best cover that the greedy one reaches at least."""


@dataclass(frozen=True)
class Cover:
    """Cells for all drones, and how many users they cover; no cells cover more than ``at_most``."""

    cells: list[Cell]
    users: int
    at_most: int

    @property
    def exact(self) -> bool:
        """Is it the best one?"""
        return self.users == self.at_most


@dataclass(frozen=True)
class FairCover:
    """Cells with the largest sum over drones of R1, min(1, U_c / (U / N)).

    Every user is attached to the drone, of those that cover it, that it serves best. The sum is
    exactly ``score`` / users, and no cells give more than ``at_most`` / users. Among the cells that
    reach it the users covered range from ``least`` (None: not known) to ``users``, by ``cells``.
    """

    cells: list[Cell]
    score: int
    at_most: int
    users: int
    least: int | None

    @property
    def exact(self) -> bool:
        """Is it the best one?"""
        return self.score == self.at_most


class Places:
    """The different footprints of the cells drones can get to, the largest first.

    ``cells`` holds the first cell of each, ``best`` those that lie in no other one.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self.footprints = Footprints(world)
        self.drones = world.scenario.drones.count
        self.users = len(world.homes)
        held = self.footprints.by_cell()
        cells = sorted({(ix, iy) for ix, iy, _ in flown_to(world)})
        rows = as_bits(np.array([held[cell] for cell in cells]))
        different = np.sort(np.unique(rows, axis=0, return_index=True)[1])
        order = different[np.argsort(-sizes(rows[different]), kind="stable")]
        self.sets = rows[order]
        self.cells = [cells[k] for k in order.tolist()]
        self.best = np.flatnonzero(undominated(self.sets))

    def cells_of(self, chosen: NDArray[np.int64]) -> list[Cell]:
        """The cells of footprints, in order."""
        return sorted(self.cells[k] for k in chosen.tolist())

    def on_the_way(self) -> NDArray[np.uint64]:
        """The footprints, over the cells and between them, that lie in no other one."""
        seen = set()
        for leg in moves(self.world):
            seen |= self.footprints.sets_along(leg, self.world.step_us)
        bytes_ = self.sets.shape[1] * 8
        packed = b"".join(one.to_bytes(bytes_, "little") for one in seen)
        rows = np.concatenate(
            (self.sets, np.frombuffer(packed, np.uint64).reshape(-1, bytes_ // 8))
        )
        rows = np.unique(rows, axis=0)
        rows = rows[np.argsort(-sizes(rows), kind="stable")]
        return rows[undominated(rows)]


def cover(places: Places, budget: int = BUDGET) -> Cover:
    """The cells that cover most users, by branch and bound; else the best found, and a bound.

    The search begins from the greedy cover, so what is found is never worse: at least 1 - 1/e of
    the best.
    """
    drones = min(places.drones, len(places.best))
    chosen, users, at_most = _most_covered(places.sets[places.best], drones, budget)
    cells = places.cells_of(places.best[chosen])
    return Cover(sorted(cells + cells[:1] * (places.drones - drones)), users, at_most)


def instant_bound(places: Places, budget: int = BUDGET) -> int:
    """No policy has more users attached than this, at any instant, on its way or not."""
    sets = places.on_the_way()
    return _most_covered(sets, min(places.drones, len(sets)), budget)[2]


def _most_covered(
    sets: NDArray[np.uint64], drones: int, budget: int
) -> tuple[NDArray[np.int64], int, int]:
    """(The sets found, users covered, the most that any can cover)."""
    chosen, users, at_most = greedy_cover(sets, drones)
    at_most = min(at_most, int(users / GUARANTEE), int(sizes(union_of(sets))[0]))
    if users < at_most and drones * len(sets) <= MOST_IN_TURN:
        chosen, users, proven = best_cover(sets, drones, chosen, users, budget)
        at_most = users if proven else at_most
    return chosen, int(users), int(at_most)


def fair_cover(places: Places, budget: int = BUDGET) -> FairCover | None:
    """The cells that earn most by R1; None where there are too many drones to search.

    Where ``exact`` the number of users it covers is the largest, too.
    """
    drones, users = places.drones, places.users
    if drones > MOST_SHARING:
        return None
    sets, base = places.sets[places.best], users + 1
    none = np.zeros(drones, np.int64)
    chosen, key, proven = best_shares(sets, drones, users, 1, none, -1, budget)
    score, most = divmod(int(key), base)
    least = None
    if proven:
        # With the sign turned, a key is score (users + 1) - covered: from here on fewer count.
        found = places.best[chosen]
        start = score * base - most
        _, key, proven_least = best_shares(places.sets, drones, users, -1, found, start, budget)
        least = score * base - int(key) if proven_least else None
    quota, rest = divmod(users, drones)
    top = (drones - rest) * drones * quota + rest * min(users, drones * (quota + 1))
    cells = places.cells_of(places.best[chosen])
    return FairCover(cells, score, score if proven else top, most, least)
