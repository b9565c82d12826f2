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
from functools import partial

import numpy as np

from desim_uav.model.geometry.grid import Cell
from desim_uav.optimum.footprints import Footprints, flown_to, moves
from desim_uav.optimum.search import HeldPlaces, Placement, best_cover, covered, greedy_cover
from desim_uav.optimum.shares import as_bits, best_shares, undominated
from desim_uav.world import World

LIMIT_S = 60.0
"""The time after which the search for a cover gives up."""

MOST_PAIRS = 10**6
"""The number of pairs of a footprint and a user in it above which no cover is searched for."""

BUDGET = 5 * 10**7
"""The number of footprints that the search for fair shares examines before it gives up."""

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


class Spots:
    """The different footprints of the cells that drones can reach, the largest first.

    ``held`` (footprints, users) says which users they contain; ``cells`` has the first cell of
    each.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self.footprints = Footprints(world)
        self.drones = world.scenario.drone_count
        self.users = len(world.homes)
        users_of = self.footprints.by_cell()
        cells = sorted({(ix, iy) for ix, iy, _ in flown_to(world)})
        rows = np.array([users_of[cell] for cell in cells])
        different = np.sort(np.unique(rows, axis=0, return_index=True)[1])
        order = different[np.argsort(-rows[different].sum(axis=1), kind="stable")]
        self.held: HeldPlaces = rows[order]
        self.cells = [cells[k] for k in order.tolist()]

    def cells_of(self, placement: Placement) -> list[Cell]:
        """Return the cells of a placement, in order."""
        return sorted(self.cells[k] for k in placement.tolist())

    def on_the_way(self) -> HeldPlaces:
        """Return the different footprints over and between cells."""
        sets = set()
        for leg in moves(self.world):
            sets |= self.footprints.sets_along(leg, self.world.step_us)
        bytes_ = -(-self.users // 8)
        packed = np.frombuffer(b"".join(one.to_bytes(bytes_, "little") for one in sets), np.uint8)
        between = np.unpackbits(
            packed.reshape(-1, bytes_), axis=1, count=self.users, bitorder="little"
        )
        return np.unique(np.concatenate((self.held, between.astype(bool))), axis=0)


def cover(places: Spots, limit_s: float = LIMIT_S) -> Cover:
    """Return the cells that cover most users.

    If the search gives up, the best cover found so far and a bound are returned. The result is at
    least the greedy cover, which reaches 1 - 1/e of the best.
    """
    placement, at_most = _most_covered(places.held, places.drones, limit_s, in_order=True)
    return Cover(places.cells_of(placement), covered(places.held, placement), at_most)


def instant_bound(places: Spots, limit_s: float = LIMIT_S) -> int:
    """Return a number of attached users that no policy exceeds at any instant."""
    return _most_covered(places.on_the_way(), places.drones, limit_s)[1]


def _most_covered(
    covers: HeldPlaces, drones: int, limit_s: float, in_order: bool = False
) -> tuple[Placement, int]:
    """Return the best placement found, and an upper bound on the users that any one covers.

    ``in_order`` makes the choice among equally good placements a matter of their order.
    """
    placement, bound = greedy_cover(covers, drones)
    users = covered(covers, placement)
    at_most = min(bound, int(users / GUARANTEE), int(covers.any(axis=0).sum()))
    if users < at_most and covers.sum() <= MOST_PAIRS:
        candidate, most = best_cover(covers, drones, limit_s, in_order)
        at_most = int(min(at_most, most))
        if candidate is not None:
            placement = max(candidate, placement, key=partial(covered, covers))
    return placement, at_most


def fair_cover(places: Spots, budget: int = BUDGET) -> FairCover | None:
    """Return the cells that earn most by R1, or None if there are too many drones to search.

    If the result is exact, its cells cover the most users among all cells with this reward.
    """
    drones, users = places.drones, places.users
    if drones > MOST_SHARING:
        return None
    sets, base = as_bits(places.held), users + 1
    best, none = undominated(sets), np.zeros(drones, np.int64)
    indices, key, proven = best_shares(sets[best], drones, users, 1, none, -1, budget)
    indices = best[indices]
    score, most = divmod(int(key), base)
    least = None
    if proven:
        # With sign -1 the key is score (users + 1) - covered, so that fewer users are better.
        start = score * base - most
        _, key, proven_least = best_shares(sets, drones, users, -1, indices, start, budget)
        least = score * base - int(key) if proven_least else None
    quota, rest = divmod(users, drones)
    top = (drones - rest) * drones * quota + rest * min(users, drones * (quota + 1))
    cells = places.cells_of(indices)
    return FairCover(cells, score, score if proven else top, most, least)
