"""Drones: flight, return, queue, charge and crash, as ``engine.des.drone`` has them."""

from __future__ import annotations

from desim_uav.engine.batch.access import (
    drone_of,
    hop_of,
    move_of,
    plan_of,
    profile_of,
    spot_of,
    station_of,
    transit_of,
)
from desim_uav.engine.batch.airlink import note, note_at, silence, track
from desim_uav.engine.batch.kernels import inner, part
from desim_uav.engine.batch.memory import (
    AT_BLOCKED,
    AT_CEILINGS,
    AT_CRASHED,
    AT_DISTANCES_M,
    AT_ERROR,
    AT_HOP_TRANSITS,
    AT_LEVELS_M,
    AT_STATION_AT,
    AT_STATIONS,
    BACK,
    BACK_LEVEL,
    BACK_X,
    BACK_Y,
    BATTERY_US,
    CAPACITY_US,
    CELL_X_M,
    CELL_Y_M,
    CHARGES,
    COUNTED_M,
    CRASHES,
    DISTANCE_M,
    DRONES,
    DURATION_US,
    FALLEN,
    FALLEN_X_M,
    FALLEN_Y_M,
    FULL_CHARGE_US,
    HOPPING,
    K_ARRIVE,
    K_BLOCKED,
    K_CHARGE,
    K_CHARGED,
    K_CRASH,
    K_DEPART,
    K_DEPLETE,
    K_LAND,
    K_LEG,
    K_RESPAWN,
    LANDED_IN,
    LEVEL,
    LEVEL_STEP_M,
    LEVELS,
    LEVELS_UNDER_CEILING,
    LIMITED,
    LOWEST_M,
    MODE,
    MOVE_ACTION,
    MOVE_LEVEL,
    MOVE_TRANSIT,
    MOVE_X,
    MOVE_Y,
    NOISY,
    NOW,
    NX,
    NY,
    PADS,
    PLAN_END,
    PLAN_FIRST,
    PLAN_STATION,
    QUEUEING_US,
    REST,
    ROUTE,
    ROUTE_END,
    ROWS,
    SINCE_US,
    STEP_US,
    STEPS,
    TO_LEVEL,
    TO_X,
    TO_Y,
    TRANSIT,
    USERS,
    WAITS,
    Fixed,
    Path,
    State,
    X,
    Y,
)
from desim_uav.engine.batch.pointers import moved, table
from desim_uav.engine.batch.queue import (
    ARRIVAL,
    COMMAND,
    COVERAGE,
    DEPLETION,
    RESPAWN,
    due,
    key,
    undo,
)
from desim_uav.model.battery import charged_us, time_to_full_us
from desim_uav.model.grid import cell_index, level_index
from desim_uav.model.motion import travelled

FLYING, RETURNING, QUEUED, CHARGING, CHARGED, CRASHED = range(6)
"""See ``Mode``."""

HOVER, GOTO, CHARGE = 4, 7, 8
"""See ``Action``."""


@inner
def arrival_slot(w: Fixed, d: int) -> int:
    """The end of a transit, a hop or a charge."""
    return int(2 * w.i[USERS] + w.i[DRONES] + d)


@inner
def depletion_slot(w: Fixed, d: int) -> int:
    """An empty battery."""
    return int(2 * w.i[USERS] + 2 * w.i[DRONES] + d)


# ---- where a drone is


@inner
def node(w: Fixed, x: int, y: int, level: int) -> int:
    """The number of a place among the plans."""
    nx, ny = w.i[NX], w.i[NY]
    return int((level * nx + x) * ny + y)


@inner
def at_station(w: Fixed, s: State, d: int) -> int:
    """The station whose cell the drone is on, at its landing level, or -1."""
    drone = drone_of(s, d)
    if s.i[drone + LEVEL] != 0:
        return -1
    return int(w.i[w.i[AT_STATION_AT] + s.i[drone + X] * w.i[NY] + s.i[drone + Y]])


@inner
def _can_enter(w: Fixed, d: int, x: int, y: int, level: int) -> bool:
    nx, ny = w.i[NX], w.i[NY]
    levels = w.i[LEVELS_UNDER_CEILING] if w.i[w.i[AT_CEILINGS] + d] else w.i[LEVELS]
    if not (0 <= x < nx and 0 <= y < ny and 0 <= level < levels):
        return False
    return bool(w.i[w.i[AT_BLOCKED] + (level * nx + x) * ny + y] == 0)


