"""The shield: actions after which a drone might not reach a station any more are masked.

``docs/explanation/shield.md`` proves that shielded drones do not crash.
"""

from __future__ import annotations

from desim_uav.model.motion.needs import drawn_uj
from desim_uav.rowcode.compiled_rows import call_for_int
from desim_uav.rowcode.kernels import apart, rule
from desim_uav.rules import words
from desim_uav.rules.battery import type_of
from desim_uav.rules.flight import can_enter, hop_transit, station_under, way_back
from desim_uav.rules.note import place
from desim_uav.rules.reserve import takes, way_home
from desim_uav.rules.rows import Constants, Drone, Move, State, TransitRow


@apart
def shield(world: Constants, state: State, drone: Drone) -> None:
    """Forbid a drone that decides what might leave it without a way to a station.

    If it cannot hover any more, it may return, whatever its type's ``return_charge``. If nothing is
    left, the fault STRANDED is set: it has begun too far from all stations.
    """
    observation, first = state.observations[drone.index], drone.index * len(world.moves)
    charge, options = observation.charge, 0
    hovers = charge > _after(
        world, drone, world.transits[words.REST], drone.x, drone.y, drone.level
    )
    for k in range(len(world.moves)):
        move, allowed = world.moves[k], state.masks[first + k] == 1
        if move.action == words.GOTO:
            allowed = (allowed or not hovers) and charge > _return(
                world, drone, observation.believed
            )
        elif move.action in (words.HOVER, words.FLY):
            allowed = allowed and hovers
        elif move.action != words.CHARGE:
            allowed = allowed and _may_move(world, drone, move, charge, hovers)
        state.masks[first + k] = int(allowed)
        options += int(allowed)
    observation.allows = 0  # the mask depends on more, and is written anew at each epoch
    observation.forced = int(options == 1)
    if options == 0:
        state.faults |= words.STRANDED


@rule
def _may_move(world: Constants, drone: Drone, move: Move, charge: int, hovers: bool) -> bool:
    """Return whether a drone reaches a station after a move, which may be blocked."""
    x, y, level = drone.x + move.dx, drone.y + move.dy, drone.level + move.dlevel
    if not can_enter(world, drone, x, y, level):
        return hovers
    flight = world.transits[type_of(world, drone).first_transit + move.transit]
    reaches = charge > _after(world, drone, flight, x, y, level)
    return reaches and (hovers or not world.gives_way)


@rule
def _after(world: Constants, drone: Drone, flight: TransitRow, x: int, y: int, level: int) -> int:
    """Return what a command of a flight to a place takes, with what is needed from there on."""
    if drone.off_grid:
        return takes(world, drone, flight) + way_home(world, drone)
    own, places = type_of(world, drone), world.levels * world.nx * world.ny
    first = own.first_need + world.ceilings[drone.index] * places
    return takes(world, drone, flight) + world.needs[first + place(world, x, y, level)]


@rule
def _return(world: Constants, drone: Drone, believed: int) -> int:
    """Return what a return takes that is planned from where a drone believes to be.

    Its hops lead from where the drone is. If they end elsewhere than at a station, or one is
    blocked, the rest is planned from the true place (see ``flight.fly_home``).
    """
    if station_under(world, drone) >= 0:
        return 0
    if drone.off_grid:
        return way_home(world, drone)
    plan, own = way_back(world, drone, believed), type_of(world, drone)
    x, y, level, needed, lasts_us = drone.x, drone.y, drone.level, 0, 0
    route, end = plan.first, plan.end if plan.station >= 0 else plan.first
    while route < end:
        hop = world.hops[route]
        if not can_enter(world, drone, x + hop.dx, y + hop.dy, level + hop.dlevel):
            break
        x, y, level, route = x + hop.dx, y + hop.dy, level + hop.dlevel, route + 1
        flight = world.transits[hop_transit(world, drone, hop)]
        needed += call_for_int(own.drain_of, (own, flight, flight.duration_us))
        lasts_us += flight.duration_us
    if level != 0 or world.station_at[x * world.ny + y] < 0:
        plan = way_back(world, drone, place(world, x, y, level))
        if plan.station < 0:
            return words.NEVER
        needed, lasts_us = needed + plan.drain, lasts_us + plan.duration_us
    return needed + drawn_uj(own.draws_uw, lasts_us)
