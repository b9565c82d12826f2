"""The air link: who is covered, who is attached to whom, and who is served.

The same as ``engine.des.airlink``, over arrays. Attachment and admission always follow in the
attachment phase of an instant, or after all of its commands.
"""

from __future__ import annotations

from desim_uav.engine.batch.access import (
    asking_of,
    closed_of,
    covering_of,
    crossing_of,
    drone_of,
    event_of,
    profile_of,
    request_of,
    served_of,
    transit_of,
    user_of,
    waiting_of,
)
from desim_uav.engine.batch.kernels import inner, part
from desim_uav.engine.batch.memory import (
    AFFECTED,
    AT_AFFECTED,
    AT_FOLLOWING,
    AT_HANDOVERS,
    AT_HEADS,
    AT_LEG_OFFSETS,
    AT_LOOSE,
    AT_OPEN_REQUESTS,
    AT_ROW_OFFSETS,
    AT_SHARES,
    AT_USERS_SEEN,
    ATTACHED_FROM_US,
    ATTACHED_SO_FAR_US,
    ATTACHED_US,
    ATTACHED_USERS,
    BANDWIDTH_BPS,
    BANDWIDTH_US_BPS,
    BPS,
    BUCKET_X_M,
    BUCKET_Y_M,
    BUCKETS_X,
    BUCKETS_Y,
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
    COVERED,
    CROSSING_COLUMNS,
    CROSSINGS,
    DRONES,
    EVENTS,
    FAR_M,
    FIRST_AFFECTED,
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
    LAST_AFFECTED,
    LAST_DRONE,
    LOOSE,
    MOST_CLOSED,
    MOST_CROSSINGS,
    MOST_EVENTS,
    MOST_HANDOVERS,
    MOST_LOOSE,
    NEXT_ROW,
    NOW,
    OPEN_US,
    OPENED,
    P_AFTER_PREVIOUS,
    P_AT_RANDOM,
    QUEUED_UP,
    RADIO,
    RADIUS_M,
    REQUEST,
    REQUIRED_US,
    ROWS,
    SEEN_FROM_US,
    SEEN_TO_US,
    SERVED_SO_FAR_US,
    SERVED_US,
    SERVICE,
    SERVING,
    STAND,
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
    Path,
    State,
    X,
    Y,
)
from desim_uav.engine.batch.pointers import moved, table
from desim_uav.engine.batch.queue import (
    ATTACHMENT,
    COMPLETION,
    ENTRY,
    EXIT,
    RECORD,
    due,
    is_before,
    key,
    next_slot,
    undo,
)
from desim_uav.engine.batch.queue import REQUEST as REQUEST_PHASE
from desim_uav.engine.batch.standing import recall
from desim_uav.engine.batch.walking import walk, walked
from desim_uav.model.coverage import (
    ENTERS,
    SEEN_ROWS,
    TIME_US,
    USER,
    crossings,
    crossings_near,
    look_around,
    sort_into_buckets,
)
from desim_uav.model.demand import BANDWIDTH_BPS as ROW_BPS
from desim_uav.model.demand import DUE_US
from desim_uav.model.demand import REQUIRED_US as ROW_REQUIRED_US
from desim_uav.model.demand import SERVICE as ROW_SERVICE


@inner
def note(
    s: State, phase: int, kind: int, drone: int, user: int, request: int, station: int
) -> None:
    """Write to the log, where events are kept."""
    note_at(s, s.i[NOW], phase, kind, drone, user, request, station)


