"""The air link: who is covered, who is attached to whom, and who is served.

The same as ``engine.des.airlink``, over arrays. Attachment and admission always follow in the
attachment phase of an instant, or after all of its commands.
"""

from __future__ import annotations

from desim_uav.engine.batch.access import (
    asking_of,
    closed_of,
    covering_of,
    crossings_of,
    drone_of,
    event_of,
    leg_offsets_of,
    legs_of,
    profile_of,
    request_of,
    served_of,
    user_of,
    waiting_of,
)
from desim_uav.engine.batch.kernels import inner, kernel
from desim_uav.engine.batch.memory import (
    AFFECTED,
    AT_AFFECTED,
    AT_HANDOVERS,
    AT_LOOSE,
    AT_OPEN_REQUESTS,
    AT_ROW_OFFSETS,
    AT_SHARES,
    ATTACHED_FROM_US,
    ATTACHED_SO_FAR_US,
    ATTACHED_US,
    ATTACHED_USERS,
    BANDWIDTH_BPS,
    BANDWIDTH_US_BPS,
    BPS,
    C_ATTACHED_US,
    C_BPS,
    C_INTERRUPTIONS,
    C_REQUEST,
    C_REQUIRED_US,
    C_SERVED_US,
    C_SERVICE,
    C_T_END_US,
    C_T_FIRST_US,
    C_T_REQUEST_US,
    C_USER,
    CELL_X_M,
    CELL_Y_M,
    CLOSED,
    CLOSED_QOE1,
    CROSSING_ENTERS,
    CROSSING_TIME,
    CROSSING_USER,
    CROSSINGS,
    DRONES,
    EVENTS,
    FREE_BPS,
    FULL,
    HANDOVERS,
    HELD_SINCE_US,
    HOLDER,
    HORIZON_US,
    IN_SERVICE,
    INTERRUPTIONS,
    K_ATTACH,
    K_CLOSE,
    K_COMPLETE,
    K_DETACH,
    K_ENTER,
    K_EXIT,
    K_REQUEST,
    K_SERVE,
    K_STOP,
    LAST_DRONE,
    LOOSE,
    MOST_CLOSED,
    MOST_EVENTS,
    MOST_HANDOVERS,
    MOST_LOOSE,
    NEXT_ROW,
    NOW,
    OPEN_US,
    OPENED,
    P_AFTER_PREVIOUS,
    QUEUED_UP,
    RADIO,
    RADIUS_M,
    REQUEST,
    REQUIRED_US,
    SERVED_SO_FAR_US,
    SERVED_US,
    SERVICE,
    SERVING,
    STARTED_US,
    STEP_US,
    STOPPED_US,
    SUPPRESSED,
    T_FIRST_US,
    T_REQUEST_US,
    TO_X,
    TO_Y,
    TRANSIT,
    USED_BPS,
    USERS,
    Fixed,
    Ints,
    Path,
    State,
    X,
    Y,
)
from desim_uav.engine.batch.queue import ATTACHMENT, COMPLETION, ENTRY, EXIT, RECORD, due, key, undo
from desim_uav.engine.batch.queue import REQUEST as REQUEST_PHASE
from desim_uav.model.coverage import crossings
from desim_uav.model.demand import BANDWIDTH_BPS as ROW_BPS
from desim_uav.model.demand import DUE_US
from desim_uav.model.demand import REQUIRED_US as ROW_REQUIRED_US
from desim_uav.model.demand import SERVICE as ROW_SERVICE


@inner
def note(
    s: State, phase: int, kind: int, drone: int, user: int, request: int, station: int
) -> None:
    """Write to the log, where events are kept."""
    if s.i[MOST_EVENTS] == 0:
        return
    row = s.i[EVENTS]
    s.i[EVENTS] = row + 1
    if row >= s.i[MOST_EVENTS]:
        s.i[FULL] = 1
        return
    event = event_of(s, row)
    event[0], event[1], event[2], event[3] = s.i[NOW], phase, kind, drone
    event[4], event[5], event[6] = user, request, station


# ---- slots


