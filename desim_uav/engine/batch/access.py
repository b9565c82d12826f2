"""Rows of the sections of ``memory``, for kernels: views, not copies."""

from __future__ import annotations

from desim_uav.engine.batch.kernels import inner
from desim_uav.engine.batch.memory import (
    ACTIONS_OF_STATE,
    AT_ASKING,
    AT_CEILINGS,
    AT_CLOSED,
    AT_COVERING,
    AT_CROSSINGS,
    AT_DRONE,
    AT_EVENTS,
    AT_HOPS,
    AT_LEG_OFFSETS,
    AT_MASKS,
    AT_MOVES,
    AT_PLACE,
    AT_PLANS,
    AT_PROFILES,
    AT_RECORD,
    AT_ROWS,
    AT_SEEN,
    AT_SERVED,
    AT_STATION,
    AT_TERMS,
    AT_TRANSITS,
    AT_USER,
    AT_WAITING,
    CLOSED_COLUMNS,
    DRONE_COLUMNS,
    DRONES_OF_STATE,
    EVENT_COLUMNS,
    LEVELS,
    MOST_CROSSINGS,
    NX,
    NY,
    PLACE_COLUMNS,
    PROFILE_ROWS,
    RECORD_COLUMNS,
    ROWS,
    SEEN_COLUMNS,
    SERVICES_OF_STATE,
    USER_COLUMNS,
    USERS_OF_STATE,
    Fixed,
    Floats,
    Ints,
    Path,
    State,
)


@inner
def drone_of(s: State, d: int) -> Ints:
    """A drone."""
    at = s.i[AT_DRONE] + d * DRONE_COLUMNS
    return s.i[at : at + DRONE_COLUMNS]


@inner
def user_of(s: State, user: int) -> Ints:
    """A user, and its open request."""
    at = s.i[AT_USER] + user * USER_COLUMNS
    return s.i[at : at + USER_COLUMNS]


@inner
def record_of(s: State, d: int) -> Ints:
    """What is logged of a drone's step."""
    at = s.i[AT_RECORD] + d * RECORD_COLUMNS
    return s.i[at : at + RECORD_COLUMNS]


@inner
def event_of(s: State, k: int) -> Ints:
    """An event."""
    at = s.i[AT_EVENTS] + k * EVENT_COLUMNS
    return s.i[at : at + EVENT_COLUMNS]


@inner
def closed_of(s: State, k: int) -> Ints:
    """A closed request."""
    at = s.i[AT_CLOSED] + k * CLOSED_COLUMNS
    return s.i[at : at + CLOSED_COLUMNS]


@inner
def served_of(s: State, d: int) -> Ints:
    """How many requests a drone serves, by service."""
    width = s.i[SERVICES_OF_STATE]
    at = s.i[AT_SERVED] + d * width
    return s.i[at : at + width]


@inner
def asking_of(s: State, d: int) -> Ints:
    """How many open requests a drone's footprint holds, by service."""
    width = s.i[SERVICES_OF_STATE]
    at = s.i[AT_ASKING] + d * width
    return s.i[at : at + width]


@inner
def covering_of(s: State, user: int) -> Ints:
    """Since when each drone's footprint holds a user."""
    width = s.i[DRONES_OF_STATE]
    at = s.i[AT_COVERING] + user * width
    return s.i[at : at + width]


@inner
def waiting_of(s: State, d: int) -> Ints:
    """The users who wait at a drone."""
    width = s.i[USERS_OF_STATE]
    at = s.i[AT_WAITING] + d * width
    return s.i[at : at + width]


@inner
def seen_of(s: State, d: int) -> Ints:
    """What a drone is shown."""
    width = s.i[SEEN_COLUMNS]
    at = s.i[AT_SEEN] + d * width
    return s.i[at : at + width]


@inner
def mask_of(s: State, d: int) -> Ints:
    """What a drone may be told."""
    width = s.i[ACTIONS_OF_STATE]
    at = s.i[AT_MASKS] + d * width
    return s.i[at : at + width]


@inner
def station_of(s: State, station: int) -> Ints:
    """How many drones are at a station, and who."""
    width = s.i[DRONES_OF_STATE] + 1
    at = s.i[AT_STATION] + station * width
    return s.i[at : at + width]


@inner
def crossings_of(s: State, d: int) -> Ints:
    """The crossings of a drone's leg (most, 3)."""
    most = s.i[MOST_CROSSINGS]
    at = s.i[AT_CROSSINGS] + d * 3 * most
    return s.i[at : at + 3 * most].reshape(most, 3)


@inner
def spot_of(s: State, d: int) -> Floats:
    """Where a drone is, as real numbers."""
    at = s.i[AT_PLACE] + d * PLACE_COLUMNS
    return s.f[at : at + PLACE_COLUMNS]


@inner
def terms_of(s: State, d: int) -> Floats:
    """The terms of a drone's reward."""
    width = s.i[SERVICES_OF_STATE] + 3
    at = s.i[AT_TERMS] + d * width
    return s.f[at : at + width]


# ---- Fixed


@inner
def move_of(w: Fixed, action: int) -> Ints:
    """A move."""
    at = w.i[AT_MOVES] + action * 5
    return w.i[at : at + 5]


@inner
def transit_of(w: Fixed, transit: int) -> Ints:
    """A transit."""
    at = w.i[AT_TRANSITS] + transit * 2
    return w.i[at : at + 2]


@inner
def profile_of(w: Fixed, transit: int) -> Floats:
    """A transit's profile (rows, 4)."""
    rows = w.i[w.i[AT_TRANSITS] + transit * 2 + ROWS]
    at = w.i[AT_PROFILES] + transit * 4 * w.i[PROFILE_ROWS]
    return w.f[at : at + 4 * rows].reshape(rows, 4)


@inner
def plan_of(w: Fixed, d: int, node: int) -> Ints:
    """A drone's way back from a node."""
    nodes = w.i[LEVELS] * w.i[NX] * w.i[NY]
    at = w.i[AT_PLANS] + (w.i[w.i[AT_CEILINGS] + d] * nodes + node) * 5
    return w.i[at : at + 5]


@inner
def hop_of(w: Fixed, hop: int) -> Ints:
    """A hop of a way back."""
    at = w.i[AT_HOPS] + hop * 3
    return w.i[at : at + 3]


# ---- Path


@inner
def legs_of(p: Path) -> Floats:
    """All walks (legs, 5)."""
    legs = p.i[p.i[AT_ROWS] - 1]  # the last of the offsets
    return p.f[: 5 * legs].reshape(legs, 5)


@inner
def leg_offsets_of(p: Path) -> Ints:
    """Where each user's walk begins."""
    return p.i[p.i[AT_LEG_OFFSETS] : p.i[AT_ROWS]]


@inner
def request_of(p: Path, row: int) -> Ints:
    """A request to come."""
    at = p.i[AT_ROWS] + row * 4
    return p.i[at : at + 4]