@inner
def note_at(
    s: State, t_us: int, phase: int, kind: int, drone: int, user: int, request: int, station: int
) -> None:
    """The same of another time."""
    if s.i[MOST_EVENTS] == 0:
        return
    row = s.i[EVENTS]
    s.i[EVENTS] = row + 1
    if row >= s.i[MOST_EVENTS]:
        s.i[FULL] = 1
        return
    event = event_of(s, row)
    s.i[event + 0], s.i[event + 1], s.i[event + 2], s.i[event + 3] = t_us, phase, kind, drone
    s.i[event + 4], s.i[event + 5], s.i[event + 6] = user, request, station


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
    drone, first = drone_of(s, d), crossing_of(s, d, 0)
    fresh, most = s.i[drone + RADIO] == 0, s.i[MOST_CROSSINGS]
    known = s.i[STAND] and not fresh and span_us == w.i[STEP_US]
    count = recall(w, s, drone, first) if known else _foresee(w, p, s, d, span_us, fresh)
    if count > most:
        s.i[FULL] = 1
        count = most
    if not known:
        _sort_last_first(s, first, count)
    s.i[drone + RADIO] = 1
    while count > 0 and s.i[crossing_of(s, d, count - 1) + TIME_US] == s.i[NOW]:
        count -= 1
        _cross(w, s, d, crossing_of(s, d, count), phase, phase)
    s.i[drone + CROSSINGS] = count
    _await_next(w, s, d)
    settle_after(w, s, phase)


@part
def _foresee(w: Fixed, p: Path, s: State, d: int, span_us: int, fresh: bool) -> int:
    """Find the crossings of a drone's leg; their number, more than there is room for perhaps."""
    drone = drone_of(s, d)
    now_us, most = s.i[NOW], s.i[MOST_CROSSINGS]
    transit = s.i[drone + TRANSIT]
    profile, rows = profile_of(w, transit), w.i[transit_of(w, transit) + ROWS]
    first = crossing_of(s, d, 0)
    seen = table(moved(s.f, s.i[AT_USERS_SEEN]), SEEN_ROWS, w.i[USERS])
    shape, side = (w.i[BUCKETS_X], w.i[BUCKETS_Y]), (w.f[BUCKET_X_M], w.f[BUCKET_Y_M])
    buckets = shape[0] * shape[1]
    heads = table(moved(s.i, s.i[AT_HEADS]), 1, buckets)[0]
    following = table(moved(s.i, s.i[AT_FOLLOWING]), 1, w.i[USERS])[0]
    new_span = s.i[SEEN_FROM_US] != now_us or s.i[SEEN_TO_US] != now_us + span_us
    if p.i[P_AT_RANDOM]:
        if new_span:
            walk(w, s, now_us, now_us + span_us)
        legs, offsets = walked(w, s)
    else:
        legs = table(p.f, p.i[p.i[AT_LEG_OFFSETS] + w.i[USERS]], 5)
        offsets = table(moved(p.i, p.i[AT_LEG_OFFSETS]), 1, w.i[USERS] + 1)[0]
    if new_span:
        look_around(legs, offsets, now_us, now_us + span_us, seen)
        s.i[SEEN_FROM_US], s.i[SEEN_TO_US] = now_us, now_us + span_us
        if buckets > 0:
            s.f[FAR_M] = sort_into_buckets(seen, shape, side, heads, following)
    leg = (
        table(moved(w.f, profile), rows, 4),
        (s.i[drone + X] + 0.5) * w.f[CELL_X_M],
        (s.i[drone + Y] + 0.5) * w.f[CELL_Y_M],
        (s.i[drone + TO_X] + 0.5) * w.f[CELL_X_M],
        (s.i[drone + TO_Y] + 0.5) * w.f[CELL_Y_M],
        now_us,
        now_us + span_us,
        w.f[RADIUS_M],
        legs,
        offsets,
        seen,
        fresh,
        table(moved(s.i, first), most, CROSSING_COLUMNS),
    )
    if buckets > 0:
        return int(crossings_near(*leg, shape, side, s.f[FAR_M], heads, following))
    return int(crossings(*leg))


@inner
def _is_later(s: State, t_us: int, user: int, enters: int, other: int) -> bool:
    """Does a crossing come after another: by time, entries after exits, by user?"""
    if t_us != s.i[other + TIME_US]:
        return bool(t_us > s.i[other + TIME_US])
    if enters != s.i[other + ENTERS]:
        return bool(enters > s.i[other + ENTERS])
    return bool(user > s.i[other + USER])