@inner
def ask_slot(w: Fixed, user: int) -> int:
    """A user's next request; its completion has the slot of its own number."""
    return int(w.i[USERS] + user)


@inner
def crossing_slot(w: Fixed, drone: int) -> int:
    """A drone's next crossing."""
    return int(2 * w.i[USERS] + drone)


@inner
def settle_slot(w: Fixed) -> int:
    """Attachment and admission."""
    return int(2 * w.i[USERS] + 3 * w.i[DRONES])


# ---- coverage


@inner
def track(w: Fixed, p: Path, s: State, d: int, span_us: int, phase: int) -> None:
    """Foresee all crossings of a serving drone's leg of ``span_us``, from now on.

    Those of this very instant happen at once, in ``phase``.
    """
    drone = drone_of(s, d)
    now_us = s.i[NOW]
    ahead = crossings_of(s, d)
    transit = drone[TRANSIT]
    count = crossings(
        profile_of(w, transit),
        (drone[X] + 0.5) * w.f[CELL_X_M],
        (drone[Y] + 0.5) * w.f[CELL_Y_M],
        (drone[TO_X] + 0.5) * w.f[CELL_X_M],
        (drone[TO_Y] + 0.5) * w.f[CELL_Y_M],
        now_us,
        now_us + span_us,
        w.f[RADIUS_M],
        legs_of(p),
        leg_offsets_of(p),
        drone[RADIO] == 0,
        ahead,
    )
    if count > len(ahead):
        s.i[FULL] = 1
        count = len(ahead)
    _sort_last_first(ahead, count)
    drone[RADIO] = 1
    while count > 0 and ahead[count - 1, CROSSING_TIME] == now_us:
        count -= 1
        _cross(w, s, d, ahead[count], phase, phase)
    drone[CROSSINGS] = count
    _await_next(w, s, d)
    settle_after(w, s, phase)


@inner
def _is_later(one: Ints, other: Ints) -> bool:
    """Does a crossing come after another: by time, entries after exits, by user?"""
    if one[CROSSING_TIME] != other[CROSSING_TIME]:
        return bool(one[CROSSING_TIME] > other[CROSSING_TIME])
    if one[CROSSING_ENTERS] != other[CROSSING_ENTERS]:
        return bool(one[CROSSING_ENTERS] > other[CROSSING_ENTERS])
    return bool(one[CROSSING_USER] > other[CROSSING_USER])


@inner
def _swap(rows: Ints, i: int, j: int) -> None:
    for column in range(3):
        rows[i, column], rows[j, column] = rows[j, column], rows[i, column]


@inner
def _sink(rows: Ints, parent: int, count: int) -> None:
    while True:
        child = 2 * parent + 1
        if child >= count:
            return
        if child + 1 < count and _is_later(rows[child], rows[child + 1]):
            child += 1
        if not _is_later(rows[parent], rows[child]):
            return
        _swap(rows, parent, child)
        parent = child


