"""Free flight: the leg of a command, and the way home round obstacles, leg by leg."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry import roads as nets
from desim_uav.model.geometry.grid import cell_index, level_index
from desim_uav.model.geometry.prisms import Prisms, first_entry
from desim_uav.model.geometry.roads import Roads
from desim_uav.model.motion.flight import chosen_mps, no_faster, step_leg
from desim_uav.model.motion.legs import FreeLeg, LegBounds, direction, leg_between
from desim_uav.model.motion.limits import Limits, Wind, wind_along
from desim_uav.model.motion.motion import TRAPEZOID, trapezoid
from desim_uav.model.motion.space import Ways
from desim_uav.model.radio.tracks import Point
from desim_uav.model.rules import US
from desim_uav.rowcode.compiled_rows import call_for_int
from desim_uav.rowcode.kernels import apart, rule
from desim_uav.rowcode.rows import shaped
from desim_uav.rules import words
from desim_uav.rules.battery import is_limited, type_of
from desim_uav.rules.coverage import silence
from desim_uav.rules.flight import await_end, await_hop, position, serve_on, set_out
from desim_uav.rules.note import note_drone
from desim_uav.rules.reserve import takes, way_home
from desim_uav.rules.rows import Constants, Course, Drone, Path, State, TransitRow
from desim_uav.rules.separation import must_wait


class Memory(NamedTuple):
    """Memory for the search of ways home: a number for each node."""

    away_m: NDArray[np.float64]


# ---- what the space of a type of drones contains


@rule
def prisms_of(world: Constants, number: int) -> Prisms:
    """Return the obstacles of a type of drones."""
    space = world.spaces[number]
    count = len(space.offsets) - 1
    return Prisms(
        shaped(space.corners_m, (len(space.corners_m) // 2, 2)),
        shaped(space.walls, (len(space.walls) // 3, 3)),
        shaped(space.offsets, (count + 1,)),
        shaped(space.heights_m, (count, 2)),
        shaped(space.boxes_m, (count, 4)),
        (space.shape_x, space.shape_y),
        (space.side_x_m, space.side_y_m),
        shaped(space.heads, (len(space.heads),)),
        shaped(space.members, (len(space.members),)),
    )


@rule
def ways_of(world: Constants, number: int, level: int) -> Ways:
    """Return the ways home of a type of drones at a level."""
    ways = world.spaces[number].levels[level]
    nodes = len(ways.nodes_m) // 2
    shape = (len(ways.lengths_m) // nodes, nodes)
    roads = Roads(
        shaped(ways.nodes_m, (nodes, 2)),
        shaped(ways.lengths_m, shape),
        shaped(ways.following, shape),
        ways.altitude_m,
    )
    return Ways(roads, shaped(ways.times_us, shape), shaped(ways.drains, shape))


@rule
def memory_of(state: State) -> Memory:
    """Return memory for a number for each node."""
    return Memory(shaped(state.away_m, (len(state.away_m),)))


@rule
def limits_of(world: Constants, number: int) -> Limits:
    """Return the limits of a type of drones."""
    space = world.spaces[number]
    return Limits(
        space.level_mps, space.level_mps2, space.climb_mps, space.descent_mps, space.vertical_mps2
    )


@rule
def cruise_of(world: Constants, number: int) -> tuple[float, float]:
    """Return the lowest and the highest speed that commands choose (infinity: none)."""
    return world.spaces[number].lowest_mps, world.spaces[number].highest_mps


@rule
def wind_of(world: Constants, number: int) -> Wind:
    """Return the wind in which a type of drones flies."""
    return world.spaces[number].wind_x_mps, world.spaces[number].wind_y_mps


# ---- legs


@rule
def here(course: Course) -> Point:
    """Return where a drone is that hovers, or where its leg ends."""
    return course.x1_m, course.y1_m, course.z1_m


@rule
def bounds_of(world: Constants, drone: Drone) -> LegBounds:
    """Return where a drone may be."""
    levels = world.levels_under_ceiling if world.ceilings[drone.index] else world.levels
    return LegBounds(world.width_m, world.depth_m, world.levels_m[0], world.levels_m[levels - 1])


@rule
def write_flight(flight: TransitRow, leg: FreeLeg, wind: Wind) -> None:
    """Write a leg in wind as a transit."""
    flight.duration_us, flight.distance_m = leg.duration_us, float(leg.distance_m)
    flight.rises = flight.tail_mps = flight.side_mps = 0.0
    if leg.distance_m > 0.0:
        x0, y0, z0, x1, y1, z1 = leg.route
        flight.rises = float((z1 - z0) / leg.distance_m)
        ahead, _ = direction((x0, y0, z0), (x1, y1, z1))
        flight.tail_mps, flight.side_mps = wind_along(wind, ahead)
        pieces = trapezoid(leg.distance_m, leg.speed_mps, leg.acceleration_mps2, leg.duration_s)
        for k in range(TRAPEZOID):
            own, piece = pieces[k], flight.pieces[k]
            piece.start_s, piece.from_m = float(own.start_s), float(own.from_m)
            piece.speed_mps = float(own.speed_mps)
            piece.acceleration_mps2 = float(own.acceleration_mps2)


@rule
def begin_leg(world: Constants, drone: Drone, leg: FreeLeg, limit_mps: float) -> int:
    """Make a leg that of a drone, and return the number of its transit (REST: it hovers).

    ``limit_mps`` limits its ground speed (see ``Course``).
    """
    course = drone.course
    course.limit_mps = limit_mps
    x0, y0, z0, x1, y1, z1 = leg.route
    course.x0_m, course.y0_m, course.z0_m = float(x0), float(y0), float(z0)
    course.x1_m, course.y1_m, course.z1_m = float(x1), float(y1), float(z1)
    drone.to_x = cell_index(course.x1_m, world.cell_x_m, world.nx)
    drone.to_y = cell_index(course.y1_m, world.cell_y_m, world.ny)
    drone.to_level = level_index(course.z1_m, world.lowest_m, world.level_step_m, world.levels)
    if leg.distance_m == 0.0:
        return words.REST
    write_flight(course.flight, leg, wind_of(world, drone.type))
    return words.OWN


@rule
def steer(world: Constants, state: State, drone: Drone) -> int:
    """Begin the leg of a command, which an obstacle may cut short; return its transit's number."""
    course, number = drone.course, drone.type
    limits, wind, lasts_s = limits_of(world, number), wind_of(world, number), world.step_us / US
    if world.spaces[number].whole_map:
        lasts_s = np.inf
    lowest, highest = cruise_of(world, number)
    if highest < np.inf:
        limits = no_faster(limits, highest)
    command = (course.aim_x, course.aim_y, course.aim_z)
    leg, blocked = step_leg(
        limits,
        wind,
        np.inf,
        bounds_of(world, drone),
        prisms_of(world, number),
        lasts_s,
        here(course),
        command,
    )
    limit_mps = np.inf
    if highest < np.inf:
        cruise_mps = between(lowest, highest, course.aim_cruise)
        limit_mps = chosen_mps(limits, wind, cruise_mps, lasts_s, leg)
        x0, y0, z0, x1, y1, z1 = leg.route
        leg = leg_between(limits, wind, limit_mps, (x0, y0, z0), (x1, y1, z1))
    course.blocked = int(blocked)
    return begin_leg(world, drone, leg, limit_mps)


