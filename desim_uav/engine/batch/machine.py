"""One decision step of one environment, as ``engine.des.simulation`` has it."""

from __future__ import annotations

from desim_uav.engine.batch.access import (
    asking_of,
    covering_of,
    drone_of,
    mask_of,
    move_of,
    record_of,
    request_of,
    seen_of,
    served_of,
    spot_of,
    station_of,
    transit_of,
    user_of,
)
from desim_uav.engine.batch.airlink import (
    ask_slot,
    end_all,
    note,
    on_completion,
    on_crossing,
    on_request,
    settle,
    track,
)
from desim_uav.engine.batch.drones import (
    CHARGE,
    CHARGING,
    CRASHED,
    FLYING,
    GOTO,
    HOVER,
    QUEUED,
    RETURNING,
    appear,
    arrival_slot,
    at_station,
    await_full,
    battery_now,
    count_distance,
    count_queueing,
    foresee_depletion,
    go_home,
    grant,
    note_leg,
    obey,
    on_arrival,
    on_depletion,
    orient,
    position,
    respawn,
)
from desim_uav.engine.batch.kernels import inner, part
from desim_uav.engine.batch.memory import (
    ACTIONS,
    AT_AFFECTED,
    AT_ASKED,
    AT_HISTORY,
    AT_OPEN_REQUESTS,
    AT_RESPAWN,
    AT_ROW_OFFSETS,
    AT_SHARES,
    AT_SLOT_TIME,
    AT_STARTS,
    AT_STATES,
    ATTACHED_USERS,
    BACK,
    BACK_LEVEL,
    BACK_X,
    BACK_Y,
    BANDWIDTH_BPS,
    CAPACITY_US,
    CLOSED,
    CLOSED_QOE1,
    COUNTERS,
    COVERED,
    CROSSINGS,
    DISTANCE_M,
    DRONES,
    DURATION_US,
    EPOCH,
    EVENTS,
    FREE_BPS,
    HANDOVERS,
    HOLDER,
    HOPPING,
    HORIZON_US,
    K_DECIDE,
    LANDED_IN,
    MODE,
    MOVE_ACTION,
    NEXT_ROW,
    NOW,
    ON_CRASH,
    ON_CRASH_END,
    ON_CRASH_REMOVE,
    P_AT_RANDOM,
    QUEUED_UP,
    R_ATTACHED,
    R_BACK,
    R_BATTERY_US,
    R_MODE,
    R_SERVED,
    R_USED_BPS,
    RADIO,
    REQUEST,
    RESPAWN_AFTER_US,
    RESPAWNS,
    RESPAWNS_DRAWN,
    RETURN_BELOW_US,
    S_ATTACHED,
    S_BACK,
    S_BATTERY_US,
    S_LEVEL,
    S_MODE,
    S_USED_BPS,
    S_X,
    S_Y,
    SEEN_FROM_US,
    SEEN_TO_US,
    SEEN_US,
    SEEN_X_M,
    SEEN_Y_M,
    SEEN_Z_M,
    SERVICES,
    SERVING,
    SINCE_US,
    STAND,
    STATIONS,
    STEP_US,
    STEPS,
    TAKEN,
    TERMINATED,
    TOLD,
    TRANSIT,
    TRUNCATED,
    USED_BPS,
    USERS,
    WAITS,
    Fixed,
    Ints,
    Path,
    State,
)
from desim_uav.engine.batch.queue import (
    ADMISSION,
    ARRIVAL,
    ATTACHMENT,
    COMMAND,
    COVERAGE,
    ENTRY,
    RECORD,
    RESPAWN,
    clear_all,
    due,
    is_before,
    key,
    next_slot,
    undo,
)
from desim_uav.engine.batch.queue import REQUEST as REQUEST_PHASE
from desim_uav.engine.batch.rewards import S_COUNTS, reward
from desim_uav.engine.batch.standing import stand
from desim_uav.engine.batch.walking import begin_walks
from desim_uav.model.demand import DUE_US

IDLE, ATTACHED, OPEN, SERVED = range(4)
"""See ``UserState``."""


# ---- an episode


