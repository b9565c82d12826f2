"""The leg that a drone flies, by a transit of the world or, in free flight, one of its own."""

from __future__ import annotations

from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rules.rows import Constants, Drone, State, TransitRow
from desim_uav.rules.words import OWN, REST
from desim_uav.sky.rows import LegRow


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


@rule
def way_of(world: Constants, drone: Drone) -> tuple[float, float, float, float]:
    """Return the start and the end of a drone's leg: x0, y0, x1 and y1, in metres."""
    if drone.off_grid:
        course = drone.course
        return course.x0_m, course.y0_m, course.x1_m, course.y1_m
    return (
        (drone.x + 0.5) * world.cell_x_m,
        (drone.y + 0.5) * world.cell_y_m,
        (drone.to_x + 0.5) * world.cell_x_m,
        (drone.to_y + 0.5) * world.cell_y_m,
    )


@rule
def heights_of(world: Constants, drone: Drone) -> tuple[float, float]:
    """Return the heights at the start and at the end of a drone's leg, in metres."""
    if drone.off_grid:
        return drone.course.z0_m, drone.course.z1_m
    return world.levels_m[drone.level], world.levels_m[drone.to_level]


@rule
def show_leg(world: Constants, state: State, drone: Drone) -> None:
    """Write the leg of a drone to the sky.

    A drone that rests stays where it is, even if it has just received its next command.
    """
    leg = state.sky.legs[drone.index]
    leg.x0_m, leg.y0_m, leg.x1_m, leg.y1_m = way_of(world, drone)
    leg.z0_m, leg.z1_m = heights_of(world, drone)
    if drone.transit == REST:
        leg.x1_m, leg.y1_m, leg.z1_m = leg.x0_m, leg.y0_m, leg.z0_m
    leg.since_us, leg.transit = drone.since_us, drone.transit
    leg.level, leg.to_level = drone.level, drone.to_level
    leg.radio, leg.serving, leg.marked_us = drone.radio, drone.serving, drone.marked_us
    if drone.transit == OWN:
        _show_pieces(drone.course.flight, leg)


@rare_rule
def _show_pieces(flight: TransitRow, leg: LegRow) -> None:
    """Write the pieces of a transit of free flight to a leg."""
    for k in range(len(flight.pieces)):
        own, piece = flight.pieces[k], leg.pieces[k]
        piece.start_s, piece.from_m = own.start_s, own.from_m
        piece.speed_mps, piece.acceleration_mps2 = own.speed_mps, own.acceleration_mps2