@inner
def _flown_m(w: Fixed, s: State, d: int) -> float:
    """How far the drone has flown on its leg."""
    drone = drone_of(s, d)
    transit = s.i[drone + TRANSIT]
    first, rows = profile_of(w, transit), w.i[transit_of(w, transit) + ROWS]
    elapsed_s = (s.i[NOW] - s.i[drone + SINCE_US]) / 1_000_000
    return float(travelled(table(moved(w.f, first), rows, 4), elapsed_s))


@inner
def position(w: Fixed, s: State, d: int) -> tuple[float, float, float]:
    """Where the drone is now: x, y, z."""
    drone = drone_of(s, d)
    if s.i[drone + FALLEN]:
        return s.f[spot_of(s, d) + FALLEN_X_M], s.f[spot_of(s, d) + FALLEN_Y_M], 0.0
    x0 = (s.i[drone + X] + 0.5) * w.f[CELL_X_M]
    y0 = (s.i[drone + Y] + 0.5) * w.f[CELL_Y_M]
    z0 = w.f[w.i[AT_LEVELS_M] + s.i[drone + LEVEL]]
    transit = s.i[drone + TRANSIT]
    if transit == REST:
        return x0, y0, z0
    flown_m = _flown_m(w, s, d)
    share = flown_m / w.f[w.i[AT_DISTANCES_M] + transit]
    x1 = (s.i[drone + TO_X] + 0.5) * w.f[CELL_X_M]
    y1 = (s.i[drone + TO_Y] + 0.5) * w.f[CELL_Y_M]
    z1 = w.f[w.i[AT_LEVELS_M] + s.i[drone + TO_LEVEL]]
    return x0 + share * (x1 - x0), y0 + share * (y1 - y0), z0 + share * (z1 - z0)


@inner
def orient(w: Fixed, p: Path, s: State, d: int, epoch: int) -> None:
    """The drone takes its bearings: where does it believe it is?"""
    drone = drone_of(s, d)
    noisy = p.i[NOISY] != 0
    x, y, level = s.i[drone + X], s.i[drone + Y], s.i[drone + LEVEL]
    if noisy or s.i[drone + TRANSIT] != REST or s.i[drone + FALLEN]:
        x_m, y_m, z_m = position(w, s, d)
        if noisy:
            error = p.i[AT_ERROR] + (d * (w.i[STEPS] + 1) + epoch) * 2
            x_m += p.f[error] * w.f[CELL_X_M]
            y_m += p.f[error + 1] * w.f[CELL_Y_M]
        nx, ny = w.i[NX], w.i[NY]
        x = cell_index(x_m, w.f[CELL_X_M], nx)
        y = cell_index(y_m, w.f[CELL_Y_M], ny)
        level = level_index(z_m, w.f[LOWEST_M], w.f[LEVEL_STEP_M], w.i[LEVELS])
    s.i[drone + BACK] = node(w, x, y, level)
    s.i[drone + BACK_X], s.i[drone + BACK_Y], s.i[drone + BACK_LEVEL] = x, y, level


# ---- battery and modes


@inner
def battery_now(w: Fixed, s: State, d: int) -> int:
    """What the battery holds now, in microseconds of autonomy."""
    if not w.i[LIMITED]:
        return 0
    drone = drone_of(s, d)
    elapsed_us = s.i[NOW] - s.i[drone + SINCE_US]
    mode = s.i[drone + MODE]
    if mode in (FLYING, RETURNING):
        return int(s.i[drone + BATTERY_US] - elapsed_us)
    if mode == CHARGING:
        held_us = s.i[drone + BATTERY_US]
        return int(charged_us(held_us, elapsed_us, w.i[CAPACITY_US], w.i[FULL_CHARGE_US]))
    return int(s.i[drone + BATTERY_US])


@inner
def change_mode(w: Fixed, s: State, d: int, mode: int) -> None:
    """Book what the battery has lost or won so far; from now on another leg or mode counts."""
    drone = drone_of(s, d)
    s.i[drone + BATTERY_US] = battery_now(w, s, d)
    s.i[drone + SINCE_US] = s.i[NOW]
    s.i[drone + MODE] = mode
    s.f[spot_of(s, d) + COUNTED_M] = 0.0
    undo(s, depletion_slot(w, d))


@inner
def _hover_at(s: State, d: int, x: int, y: int, level: int) -> None:
    drone = drone_of(s, d)
    s.i[drone + X], s.i[drone + Y], s.i[drone + LEVEL] = x, y, level
    s.i[drone + TO_X], s.i[drone + TO_Y], s.i[drone + TO_LEVEL] = x, y, level
    s.i[drone + TRANSIT] = REST
    s.i[drone + FALLEN] = 0