@rule
def between(lowest: float, highest: float, aim: float) -> float:
    """Return what a number of a command chooses: from the lowest at -1 to the highest at 1."""
    share = 0.5 * (min(max(aim, -1.0), 1.0) + 1.0)
    return (1.0 - share) * lowest + share * highest


# ---- serving flight


@apart
def hear_freely(world: Constants, state: State, drone: Drone) -> None:
    """Keep a command of free flight, and let its wish to charge come true if it can."""
    _keep_aim(state, drone)
    _wish(world, state, drone)


@rule
def _keep_aim(state: State, drone: Drone) -> None:
    """Keep what belongs to a command of free flight, beside ``history``."""
    at, course = words.AIMS * (state.step * len(state.drones) + drone.index), drone.course
    state.aims[at], state.aims[at + 1] = course.aim_x, course.aim_y
    state.aims[at + 2], state.aims[at + 3] = course.aim_z, course.aim_cruise
    state.aims[at + 4], state.aims[at + 5] = course.aim_share, course.aim_charge


@rule
def _wish(world: Constants, state: State, drone: Drone) -> None:
    """Turn a command with the wish to charge into that of charging, or of returning to a station.

    If neither is allowed, the drone flies as the command says.
    """
    if drone.course.aim_charge <= 0.0 or drone.command < 0:
        return
    if world.moves[drone.command].action != words.FLY:
        return
    first = drone.index * len(world.moves)
    for k in range(len(world.moves)):  # charging comes after the return
        action = world.moves[k].action
        if action in (words.GOTO, words.CHARGE) and state.masks[first + k]:
            drone.command = k


