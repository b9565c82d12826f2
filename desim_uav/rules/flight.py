"""Flight: commanded moves from cell to cell, and returns to a charging station."""

from __future__ import annotations

from desim_uav.model.rules import US
from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rules import words
from desim_uav.rules.battery import change_mode, foresee_depletion, refill, type_of
from desim_uav.rules.coverage import silence, track
from desim_uav.rules.due import arrival_slot, due, key
from desim_uav.rules.epochs import ask_at, span_of
from desim_uav.rules.note import note_drone, note_leg, place
from desim_uav.rules.rows import Constants, Drone, Hop, Move, Path, PlanRow, State
from desim_uav.rules.separation import must_wait
from desim_uav.rules.transits import flight_of, heights_of, way_of

# ---- where a drone is


@rule
def station_under(world: Constants, drone: Drone) -> int:
    """Return the index of the station on whose cell a drone is at the lowest level, or -1."""
    if drone.level != 0 or (drone.off_grid and not _is_at_centre(world, drone)):
        return -1
    return world.station_at[drone.x * world.ny + drone.y]


@rare_rule
def _is_at_centre(world: Constants, drone: Drone) -> bool:
    """Return whether a drone that flies freely hovers just at the centre of a cell, and lowest."""
    course = drone.course
    level = course.z1_m == world.levels_m[0] and drone.transit == words.REST
    x_m, y_m = (drone.x + 0.5) * world.cell_x_m, (drone.y + 0.5) * world.cell_y_m
    return bool(level and course.x1_m == x_m and course.y1_m == y_m)


@rule
def can_enter(world: Constants, drone: Drone, x: int, y: int, level: int) -> bool:
    """Return whether a place is on the map, under the drone's ceiling and free of buildings."""
    levels = world.levels_under_ceiling if world.ceilings[drone.index] else world.levels
    if not (0 <= x < world.nx and 0 <= y < world.ny and 0 <= level < levels):
        return False
    return world.blocked[place(world, x, y, level)] == 0


@rule
def flown_m(world: Constants, state: State, drone: Drone) -> float:
    """Return the distance in metres that a drone has flown on its leg until now."""
    pieces = flight_of(world, drone).pieces
    elapsed_s, k = (state.now_us - drone.since_us) / US, 0
    while k + 1 < len(pieces) and pieces[k + 1].start_s <= elapsed_s:
        k += 1
    piece = pieces[k]
    t = elapsed_s - piece.start_s
    half_acceleration = 0.5 * piece.acceleration_mps2
    return piece.from_m + piece.speed_mps * t + half_acceleration * t * t


@rule
def position(world: Constants, state: State, drone: Drone) -> tuple[float, float, float]:
    """Return the true position of a drone now: x, y and z in metres."""
    if drone.fallen:
        return drone.fallen_x_m, drone.fallen_y_m, 0.0
    x0, y0, x1, y1 = way_of(world, drone)
    z0, z1 = heights_of(world, drone)
    if drone.transit == words.REST:
        return x0, y0, z0
    share = flown_m(world, state, drone) / flight_of(world, drone).distance_m
    return x0 + share * (x1 - x0), y0 + share * (y1 - y0), z0 + share * (z1 - z0)


@rule
def way_back(world: Constants, drone: Drone, from_place: int) -> PlanRow:
    """Return the planned return from a place, below the drone's ceiling if it has one.

    In free flight, it is from where the drone has been at the latest decision epoch.
    """
    if drone.off_grid:
        return drone.course.home
    places, first = world.levels * world.nx * world.ny, type_of(world, drone).first_plan
    return world.plans[first + world.ceilings[drone.index] * places + from_place]


# ---- legs


@rule
def hover_at(drone: Drone, x: int, y: int, level: int) -> None:
    """Put a drone at rest at the centre of a cell, at a level."""
    drone.x, drone.y, drone.level = x, y, level
    drone.to_x, drone.to_y, drone.to_level = x, y, level
    drone.transit = words.REST
    drone.fallen = 0


