"""The flights of the legs in the sky."""

from __future__ import annotations

from desim_uav.model.motion.motion import PieceRow
from desim_uav.model.radio.tracks import Flight
from desim_uav.rowcode.kernels import rule
from desim_uav.rowcode.rows import Table
from desim_uav.sky.rows import LegRow, Scene


@rule
def pieces_of(scene: Scene, leg: LegRow) -> Table[PieceRow]:
    """Return the pieces of a leg's transit."""
    return leg.pieces if leg.transit < 0 else scene.transits[leg.transit].pieces


@rule
def flight_of(scene: Scene, leg: LegRow) -> Flight:
    """Return a leg as a flight in three dimensions."""
    route = leg.x0_m, leg.y0_m, leg.z0_m, leg.x1_m, leg.y1_m, leg.z1_m
    return Flight(pieces_of(scene, leg), route, leg.since_us)