@inner
def start_afresh(w: Fixed, s: State) -> None:
    """Put the drones at their starts."""
    s.i[NOW] = 0
    for d in range(w.i[DRONES]):
        appear(w, s, d, w.i[w.i[AT_STARTS] + 2 * d], w.i[w.i[AT_STARTS] + 2 * d + 1])
        s.i[drone_of(s, d) + HOPPING] = 0
    for station in range(w.i[STATIONS]):
        s.i[station_of(s, station) + 0] = 0


@inner
def reset(w: Fixed, p: Path, s: State) -> None:
    """Begin an episode with the drones as they are, and run up to its first decision epoch."""
    _forget(w, s)
    s.i[STAND] = stand(w, p)
    if p.i[P_AT_RANDOM]:
        begin_walks(w, p, s)
    drones = w.i[DRONES]
    for d in range(drones):
        drone = drone_of(s, d)
        if s.i[drone + MODE] == FLYING:
            track(w, p, s, d, 0, ENTRY)
        orient(w, p, s, d, 0)
    for user in range(w.i[USERS]):
        row = p.i[p.i[AT_ROW_OFFSETS] + user]
        s.i[user_of(s, user) + NEXT_ROW] = row
        if row < p.i[p.i[AT_ROW_OFFSETS] + user + 1]:
            due_us = p.i[request_of(p, row) + DUE_US]
            if due_us < w.i[HORIZON_US]:
                due(s, ask_slot(w, user), due_us, key(REQUEST_PHASE, -1, user))
    for d in range(drones):
        _take_up(w, s, d)
    for station in range(w.i[STATIONS]):
        grant(w, s, station)
    _run_before(w, p, s, 0, key(RESPAWN, -1, -1))
    _observe(w, s)
    _respawn(w, p, s)
    _show(w, s)


@inner
def _forget(w: Fixed, s: State) -> None:
    """Users, requests and measures begin anew; what drones do is as long ago as it was."""
    ended_us = s.i[NOW]
    for counter in range(COUNTERS):
        s.i[counter] = 0
    s.i[SEEN_FROM_US] = s.i[SEEN_TO_US] = -1
    s.f[CLOSED_QOE1] = s.f[DISTANCE_M] = 0.0
    for d in range(w.i[DRONES]):
        drone = drone_of(s, d)
        s.i[drone + SINCE_US] -= ended_us
        s.i[drone + RESPAWNS] = s.i[drone + WAITS] = s.i[drone + RADIO] = s.i[drone + CROSSINGS] = 0
        s.i[drone + FREE_BPS] = w.i[BANDWIDTH_BPS]
        s.i[drone + USED_BPS] = s.i[drone + ATTACHED_USERS] = s.i[drone + QUEUED_UP] = 0
        for service in range(w.i[SERVICES]):
            s.i[served_of(s, d) + service] = s.i[asking_of(s, d) + service] = 0
        s.i[s.i[AT_AFFECTED] + d] = 0
    for user in range(w.i[USERS]):
        u = user_of(s, user)
        s.i[u + HOLDER] = s.i[u + REQUEST] = s.i[u + SERVING] = -1
        s.i[u + COVERED] = 0
        s.f[s.i[AT_SHARES] + user] = 0.0
        for d in range(w.i[DRONES]):
            s.i[covering_of(s, user) + d] = -1
    for service in range(w.i[SERVICES]):
        s.i[s.i[AT_OPEN_REQUESTS] + service] = 0
    clear_all(s)


@inner
def _take_up(w: Fixed, s: State, d: int) -> None:
    """Go on with what the drone was about in the episode before."""
    drone = drone_of(s, d)
    mode = s.i[drone + MODE]
    note_leg(w, s, d)
    if mode == RETURNING:
        if s.i[drone + HOPPING]:
            duration_us = w.i[transit_of(w, s.i[drone + TRANSIT]) + DURATION_US]
            due(s, arrival_slot(w, d), s.i[drone + SINCE_US] + duration_us, key(ARRIVAL, d, -1))
            foresee_depletion(w, s, d, duration_us)
        else:
            go_home(w, s, d, ARRIVAL)
    elif mode == QUEUED:
        s.i[drone + LANDED_IN] = ARRIVAL
    elif mode == CHARGING:
        await_full(w, s, d)
    elif mode != CRASHED:
        s.i[drone + WAITS] = 1


# ---- a step