GAPS = (1750, 701, 301, 132, 57, 23, 10, 4, 1)
"""Of a Shellsort (Ciura, 2001)."""


@inner
def _sort_last_first(s: State, first: int, count: int) -> None:
    """Shellsort, the latest crossing first."""
    for gap in GAPS:
        for k in range(gap, count):
            at = first + k * CROSSING_COLUMNS
            t_us, user, enters = s.i[at + TIME_US], s.i[at + USER], s.i[at + ENTERS]
            while at >= first + gap * CROSSING_COLUMNS:
                before = at - gap * CROSSING_COLUMNS
                if not _is_later(s, t_us, user, enters, before):
                    break
                for column in range(CROSSING_COLUMNS):
                    s.i[at + column] = s.i[before + column]
                at = before
            s.i[at + TIME_US], s.i[at + USER], s.i[at + ENTERS] = t_us, user, enters


@part
def _await_next(w: Fixed, s: State, d: int) -> None:
    count = s.i[drone_of(s, d) + CROSSINGS]
    if count == 0:
        undo(s, crossing_slot(w, d))
        return
    ahead = crossing_of(s, d, count - 1)
    phase = ENTRY if s.i[ahead + ENTERS] else EXIT
    due(s, crossing_slot(w, d), s.i[ahead + TIME_US], key(phase, d, s.i[ahead + USER]))


@part
def _cross(w: Fixed, s: State, d: int, crossing: int, entry: int, exit_: int) -> None:
    if s.i[crossing + ENTERS]:
        _enter(s, d, s.i[crossing + USER], entry)
    else:
        _leave(w, s, d, s.i[crossing + USER], exit_)


@part
def on_crossing(w: Fixed, s: State, d: int) -> None:
    """The next crossing of a drone's leg."""
    count = s.i[drone_of(s, d) + CROSSINGS] - 1
    s.i[drone_of(s, d) + CROSSINGS] = count
    _await_next(w, s, d)
    _cross(w, s, d, crossing_of(s, d, count), ENTRY, EXIT)
    settle_after(w, s, ENTRY)


@part
def _enter(s: State, d: int, user: int, phase: int) -> None:
    _cover(s, d, user, s.i[NOW])
    note(s, phase, K_ENTER, d, user, -1, -1)
    if s.i[user_of(s, user) + REQUEST] >= 0:
        s.i[asking_of(s, d) + s.i[user_of(s, user) + SERVICE]] += 1
    if s.i[user_of(s, user) + HOLDER] < 0:
        _loosen(s, user)


@inner
def _cover(s: State, d: int, user: int, since_us: int) -> None:
    """A footprint holds a user since then, or (-1) does no longer.

    Counted by what it says: a crossing may be missing where there was no room for it.
    """
    covering = covering_of(s, user) + d
    s.i[user_of(s, user) + COVERED] += int(since_us >= 0) - int(s.i[covering] >= 0)
    s.i[covering] = since_us


@inner
def _leave(w: Fixed, s: State, d: int, user: int, phase: int) -> None:
    _cover(s, d, user, -1)
    note(s, phase, K_EXIT, d, user, -1, -1)
    if s.i[user_of(s, user) + REQUEST] >= 0:
        s.i[asking_of(s, d) + s.i[user_of(s, user) + SERVICE]] -= 1
    if s.i[user_of(s, user) + HOLDER] == d:
        _detach(w, s, d, user, phase)


