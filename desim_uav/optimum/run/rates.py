"""How fast users can send to a drone on each leg of its flight, at most.

A leg is cut into pieces of equal time. In a piece a user sends at most at the rate that it has
where the drone is nearest to it, if it has the whole bandwidth.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.drone_type import DroneType
from desim_uav.model.motion.motion import REST, travelled
from desim_uav.model.rules import MOVES, kind_of
from desim_uav.optimum.run.legs import HEADINGS, cells_ahead
from desim_uav.world import World

PIECES = 4
"""The number of pieces of a leg."""

MARGIN_M = 1e-3
"""By how much a user may be nearer to a drone because of rounding."""


class Rates(NamedTuple):
    """What users send over the links of a drone.

    ``ahead`` (cells, legs): the cell to which each leg leads, or -1. ``mbps`` (cells, legs,
    PIECES, users): the highest rate in each piece of a leg, in Mbit/s.
    """

    ahead: NDArray[np.int64]
    mbps: NDArray[np.float64]


def rates_of(world: World, kind: DroneType, places_m: NDArray[np.float64]) -> Rates:
    """Return the rates of users who stand at ``places_m`` (users, 2) to drones of a type."""
    ahead = cells_ahead(world.grid)
    nx, ny = world.grid.cells
    centres = np.array([world.grid.centre(ix, iy) for ix in range(nx) for iy in range(ny)])
    nearest = np.full((*ahead.shape, PIECES, len(places_m)), np.inf)
    for leg, passed in enumerate(_passed_m(world, kind)):
        way = np.array(MOVES.get(HEADINGS[leg], (0, 0, 0))[:2], float)
        for piece in range(PIECES):
            begins, ends = (centres + passed[piece + at] * way for at in (0, 1))
            nearest[:, leg, piece] = _distance_m(begins, ends, places_m)
    nearest[ahead < 0] = np.inf
    return Rates(ahead, _mbps(world, kind, nearest - MARGIN_M))


def _passed_m(world: World, kind: DroneType) -> list[NDArray[np.float64]]:
    """Return how far a drone has flown at the ends of all pieces of each leg."""
    flown = {kind_of(choice): transit for choice, transit in kind.epoch_transits.items()}
    times_s = np.linspace(0.0, 1e-6 * world.step_us, PIECES + 1)
    profiles = [flown[heading].rows if heading in flown else REST.rows for heading in HEADINGS]
    return [np.array([travelled(rows, float(t)) for t in times_s]) for rows in profiles]


def _distance_m(
    begins: NDArray[np.float64], ends: NDArray[np.float64], places: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the least distances (segments, places) of places from straight segments."""
    way = ends - begins
    length2 = np.maximum((way**2).sum(-1), 1e-12)
    along = ((places[None] - begins[:, None]) * way[:, None]).sum(-1) / length2[:, None]
    at = begins[:, None] + along.clip(0.0, 1.0)[..., None] * way[:, None]
    distance_m: NDArray[np.float64] = np.sqrt(((places[None] - at) ** 2).sum(-1))
    return distance_m


def _mbps(world: World, kind: DroneType, distance_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rates at distances, with the whole bandwidth."""
    radio: Any = kind.drones.radio
    links = world.links[world.types.index(kind)]
    rings_m = links.rings_m.max((0, 1))
    efficiencies = np.array([0.0, *np.array(radio.efficiencies()) / 1e6])
    classes = (distance_m[..., None] <= rings_m).sum(-1)
    bandwidth_mhz = (radio.uplink_hz or links.bandwidth_hz) / 1e6
    mbps: NDArray[np.float64] = efficiencies[classes] * bandwidth_mhz
    return mbps