@inner
def foresee_depletion(w: Fixed, s: State, d: int, span_us: int) -> None:
    """Put it on the agenda, if the battery does not last a leg of ``span_us`` out."""
    drone = drone_of(s, d)
    if w.i[LIMITED] and s.i[drone + BATTERY_US] <= span_us:
        depleted_us = s.i[drone + SINCE_US] + s.i[drone + BATTERY_US]
        due(s, depletion_slot(w, d), depleted_us, key(DEPLETION, d, -1))


@inner
def _set_out(
    w: Fixed, s: State, d: int, mode: int, dx: int, dy: int, dz: int, transit: int, span_us: int
) -> None:
    """Begin a leg of ``span_us``, a hover then included."""
    change_mode(w, s, d, mode)
    drone = drone_of(s, d)
    s.i[drone + TO_X], s.i[drone + TO_Y], s.i[drone + TO_LEVEL] = (
        s.i[drone + X] + dx,
        s.i[drone + Y] + dy,
        s.i[drone + LEVEL] + dz,
    )
    s.i[drone + TRANSIT] = transit
    if transit != REST:
        note_leg(w, s, d)
    foresee_depletion(w, s, d, span_us)


@inner
def note_leg(w: Fixed, s: State, d: int) -> None:
    """Write to the log what the drone is about: a transit, or to be where it is."""
    drone = drone_of(s, d)
    start = node(w, s.i[drone + X], s.i[drone + Y], s.i[drone + LEVEL])
    end = node(w, s.i[drone + TO_X], s.i[drone + TO_Y], s.i[drone + TO_LEVEL])
    duration_us = w.i[transit_of(w, s.i[drone + TRANSIT]) + DURATION_US]
    note_at(s, s.i[drone + SINCE_US], s.i[drone + MODE], K_LEG, d, start, end, duration_us)


@inner
def count_distance(w: Fixed, s: State, d: int) -> None:
    """Count what the drone has flown of its leg, and not counted before."""
    flown_m = _flown_m(w, s, d)
    s.f[DISTANCE_M] += flown_m - s.f[spot_of(s, d) + COUNTED_M]
    s.f[spot_of(s, d) + COUNTED_M] = flown_m


@inner
def _arrive(w: Fixed, s: State, d: int) -> None:
    """End a leg; the drone hovers where it has led."""
    drone = drone_of(s, d)
    s.f[DISTANCE_M] += (
        w.f[w.i[AT_DISTANCES_M] + s.i[drone + TRANSIT]] - s.f[spot_of(s, d) + COUNTED_M]
    )
    change_mode(w, s, d, s.i[drone + MODE])
    _hover_at(s, d, s.i[drone + TO_X], s.i[drone + TO_Y], s.i[drone + TO_LEVEL])
    note(s, ARRIVAL, K_ARRIVE, d, -1, -1, -1)


# ---- what a drone does


@inner
def appear(w: Fixed, s: State, d: int, x: int, y: int) -> None:
    """Airborne at the lowest level, full battery, holding no pad."""
    drone = drone_of(s, d)
    s.i[drone + MODE] = FLYING
    s.i[drone + BATTERY_US] = w.i[CAPACITY_US]
    s.i[drone + SINCE_US] = s.i[NOW]
    s.f[spot_of(s, d) + COUNTED_M] = 0.0
    _hover_at(s, d, x, y, 0)


@part
def obey(w: Fixed, p: Path, s: State, d: int, command: int) -> None:
    """Act on an action (by its index)."""
    s.i[drone_of(s, d) + WAITS] = 0
    move = move_of(w, command)
    if w.i[move + MOVE_ACTION] == GOTO:
        _return(w, s, d)
    elif w.i[move + MOVE_ACTION] == CHARGE:
        _land(w, s, d, COMMAND)
    else:
        _fly(w, p, s, d, command)