@inner
def silence(w: Fixed, s: State, d: int, phase: int) -> None:
    """The drone stops serving: its footprint is gone."""
    drone = drone_of(s, d)
    if s.i[drone + RADIO] == 0:
        return
    s.i[drone + RADIO] = 0
    s.i[drone + CROSSINGS] = 0
    undo(s, crossing_slot(w, d))
    for user in range(w.i[USERS]):
        if s.i[covering_of(s, user) + d] >= 0:
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
    if s.i[AFFECTED] == 0 or d < s.i[FIRST_AFFECTED]:
        s.i[FIRST_AFFECTED] = d
    if s.i[AFFECTED] == 0 or d > s.i[LAST_AFFECTED]:
        s.i[LAST_AFFECTED] = d
    s.i[s.i[AT_AFFECTED] + d] = 1
    s.i[AFFECTED] = 1


@part
def _detach(w: Fixed, s: State, d: int, user: int, phase: int) -> None:
    whole, u, now_us = s.i, user_of(s, user), s.i[NOW]
    since_us = s.i[u + HELD_SINCE_US]
    if s.i[u + REQUEST] >= 0:
        _count_attached(s, u)
        if s.i[u + SERVING] < 0:
            _no_longer_wait(s, d, user)
        else:
            _stop(s, user, phase)
            if s.i[drone_of(s, d) + QUEUED_UP] > 0:
                _affect(s, d)
    whole[ATTACHED_US] += now_us - since_us
    whole[ATTACHED_FROM_US] -= since_us
    s.i[u + HOLDER] = -1
    s.i[drone_of(s, d) + ATTACHED_USERS] -= 1
    note(s, phase, K_DETACH, d, user, -1, -1)
    if s.i[u + COVERED] > 0:
        _loosen(s, user)


@part
def _attach(s: State, d: int, user: int, phase: int) -> None:
    u, now_us = user_of(s, user), s.i[NOW]
    s.i[u + HOLDER] = d
    s.i[u + HELD_SINCE_US] = now_us
    s.i[ATTACHED_FROM_US] += now_us
    s.i[drone_of(s, d) + ATTACHED_USERS] += 1
    note(s, phase, K_ATTACH, d, user, -1, -1)
    if s.i[u + REQUEST] >= 0:
        _wait(s, d, user)
        _affect(s, d)


@inner
def settle_after(w: Fixed, s: State, phase: int) -> None:
    """See to it that whoever is loose gets attached, and affected queues get scanned.

    At once, if nothing else of this instant comes before.
    """
    if phase <= ATTACHMENT and (s.i[LOOSE] > 0 or s.i[AFFECTED] > 0):
        place = key(ATTACHMENT, -1, -1)
        if not is_before(s, next_slot(s), s.i[NOW], place + 1):
            settle(w, s, ATTACHMENT, ATTACHMENT)
        else:
            due(s, settle_slot(w), s.i[NOW], place)


@inner
def settle(w: Fixed, s: State, attachment: int, admission: int) -> None:
    """Attach whoever is loose, to the drone entered first; then scan the affected queues."""
    whole = s.i
    for k in range(whole[LOOSE]):
        user = s.i[s.i[AT_LOOSE] + k]
        if s.i[user_of(s, user) + HOLDER] < 0:
            first = _entered_first(s, user)
            if first >= 0:
                _attach(s, first, user, attachment)
    whole[LOOSE] = 0
    if whole[AFFECTED] > 0:
        for d in range(whole[FIRST_AFFECTED], whole[LAST_AFFECTED] + 1):
            if s.i[s.i[AT_AFFECTED] + d]:
                s.i[s.i[AT_AFFECTED] + d] = 0
                _scan(w, s, d, admission)
        whole[AFFECTED] = 0


@part
def _entered_first(s: State, user: int) -> int:
    """The drone whose footprint was entered first; ties: the lowest index; -1: none."""
    first, d, left = -1, 0, s.i[user_of(s, user) + COVERED]
    while left > 0:
        entered_us = s.i[covering_of(s, user) + d]
        if entered_us >= 0:
            left -= 1
            if first < 0 or entered_us < s.i[covering_of(s, user) + first]:
                first = d
        d += 1
    return first


