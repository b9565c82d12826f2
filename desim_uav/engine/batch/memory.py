"""What the compiled engine works on: flat arrays of whole and of real numbers.

``Fixed`` does not change in a run, ``Path`` is an episode's sample path, ``State`` is everything
else. Each is two arrays, ``i`` and ``f``, whose first entries are named here and say where its
sections begin; rows of sections are had from ``access``, whole sections, by name, from ``views``.
Two arrays, because a kernel that takes thirty compiles for minutes. Times are whole microseconds,
-1 is none, ``NEVER`` a time that does not come.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.coverage import SEEN_ROWS

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

NEVER = 2**62

# ---- Fixed

(
    DRONES,
    USERS,
    STATIONS,
    SERVICES,
    STEPS,
    STEP_US,
    HORIZON_US,
    LIMITED,
    CAPACITY_US,
    FULL_CHARGE_US,
    RETURN_BELOW_US,
    RESPAWN_AFTER_US,
    ON_CRASH,
    PADS,
    BANDWIDTH_BPS,
    LEVELS_UNDER_CEILING,
    REWARD,
    NX,
    NY,
    LEVELS,
    ACTIONS,
    OBSERVATION,
    FEATURES,
    THREE_D,
    TERMS,
    BUCKETS_X,
    BUCKETS_Y,
    TABULATED,
    C1_US,
    C2_US,
    C3_US,
    C4_US,
    AT_STATIONS,
    AT_STATION_AT,
    AT_STARTS,
    AT_CEILINGS,
    AT_MOVES,
    AT_TRANSITS,
    AT_HOP_TRANSITS,
    AT_PLANS,
    AT_HOPS,
    AT_BLOCKED,
    AT_KNOWN,
    AT_KNOWN_ROWS,
    AT_LEVELS_M,
    AT_PROFILES,
    AT_DISTANCES_M,
    AT_WEIGHTS,
    AT_HOMES,
    PROFILE_ROWS,
    WALK_LEG_US,
) = range(51)
"""The first of ``Fixed.i``; AT_…: where a section begins. A bandwidth of -1 is unlimited. C1_US …
C4_US: the thresholds of a low battery in R2 and R3."""

(
    CELL_X_M,
    CELL_Y_M,
    LOWEST_M,
    LEVEL_STEP_M,
    RADIUS_M,
    COST_SIGN,
    WEIGHT_USERS,
    BUCKET_X_M,
    BUCKET_Y_M,
    WALK_SPEED_MPS,
    WIDTH_M,
    DEPTH_M,
) = range(12)
"""The first of ``Fixed.f``."""

ON_CRASH_RESPAWN, ON_CRASH_REMOVE, ON_CRASH_END = range(3)
REWARD_COVERAGE, REWARD_BATTERY, REWARD_SERVICES = range(3)
OBSERVATION_NONE, OBSERVATION_POSITION, OBSERVATION_LOCAL = range(3)

DURATION_US, ROWS = range(2)
"""Columns of the section of transits."""

REST = 0
"""The transit of no distance; then those of the moving actions, then those of returns."""

MOVE_X, MOVE_Y, MOVE_LEVEL, MOVE_TRANSIT, MOVE_ACTION = range(5)
"""Columns of the section of moves: dx, dy, dlevel, transit, action."""

PLAN_STATION, PLAN_DURATION_US, PLAN_DRAINED_US, PLAN_FIRST, PLAN_END = range(5)
"""Columns of the section of plans; a station of -1: there is no way."""


class Fixed(NamedTuple):
    """A world and its run settings.

    Sections of ``i``: stations (S, 2); station_at (nx, ny), the index of a cell's station or -1;
    starts (drones, 2); ceilings (drones,), is it bound by the tallest building?; moves
    (actions, 5), see MOVE_X …; transits (n, 2), see DURATION_US …; hop_transits (3,) by axis; plans
    (2, nodes, 5), see PLAN_STATION …, without and under the ceiling, a node being
    (level * nx + x) * ny + y; hops (n, 3); blocked (levels, nx, ny); known (cells * 5 + 1,) and
    known_rows (n, 3), crossings by a drone's leg where they are TABULATED (see ``standing``). Of
    ``f``: levels_m (levels,); profiles (transits, PROFILE_ROWS, 4); distances_m (transits,);
    weights (services,); homes (users, 2). WALK_…: how users walk who do so at random.
    """

    i: Ints
    f: Floats

    def __deepcopy__(self, memo: dict[int, Any]) -> Fixed:
        """The same object: a world does not change, so copies of an engine share it."""
        return self


(
    P_AFTER_PREVIOUS,
    P_AT_RANDOM,
    AT_LEG_OFFSETS,
    AT_ROWS,
    AT_ROW_OFFSETS,
    AT_RESPAWN,
    RESPAWNS_DRAWN,
    NOISY,
    AT_ERROR,
    PATH_HEADER,
) = range(10)
"""The first of ``Path.i``; its walks begin ``Path.f``, the position errors begin at AT_ERROR.