@rule
def appear(world: Constants, state: State, drone: Drone, x: int, y: int) -> None:
    """Put a drone in the air above a cell, at the lowest level and with a full battery."""
    drone.mode = words.FLYING
    refill(world, drone)
    drone.since_us = drone.until_us = state.now_us
    drone.counted_m = 0.0
    drone.power_uw = drone.rest_pj = 0
    drone.drawn_us = state.now_us
    hover_at(drone, x, y, 0)
    if drone.off_grid:
        x_m, y_m = (x + 0.5) * world.cell_x_m, (y + 0.5) * world.cell_y_m
        stay_at(drone, x_m, y_m, world.levels_m[0])
        drone.course.share = world.least_share  # nothing has been commanded it


@rare_rule
def stay_at(drone: Drone, x_m: float, y_m: float, z_m: float) -> None:
    """Put a drone that flies freely at rest at a place."""
    course = drone.course
    course.x0_m, course.y0_m, course.z0_m = x_m, y_m, z_m
    course.x1_m, course.y1_m, course.z1_m = x_m, y_m, z_m


@rule
def set_out(world: Constants, state: State, drone: Drone, mode: int, transit: int) -> None:
    """Begin a leg to (``to_x``, ``to_y``, ``to_level``) by a transit's number (REST: a hover)."""
    change_mode(world, state, drone, mode)
    drone.transit, drone.marked_until_us = transit, -1
    if transit != words.REST:
        note_leg(world, state, drone)


@rule
def arrive(world: Constants, state: State, drone: Drone) -> None:
    """End a drone's transit: it hovers at its destination."""
    state.distance_m += flight_of(world, drone).distance_m - drone.counted_m
    change_mode(world, state, drone, drone.mode)
    hover_at(drone, drone.to_x, drone.to_y, drone.to_level)
    if drone.off_grid:
        stay_at(drone, drone.course.x1_m, drone.course.y1_m, drone.course.z1_m)
    note_drone(state, words.ARRIVAL, words.ON_ARRIVE, drone)


@rule
def count_distance(world: Constants, state: State, drone: Drone) -> None:
    """Add the part of a drone's leg that is flown but not counted yet to ``distance_m``."""
    flown = flown_m(world, state, drone)
    state.distance_m += flown - drone.counted_m
    drone.counted_m = flown


# ---- serving flight


@rule
def fly(world: Constants, path: Path, state: State, drone: Drone, taken: int) -> None:
    """Begin a step of serving flight: a move to the next cell or level, or a hover.

    A move to a place that the drone cannot enter is blocked: the drone hovers instead. So is one
    that leads too near to a drone with a lower index, if drones give way to these.
    """
    move = world.moves[taken]
    x, y, level = drone.x + move.dx, drone.y + move.dy, drone.level + move.dlevel
    moves = move.action != words.HOVER
    if moves and not (
        can_enter(world, drone, x, y, level)
        and (not world.gives_way or _has_way(world, state, drone, move))
    ):
        note_drone(state, words.COMMAND, words.ON_BLOCKED, drone)
        moves = False
    if not moves:
        hover_at(drone, drone.x, drone.y, drone.level)
        serve_on(world, path, state, drone, words.REST)
        if world.by_event:
            await_end(world, state, drone, world.patience_us)
        else:
            drone.waits = 1
        return
    drone.to_x, drone.to_y, drone.to_level = x, y, level
    serve_on(world, path, state, drone, type_of(world, drone).first_transit + move.transit)
    note_drone(state, words.COMMAND, words.ON_DEPART, drone)
    _await_arrival(world, state, drone)


@rare_rule
def _has_way(world: Constants, state: State, drone: Drone, move: Move) -> bool:
    """Return whether a drone may begin a move, as far as drones with lower indices let it."""
    drone.to_x, drone.to_y = drone.x + move.dx, drone.y + move.dy
    drone.to_level = drone.level + move.dlevel
    transit = type_of(world, drone).first_transit + move.transit
    return not must_wait(world, state, drone, transit)


@rule
def serve_on(world: Constants, path: Path, state: State, drone: Drone, transit: int) -> None:
    """Begin a leg on which the drone serves users until its next command."""
    set_out(world, state, drone, words.FLYING, transit)
    span_us = span_of(world, drone)
    drone.until_us = state.now_us + span_us
    foresee_depletion(world, state, drone, span_us)
    track(world, path, state, drone, span_us, words.COVERAGE)


@rule
def _await_arrival(world: Constants, state: State, drone: Drone) -> None:
    """Schedule the end of a drone's transit."""
    await_end(world, state, drone, flight_of(world, drone).duration_us)