@inner
def _wait(s: State, d: int, user: int) -> None:
    """A request waits, in its place: by the time of the request, then by user."""
    waiting, place = waiting_of(s, d), s.i[drone_of(s, d) + QUEUED_UP]
    asked_us = s.i[user_of(s, user) + T_REQUEST_US]
    while place > 0:
        before = s.i[waiting + place - 1]
        t_us = s.i[user_of(s, before) + T_REQUEST_US]
        if t_us < asked_us or (t_us == asked_us and before < user):
            break
        s.i[waiting + place] = before
        place -= 1
    s.i[waiting + place] = user
    s.i[drone_of(s, d) + QUEUED_UP] += 1


@part
def _no_longer_wait(s: State, d: int, user: int) -> None:
    waiting, last = waiting_of(s, d), s.i[drone_of(s, d) + QUEUED_UP] - 1
    place = 0
    while s.i[waiting + place] != user:
        place += 1
    for k in range(place, last):
        s.i[waiting + k] = s.i[waiting + k + 1]
    s.i[drone_of(s, d) + QUEUED_UP] = last


@part
def _scan(w: Fixed, s: State, d: int, phase: int) -> None:
    """One admission scan of a drone's queue: in order, each that fits is served."""
    waiting, count = waiting_of(s, d), s.i[drone_of(s, d) + QUEUED_UP]
    unlimited = w.i[BANDWIDTH_BPS] < 0
    kept = 0
    for k in range(count):
        user = s.i[waiting + k]
        if unlimited or s.i[user_of(s, user) + BPS] <= s.i[drone_of(s, d) + FREE_BPS]:
            _serve(w, s, d, user, phase)
        else:
            s.i[waiting + kept] = user
            kept += 1
    s.i[drone_of(s, d) + QUEUED_UP] = kept


@part
def _serve(w: Fixed, s: State, d: int, user: int, phase: int) -> None:
    whole, u, now_us = s.i, user_of(s, user), s.i[NOW]
    s.i[drone_of(s, d) + FREE_BPS] -= s.i[u + BPS]
    s.i[drone_of(s, d) + USED_BPS] += s.i[u + BPS]
    s.i[served_of(s, d) + s.i[u + SERVICE]] += 1
    s.i[u + SERVING] = d
    s.i[u + STARTED_US] = now_us
    whole[IN_SERVICE] += 1
    whole[SERVED_US] -= now_us
    note(s, phase, K_SERVE, d, user, s.i[u + REQUEST], -1)
    done_us = now_us + s.i[u + REQUIRED_US] - s.i[u + SERVED_SO_FAR_US]
    if done_us <= w.i[HORIZON_US]:
        due(s, user, done_us, key(COMPLETION, d, user))


@inner
def _stop(s: State, user: int, phase: int) -> None:
    whole, u, now_us = s.i, user_of(s, user), s.i[NOW]
    d = s.i[u + SERVING]
    s.i[u + SERVING] = -1
    undo(s, user)
    elapsed_us = now_us - s.i[u + STARTED_US]
    if elapsed_us > 0:
        s.i[u + SERVED_SO_FAR_US] += elapsed_us
        if s.i[u + T_FIRST_US] < 0:
            s.i[u + T_FIRST_US] = s.i[u + STARTED_US]
        elif s.i[u + STARTED_US] > s.i[u + STOPPED_US]:
            s.i[u + INTERRUPTIONS] += 1
        if s.i[u + LAST_DRONE] != d:
            s.i[u + LAST_DRONE] = d
            _hand_over(s, s.i[u + REQUEST], d)
        s.i[u + STOPPED_US] = now_us
    whole[IN_SERVICE] -= 1
    whole[SERVED_US] += now_us
    s.f[s.i[AT_SHARES] + user] = s.i[u + SERVED_SO_FAR_US] / s.i[u + REQUIRED_US]
    whole[BANDWIDTH_US_BPS] += elapsed_us * s.i[u + BPS]
    s.i[drone_of(s, d) + FREE_BPS] += s.i[u + BPS]
    s.i[drone_of(s, d) + USED_BPS] -= s.i[u + BPS]
    s.i[served_of(s, d) + s.i[u + SERVICE]] -= 1
    note(s, phase, K_STOP, d, user, s.i[u + REQUEST], -1)


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


