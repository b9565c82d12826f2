"""Free flight in the SimPy engine."""

from __future__ import annotations

from typing import Any

import numpy as np

from desim_uav.model.motion.motion import Transit
from desim_uav.world import World


def set_free(constants: Any, world: World) -> None:
    """Set what the constants have for free flight: spaces as they are."""
    constants.spaces = [own.space if own.free else None for own in world.types]


def transit_of(flight: Any) -> Transit:
    """Return the row of a transit as one."""
    profile = [
        (piece.start_s, piece.from_m, piece.speed_mps, piece.acceleration_mps2)
        for piece in flight.pieces
    ]
    return Transit(
        np.array(profile),
        flight.duration_us,
        flight.distance_m,
        flight.rises,
        flight.tail_mps,
        flight.side_mps,
    )
