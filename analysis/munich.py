"""Do lines of sight past the buildings of Sionna's scene `munich` agree with Sionna RT?

    pip install sionna-rt
    python analysis/munich.py [--links 100000] [--seed 0]

The scene comes with Sionna RT, and so do the rays: paths of depth 0. Its buildings with flat roofs
and upright walls are taken as they are, and the others are left out on both sides, because cities
of desim-uav have no other roofs. Drones hover above the roofs in the middle of the map, and users
stand outside of buildings. Prints how many links are blocked, and for each link that differs, by
how much it passes through a building or misses all of them. On a processor Sionna RT needs LLVM,
whose library DRJIT_LIBLLVM_PATH names: version 14 was too old, and 19 was used. Exits with 6 if a
link differs that passes or misses a building by more than 1 cm.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from desim_uav.city.footprints import convex_pieces
from desim_uav.model.geometry.city import City
from desim_uav.model.radio.buildings import buffers_for, pieces_as_prisms
from desim_uav.model.radio.sight import BLOCKED, state_at
from desim_uav.model.radio.tracks import TrackRow
from desim_uav.rowcode.views import zeros

HALF_M = 500.0
"""Links are in a square of twice this size, in the middle of the scene."""

USER_M, DRONES_M = 1.5, (40.0, 150.0)
"""The height of users, and the heights of drones, of which each has links with USERS users."""

USERS = 1000
NEAR_M = 0.01
"""A link may differ if it passes or misses a building by at most this much, because Sionna RT
computes with single precision, in which places on the map are 0.06 mm apart."""

Lines = NDArray[np.float64]
"""Users and drones: (links, 2, 3), in metres."""


def main() -> int:
    """Compare, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--links", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    try:
        from sionna import rt
    except ImportError:
        print("munich.py: needs Sionna RT: pip install sionna-rt", file=sys.stderr)
        return 5
    scene = rt.load_scene(rt.scene.munich, merge_shapes=False)
    buildings, others = buildings_of(scene)
    scene.edit(remove=others)
    print(f"{len(buildings)} buildings, {len(others)} objects of the scene left out")
    users, drones = places(buildings, asked.links, np.random.default_rng(asked.seed))
    blocked_there = ~seen_by_sionna(rt, scene, users, drones).ravel()
    lines = np.stack(
        [np.tile(users, (len(drones), 1)), np.repeat(drones, len(users), axis=0)], axis=1
    )
    blocked_here = blocked(buildings, lines)
    differ = np.flatnonzero(blocked_here != blocked_there)
    print(f"{len(lines)} links, {blocked_here.sum()} blocked; {len(differ)} differ")
    depths_m = [deepest_m(buildings, line) for line in lines[differ]]
    for link, depth_m in zip(differ.tolist(), depths_m, strict=True):
        print(f"  link {link}: {1e3 * depth_m:.3f} mm in a building (below 0: beside or over all)")
    return 6 if any(abs(depth_m) > NEAR_M for depth_m in depths_m) else 0


def buildings_of(scene: Any) -> tuple[list[tuple[Any, float]], list[Any]]:
    """Return the outlines and heights of buildings with flat roofs, and all other objects."""
    parts: dict[str, list[Any]] = {}
    for name, thing in scene.objects.items():
        parts.setdefault(name.rpartition("-itu_")[0] or name, []).append(thing)
    buildings, others = [], []
    for things in parts.values():
        prism = prism_of(np.concatenate([triangles_of(one) for one in things]))
        if prism is None:
            others += things
        else:
            buildings.append(prism)
    return buildings, others


def triangles_of(thing: Any) -> Lines:
    """Return the triangles of an object: (triangles, 3, 3), in metres."""
    mesh = thing.mi_mesh
    corners = np.array(mesh.vertex_positions_buffer(), float).reshape(-1, 3)
    return corners[np.array(mesh.faces_buffer()).reshape(-1, 3)]


