"""The transit that a drone flies: one of those of the world, or its own in free flight."""

from __future__ import annotations

from desim_uav.rowcode.kernels import rule
from desim_uav.rules.rows import Constants, Drone, State, TransitRow
from desim_uav.rules.words import OWN, REST


@rule
def flight_of(world: Constants, drone: Drone) -> TransitRow:
    """Return the transit that a drone flies now."""
    if drone.transit == OWN:
        return drone.course.flight
    return world.transits[drone.transit]


@rule
def began_us(state: State, drone: Drone) -> int:
    """Return when the transit of a drone began, which may be in the previous episode; or now.

    A hover may be taken to begin now, because it is the same at all times.
    """
    return state.now_us if drone.transit == REST else drone.since_us