@inner
def step(w: Fixed, p: Path, s: State, commands: Ints) -> None:
    """Give each drone its command (an index of an action) and run to the next decision epoch."""
    s.i[EVENTS] = s.i[CLOSED] = s.i[HANDOVERS] = 0
    for d in range(w.i[DRONES]):
        drone = drone_of(s, d)
        told = commands[d]
        s.i[drone + TOLD] = told if 0 <= told < w.i[ACTIONS] else -1
        s.i[s.i[AT_HISTORY] + s.i[EPOCH] * w.i[DRONES] + d] = told
        s.i[drone + TAKEN] = _obeyed(w, s, d, s.i[drone + TOLD])
        if s.i[drone + WAITS]:
            note(s, COMMAND, K_DECIDE, d, -1, -1, -1)
    for d in range(w.i[DRONES]):
        if s.i[drone_of(s, d) + WAITS]:
            obey(w, p, s, d, s.i[drone_of(s, d) + TAKEN])
    settle(w, s, COVERAGE, ADMISSION)
    end_us = s.i[NOW] + w.i[STEP_US]
    _run_before(w, p, s, end_us, key(RECORD, -1, -1))
    s.i[NOW] = end_us
    _record(w, p, s)


@part
def _obeyed(w: Fixed, s: State, d: int, told: int) -> int:
    """The index of the action a command leads to: itself, else the mask's only one, else hover."""
    mask = mask_of(s, d)
    if told >= 0 and s.i[mask + told]:
        return int(told)
    allowed, only = 0, 0
    for k in range(w.i[ACTIONS]):
        if s.i[mask + k]:
            allowed += 1
            only = k
    if allowed == 1:
        return only
    hover = 0
    while w.i[move_of(w, hover) + MOVE_ACTION] != HOVER:
        hover += 1
    return hover


@inner
def _run_before(w: Fixed, p: Path, s: State, end_us: int, end_key: int) -> None:
    """Let everything happen that comes before a place in an instant."""
    users, drones = w.i[USERS], w.i[DRONES]
    while is_before(s, next_slot(s), end_us, end_key):
        slot = next_slot(s)
        s.i[NOW] = s.i[s.i[AT_SLOT_TIME] + slot]
        if 2 * users <= slot < 2 * users + drones:
            on_crossing(w, s, slot - 2 * users)
            continue  # its slot is the next crossing's
        undo(s, slot)
        if slot < users:
            on_completion(w, p, s, slot)
        elif slot < 2 * users:
            on_request(w, p, s, slot - users)
        else:
            slot -= 2 * users
            if slot < 2 * drones:
                on_arrival(w, s, slot - drones)
            elif slot < 3 * drones:
                on_depletion(w, s, slot - 2 * drones)
            else:
                settle(w, s, ATTACHMENT, ATTACHMENT)


# ---- a decision epoch


@part
def _record(w: Fixed, p: Path, s: State) -> None:
    """Phase 8: the step's record, its reward, and the end of the episode; then respawns."""
    whole = s.i
    whole[EPOCH] += 1
    crashed = False
    for d in range(w.i[DRONES]):
        orient(w, p, s, d, whole[EPOCH])
        crashed = crashed or s.i[drone_of(s, d) + MODE] == CRASHED
    _observe(w, s)
    for d in range(w.i[DRONES]):
        reward(w, s, d)
        _write_record(w, s, d)
    whole[TERMINATED] = crashed and w.i[ON_CRASH] == ON_CRASH_END
    whole[TRUNCATED] = whole[EPOCH] == w.i[STEPS]
    if whole[TERMINATED] or whole[TRUNCATED]:
        _show(w, s)
        _end_episode(w, p, s)
        return
    if crashed:
        _respawn(w, p, s)
    _show(w, s)


@part
def _write_record(w: Fixed, s: State, d: int) -> None:
    seen, record = seen_of(s, d), record_of(s, d)
    s.i[record + R_BATTERY_US] = s.i[seen + S_BATTERY_US]
    s.i[record + R_MODE] = s.i[seen + S_MODE]
    s.i[record + R_ATTACHED] = s.i[seen + S_ATTACHED]
    s.i[record + R_USED_BPS] = s.i[seen + S_USED_BPS]
    s.i[record + R_BACK] = s.i[seen + S_BACK]
    s.i[record + R_SERVED] = 0
    for k in range(w.i[SERVICES]):
        s.i[record + R_SERVED] += s.i[seen + S_COUNTS + k]
    x_m, y_m, z_m = position(w, s, d)
    s.f[spot_of(s, d) + SEEN_X_M], s.f[spot_of(s, d) + SEEN_Y_M], s.f[spot_of(s, d) + SEEN_Z_M] = (
        x_m,
        y_m,
        z_m,
    )


