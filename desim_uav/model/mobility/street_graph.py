"""A graph of streets on a map: streets between junctions, and the lengths of shortest ways."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from desim_uav.model.mobility.walks import Area
from desim_uav.rowcode.kernels import maker

MOST_JUNCTIONS = 2000
"""The most junctions of a graph: its table of lengths has the square of this number of entries."""

LEAST_M = 1e-3
"""Shorter pieces of a street are left out."""

Point = tuple[float, float]


class StreetWay(NamedTuple):
    """A line of points in metres along which users move, in both directions or forwards only."""

    points: tuple[Point, ...]
    one_way: bool = False


class StreetGraph(NamedTuple):
    """Streets between junctions.

    Street s has the points ``first[s]:first[s + 1]``: ``places_m`` (points, 2), and ``along_m``
    (points,), the length of the street up to each of them. It leads from the junction ``tails[s]``
    to ``heads[s]``; if ``one_way[s]``, in this direction only. From junction j lead the arcs
    ``arcs_at[j]:arcs_at[j + 1]``: arc 2 s is street s forwards, 2 s + 1 backwards. ``lengths_m``
    (junctions, junctions) are those of the shortest ways from the one to the other.
    """

    places_m: NDArray[np.float64]
    along_m: NDArray[np.float64]
    first: NDArray[np.int64]
    tails: NDArray[np.int64]
    heads: NDArray[np.int64]
    one_way: NDArray[np.bool_]
    arcs: NDArray[np.int64]
    arcs_at: NDArray[np.int64]
    lengths_m: NDArray[np.float64]

    @property
    def street_m(self) -> NDArray[np.float64]:
        """The lengths of the streets, in metres."""
        return self.along_m[self.first[1:] - 1]


class Reachable(NamedTuple):
    """A graph, and the length of the streets that are left out because they lead nowhere else."""

    graph: StreetGraph
    left_out_m: float


def graph_of(ways: Iterable[StreetWay]) -> Reachable:
    """Return the graph of ways, which meet where they have a point in common.

    Only the largest part remains in which every junction can be reached from every other one.
    Raises ValueError if no street or more than MOST_JUNCTIONS junctions remain.
    """
    streets = _between_junctions(list(ways))
    if not streets:
        raise ValueError("there are no streets")
    numbers = {point: number for number, point in enumerate(_ends(streets))}
    part_of = _parts(streets, numbers)
    lengths: Counter[int] = Counter()
    for street in streets:
        tail, head = (part_of[numbers[street.points[end]]] for end in (0, -1))
        if tail == head:
            lengths[tail] += round(1e6 * _length(street.points))
    if not lengths:
        raise ValueError("no street can be entered again after it has been left: all are one-way")
    largest = max(lengths, key=lambda part: (lengths[part], -part))
    kept = [s for s in streets if {part_of[numbers[s.points[end]]] for end in (0, -1)} == {largest}]
    kept = _joined(kept)
    junctions = list(_ends(kept))
    if len(junctions) > MOST_JUNCTIONS:
        raise ValueError(
            f"there are {len(junctions)} junctions, more than {MOST_JUNCTIONS}; take a smaller map"
        )
    whole_m = sum(_length(street.points) for street in streets)
    return Reachable(
        _graph(kept, junctions), whole_m - sum(_length(street.points) for street in kept)
    )


def cut(ways: Iterable[StreetWay], area: Area) -> list[StreetWay]:
    """Return what lies on a map of ways that may lead off it."""
    inside: list[StreetWay] = []
    for way in ways:
        points: list[Point] = []
        for start, stop in pairwise(way.points):
            piece = _on_map(start, stop, area)
            if piece is None or (points and piece[0] != points[-1]):
                inside += [StreetWay(tuple(points), way.one_way)] if len(points) > 1 else []
                points = []
            if piece is not None:
                points += [piece[1]] if points else list(piece)
        inside += [StreetWay(tuple(points), way.one_way)] if len(points) > 1 else []
    return inside


def _on_map(start: Point, stop: Point, area: Area) -> tuple[Point, Point] | None:
    """Return the part of a line on the map; None if there is none (Liang and Barsky 1984)."""
    since, until = 0.0, 1.0
    for at, to, size in zip(start, stop, area, strict=True):
        for far, over in ((at - to, at), (to - at, size - at)):
            if far == 0.0:
                if over < 0.0:
                    return None
            elif far < 0.0:
                since = max(since, over / far)
            else:
                until = min(until, over / far)
    if since >= until:
        return None
    ends = start if since == 0.0 else _at(start, stop, since, area)
    return ends, (stop if until == 1.0 else _at(start, stop, until, area))


def _at(start: Point, stop: Point, share: float, area: Area) -> Point:
    x, y = (
        min(max(a + share * (b - a), 0.0), size)
        for a, b, size in zip(start, stop, area, strict=True)
    )
    return x, y


def _between_junctions(ways: Sequence[StreetWay]) -> list[StreetWay]:
    """Return ways cut at all points that several ways have, or one way several times.

    Two one-way streets along the same line, in opposite directions, are one street.
    """
    clean = [way for way in map(_without_repeats, ways) if len(way.points) > 1]
    uses = Counter(point for way in clean for point in way.points)
    uses.update(point for way in clean for point in (way.points[0], way.points[-1]))
    one_way: dict[tuple[Point, ...], bool] = {}
    for way in clean:
        start = 0
        for k in range(1, len(way.points)):
            if uses[way.points[k]] > 1:
                piece = way.points[start : k + 1]
                if piece[::-1] in one_way:
                    one_way[piece[::-1]] = False
                else:
                    one_way[piece] = one_way.get(piece, True) and way.one_way
                start = k
    return [StreetWay(*street) for street in one_way.items()]


def _joined(streets: Sequence[StreetWay]) -> list[StreetWay]:
    """Return streets of which two that meet where no third one does are one."""
    joined: list[StreetWay | None] = list(streets)
    at: dict[Point, list[int]] = {}
    for number, street in enumerate(streets):
        for end in (0, -1):
            at.setdefault(street.points[end], []).append(number)
    for point, meeting in at.items():
        if len(meeting) != 2 or meeting[0] == meeting[1]:
            continue
        one, other = sorted(meeting)
        first, second = joined[one], joined[other]
        assert first and second
        whole = _one_of_two(first, second, point)
        if whole is not None:
            joined[one], joined[other] = whole, None
            far = second.points[0 if second.points[-1] == point else -1]
            at[far][at[far].index(other)] = one
    return [street for street in joined if street is not None]


def _one_of_two(first: StreetWay, second: StreetWay, point: Point) -> StreetWay | None:
    """Return two streets that meet at a point as one; None if they lead in different directions."""
    if first.one_way != second.one_way:
        return None
    turned = first.points[-1] != point, second.points[0] != point
    if first.one_way and turned == (True, True):
        return StreetWay(second.points + first.points[1:], True)
    if first.one_way and any(turned):
        return None
    before = first.points[::-1] if turned[0] else first.points
    after = second.points[::-1] if turned[1] else second.points
    return StreetWay(before + after[1:], first.one_way)


def _without_repeats(way: StreetWay) -> StreetWay:
    points = [way.points[0]]
    for x, y in way.points[1:]:
        if abs(x - points[-1][0]) + abs(y - points[-1][1]) > LEAST_M:
            points.append((x, y))
    return StreetWay(tuple(points), way.one_way)


def _ends(streets: Sequence[StreetWay]) -> dict[Point, None]:
    """Return the ends of streets, in the order in which they first appear."""
    return dict.fromkeys(street.points[end] for street in streets for end in (0, -1))


def _length(points: Sequence[Point]) -> float:
    return float(np.hypot(*np.diff(np.array(points), axis=0).T).sum())


def _parts(streets: Sequence[StreetWay], numbers: dict[Point, int]) -> NDArray[np.int64]:
    """Return for each end the number of the part whose ends can all reach one another."""
    tails = [numbers[s.points[0]] for s in streets]
    heads = [numbers[s.points[-1]] for s in streets]
    back = [(h, t) for s, t, h in zip(streets, tails, heads, strict=True) if not s.one_way]
    arcs = np.array([*zip(tails, heads, strict=True), *back]).T
    table = csr_array((np.ones(arcs.shape[1]), arcs), shape=(len(numbers), len(numbers)))
    parts: NDArray[np.int64] = connected_components(table, connection="strong")[1]
    return parts


def _graph(streets: Sequence[StreetWay], junctions: Sequence[Point]) -> StreetGraph:
    """Return the graph of streets that are all of one part."""
    numbers = {point: number for number, point in enumerate(junctions)}
    counts = [len(street.points) for street in streets]
    along = [_along(street.points) for street in streets]
    tails = np.array([numbers[street.points[0]] for street in streets])
    heads = np.array([numbers[street.points[-1]] for street in streets])
    leaving: list[list[int]] = [[] for _ in junctions]
    for number, street in enumerate(streets):
        leaving[tails[number]].append(2 * number)
        if not street.one_way:
            leaving[heads[number]].append(2 * number + 1)
    arcs = np.array([arc for own in leaving for arc in own])
    arcs_at = np.cumsum([0, *map(len, leaving)])
    long_m = np.array([own[-1] for own in along])
    return StreetGraph(
        np.array([point for street in streets for point in street.points]),
        np.concatenate(along),
        np.cumsum([0, *counts]),
        tails,
        heads,
        np.array([street.one_way for street in streets]),
        arcs,
        arcs_at,
        lengths_between(arcs, arcs_at, tails, heads, long_m),
    )


def _along(points: Sequence[Point]) -> NDArray[np.float64]:
    x, y = np.diff(np.array(points), axis=0).T
    return np.concatenate([[0.0], np.cumsum(np.sqrt(x * x + y * y))])


@maker
def lengths_between(
    arcs: NDArray[np.int64],
    arcs_at: NDArray[np.int64],
    tails: NDArray[np.int64],
    heads: NDArray[np.int64],
    long_m: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the lengths of the shortest ways between all junctions: (junctions, junctions).

    From each junction on, those whose length has decreased wait in a queue for their neighbours to
    be looked at (Pape 1974, with a queue in place of a stack).
    """
    count = len(arcs_at) - 1
    lengths_m = np.full((count, count), np.inf)
    queue = np.empty(count, np.int64)
    waits = np.zeros(count, np.bool_)
    for source in range(count):
        own = lengths_m[source]
        own[source] = 0.0
        queue[0], waits[source] = source, True
        first, last = 0, 1
        while first < last:
            here = queue[first % count]
            first += 1
            waits[here] = False
            for k in range(arcs_at[here], arcs_at[here + 1]):
                street = arcs[k] // 2
                there = heads[street] if arcs[k] % 2 == 0 else tails[street]
                through = own[here] + long_m[street]
                if through < own[there]:
                    own[there] = through
                    if not waits[there]:
                        queue[last % count], waits[there] = there, True
                        last += 1
    return lengths_m
