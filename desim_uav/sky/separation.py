"""When two drones come nearer to each other than ``Scene.separation_m``, and part again."""

from __future__ import annotations

from typing import Any

from desim_uav.model.geometry.separation import approach, conflicts
from desim_uav.model.radio.tracks import fly
from desim_uav.rowcode.kernels import kernel, rule
from desim_uav.sky.flights import flight_of
from desim_uav.sky.memory import scene_at, sky_at
from desim_uav.sky.rows import Scene, Sky


@kernel
def meet(scene: int, sky: int, one: int, other: int, near: int, since_us: int, end_us: int) -> int:
    """Write to ``Sky.turns`` when two drones come too near or part, and return how often.

    The drones are on their legs from ``since_us`` to ``end_us``. ``near`` says whether they have
    been too near so far; if that is not so now, the first turn is at ``since_us``.
    """
    at, own, span = scene_at(scene), sky_at(sky), (since_us, end_us)
    mine, theirs = _fly(at, own, one, other, span)
    return conflicts(own.tracks, mine, theirs, at.separation_m, span, near, own.turns)


@kernel
def least_m(scene: int, sky: int, one: int, other: int, since_us: int, end_us: int) -> float:
    """Return the least distance of two drones in a part of their legs, in metres."""
    own = sky_at(sky)
    mine, theirs = _fly(scene_at(scene), own, one, other, (since_us, end_us))
    return float(approach(own.tracks, mine, theirs, 0.0, (end_us - since_us) * 1e-6).distance_m)


def most_turns(pieces: int) -> int:
    """Return how often two drones come too near or part in a window at most.

    Their squared distance is a polynomial of degree 4 between any two of the times at which the
    window begins or ends or one of them begins a piece. Transits have at most so many ``pieces``.
    """
    return 4 * (2 * pieces + 1) + 2


@rule
def _fly(scene: Scene, sky: Sky, one: int, other: int, span_us: tuple[int, int]) -> Any:
    """Write the tracks of two drones in a span, and return the rows of each."""
    mine = (0, fly(flight_of(scene, sky.legs[one]), span_us, sky.tracks, 0))
    after = fly(flight_of(scene, sky.legs[other]), span_us, sky.tracks, mine[1])
    return mine, (mine[1], after)