P_AT_RANDOM: users walk at random; in place of leg_offsets there are the beginnings of their
streams (users, 4), and of walks there are none.
"""


class Path(NamedTuple):
    """A sample path (see ``SamplePath``).

    Sections of ``i``: leg_offsets and row_offsets (users + 1,), rows (requests, 4), respawn
    (drones, RESPAWNS_DRAWN). Of ``f``: legs (n, 5), then the errors (drones, steps + 1, 2).
    """

    i: Ints
    f: Floats

    def __deepcopy__(self, memo: dict[int, Any]) -> Path:
        """The same object: a sample path does not change, so copies of an engine share it."""
        return self


# ---- State

(
    NOW,
    EPOCH,
    TERMINATED,
    TRUNCATED,
    OPENED,
    OPEN_US,
    SERVED_US,
    ATTACHED_FROM_US,
    ATTACHED_US,
    BANDWIDTH_US_BPS,
    IN_SERVICE,
    CHARGES,
    QUEUEING_US,
    SUPPRESSED,
    CRASHES,
    LOOSE,
    EVENTS,
    CLOSED,
    HANDOVERS,
    AFFECTED,
    FIRST_AFFECTED,
    LAST_AFFECTED,
    FULL,
    SEEN_FROM_US,
    SEEN_TO_US,
    STAND,
    MOST_CROSSINGS,
    MOST_LOOSE,
    MOST_EVENTS,
    MOST_CLOSED,
    MOST_HANDOVERS,
    MOST_LEGS,
    SLOTS,
    WIDTH_OF_SEEN,
    SERVICES_OF_STATE,
    DRONES_OF_STATE,
    USERS_OF_STATE,
    ACTIONS_OF_STATE,
    AT_DRONE,
    AT_SERVED,
    AT_ASKING,
    AT_USER,
    AT_COVERING,
    AT_WAITING,
    AT_CROSSINGS,
    AT_STATION,
    AT_LOOSE,
    AT_AFFECTED,
    AT_OPEN_REQUESTS,
    AT_SLOT_TIME,
    AT_SLOT_KEY,
    AT_WINNERS,
    AT_RECORD,
    AT_SEEN,
    AT_MASKS,
    AT_ASKED,
    AT_STATES,
    AT_EVENTS,
    AT_CLOSED,
    AT_HANDOVERS,
    AT_CRASHED,
    AT_HISTORY,
    AT_HEADS,
    AT_FOLLOWING,
    AT_STREAMS,
    AT_WALKERS,
    AT_WALKED_OFFSETS,
    AT_PLACE,
    AT_SHARES,
    AT_REWARDS,
    AT_TERMS,
    AT_USERS_SEEN,
    AT_WALKING,
    AT_WALKED,
    STATE_HEADER,
) = range(75)
"""The first of ``State.i``: clock, sums and counters, up to ``FULL`` (something did not fit); for
which span users were looked for; then sizes, and where sections begin, the last seven in
``State.f``."""

COUNTERS = FULL + 1

CLOSED_QOE1, DISTANCE_M, FAR_M = range(3)
"""The first of ``State.f``."""

(
    MODE,
    X,
    Y,
    LEVEL,
    BATTERY_US,
    SINCE_US,
    TRANSIT,
    TO_X,
    TO_Y,
    TO_LEVEL,
    HOPPING,
    ROUTE,
    ROUTE_END,
    FALLEN,
    LANDED_IN,
    WAITS,
    SEEN_US,
    BACK,
    BACK_X,
    BACK_Y,
    BACK_LEVEL,
    RESPAWNS,
    RADIO,
    FREE_BPS,
    USED_BPS,
    ATTACHED_USERS,
    QUEUED_UP,
    CROSSINGS,
    TOLD,
    TAKEN,
) = range(30)
"""Columns of the section drone.