@part
def _fly(w: Fixed, p: Path, s: State, d: int, command: int) -> None:
    """A step of serving flight: a move to the next cell, or a hover."""
    drone, move = drone_of(s, d), move_of(w, command)
    step_us = w.i[STEP_US]
    moves = w.i[move + MOVE_ACTION] != HOVER
    dx, dy, dz = w.i[move + MOVE_X], w.i[move + MOVE_Y], w.i[move + MOVE_LEVEL]
    if moves and not _can_enter(
        w, d, s.i[drone + X] + dx, s.i[drone + Y] + dy, s.i[drone + LEVEL] + dz
    ):
        note(s, COMMAND, K_BLOCKED, d, -1, -1, -1)
        moves = False
    if not moves:
        _set_out(w, s, d, FLYING, 0, 0, 0, REST, step_us)
        track(w, p, s, d, step_us, COVERAGE)
        s.i[drone + WAITS] = 1
        return
    transit = w.i[move + MOVE_TRANSIT]
    _set_out(w, s, d, FLYING, dx, dy, dz, transit, step_us)
    track(w, p, s, d, step_us, COVERAGE)
    note(s, COMMAND, K_DEPART, d, -1, -1, -1)
    due(
        s,
        arrival_slot(w, d),
        s.i[drone + SINCE_US] + w.i[transit_of(w, transit) + DURATION_US],
        key(ARRIVAL, d, -1),
    )


@inner
def _return(w: Fixed, s: State, d: int) -> None:
    """Fly back by A*, first as planned from where the drone believes it is."""
    drone = drone_of(s, d)
    change_mode(w, s, d, RETURNING)
    silence(w, s, d, COVERAGE)
    plan = plan_of(w, d, s.i[drone + BACK])
    s.i[drone + ROUTE] = s.i[drone + ROUTE_END] = 0
    if at_station(w, s, d) < 0 and w.i[plan + PLAN_STATION] >= 0:
        s.i[drone + ROUTE], s.i[drone + ROUTE_END] = w.i[plan + PLAN_FIRST], w.i[plan + PLAN_END]
    go_home(w, s, d, COMMAND)


@inner
def go_home(w: Fixed, s: State, d: int, phase: int) -> None:
    """Begin the next hop home, or land where the route has ended at a station."""
    drone = drone_of(s, d)
    while at_station(w, s, d) < 0 or s.i[drone + ROUTE] < s.i[drone + ROUTE_END]:
        _next_hop(w, s, d, phase)
        if s.i[drone + HOPPING]:
            return
    _land(w, s, d, phase)


@inner
def _next_hop(w: Fixed, s: State, d: int, phase: int) -> None:
    """Begin the next hop of the route, unless it is blocked, which ends the route."""
    drone = drone_of(s, d)
    if s.i[drone + ROUTE] == s.i[drone + ROUTE_END]:
        plan = plan_of(w, d, node(w, s.i[drone + X], s.i[drone + Y], s.i[drone + LEVEL]))
        s.i[drone + ROUTE], s.i[drone + ROUTE_END] = w.i[plan + PLAN_FIRST], w.i[plan + PLAN_END]
    hop = hop_of(w, s.i[drone + ROUTE])
    dx, dy, dz = w.i[hop], w.i[hop + 1], w.i[hop + 2]
    s.i[drone + ROUTE] += 1
    if not _can_enter(w, d, s.i[drone + X] + dx, s.i[drone + Y] + dy, s.i[drone + LEVEL] + dz):
        note(s, phase, K_BLOCKED, d, -1, -1, -1)
        s.i[drone + ROUTE] = s.i[drone + ROUTE_END]
        return
    axis = 0 if dx != 0 else 1 if dy != 0 else 2
    transit = w.i[w.i[AT_HOP_TRANSITS] + axis]
    duration_us = w.i[transit_of(w, transit) + DURATION_US]
    _set_out(w, s, d, RETURNING, dx, dy, dz, transit, duration_us)
    note(s, phase, K_DEPART, d, -1, -1, -1)
    s.i[drone + HOPPING] = 1
    due(s, arrival_slot(w, d), s.i[drone + SINCE_US] + duration_us, key(ARRIVAL, d, -1))


@part
def on_arrival(w: Fixed, s: State, d: int) -> None:
    """A move, a hop of a return or a charge ends."""
    drone = drone_of(s, d)
    if s.i[drone + MODE] == CHARGING:
        station = at_station(w, s, d)
        _be_charged(w, s, d, station, ARRIVAL)
        grant(w, s, station)
    elif s.i[drone + MODE] == RETURNING:
        _arrive(w, s, d)
        s.i[drone + HOPPING] = 0
        go_home(w, s, d, ARRIVAL)
    else:
        duration_us = w.i[transit_of(w, s.i[drone + TRANSIT]) + DURATION_US]
        _arrive(w, s, d)
        foresee_depletion(w, s, d, w.i[STEP_US] - duration_us)
        s.i[drone + WAITS] = 1