@part
def on_request(w: Fixed, p: Path, s: State, user: int) -> None:
    """A user asks, unless (in an open loop) a request of its is open."""
    u = user_of(s, user)
    row = s.i[u + NEXT_ROW]
    s.i[u + NEXT_ROW] = row + 1
    if not p.i[P_AFTER_PREVIOUS] and row + 1 < p.i[p.i[AT_ROW_OFFSETS] + user + 1]:
        next_us = p.i[request_of(p, row + 1) + DUE_US]
        if next_us < w.i[HORIZON_US]:
            due(s, ask_slot(w, user), next_us, key(REQUEST_PHASE, -1, user))
    if s.i[u + REQUEST] >= 0:
        s.i[SUPPRESSED] += 1
    else:
        _ask(w, p, s, user, request_of(p, row))


@part
def _ask(w: Fixed, p: Path, s: State, user: int, row: int) -> None:
    whole, u, now_us = s.i, user_of(s, user), s.i[NOW]
    service = p.i[row + ROW_SERVICE]
    s.i[u + REQUEST] = whole[OPENED]
    s.i[u + SERVICE] = service
    s.i[u + REQUIRED_US] = p.i[row + ROW_REQUIRED_US]
    s.i[u + BPS] = p.i[row + ROW_BPS]
    s.i[u + T_REQUEST_US] = now_us
    s.i[u + SERVED_SO_FAR_US] = 0
    s.i[u + ATTACHED_SO_FAR_US] = 0
    s.i[u + INTERRUPTIONS] = 0
    s.i[u + T_FIRST_US] = -1
    s.i[u + STARTED_US] = -1
    s.i[u + STOPPED_US] = -1
    s.i[u + SERVING] = -1
    s.i[u + LAST_DRONE] = -1
    whole[OPENED] += 1
    whole[OPEN_US] -= now_us
    s.i[s.i[AT_OPEN_REQUESTS] + service] += 1
    _count_asking(s, user, 1)
    note(s, REQUEST_PHASE, K_REQUEST, -1, user, s.i[u + REQUEST], -1)
    holder = s.i[u + HOLDER]
    if holder >= 0:
        _wait(s, holder, user)
        _affect(s, holder)
        settle_after(w, s, REQUEST_PHASE)


@part
def on_completion(w: Fixed, p: Path, s: State, user: int) -> None:
    """A request has had all it asked for."""
    d = s.i[user_of(s, user) + SERVING]
    _stop(s, user, COMPLETION)
    _close(w, p, s, user, COMPLETION, K_COMPLETE)
    if s.i[drone_of(s, d) + QUEUED_UP] > 0:
        _affect(s, d)
        settle_after(w, s, COMPLETION)


@inner
def _count_asking(s: State, user: int, by: int) -> None:
    """Tell the drones that cover a user that it asks, or does no longer."""
    u = user_of(s, user)
    d, left = 0, s.i[u + COVERED]
    while left > 0:
        if s.i[covering_of(s, user) + d] >= 0:
            s.i[asking_of(s, d) + s.i[u + SERVICE]] += by
            left -= 1
        d += 1


@inner
def _count_attached(s: State, u: int) -> None:
    s.i[u + ATTACHED_SO_FAR_US] += s.i[NOW] - max(s.i[u + HELD_SINCE_US], s.i[u + T_REQUEST_US])