It rests at or flies from (X, Y, LEVEL) to (TO_X, TO_Y, TO_LEVEL) since SINCE_US, when its battery
held BATTERY_US. HOPPING: on a hop of a return, whose next hops are ROUTE … ROUTE_END-1 of
the hops. FALLEN: it lies where ``place`` says. WAITS: it can be told something. SEEN_US: its
battery when it was observed last. BACK: the node it believes to be at, which is
BACK_X, BACK_Y, BACK_LEVEL. QUEUED_UP counts the users
in its row of waiting, CROSSINGS those left of its leg. TOLD and TAKEN: indexes of actions.
"""

R_BATTERY_US, R_MODE, R_ATTACHED, R_SERVED, R_USED_BPS, R_BACK = range(6)
"""Columns of the section record."""

FALLEN_X_M, FALLEN_Y_M, COUNTED_M, SEEN_X_M, SEEN_Y_M, SEEN_Z_M = range(6)
"""Columns of the section place."""

S_MODE, S_X, S_Y, S_LEVEL, S_BATTERY_US, S_BACK, S_ATTACHED, S_USED_BPS = range(8)
"""Columns of the section seen; then the counts of served and of asked requests, by service."""

(
    HOLDER,
    HELD_SINCE_US,
    NEXT_ROW,
    REQUEST,
    SERVICE,
    REQUIRED_US,
    BPS,
    T_REQUEST_US,
    SERVED_SO_FAR_US,
    ATTACHED_SO_FAR_US,
    INTERRUPTIONS,
    T_FIRST_US,
    STARTED_US,
    STOPPED_US,
    SERVING,
    LAST_DRONE,
    COVERED,
) = range(17)
"""Columns of the section user: who holds it, its open request, if REQUEST >= 0, and how many
footprints it is in."""

W_X, W_Y, W_VX, W_VY, W_T0_US, W_X0, W_Y0 = range(7)
WALKING_COLUMNS = 7
"""Columns of the section walking: where the user's leg leads, its velocity, when and where it
began. The section walkers has when it gets there, and when it turns."""

(
    C_REQUEST,
    C_USER,
    C_SERVICE,
    C_BPS,
    C_REQUIRED_US,
    C_SERVED_US,
    C_ATTACHED_US,
    C_T_REQUEST_US,
    C_T_FIRST_US,
    C_T_END_US,
    C_INTERRUPTIONS,
) = range(11)
"""Columns of the section closed."""


KINDS = (
    *("request", "serve", "stop", "complete", "refuse", "close"),
    *("enter", "exit", "attach", "detach"),
    *("decide", "depart", "blocked", "arrive", "land", "charge", "charged"),
    *("deplete", "crash", "respawn"),
)
"""Kinds of events; the section events holds their index here.

