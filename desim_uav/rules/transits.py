"""The transit that a drone flies: one of those of the world, or its own in free flight."""

from __future__ import annotations

from desim_uav.model.kernels import rule
from desim_uav.rules.rows import Constants, Drone, TransitRow
from desim_uav.rules.words import OWN


@rule
def flight_of(world: Constants, drone: Drone) -> TransitRow:
    """Return the transit that a drone flies now."""
    if drone.transit == OWN:
        return drone.course.flight
    return world.transits[drone.transit]