def prism_of(triangles: Lines) -> tuple[Any, float] | None:
    """Return the outline and the height of a building on the ground, or None for another shape.

    Its triangles are walls from the ground to the roof, which are upright, and a flat roof.
    """
    z = triangles[..., 2]
    roof_m, level = float(z.max()), np.ptp(z, axis=1) == 0.0
    roof = level & (z[:, 0] == roof_m)
    walls = triangles[~level]
    if roof_m <= 0.0 or not len(walls) or not np.isin(z, (0.0, roof_m)).all():
        return None
    outline = shapely.union_all(shapely.polygons(triangles[roof, :, :2]))
    plain = [shapely.LineString(one[:, :2]) for one in walls]
    on_walls = shapely.union_all(plain)
    if outline.geom_type != "Polygon" or shapely.hausdorff_distance(outline.boundary, on_walls) > 0:
        return None
    return outline, roof_m


def places(
    buildings: list[tuple[Any, float]], links: int, rng: np.random.Generator
) -> tuple[Lines, Lines]:
    """Return users outside of buildings, and drones."""
    built = shapely.union_all([outline for outline, _ in buildings])
    shapely.prepare(built)
    users = rng.uniform(-HALF_M, HALF_M, (4 * USERS, 2))
    users = users[~shapely.intersects_xy(built, users)][:USERS]
    low, high = (-HALF_M, -HALF_M, DRONES_M[0]), (HALF_M, HALF_M, DRONES_M[1])
    drones = rng.uniform(low, high, (max(1, links // len(users)), 3))
    heights = np.full((len(users), 1), USER_M)
    # Single precision, so that both see the same places.
    return (
        np.hstack([users, heights]).astype(np.float32).astype(float),
        drones.astype(np.float32).astype(float),
    )


def seen_by_sionna(rt: Any, scene: Any, users: Lines, drones: Lines) -> NDArray[np.bool_]:
    """Return for each drone and user whether Sionna RT finds a path of depth 0 between them."""
    scene.tx_array = scene.rx_array = rt.PlanarArray(
        num_rows=1, num_cols=1, pattern="iso", polarization="V"
    )
    for number, place in enumerate(users.tolist()):
        scene.add(rt.Receiver(f"user {number}", position=place))
    found = []
    for place in drones.tolist():
        scene.add(rt.Transmitter("drone", position=place))
        paths = rt.PathSolver()(
            scene, max_depth=0, specular_reflection=False, refraction=False, los=True
        )
        valid = np.array(paths.valid).reshape(len(users), -1)
        found.append(valid.any(axis=1))
        scene.remove("drone")
    return np.array(found)


def blocked(buildings: list[tuple[Any, float]], lines: Lines) -> NDArray[np.bool_]:
    """Return for each line whether desim-uav finds it blocked."""
    origin = np.array([-2000.0, -2000.0])
    pieces: list[Any] = []
    roofs_m: list[float] = []
    for number, (outline, roof_m) in enumerate(buildings):
        moved = shapely.transform(outline, lambda places: places - origin)
        own = convex_pieces(moved, f"building {number}")
        pieces += own
        roofs_m += [roof_m] * len(own)
    city = City(tuple(pieces), np.array(roofs_m))
    prisms = pieces_as_prisms(city.blocking_m, city.roofs_m, (4000.0, 4000.0))
    buffers, rows = buffers_for(prisms.offsets, 1000), zeros(TrackRow, 2)
    found = np.zeros(len(lines), bool)
    for k, ends in enumerate((lines - (*origin, 0.0)).tolist()):
        for row, end in zip((rows[0], rows[1]), ends, strict=True):
            row.x_m, row.y_m, row.z_m = end
        found[k] = state_at(rows[0], rows[1], 0.0, prisms, buffers) == BLOCKED
    return found


def deepest_m(buildings: list[tuple[Any, float]], line: Lines) -> float:
    """Return how deep a line is in a building: in length or below its roof, the smaller of both.

    It is below 0 if the line is beside or over all buildings.
    """
    (x0, y0, z0), (x1, y1, z1) = line.tolist()
    way, deepest = shapely.LineString([(x0, y0), (x1, y1)]), -np.inf
    for outline, roof_m in buildings:
        stretches = shapely.get_parts(way.intersection(outline))
        for part in stretches[~shapely.is_empty(stretches)]:
            ends = [way.project(shapely.Point(one), normalized=True) for one in part.coords]
            lowest = min(z0 + share * (z1 - z0) for share in ends)
            deepest = max(deepest, min(part.length, roof_m - lowest))
        if way.disjoint(outline):
            deepest = max(deepest, -way.distance(outline))
    return float(deepest)


if __name__ == "__main__":
    sys.exit(main())