A row of the kind after them is a leg: (t_us, mode, K_LEG, drone, from, to, duration_us), with
places by number.
"""

(
    K_REQUEST,
    K_SERVE,
    K_STOP,
    K_COMPLETE,
    K_REFUSE,
    K_CLOSE,
    K_ENTER,
    K_EXIT,
    K_ATTACH,
    K_DETACH,
    K_DECIDE,
    K_DEPART,
    K_BLOCKED,
    K_ARRIVE,
    K_LAND,
    K_CHARGE,
    K_CHARGED,
    K_DEPLETE,
    K_CRASH,
    K_RESPAWN,
    K_LEG,
) = range(21)


class State(NamedTuple):
    """One environment under way.

    Sections of ``i``: drone and user; served and asking (drones, services), counts of requests;
    covering (users, drones), times of entry, or -1; waiting (drones, users), the users whose
    requests wait, in order; crossings (drones, MOST_CROSSINGS, 3), those of a drone's leg, the next
    one last; station (stations, drones + 1), how many are there, and who, first come first; loose,
    users to be attached; affected (drones,), queues to be scanned; slot_time and slot_key (SLOTS,),
    what is to happen when, one slot for each thing that can, and winners (2 * SLOTS,), who comes
    first (see ``queue``); seen and masks (drones, actions), what drones are shown at a decision
    epoch; record, what is logged of the step before; asked, the open requests by service; states
    (users,) at the episode's end; events, closed and handovers (request, drone), which have rows
    where they are kept; crashed, who did; history (steps, drones), the commands of the episode so
    far; heads and following, users in buckets (see ``sort_into_buckets``); of users who walk at
    random streams (users, 4), walkers (users, 2) and walked_offsets (users + 1,). Of ``f``: place,
    shares (users,), rewards (drones,) and their terms, users_seen, where users are in this step
    (see ``look_around``); walking, see W_X …, and walked, the legs of this step (see ``walking``).
    """

    i: Ints
    f: Floats


DRONE_COLUMNS, USER_COLUMNS, PLACE_COLUMNS = 30, 17, 6
RECORD_COLUMNS, EVENT_COLUMNS, CLOSED_COLUMNS, COUNTS, CROSSING_COLUMNS = 6, 7, 11, 8, 3


def state_of(
    drones: int,
    users: int,
    stations: int,
    services: int,
    steps: int,
    actions: int,
    *,
    events: int = 0,
    requests: int = 0,
    crossings: int,
    buckets: int,
    legs: int = 0,
) -> State:
    """Room for one environment.

    ``events`` and ``requests``: rows for what is kept of a step; ``crossings``: rows for those of
    a leg; ``buckets``: how many users are sorted into; ``legs``: rows for those walked in a step,
    where users walk at random.
    """
    walkers = users if legs else 0
    most_crossings = crossings
    most_loose, slots = users * (2 * drones + 2), 2 * users + 3 * drones + 1
    seen = COUNTS + 2 * services
    sizes = [most_crossings, most_loose, events, requests, 2 * requests, legs, slots, seen]
    sizes += [services, drones, users, actions]
    whole = [
        drones * DRONE_COLUMNS,
        drones * services,
        drones * services,
        users * USER_COLUMNS,
        users * drones,
        drones * users,
        drones * most_crossings * 3,
        max(stations, 1) * (drones + 1),
        most_loose,
        drones,
        services,
        slots,
        slots,
        2 * slots,
        drones * RECORD_COLUMNS,
        drones * seen,
        drones * actions,
        services,
        users,
        events * EVENT_COLUMNS,
        requests * CLOSED_COLUMNS,
        2 * requests * 2,
        drones * (steps + 2),
        drones * steps,
        buckets,
        users if buckets else 0,
        walkers * 4,
        walkers * 2,
        walkers + 1,
    ]
    real = [drones * PLACE_COLUMNS, users, drones, drones * (services + 3), users * SEEN_ROWS]
    real += [walkers * WALKING_COLUMNS, legs * 5]
    whole_at, real_at = np.cumsum([STATE_HEADER, *whole]), np.cumsum([3, *real])
    i, f = np.zeros(whole_at[-1], np.int64), np.zeros(real_at[-1])
    i[MOST_CROSSINGS : MOST_CROSSINGS + len(sizes)] = sizes
    i[AT_DRONE:AT_PLACE] = whole_at[:-1]
    i[AT_PLACE:STATE_HEADER] = real_at[:-1]
    return State(i, f)


class Views(NamedTuple):
    """Sections of a state by name, for Python."""

    drone: Ints
    place: Floats
    user: Ints
    station: Ints
    record: Ints
    seen: Ints
    masks: Ints
    asked: Ints
    states: Ints
    events: Ints
    closed: Ints
    handovers: Ints
    crashed: Ints
    history: Ints
    rewards: Floats
    terms: Floats


def views(s: State) -> Views:
    """Its sections; they show what is there."""
    drones, services = int(s.i[DRONES_OF_STATE]), int(s.i[SERVICES_OF_STATE])

    def ints(first: int, *shape: int) -> Ints:
        at = s.i[first]
        return s.i[at : at + int(np.prod(shape))].reshape(shape)

    def floats(first: int, *shape: int) -> Floats:
        at = s.i[first]
        return s.f[at : at + int(np.prod(shape))].reshape(shape)

    stations = int(s.i[AT_LOOSE] - s.i[AT_STATION]) // (drones + 1)
    return Views(
        drone=ints(AT_DRONE, drones, DRONE_COLUMNS),
        place=floats(AT_PLACE, drones, PLACE_COLUMNS),
        user=ints(AT_USER, int(s.i[USERS_OF_STATE]), USER_COLUMNS),
        station=ints(AT_STATION, stations, drones + 1),
        record=ints(AT_RECORD, drones, RECORD_COLUMNS),
        seen=ints(AT_SEEN, drones, int(s.i[WIDTH_OF_SEEN])),
        masks=ints(AT_MASKS, drones, int(s.i[ACTIONS_OF_STATE])),
        asked=ints(AT_ASKED, services),
        states=ints(AT_STATES, int(s.i[USERS_OF_STATE])),
        events=ints(AT_EVENTS, int(s.i[MOST_EVENTS]), EVENT_COLUMNS),
        closed=ints(AT_CLOSED, int(s.i[MOST_CLOSED]), CLOSED_COLUMNS),
        handovers=ints(AT_HANDOVERS, int(s.i[MOST_HANDOVERS]), 2),
        crashed=s.i[s.i[AT_CRASHED] : s.i[AT_HISTORY]],
        history=s.i[s.i[AT_HISTORY] : s.i[AT_HEADS]].reshape(-1, drones),
        rewards=floats(AT_REWARDS, drones),
        terms=floats(AT_TERMS, drones, services + 3),
    )