@inner
def _end_episode(w: Fixed, p: Path, s: State) -> None:
    for user in range(w.i[USERS]):
        s.i[s.i[AT_STATES] + user] = user_state(s, user)
    end_all(w, p, s)
    for d in range(w.i[DRONES]):
        count_distance(w, s, d)
        if s.i[drone_of(s, d) + MODE] == QUEUED:
            count_queueing(s, d)


@inner
def user_state(s: State, user: int) -> int:
    """What a user is doing (see ``UserState``)."""
    u = user_of(s, user)
    if s.i[u + REQUEST] >= 0:
        return SERVED if s.i[u + SERVING] >= 0 else OPEN
    return IDLE if s.i[u + HOLDER] < 0 else ATTACHED


@inner
def _respawn(w: Fixed, p: Path, s: State) -> None:
    """Phase 9: crashed drones come back after their downtime."""
    if w.i[ON_CRASH] == ON_CRASH_REMOVE:
        return
    back = False
    for d in range(w.i[DRONES]):
        drone = drone_of(s, d)
        down_us = s.i[NOW] - s.i[drone + SINCE_US]
        if s.i[drone + MODE] == CRASHED and down_us >= w.i[RESPAWN_AFTER_US]:
            respawn(w, s, d, p.i[p.i[AT_RESPAWN] + d * p.i[RESPAWNS_DRAWN] + s.i[drone + RESPAWNS]])
            s.i[drone + RESPAWNS] += 1
            orient(w, p, s, d, s.i[EPOCH])
            back = True
    if back:
        _observe(w, s)


@inner
def _observe(w: Fixed, s: State) -> None:
    """Note what each drone knows, once it has taken its bearings."""
    services = w.i[SERVICES]
    for d in range(w.i[DRONES]):
        drone, seen = drone_of(s, d), seen_of(s, d)
        s.i[drone + SEEN_US] = battery_now(w, s, d)
        s.i[seen + S_MODE] = s.i[drone + MODE]
        s.i[seen + S_X] = s.i[drone + BACK_X]
        s.i[seen + S_Y] = s.i[drone + BACK_Y]
        s.i[seen + S_LEVEL] = s.i[drone + BACK_LEVEL]
        s.i[seen + S_BATTERY_US] = s.i[drone + SEEN_US]
        s.i[seen + S_BACK] = s.i[drone + BACK]
        s.i[seen + S_ATTACHED] = s.i[drone + ATTACHED_USERS]
        s.i[seen + S_USED_BPS] = s.i[drone + USED_BPS]
        for k in range(services):
            s.i[seen + S_COUNTS + k] = s.i[served_of(s, d) + k]
            s.i[seen + S_COUNTS + services + k] = s.i[asking_of(s, d) + k]
    for k in range(services):
        s.i[s.i[AT_ASKED] + k] = s.i[s.i[AT_OPEN_REQUESTS] + k]


@inner
def _show(w: Fixed, s: State) -> None:
    """What each drone may be told now; never nothing."""
    for d in range(w.i[DRONES]):
        drone, mask = drone_of(s, d), mask_of(s, d)
        mode = s.i[drone + MODE]
        low = s.i[drone + SEEN_US] <= w.i[RETURN_BELOW_US]
        not_full = s.i[drone + SEEN_US] < w.i[CAPACITY_US]
        for k in range(w.i[ACTIONS]):
            action = w.i[move_of(w, k) + MOVE_ACTION]
            if mode == RETURNING:
                legal = action == GOTO
            elif mode in (QUEUED, CHARGING):
                legal = action == CHARGE
            elif mode == CRASHED:
                legal = action == HOVER
            elif action == GOTO:
                legal = low
            elif action == CHARGE:
                legal = not_full and at_station(w, s, d) >= 0
            else:
                legal = True
            s.i[mask + k] = legal