@inner
def _close(w: Fixed, p: Path, s: State, user: int, phase: int, kind: int) -> None:
    whole, u, now_us = s.i, user_of(s, user), s.i[NOW]
    holder = s.i[u + HOLDER]
    if holder >= 0:
        _count_attached(s, u)
    if 0 < s.i[u + SERVED_SO_FAR_US] < s.i[u + REQUIRED_US] and now_us > s.i[u + STOPPED_US]:
        s.i[u + INTERRUPTIONS] += 1
    s.f[CLOSED_QOE1] += s.i[u + SERVED_SO_FAR_US] / s.i[u + REQUIRED_US]
    s.f[s.i[AT_SHARES] + user] = 0.0
    whole[OPEN_US] += now_us
    s.i[s.i[AT_OPEN_REQUESTS] + s.i[u + SERVICE]] -= 1
    _count_asking(s, user, -1)
    _write_closed(s, user)
    note(s, phase, kind, holder, user, s.i[u + REQUEST], -1)
    s.i[u + REQUEST] = -1
    row = s.i[u + NEXT_ROW]
    if p.i[P_AFTER_PREVIOUS] and row < p.i[p.i[AT_ROW_OFFSETS] + user + 1]:
        again_us = now_us + p.i[request_of(p, row) + DUE_US]
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
    s.i[closed + C_REQUEST] = s.i[u + REQUEST]
    s.i[closed + C_USER] = user
    s.i[closed + C_SERVICE] = s.i[u + SERVICE]
    s.i[closed + C_BPS] = s.i[u + BPS]
    s.i[closed + C_REQUIRED_US] = s.i[u + REQUIRED_US]
    s.i[closed + C_SERVED_US] = s.i[u + SERVED_SO_FAR_US]
    s.i[closed + C_ATTACHED_US] = s.i[u + ATTACHED_SO_FAR_US]
    s.i[closed + C_T_REQUEST_US] = s.i[u + T_REQUEST_US]
    s.i[closed + C_T_FIRST_US] = s.i[u + T_FIRST_US]
    s.i[closed + C_T_END_US] = s.i[NOW]
    s.i[closed + C_INTERRUPTIONS] = s.i[u + INTERRUPTIONS]


@inner
def end_all(w: Fixed, p: Path, s: State) -> None:
    """The episode ends: every open request closes, attachments and coverage clear."""
    for user in range(w.i[USERS]):
        if s.i[user_of(s, user) + REQUEST] >= 0:
            if s.i[user_of(s, user) + SERVING] >= 0:
                _stop(s, user, RECORD)
            _close(w, p, s, user, RECORD, K_CLOSE)
    for user in range(w.i[USERS]):
        d = 0
        while s.i[user_of(s, user) + COVERED] > 0:
            if s.i[covering_of(s, user) + d] >= 0:
                _leave(w, s, d, user, RECORD)
            d += 1


@inner
def measures(w: Fixed, s: State) -> tuple[float, float, float]:
    """QoE1-3 so far, open requests by what they have had so far; nan where nothing was asked."""
    whole, now_us = s.i, s.i[NOW]
    qoe1, opened = s.f[CLOSED_QOE1], whole[OPENED]
    open_now = 0
    for user in range(w.i[USERS]):
        u = user_of(s, user)
        if s.i[u + REQUEST] >= 0:
            open_now += 1
            share = s.f[s.i[AT_SHARES] + user]
            if s.i[u + SERVING] >= 0:
                share = (s.i[u + SERVED_SO_FAR_US] + now_us - s.i[u + STARTED_US]) / s.i[
                    u + REQUIRED_US
                ]
            qoe1 += share
    open_us = whole[OPEN_US] + open_now * now_us
    served_us = whole[SERVED_US] + whole[IN_SERVICE] * now_us
    attached = 0
    for d in range(w.i[DRONES]):
        attached += s.i[drone_of(s, d) + ATTACHED_USERS]
    attached_us = whole[ATTACHED_US] + attached * now_us - whole[ATTACHED_FROM_US]
    lasted_us = w.i[USERS] * now_us
    first = 100 * qoe1 / opened if opened else float("nan")
    second = (open_us - served_us) / w.i[STEP_US] / opened if opened else float("nan")
    third = 100 * attached_us / lasted_us if lasted_us else float("nan")
    return first, second, third
