"""The rows of a world that the kernels of the sky need (see ``sky.rows``), for both engines."""

from __future__ import annotations

from desim_uav.engine.constants import transit_row, transits_of
from desim_uav.model.motion.motion import TRAPEZOID
from desim_uav.model.radio.tracks import TRACK_COLUMNS
from desim_uav.rowcode.rows import Table, blank
from desim_uav.sky.rows import Leg, Piece, Scene, Sky, Turn
from desim_uav.sky.separation import most_turns
from desim_uav.world import World


def scene_of(world: World) -> Scene:
    """Return what the kernels of the sky know of a world."""
    scene = blank(Scene)
    scene.separation_m = world.scenario.separation_m or 0.0
    scene.transits = Table(map(transit_row, transits_of(world)))
    return scene


def sky_of(world: World) -> Sky:
    """Return the sky of an environment, whose legs are still to be written."""
    sky = blank(Sky)
    if world.scenario.separation_m is None:
        return sky
    pieces = most_pieces(world)
    sky.legs = Table(_leg(world, drone) for drone in range(world.scenario.drone_count))
    sky.tracks = Table([0.0] * (2 * (pieces + 1) * TRACK_COLUMNS))
    sky.turns = Table(blank(Turn) for _ in range(most_turns(pieces)))
    return sky


def most_pieces(world: World) -> int:
    """Return the number of pieces of the longest profile of a transit."""
    own = TRAPEZOID if world.free else 0
    return max(own, *(len(transit.profile) for transit in transits_of(world)))


def _leg(world: World, drone: int) -> Leg:
    """Return a leg of a drone, with memory for pieces of its own in free flight."""
    leg = blank(Leg)
    if world.type_of(drone).free:
        leg.pieces = Table(blank(Piece) for _ in range(TRAPEZOID))
    return leg
