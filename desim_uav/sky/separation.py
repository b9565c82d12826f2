"""When two drones come nearer to each other than ``Scene.separation_m``, and part again."""

from __future__ import annotations

from typing import Any

from desim_uav.model.geometry.separation import approach, conflicts
from desim_uav.model.radio.tracks import TRACK_COLUMNS, Flight, fly
from desim_uav.rowcode.compiled_rows import as_array, pointer_to
from desim_uav.rowcode.kernels import kernel, rule
from desim_uav.sky.rows import Leg, Scene, Sky

PIECE_COLUMNS, TURN_COLUMNS = 4, 2

scene_at: Any = pointer_to(Scene)
sky_at: Any = pointer_to(Sky)


@kernel
def meet(scene: int, sky: int, one: int, other: int, near: int, since_us: int, end_us: int) -> int:
    """Write to ``Sky.turns`` when two drones come too near or part, and return how often.

    The drones are on their legs from ``since_us`` to ``end_us``. ``near`` says whether they have
    been too near so far; if that is not so now, the first turn is at ``since_us``.
    """
    at, own, span = scene_at(scene), sky_at(sky), (since_us, end_us)
    tracks, mine, theirs = _fly(at, own, one, other, span)
    turns = as_array(own.turns, (len(own.turns), TURN_COLUMNS))
    return conflicts(tracks, mine, theirs, at.separation_m, span, near, turns)


@kernel
def least_m(scene: int, sky: int, one: int, other: int, since_us: int, end_us: int) -> float:
    """Return the least distance of two drones in a part of their legs, in metres."""
    tracks, mine, theirs = _fly(scene_at(scene), sky_at(sky), one, other, (since_us, end_us))
    return float(approach(tracks, mine, theirs, 0.0, (end_us - since_us) * 1e-6).distance_m)


def most_turns(pieces: int) -> int:
    """Return how often two drones come too near or part in a window at most.

    Their squared distance is a polynomial of degree 4 between any two of the times at which the
    window begins or ends or one of them begins a piece. Transits have at most so many ``pieces``.
    """
    return 4 * (2 * pieces + 1) + 2


@rule
def _fly(scene: Scene, sky: Sky, one: int, other: int, span_us: tuple[int, int]) -> Any:
    """Write the tracks of two drones in a span; return the table, and the rows of each."""
    tracks = as_array(sky.tracks, (len(sky.tracks) // TRACK_COLUMNS, TRACK_COLUMNS))
    mine = (0, fly(_flight(scene, sky.legs[one]), span_us, tracks, 0))
    theirs = (mine[1], fly(_flight(scene, sky.legs[other]), span_us, tracks, mine[1]))
    return tracks, mine, theirs


@rule
def _flight(scene: Scene, leg: Leg) -> Flight:
    """Return a leg as a flight in three dimensions."""
    pieces = leg.pieces if leg.transit < 0 else scene.transits[leg.transit].pieces
    route = leg.x0_m, leg.y0_m, leg.z0_m, leg.x1_m, leg.y1_m, leg.z1_m
    return Flight(as_array(pieces, (len(pieces), PIECE_COLUMNS)), route, leg.since_us)
