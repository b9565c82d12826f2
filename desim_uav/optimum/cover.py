"""The best cells for drones that hover: those with most users covered, and with most reward R1.

Users stand still and batteries are unlimited; two drones may share a cell. The footprint does not
depend on the level, so a cell counts if drones can reach it at any level under the ceiling.

R1 depends on the cell in which a step ends, so no policy earns more than the best cells do. QoE3
also counts the time between two cells, where a footprint may contain more users than over either
cell. A policy that flies to and fro may therefore have a higher QoE3 than any that hovers. An upper
bound for every policy is the largest number of users that footprints anywhere on the drones' paths
can contain at once.
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
"""The number of footprints that a search examines before it gives up, after some seconds."""

MOST_IN_TURN = 10**7
"""The product of drones and footprints above which the best cover is not searched for."""

MOST_SHARING = 8
"""The number of drones above which fair shares are not searched for, as it takes all subsets."""

GUARANTEE = 1.0 - math.exp(-1.0)
"""The least share of the best cover that the greedy cover reaches."""


@dataclass(frozen=True)
class Cover:
    """Cells for all drones, and how many users they cover; no cells cover more than ``at_most``."""

    cells: list[Cell]
    users: int
    at_most: int

    @property
    def exact(self) -> bool:
        """Whether the cover is proven to be the best."""
        return self.users == self.at_most


@dataclass(frozen=True)
class FairCover:
    """Cells with the largest sum over drones of R1, min(1, U_c / (U / N)).

    Every user is attached to a drone that covers it so that the sum is largest. The sum is exactly
    ``score`` / users, and no cells give more than ``at_most`` / users. The cells with this sum
    cover between ``least`` (None: not known) and ``users`` users; ``cells`` cover ``users``.
    """

    cells: list[Cell]
    score: int
    at_most: int
    users: int
    least: int | None

    @property
    def exact(self) -> bool:
        """Whether the cover is proven to be the best."""
        return self.score == self.at_most


class Places:
    """The different footprints of the cells that drones can reach, the largest first.

    ``cells`` has the first cell of each, ``best`` the indices of those contained in no other.
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
        """Return the cells of some footprints, in order."""
        return sorted(self.cells[k] for k in chosen.tolist())

    def on_the_way(self) -> NDArray[np.uint64]:
        """Return the footprints over and between cells that are contained in no other."""
        held = set()
        for leg in moves(self.world):
            held |= self.footprints.sets_along(leg, self.world.step_us)
        bytes_ = self.sets.shape[1] * 8
        packed = b"".join(one.to_bytes(bytes_, "little") for one in held)
        rows = np.concatenate(
            (self.sets, np.frombuffer(packed, np.uint64).reshape(-1, bytes_ // 8))
        )
        rows = np.unique(rows, axis=0)
        rows = rows[np.argsort(-sizes(rows), kind="stable")]
        return rows[undominated(rows)]


def cover(places: Places, budget: int = BUDGET) -> Cover:
    """Return the cells that cover most users, by branch and bound.

    If the search gives up, the best cover found so far and a bound are returned. The search begins
    with the greedy cover, so the result reaches at least 1 - 1/e of the best.
    """
    drones = min(places.drones, len(places.best))
    chosen, users, at_most = _most_covered(places.sets[places.best], drones, budget)
    cells = places.cells_of(places.best[chosen])
    return Cover(sorted(cells + cells[:1] * (places.drones - drones)), users, at_most)


def instant_bound(places: Places, budget: int = BUDGET) -> int:
    """Return a number of attached users that no policy exceeds at any instant."""
    sets = places.on_the_way()
    return _most_covered(sets, min(places.drones, len(sets)), budget)[2]


def _most_covered(
    sets: NDArray[np.uint64], drones: int, budget: int
) -> tuple[NDArray[np.int64], int, int]:
    """Return the best sets found, the users they cover, and an upper bound for all sets."""
    chosen, users, at_most = greedy_cover(sets, drones)
    at_most = min(at_most, int(users / GUARANTEE), int(sizes(union_of(sets))[0]))
    if users < at_most and drones * len(sets) <= MOST_IN_TURN:
        chosen, users, proven = best_cover(sets, drones, chosen, users, budget)
        at_most = users if proven else at_most
    return chosen, int(users), int(at_most)


def fair_cover(places: Places, budget: int = BUDGET) -> FairCover | None:
    """Return the cells that earn most by R1, or None if there are too many drones to search.

    If the result is exact, its cells cover the most users among all cells with this reward.
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
        # With sign -1 the key is score (users + 1) - covered, so that fewer users are better.
        first = places.best[chosen]
        start = score * base - most
        _, key, proven_least = best_shares(places.sets, drones, users, -1, first, start, budget)
        least = score * base - int(key) if proven_least else None
    quota, rest = divmod(users, drones)
    top = (drones - rest) * drones * quota + rest * min(users, drones * (quota + 1))
    cells = places.cells_of(places.best[chosen])
    return FairCover(cells, score, score if proven else top, most, least)
