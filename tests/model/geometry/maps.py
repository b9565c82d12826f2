"""Maps of buildings and zones at random, and the truth about them by own formulas."""

from dataclasses import dataclass

import networkx
import numpy as np

from desim_uav.model.geometry.prisms import Zone, obstacles


@dataclass(frozen=True)
class Town:
    """Buildings as rectangles (x0, y0, x1, y1, roof), zones (corners, low, high), and a margin."""

    height_m: np.ndarray
    cell_m: tuple
    zones: list
    margin_m: float

    @property
    def size_m(self):
        nx, ny = self.height_m.shape
        return nx * self.cell_m[0], ny * self.cell_m[1]

    def prisms(self):
        """The same for the package."""
        return obstacles(
            self.height_m, self.cell_m, [Zone(*one) for one in self.zones], self.margin_m
        )

    def footprints(self, z=None):
        """(corners, low, high) of all obstacles, or of those within a margin of an altitude."""
        nx, ny = self.height_m.shape
        dx, dy = self.cell_m
        square = np.array([(0.0, 0.0), (dx, 0.0), (dx, dy), (0.0, dy)])
        found = [
            (square + np.array((ix * dx, iy * dy)), -np.inf, self.height_m[ix, iy])
            for ix in range(nx)
            for iy in range(ny)
            if self.height_m[ix, iy] > 0.0
        ]
        found += [(np.array(corners), low, high) for corners, low, high in self.zones]
        if z is None:
            return found
        return [one for one in found if one[1] - self.margin_m < z < one[2] + self.margin_m]

    def clearance_m(self, places, z=None, slack_m=1e-5):
        """How far places (n, 2), or (n, 3), are from the obstacles at their altitudes.

        These are the obstacles that are there within the margin, but for ``slack_m``.
        """
        least = np.full(len(places), np.inf)
        heights = places[:, 2] if z is None else np.full(len(places), z)
        for corners, low, high in self.footprints():
            beyond = self.margin_m - slack_m
            beside = (heights > low - beyond) & (heights < high + beyond)
            away = distances(places[:, :2], corners)
            least = np.where(beside, np.minimum(least, away), least)
        return least


def distances(places, corners):
    """The distance of places (n, 2) from a polygon, 0 inside (by the rule of even and odd)."""
    following = np.roll(corners, -1, axis=0)
    ahead = following - corners
    share = ((places[:, None] - corners) * ahead).sum(axis=2) / (ahead**2).sum(axis=1)
    foot = corners + ahead * share.clip(0.0, 1.0)[..., None]
    away = np.hypot(*np.moveaxis(places[:, None] - foot, 2, 0)).min(axis=1)
    (x, y), (cx, cy), (fx, fy) = places.T, corners.T, following.T
    with np.errstate(divide="ignore", invalid="ignore"):
        at = cx + (y[:, None] - cy) * (fx - cx) / (fy - cy)
    passes = ((cy > y[:, None]) != (fy > y[:, None])) & (x[:, None] < at)
    return np.where(passes.sum(axis=1) % 2 == 1, 0.0, away)


def star(rng, centre, size):
    """A simple polygon, hardly ever convex, counterclockwise or clockwise."""
    count = int(rng.integers(3, 11))
    turns = np.sort(rng.uniform(0.0, 2 * np.pi, count))
    gaps = np.diff(np.append(turns, turns[0] + 2 * np.pi))
    if gaps.min() < 0.15 or gaps.max() > 2.8:
        return star(rng, centre, size)
    far = size * rng.uniform(0.25, 1.0, count)
    corners = centre + far[:, None] * np.column_stack([np.cos(turns), np.sin(turns)])
    return corners[:: rng.choice([1, -1])]


def random_town(rng):
    """Some built cells and some zones."""
    nx, ny = rng.integers(3, 11, 2)
    cell_m = tuple(rng.uniform(30.0, 120.0, 2).tolist())
    built = rng.random((nx, ny)) < rng.uniform(0.0, 0.35)
    roofs = rng.choice([rng.uniform(20.0, 90.0), *rng.uniform(20.0, 90.0, 3)], (nx, ny))
    size = np.array(cell_m) * (nx, ny)
    zones = []
    for _ in range(rng.integers(0, 5)):
        low = rng.choice([-np.inf, rng.uniform(0.0, 60.0)])
        high = rng.choice([np.inf, max(low, 0.0) + rng.uniform(5.0, 60.0)])
        zones.append((star(rng, rng.uniform(0.0, size), 0.25 * size.min()), low, high))
    margin = rng.uniform(0.5, 8.0)
    return Town(built * roofs, cell_m, zones, margin)


# ---- convex polygons, and straight lines past them


def pieces(prisms, z=None):
    """The grown convex polygons, or those that stand at an altitude."""
    found = zip(prisms.offsets[:-1], prisms.offsets[1:], prisms.heights_m, strict=True)
    return [
        prisms.corners_m[first:last]
        for first, last, (low, high) in found
        if z is None or low < z < high
    ]


def depths(places, convex):
    """How deep places (n, 2) are in a convex, counterclockwise polygon."""
    ahead = np.roll(convex, -1, axis=0) - convex
    apart = places[:, None] - convex
    cross = ahead[:, 0] * apart[..., 1] - ahead[:, 1] * apart[..., 0]
    return (cross / np.hypot(*ahead.T)).min(axis=1)


def cuts(starts, stops, convex):
    """Whether straight lines (n, 2) to (n, 2) get deeper than 2 um into a convex polygon."""
    ahead = np.roll(convex, -1, axis=0) - convex
    near = ahead[:, 0] * (starts[:, None] - convex)[..., 1]
    near = near - ahead[:, 1] * (starts[:, None] - convex)[..., 0]
    far = ahead[:, 0] * (stops[:, None] - convex)[..., 1]
    far = far - ahead[:, 1] * (stops[:, None] - convex)[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = near / (near - far)
    begin = np.where(far > near, share, 0.0).max(axis=1).clip(0.0)
    end = np.where(far < near, share, 1.0).min(axis=1).clip(max=1.0)
    outside = ((near <= 0.0) & (far <= 0.0)).any(axis=1) | (begin >= end)
    middle = starts + (0.5 * (begin + end))[:, None] * (stops - starts)
    return ~outside & (depths(middle, convex) > 2e-6)


def sees(starts, stops, polygons):
    """Whether lines pass no polygon."""
    free = np.ones(len(starts), bool)
    for convex in polygons:
        free &= ~cuts(starts, stops, convex)
    return free


def graph_of(nodes, polygons):
    """A networkx graph of all nodes that see each other."""
    one, other = np.triu_indices(len(nodes), 1)
    free = sees(nodes[one], nodes[other], polygons)
    lengths = np.hypot(*(nodes[one] - nodes[other]).T)
    graph = networkx.Graph()
    graph.add_nodes_from(range(len(nodes)))
    rows = zip(one[free].tolist(), other[free].tolist(), lengths[free].tolist(), strict=True)
    graph.add_weighted_edges_from(rows)
    return graph


def shortest(graph, start, goal):
    """The length of the shortest way, inf if there is none."""
    try:
        return networkx.dijkstra_path_length(graph, start, goal)
    except networkx.NetworkXNoPath:
        return np.inf
