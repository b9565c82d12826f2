"""What a drone's battery loses at most by a command and by the way home, for the shield."""

from __future__ import annotations

from desim_uav.model.motion.needs import drawn_uj
from desim_uav.rowcode.compiled_rows import call_for_int
from desim_uav.rowcode.kernels import rule
from desim_uav.rules import words
from desim_uav.rules.battery import type_of
from desim_uav.rules.epochs import span_of_flight
from desim_uav.rules.rows import Constants, Drone, TransitRow


@rule
def takes(world: Constants, drone: Drone, flight: TransitRow) -> int:
    """Return what a battery loses at most by a command: by its flight, and by a hover after it."""
    own, span_us = type_of(world, drone), span_of_flight(world, flight, drone.off_grid)
    rest_us = span_us - flight.duration_us
    flown = call_for_int(own.drain_of, (own, flight, flight.duration_us))
    hovered = call_for_int(own.drain_of, (own, world.transits[words.REST], rest_us))
    return flown + hovered + drawn_uj(own.draws_uw, span_us)


@rule
def way_home(world: Constants, drone: Drone) -> int:
    """Return what the way home takes that is in ``course.home``; NEVER if there is none."""
    home = drone.course.home
    if home.station < 0:
        return words.NEVER
    return home.drain + drawn_uj(type_of(world, drone).draws_uw, home.duration_us)