@apart
def fly_freely(world: Constants, path: Path, state: State, drone: Drone, flies: bool) -> None:
    """Begin a step of serving flight: the leg of the command if the drone ``flies``, or a hover."""
    course, transit = drone.course, words.REST
    course.blocked = 0
    if flies:
        transit = steer(world, state, drone)
        course.share = between(world.least_share, world.most_share, course.aim_share)
    gives_way = world.gives_way and transit != words.REST
    if gives_way and must_wait(world, state, drone, transit):
        course.blocked, transit = 1, words.REST
    shielded = type_of(world, drone).shielded and transit != words.REST
    if shielded and not _has_way_after(world, state, drone):
        course.blocked, transit = 1, words.REST
    if course.blocked:
        note_drone(state, words.COMMAND, words.ON_BLOCKED, drone)
    if transit == words.REST:
        rest(drone)
    serve_on(world, path, state, drone, transit)
    if transit != words.REST:
        note_drone(state, words.COMMAND, words.ON_DEPART, drone)
        await_end(world, state, drone, course.flight.duration_us)
    elif world.by_event:
        await_end(world, state, drone, world.patience_us)
    else:
        drone.waits = 1


@rule
def _has_way_after(world: Constants, state: State, drone: Drone) -> bool:
    """Return whether a drone surely reaches a station after the leg that it is to begin."""
    course = drone.course
    look_home_from(world, state, drone, course.x1_m, course.y1_m, course.z1_m)
    needed = takes(world, drone, course.flight) + way_home(world, drone)
    return bool(state.observations[drone.index].charge > needed)


@rule
def rest(drone: Drone) -> None:
    """Let a drone hover where it is."""
    course = drone.course
    course.x1_m, course.y1_m, course.z1_m = course.x0_m, course.y0_m, course.z0_m
    drone.to_x, drone.to_y, drone.to_level = drone.x, drone.y, drone.level
    drone.transit = words.REST


# ---- the way home


@apart
def turn_back_freely(world: Constants, path: Path, state: State, drone: Drone) -> None:
    """Stop serving; the return is planned from where the drone is."""
    set_out(world, state, drone, words.RETURNING, words.REST)
    silence(world, path, state, drone, words.COVERAGE)
    course = drone.course
    home = course.home
    course.station, course.node, course.level = home.station, home.first, home.end
    drone.hopping = 0


@apart
def fly_home_freely(world: Constants, state: State, drone: Drone, phase: int) -> bool:
    """Begin the next leg of a return; return False if the drone has reached a station instead."""
    drone.hopping = 0
    transit = home_leg(world, state, drone)
    if transit == words.REST:
        return False
    set_out(world, state, drone, words.RETURNING, transit)
    drone.hopping = 1
    await_hop(world, state, drone)
    note_drone(state, phase, words.ON_DEPART, drone)
    return True


