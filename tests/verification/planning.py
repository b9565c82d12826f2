"""Returns planned by A* against networkx's shortest paths (Dijkstra)."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import cache

import networkx as nx
import numpy as np

from desim_uav.model.geometry.grid import Grid, altitudes
from desim_uav.model.motion.planner import Planner
from tests.verification.figure import Exact, Figure

HOPS = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
MAPS = 1000


def figures(quick: bool = False) -> Iterator[Figure]:
    """On random maps in 3D: the quickest way to a station, or that there is none."""
    cases = surveyed(200 if quick else MAPS)
    plans = [plan for *_, plan, _ in cases]
    quickest = [
        min(((t, k) for k, t in enumerate(times) if t is not None), default=None)
        for *_, times in cases
    ]
    ours = [plan and (plan.duration_us, plan.station) for plan in plans]
    unlike = sum(one != other for one, other in zip(ours, quickest, strict=True))
    yield Exact("maps with a different time or station", unlike, 0, cases=len(cases))
    no_way = sum(way is None for way in quickest)
    yield Exact("maps without a path", plans.count(None), no_way, cases=len(cases))
    total = sum(way[0] for way in quickest if way) / 1e6
    own = sum(plan.duration_us for plan in plans if plan) / 1e6
    yield Exact("sum of the shortest times, s", own, total, cases=len(cases) - no_way)


def random_grid(rng):
    """Up to 8 x 8 cells of which many are built, up to some five levels."""
    shape = rng.integers(1, 9, 2)
    heights = rng.uniform(0.0, rng.choice([15.0, 35.0, 60.0]), shape)
    heights[rng.random(shape) > rng.uniform(0.0, 0.7)] = 0.0
    # Some exactly as tall as a level: that level is not free.
    heights[(rng.random(shape) < 0.2) & (heights > 0.0)] = 30.0
    levels, under = altitudes(20.0, 10.0, heights.max())
    return Grid(240.0 * shape[0], 240.0 * shape[1], heights, levels, 10.0, under)


def free_graph(grid, hop_us, ceiling):
    """Every node there is, with an edge into each free neighbour; weights are hop times."""
    levels = [z for z in grid.levels_m if not ceiling or z <= grid.height_m.max() or z == 20.0]
    (columns, rows), graph = grid.height_m.shape, nx.DiGraph()
    free = {
        (x, y, k)
        for x, y, (k, z) in itertools.product(range(columns), range(rows), enumerate(levels))
        if grid.height_m[x, y] == 0.0 or z > grid.height_m[x, y]
    }
    every = set(itertools.product(range(columns), range(rows), range(len(levels))))
    graph.add_nodes_from(every)
    for node in every:
        for hop in HOPS:
            neighbour = tuple(a + b for a, b in zip(node, hop, strict=True))
            if neighbour in free:
                graph.add_edge(node, neighbour, weight=hop_us[HOPS.index(hop)])
    return graph


@cache
def surveyed(maps=MAPS, windy=False):
    """Random maps: (graph, hop times, start, stations, plan, Dijkstra's times).

    If it is windy, hops there and back take different times.
    """
    rng = np.random.default_rng(1959)
    found = []
    for _ in range(maps):
        grid = random_grid(rng)
        hop_us = tuple(rng.integers(1, 60_000_000, 3).tolist())
        if rng.random() < 0.3:
            hop_us = (hop_us[0],) * 3
        each_us = rng.integers(1, 60_000_000, 6) if windy else np.repeat(hop_us, 2)
        hop_us = tuple(each_us.tolist())
        ceiling = bool(rng.random() < 0.7)
        graph = free_graph(grid, hop_us, ceiling)
        nodes = sorted(graph)
        start = nodes[rng.integers(len(nodes))]
        ground = [(x, y) for x, y, k in nodes if k == 0]
        chosen = rng.choice(len(ground), size=min(len(ground), rng.integers(1, 4)), replace=False)
        stations = [ground[k] for k in chosen]
        plan = Planner(grid, stations, hop_us).plan(start, ceiling)
        times = nx.single_source_dijkstra_path_length(graph, start)
        found.append((graph, hop_us, start, stations, plan, [times.get((*s, 0)) for s in stations]))
    return found