@rule
def await_end(world: Constants, state: State, drone: Drone, span_us: int) -> None:
    """Schedule the end of a drone's leg."""
    end_us = drone.since_us + span_us
    due(state, arrival_slot(state, drone.index), end_us, key(words.ARRIVAL, drone.index, -1))


@rule
def end_move(world: Constants, state: State, drone: Drone) -> None:
    """End a move: the drone hovers for the rest of the step, and can be commanded again."""
    if world.by_event:
        _end_leg(world, state, drone)
        return
    rest_us = world.step_us - flight_of(world, drone).duration_us
    arrive(world, state, drone)
    foresee_depletion(world, state, drone, rest_us)
    drone.waits = 1


@rare_rule
def _end_leg(world: Constants, state: State, drone: Drone) -> None:
    """End a move or a hover of a drone, which is asked now.

    After a shorter leg of free flight than ``patience_us``, it hovers until this time is over.
    """
    if drone.transit != words.REST:
        rest_us = drone.until_us - state.now_us
        arrive(world, state, drone)
        foresee_depletion(world, state, drone, rest_us)
        if rest_us > 0:
            await_end(world, state, drone, rest_us)
            return
    drone.waits = 1
    ask_at(state, state.now_us)


@rare_rule
def go_on_until(world: Constants, state: State, drone: Drone) -> None:
    """Schedule the end of what began in the previous episode, or the battery's depletion."""
    if drone.mode in words.AIRBORNE:
        foresee_depletion(world, state, drone, drone.until_us - drone.since_us)
    if drone.transit == words.REST:
        await_end(world, state, drone, drone.until_us - drone.since_us)
    else:
        _await_arrival(world, state, drone)


# ---- the way home


@rule
def turn_back(world: Constants, path: Path, state: State, drone: Drone) -> None:
    """Stop serving, and plan the return from the place where the drone believes itself to be."""
    change_mode(world, state, drone, words.RETURNING)
    silence(world, path, state, drone, words.COVERAGE)
    plan = way_back(world, drone, state.observations[drone.index].believed)
    drone.route = drone.route_end = 0
    if station_under(world, drone) < 0 and plan.station >= 0:
        drone.route, drone.route_end = plan.first, plan.end


@rule
def fly_home(world: Constants, state: State, drone: Drone, phase: int) -> bool:
    """Begin the next hop of a return; return False if the drone has reached a station instead.

    If the route ends elsewhere or is blocked, another is planned from the drone's true place.
    """
    drone.hopping = 0
    while station_under(world, drone) < 0 or drone.route < drone.route_end:
        _next_hop(world, state, drone, phase)
        if drone.hopping:
            return True
    return False


@rule
def _next_hop(world: Constants, state: State, drone: Drone, phase: int) -> None:
    """Begin the next hop of a drone's route, or end the route if the hop is blocked."""
    if drone.route == drone.route_end:
        plan = way_back(world, drone, place(world, drone.x, drone.y, drone.level))
        drone.route, drone.route_end = plan.first, plan.end
    hop = world.hops[drone.route]
    x, y, level = drone.x + hop.dx, drone.y + hop.dy, drone.level + hop.dlevel
    drone.route += 1
    if not can_enter(world, drone, x, y, level):
        note_drone(state, phase, words.ON_BLOCKED, drone)
        drone.route = drone.route_end
        return
    drone.to_x, drone.to_y, drone.to_level = x, y, level
    set_out(world, state, drone, words.RETURNING, hop_transit(world, drone, hop))
    drone.hopping = 1
    await_hop(world, state, drone)
    note_drone(state, phase, words.ON_DEPART, drone)


@rule
def hop_transit(world: Constants, drone: Drone, hop: Hop) -> int:
    """Return the number of the transit of a hop, by its number among ``planner.HOPS``."""
    axis = 0 if hop.dx != 0 else 1 if hop.dy != 0 else 2
    direction = 2 * axis + (1 if hop.dx + hop.dy + hop.dlevel < 0 else 0)
    return type_of(world, drone).first_transit + world.first_hop + direction


@rule
def await_hop(world: Constants, state: State, drone: Drone) -> None:
    """Schedule the end of a hop, or the depletion of the battery if this comes before."""
    foresee_depletion(world, state, drone, flight_of(world, drone).duration_us)
    _await_arrival(world, state, drone)