@rule
def home_leg(world: Constants, state: State, drone: Drone) -> int:
    """Begin the next leg of a return; return its transit's number (REST: it is at the station).

    It goes straight up or down to the altitude of the ways, from node to node, and down.
    """
    course, number = drone.course, drone.type
    if course.station < 0:  # which the mask does not allow
        return words.REST
    at, altitude_m = here(course), world.levels_m[course.level]
    while course.node >= 0:
        stop = (at[0], at[1], altitude_m)
        if at[2] == altitude_m:
            roads = ways_of(world, number, course.level).roads
            stop = (roads.nodes_m[course.node, 0], roads.nodes_m[course.node, 1], altitude_m)
            course.node = int(roads.following[course.station, course.node])
        leg = leg_between(limits_of(world, number), wind_of(world, number), np.inf, at, stop)
        if leg.distance_m > 0.0:
            return begin_leg(world, drone, leg, np.inf)
        at = stop
        _move(course, at)
    stop = (at[0], at[1], world.levels_m[0])
    leg = leg_between(limits_of(world, number), wind_of(world, number), np.inf, at, stop)
    if leg.distance_m > 0.0:
        return begin_leg(world, drone, leg, np.inf)
    _move(course, stop)
    return words.REST


@rule
def _move(course: Course, to: Point) -> None:
    """Put a hovering drone at a place that is no way from where it is."""
    course.x0_m, course.y0_m, course.z0_m = float(to[0]), float(to[1]), float(to[2])
    course.x1_m, course.y1_m, course.z1_m = course.x0_m, course.y0_m, course.z0_m


@apart
def look_home(world: Constants, state: State, drone: Drone) -> None:
    """Write the return from where a drone is into ``course.home``; its station is -1 if none is.

    It leads over the altitude of the world that is nearest and from which there is a way.
    """
    x, y, z = position(world, state, drone)
    look_home_from(world, state, drone, x, y, z)


@rule
def look_home_from(
    world: Constants, state: State, drone: Drone, x: float, y: float, z: float
) -> None:
    """Write the return of a drone from a place into ``course.home`` (see ``look_home``)."""
    home = drone.course.home
    home.station = home.first = home.end = -1
    home.duration_us = home.drain = words.NEVER
    if drone.fallen:
        return
    levels = world.levels_under_ceiling if world.ceilings[drone.index] else world.levels
    low = level_index(z, world.lowest_m, world.level_step_m, levels)
    high = low + 1
    while home.station < 0 and (low >= 0 or high < levels):
        level = high
        if high >= levels or (
            low >= 0 and abs(z - world.levels_m[low]) <= abs(world.levels_m[high] - z)
        ):
            level = low
            low -= 1
        else:
            high += 1
        _look_at(world, state, drone, (x, y, z), level)


@rule
def _look_at(world: Constants, state: State, drone: Drone, at: Point, level: int) -> None:
    """Write the return over a level, if there is one."""
    home, number, limits = drone.course.home, drone.type, limits_of(world, drone.type)
    prisms, wind = prisms_of(world, number), wind_of(world, number)
    over = (at[0], at[1], world.levels_m[level])
    if first_entry(prisms, at, over) != np.inf:
        return
    ways, away_m = ways_of(world, number, level), memory_of(state).away_m
    station, node, lasts_us = nets.way_home(
        prisms, ways.roads, ways.times_us, limits, wind, np.inf, at[0], at[1], away_m
    )
    if station < 0:
        return
    rising = leg_between(limits, wind, np.inf, at, over)
    there = (ways.roads.nodes_m[node, 0], ways.roads.nodes_m[node, 1], over[2])
    ahead = leg_between(limits, wind, np.inf, over, there)
    home.station, home.first, home.end = station, node, level
    home.duration_us = rising.duration_us + lasts_us
    home.drain = int(ways.drains[station, node])
    home.drain += _drains(world, drone, rising) + _drains(world, drone, ahead)


@rule
def _drains(world: Constants, drone: Drone, leg: FreeLeg) -> int:
    """Return what a leg takes of the battery."""
    if leg.distance_m == 0.0 or not is_limited(world, drone):
        return 0
    own, probe = type_of(world, drone), drone.course.probe
    write_flight(probe, leg, wind_of(world, drone.type))
    return call_for_int(own.drain_of, (own, probe, probe.duration_us))