@inner
def _land(w: Fixed, s: State, d: int, phase: int) -> None:
    """Land, and queue for a pad."""
    drone = drone_of(s, d)
    silence(w, s, d, COVERAGE)
    change_mode(w, s, d, QUEUED)
    _hover_at(s, d, s.i[drone + X], s.i[drone + Y], s.i[drone + LEVEL])
    station = at_station(w, s, d)
    note(s, phase, K_LAND, d, -1, -1, station)
    s.i[drone + LANDED_IN] = phase
    queue_up(s, d, station)
    grant(w, s, station)


@inner
def queue_up(s: State, d: int, station: int) -> None:
    """The drone is the last at a station; the first ones there have its pads."""
    there = station_of(s, station)
    s.i[there + 0] += 1
    s.i[there + s.i[there + 0]] = d


@inner
def grant(w: Fixed, s: State, station: int) -> None:
    """Those who have a pad and do not charge yet begin to; one that is full leaves at once."""
    there = station_of(s, station)
    k = 1
    while k <= min(s.i[there + 0], w.i[PADS]):
        d = s.i[there + k]
        drone = drone_of(s, d)
        if s.i[drone + MODE] == QUEUED:
            now_us = s.i[NOW]
            count_queueing(s, d)
            phase = ARRIVAL if now_us > s.i[drone + SINCE_US] else s.i[drone + LANDED_IN]
            change_mode(w, s, d, CHARGING)
            note(s, phase, K_CHARGE, d, -1, -1, station)
            if not await_full(w, s, d):
                _be_charged(w, s, d, station, phase)
                k = 0
        k += 1


@inner
def await_full(w: Fixed, s: State, d: int) -> bool:
    """Will the battery take any time until it is full? Then that is on the agenda."""
    drone = drone_of(s, d)
    rest_us = time_to_full_us(s.i[drone + BATTERY_US], w.i[CAPACITY_US], w.i[FULL_CHARGE_US])
    if rest_us <= 0:
        return False
    due(s, arrival_slot(w, d), s.i[drone + SINCE_US] + rest_us, key(ARRIVAL, d, -1))
    return True


@inner
def _be_charged(w: Fixed, s: State, d: int, station: int, phase: int) -> None:
    """Full: the pad is free, the drone waits there for its next command."""
    change_mode(w, s, d, CHARGED)
    note(s, phase, K_CHARGED, d, -1, -1, station)
    s.i[CHARGES] += 1
    there = station_of(s, station)
    k = 1
    while s.i[there + k] != d:
        k += 1
    for after in range(k, s.i[there + 0]):
        s.i[there + after] = s.i[there + after + 1]
    s.i[there + 0] -= 1
    s.i[drone_of(s, d) + WAITS] = 1


@inner
def count_queueing(s: State, d: int) -> None:
    """Count what a queued drone has waited for a pad in this episode."""
    s.i[QUEUEING_US] += s.i[NOW] - max(s.i[drone_of(s, d) + SINCE_US], 0)


@inner
def on_depletion(w: Fixed, s: State, d: int) -> None:
    """The battery is empty in the air: the drone falls where it is, its users are dropped."""
    drone = drone_of(s, d)
    note(s, DEPLETION, K_DEPLETE, d, -1, -1, -1)
    x_m, y_m, _ = position(w, s, d)
    count_distance(w, s, d)
    change_mode(w, s, d, CRASHED)
    nx, ny = w.i[NX], w.i[NY]
    x = cell_index(x_m, w.f[CELL_X_M], nx)
    y = cell_index(y_m, w.f[CELL_Y_M], ny)
    _hover_at(s, d, x, y, 0)
    s.i[drone + FALLEN] = 1
    s.f[spot_of(s, d) + FALLEN_X_M], s.f[spot_of(s, d) + FALLEN_Y_M] = x_m, y_m
    s.i[drone + WAITS] = 0
    s.i[drone + HOPPING] = 0
    s.i[drone + ROUTE] = s.i[drone + ROUTE_END] = 0
    undo(s, arrival_slot(w, d))
    silence(w, s, d, DEPLETION)
    s.i[s.i[AT_CRASHED] + s.i[CRASHES]] = d
    s.i[CRASHES] += 1
    note(s, DEPLETION, K_CRASH, d, -1, -1, -1)
    note_leg(w, s, d)


@inner
def respawn(w: Fixed, s: State, d: int, station: int) -> None:
    """A new drone takes its place, on a station."""
    appear(w, s, d, w.i[w.i[AT_STATIONS] + 2 * station], w.i[w.i[AT_STATIONS] + 2 * station + 1])
    note(s, RESPAWN, K_RESPAWN, d, -1, -1, station)
    note_leg(w, s, d)
    s.i[drone_of(s, d) + WAITS] = 1