@inner
def _sort_last_first(rows: Ints, count: int) -> None:
    """Heapsort, the latest crossing first."""
    for parent in range(count // 2 - 1, -1, -1):
        _sink(rows, parent, count)
    for last in range(count - 1, 0, -1):
        _swap(rows, 0, last)
        _sink(rows, 0, last)


@inner
def _await_next(w: Fixed, s: State, d: int) -> None:
    count = drone_of(s, d)[CROSSINGS]
    if count == 0:
        undo(s, crossing_slot(w, d))
        return
    t_us, user, enters = crossings_of(s, d)[count - 1]
    due(s, crossing_slot(w, d), t_us, key(ENTRY if enters else EXIT, d, user))


@inner
def _cross(w: Fixed, s: State, d: int, crossing: Ints, entry: int, exit_: int) -> None:
    if crossing[CROSSING_ENTERS]:
        _enter(s, d, crossing[CROSSING_USER], entry)
    else:
        _leave(w, s, d, crossing[CROSSING_USER], exit_)


@inner
def on_crossing(w: Fixed, s: State, d: int) -> None:
    """The next crossing of a drone's leg."""
    count = drone_of(s, d)[CROSSINGS] - 1
    drone_of(s, d)[CROSSINGS] = count
    _await_next(w, s, d)
    _cross(w, s, d, crossings_of(s, d)[count], ENTRY, EXIT)
    settle_after(w, s, ENTRY)


@inner
def _enter(s: State, d: int, user: int, phase: int) -> None:
    covering_of(s, user)[d] = s.i[NOW]
    note(s, phase, K_ENTER, d, user, -1, -1)
    if user_of(s, user)[REQUEST] >= 0:
        asking_of(s, d)[user_of(s, user)[SERVICE]] += 1
    if user_of(s, user)[HOLDER] < 0:
        _loosen(s, user)


@inner
def _leave(w: Fixed, s: State, d: int, user: int, phase: int) -> None:
    covering_of(s, user)[d] = -1
    note(s, phase, K_EXIT, d, user, -1, -1)
    if user_of(s, user)[REQUEST] >= 0:
        asking_of(s, d)[user_of(s, user)[SERVICE]] -= 1
    if user_of(s, user)[HOLDER] == d:
        _detach(w, s, d, user, phase)


@inner
def silence(w: Fixed, s: State, d: int, phase: int) -> None:
    """The drone stops serving: its footprint is gone."""
    drone = drone_of(s, d)
    if drone[RADIO] == 0:
        return
    drone[RADIO] = 0
    drone[CROSSINGS] = 0
    undo(s, crossing_slot(w, d))
    for user in range(w.i[USERS]):
        if covering_of(s, user)[d] >= 0:
            _leave(w, s, d, user, phase)
    settle_after(w, s, phase)


# ---- attachment and admission


@inner
def _loosen(s: State, user: int) -> None:
    if s.i[LOOSE] >= s.i[MOST_LOOSE]:
        s.i[FULL] = 1
        return
    s.i[s.i[AT_LOOSE] + s.i[LOOSE]] = user
    s.i[LOOSE] += 1


@inner
def _affect(s: State, d: int) -> None:
    if s.i[s.i[AT_AFFECTED] + d] == 0:
        s.i[s.i[AT_AFFECTED] + d] = 1
        s.i[AFFECTED] += 1


@inner
def _detach(w: Fixed, s: State, d: int, user: int, phase: int) -> None:
    whole, u, now_us = s.i, user_of(s, user), s.i[NOW]
    since_us = u[HELD_SINCE_US]
    if u[REQUEST] >= 0:
        _count_attached(u, now_us)
        if u[SERVING] < 0:
            _no_longer_wait(s, d, user)
        else:
            _stop(s, user, phase)
            if drone_of(s, d)[QUEUED_UP] > 0:
                _affect(s, d)
    whole[ATTACHED_US] += now_us - since_us
    whole[ATTACHED_FROM_US] -= since_us
    u[HOLDER] = -1
    drone_of(s, d)[ATTACHED_USERS] -= 1
    note(s, phase, K_DETACH, d, user, -1, -1)
    for other in range(w.i[DRONES]):
        if covering_of(s, user)[other] >= 0:
            _loosen(s, user)
            break


@inner
def _attach(s: State, d: int, user: int, phase: int) -> None:
    u, now_us = user_of(s, user), s.i[NOW]
    u[HOLDER] = d
    u[HELD_SINCE_US] = now_us
    s.i[ATTACHED_FROM_US] += now_us
    drone_of(s, d)[ATTACHED_USERS] += 1
    note(s, phase, K_ATTACH, d, user, -1, -1)
    if u[REQUEST] >= 0:
        _wait(s, d, user)
        _affect(s, d)


@inner
def settle_after(w: Fixed, s: State, phase: int) -> None:
    """See to it that whoever is loose gets attached, and affected queues get scanned."""
    if phase <= ATTACHMENT and (s.i[LOOSE] > 0 or s.i[AFFECTED] > 0):
        due(s, settle_slot(w), s.i[NOW], key(ATTACHMENT, -1, -1))


@inner
def settle(w: Fixed, s: State, attachment: int, admission: int) -> None:
    """Attach whoever is loose, to the drone entered first; then scan the affected queues."""
    whole = s.i
    for k in range(whole[LOOSE]):
        user = s.i[s.i[AT_LOOSE] + k]
        if user_of(s, user)[HOLDER] < 0:
            first = _entered_first(w, s, user)
            if first >= 0:
                _attach(s, first, user, attachment)
    whole[LOOSE] = 0
    if whole[AFFECTED] > 0:
        for d in range(w.i[DRONES]):
            if s.i[s.i[AT_AFFECTED] + d]:
                s.i[s.i[AT_AFFECTED] + d] = 0
                _scan(w, s, d, admission)
        whole[AFFECTED] = 0


@inner
def _entered_first(w: Fixed, s: State, user: int) -> int:
    """The drone whose footprint was entered first; ties: the lowest index; -1: none."""
    first = -1
    for d in range(w.i[DRONES]):
        entered_us = covering_of(s, user)[d]
        if entered_us >= 0 and (first < 0 or entered_us < covering_of(s, user)[first]):
            first = d
    return first


@inner
def _wait(s: State, d: int, user: int) -> None:
    """A request waits, in its place: by the time of the request, then by user."""
    waiting, place = waiting_of(s, d), drone_of(s, d)[QUEUED_UP]
    asked_us = user_of(s, user)[T_REQUEST_US]
    while place > 0:
        before = waiting[place - 1]
        t_us = user_of(s, before)[T_REQUEST_US]
        if t_us < asked_us or (t_us == asked_us and before < user):
            break
        waiting[place] = before
        place -= 1
    waiting[place] = user
    drone_of(s, d)[QUEUED_UP] += 1


@inner
def _no_longer_wait(s: State, d: int, user: int) -> None:
    waiting, last = waiting_of(s, d), drone_of(s, d)[QUEUED_UP] - 1
    place = 0
    while waiting[place] != user:
        place += 1
    for k in range(place, last):
        waiting[k] = waiting[k + 1]
    drone_of(s, d)[QUEUED_UP] = last


@inner
def _scan(w: Fixed, s: State, d: int, phase: int) -> None:
    """One admission scan of a drone's queue: in order, each that fits is served."""
    waiting, count = waiting_of(s, d), drone_of(s, d)[QUEUED_UP]
    unlimited = w.i[BANDWIDTH_BPS] < 0
    kept = 0
    for k in range(count):
        user = waiting[k]
        if unlimited or user_of(s, user)[BPS] <= drone_of(s, d)[FREE_BPS]:
            _serve(w, s, d, user, phase)
        else:
            waiting[kept] = user
            kept += 1
    drone_of(s, d)[QUEUED_UP] = kept


@inner
def _serve(w: Fixed, s: State, d: int, user: int, phase: int) -> None:
    whole, u, now_us = s.i, user_of(s, user), s.i[NOW]
    drone_of(s, d)[FREE_BPS] -= u[BPS]
    drone_of(s, d)[USED_BPS] += u[BPS]
    served_of(s, d)[u[SERVICE]] += 1
    u[SERVING] = d
    u[STARTED_US] = now_us
    whole[IN_SERVICE] += 1
    whole[SERVED_US] -= now_us
    note(s, phase, K_SERVE, d, user, u[REQUEST], -1)
    done_us = now_us + u[REQUIRED_US] - u[SERVED_SO_FAR_US]
    if done_us <= w.i[HORIZON_US]:
        due(s, user, done_us, key(COMPLETION, d, user))


@inner
def _stop(s: State, user: int, phase: int) -> None:
    whole, u, now_us = s.i, user_of(s, user), s.i[NOW]
    d = u[SERVING]
    u[SERVING] = -1
    undo(s, user)
    elapsed_us = now_us - u[STARTED_US]
    if elapsed_us > 0:
        u[SERVED_SO_FAR_US] += elapsed_us
        if u[T_FIRST_US] < 0:
            u[T_FIRST_US] = u[STARTED_US]
        elif u[STARTED_US] > u[STOPPED_US]:
            u[INTERRUPTIONS] += 1
        if u[LAST_DRONE] != d:
            u[LAST_DRONE] = d
            _hand_over(s, u[REQUEST], d)
        u[STOPPED_US] = now_us
    whole[IN_SERVICE] -= 1
    whole[SERVED_US] += now_us
    s.f[s.i[AT_SHARES] + user] = u[SERVED_SO_FAR_US] / u[REQUIRED_US]
    whole[BANDWIDTH_US_BPS] += elapsed_us * u[BPS]
    drone_of(s, d)[FREE_BPS] += u[BPS]
    drone_of(s, d)[USED_BPS] -= u[BPS]
    served_of(s, d)[u[SERVICE]] -= 1
    note(s, phase, K_STOP, d, user, u[REQUEST], -1)


@inner
def _hand_over(s: State, request: int, d: int) -> None:
    if s.i[MOST_CLOSED] == 0:
        return
    row = s.i[HANDOVERS]
    s.i[HANDOVERS] = row + 1
    if row >= s.i[MOST_HANDOVERS]:
        s.i[FULL] = 1
    else:
        at = s.i[AT_HANDOVERS] + 2 * row
        s.i[at], s.i[at + 1] = request, d


# ---- requests


@inner
def on_request(w: Fixed, p: Path, s: State, user: int) -> None:
    """A user asks, unless (in an open loop) a request of its is open."""
    u = user_of(s, user)
    row = u[NEXT_ROW]
    u[NEXT_ROW] = row + 1
    if not p.i[P_AFTER_PREVIOUS] and row + 1 < p.i[p.i[AT_ROW_OFFSETS] + user + 1]:
        next_us = request_of(p, row + 1)[DUE_US]
        if next_us < w.i[HORIZON_US]:
            due(s, ask_slot(w, user), next_us, key(REQUEST_PHASE, -1, user))
    if u[REQUEST] >= 0:
        s.i[SUPPRESSED] += 1
    else:
        _ask(w, s, user, request_of(p, row))


@inner
def _ask(w: Fixed, s: State, user: int, row: Ints) -> None:
    whole, u, now_us = s.i, user_of(s, user), s.i[NOW]
    service = row[ROW_SERVICE]
    u[REQUEST] = whole[OPENED]
    u[SERVICE] = service
    u[REQUIRED_US] = row[ROW_REQUIRED_US]
    u[BPS] = row[ROW_BPS]
    u[T_REQUEST_US] = now_us
    u[SERVED_SO_FAR_US] = 0
    u[ATTACHED_SO_FAR_US] = 0
    u[INTERRUPTIONS] = 0
    u[T_FIRST_US] = -1
    u[STARTED_US] = -1
    u[STOPPED_US] = -1
    u[SERVING] = -1
    u[LAST_DRONE] = -1
    whole[OPENED] += 1
    whole[OPEN_US] -= now_us
    s.i[s.i[AT_OPEN_REQUESTS] + service] += 1
    for d in range(w.i[DRONES]):
        if covering_of(s, user)[d] >= 0:
            asking_of(s, d)[service] += 1
    note(s, REQUEST_PHASE, K_REQUEST, -1, user, u[REQUEST], -1)
    holder = u[HOLDER]
    if holder >= 0:
        _wait(s, holder, user)
        _affect(s, holder)
        settle_after(w, s, REQUEST_PHASE)


@inner
def on_completion(w: Fixed, p: Path, s: State, user: int) -> None:
    """A request has had all it asked for."""
    d = user_of(s, user)[SERVING]
    _stop(s, user, COMPLETION)
    _close(w, p, s, user, COMPLETION, K_COMPLETE)
    if drone_of(s, d)[QUEUED_UP] > 0:
        _affect(s, d)
        settle_after(w, s, COMPLETION)


@inner
def _count_attached(u: Ints, now_us: int) -> None:
    u[ATTACHED_SO_FAR_US] += now_us - max(u[HELD_SINCE_US], u[T_REQUEST_US])


@inner
def _close(w: Fixed, p: Path, s: State, user: int, phase: int, kind: int) -> None:
    whole, u, now_us = s.i, user_of(s, user), s.i[NOW]
    holder = u[HOLDER]
    if holder >= 0:
        _count_attached(u, now_us)
    if 0 < u[SERVED_SO_FAR_US] < u[REQUIRED_US] and now_us > u[STOPPED_US]:
        u[INTERRUPTIONS] += 1
    s.f[CLOSED_QOE1] += u[SERVED_SO_FAR_US] / u[REQUIRED_US]
    s.f[s.i[AT_SHARES] + user] = 0.0
    whole[OPEN_US] += now_us
    s.i[s.i[AT_OPEN_REQUESTS] + u[SERVICE]] -= 1
    for d in range(w.i[DRONES]):
        if covering_of(s, user)[d] >= 0:
            asking_of(s, d)[u[SERVICE]] -= 1
    _write_closed(s, user)
    note(s, phase, kind, holder, user, u[REQUEST], -1)
    u[REQUEST] = -1
    row = u[NEXT_ROW]
    if p.i[P_AFTER_PREVIOUS] and row < p.i[p.i[AT_ROW_OFFSETS] + user + 1]:
        again_us = now_us + request_of(p, row)[DUE_US]
        if again_us < w.i[HORIZON_US]:
            due(s, ask_slot(w, user), again_us, key(REQUEST_PHASE, -1, user))


@inner
def _write_closed(s: State, user: int) -> None:
    if s.i[MOST_CLOSED] == 0:
        return
    u = user_of(s, user)
    row = s.i[CLOSED]
    s.i[CLOSED] = row + 1
    if row >= s.i[MOST_CLOSED]:
        s.i[FULL] = 1
        return
    closed = closed_of(s, row)
    closed[C_REQUEST] = u[REQUEST]
    closed[C_USER] = user
    closed[C_SERVICE] = u[SERVICE]
    closed[C_BPS] = u[BPS]
    closed[C_REQUIRED_US] = u[REQUIRED_US]
    closed[C_SERVED_US] = u[SERVED_SO_FAR_US]
    closed[C_ATTACHED_US] = u[ATTACHED_SO_FAR_US]
    closed[C_T_REQUEST_US] = u[T_REQUEST_US]
    closed[C_T_FIRST_US] = u[T_FIRST_US]
    closed[C_T_END_US] = s.i[NOW]
    closed[C_INTERRUPTIONS] = u[INTERRUPTIONS]


@inner
def end_all(w: Fixed, p: Path, s: State) -> None:
    """The episode ends: every open request closes, attachments and coverage clear."""
    for user in range(w.i[USERS]):
        if user_of(s, user)[REQUEST] >= 0:
            if user_of(s, user)[SERVING] >= 0:
                _stop(s, user, RECORD)
            _close(w, p, s, user, RECORD, K_CLOSE)
    for user in range(w.i[USERS]):
        for d in range(w.i[DRONES]):
            if covering_of(s, user)[d] >= 0:
                _leave(w, s, d, user, RECORD)


@kernel
def measures(w: Fixed, s: State) -> tuple[float, float, float]:
    """QoE1-3 so far, open requests by what they have had so far; nan where nothing was asked."""
    whole, now_us = s.i, s.i[NOW]
    qoe1, opened = s.f[CLOSED_QOE1], whole[OPENED]
    open_now = 0
    for user in range(w.i[USERS]):
        u = user_of(s, user)
        if u[REQUEST] >= 0:
            open_now += 1
            share = s.f[s.i[AT_SHARES] + user]
            if u[SERVING] >= 0:
                share = (u[SERVED_SO_FAR_US] + now_us - u[STARTED_US]) / u[REQUIRED_US]
            qoe1 += share
    open_us = whole[OPEN_US] + open_now * now_us
    served_us = whole[SERVED_US] + whole[IN_SERVICE] * now_us
    attached = 0
    for d in range(w.i[DRONES]):
        attached += drone_of(s, d)[ATTACHED_USERS]
    attached_us = whole[ATTACHED_US] + attached * now_us - whole[ATTACHED_FROM_US]
    lasted_us = w.i[USERS] * now_us
    first = 100 * qoe1 / opened if opened else float("nan")
    second = (open_us - served_us) / w.i[STEP_US] / opened if opened else float("nan")
    third = 100 * attached_us / lasted_us if lasted_us else float("nan")
    return first, second, third
