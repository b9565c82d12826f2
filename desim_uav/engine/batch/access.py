"""Where the rows of the sections of ``memory`` begin: what a column's number is to be added to.

Indexes rather than slices: a kernel copies and counts references to a slice.
"""

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
    CROSSING_COLUMNS,
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
    SERVICES_OF_STATE,
    USER_COLUMNS,
    USERS_OF_STATE,
    WIDTH_OF_SEEN,
    Fixed,
    Path,
    State,
)


@inner
def drone_of(s: State, d: int) -> int:
    """A drone."""
    return int(s.i[AT_DRONE] + d * DRONE_COLUMNS)


@inner
def user_of(s: State, user: int) -> int:
    """A user, and its open request."""
    return int(s.i[AT_USER] + user * USER_COLUMNS)


@inner
def record_of(s: State, d: int) -> int:
    """What is logged of a drone's step."""
    return int(s.i[AT_RECORD] + d * RECORD_COLUMNS)


@inner
def event_of(s: State, k: int) -> int:
    """An event."""
    return int(s.i[AT_EVENTS] + k * EVENT_COLUMNS)


@inner
def closed_of(s: State, k: int) -> int:
    """A closed request."""
    return int(s.i[AT_CLOSED] + k * CLOSED_COLUMNS)


@inner
def served_of(s: State, d: int) -> int:
    """How many requests a drone serves, by service."""
    return int(s.i[AT_SERVED] + d * s.i[SERVICES_OF_STATE])


@inner
def asking_of(s: State, d: int) -> int:
    """How many open requests a drone's footprint holds, by service."""
    return int(s.i[AT_ASKING] + d * s.i[SERVICES_OF_STATE])


@inner
def covering_of(s: State, user: int) -> int:
    """Since when each drone's footprint holds a user."""
    return int(s.i[AT_COVERING] + user * s.i[DRONES_OF_STATE])


@inner
def waiting_of(s: State, d: int) -> int:
    """The users who wait at a drone."""
    return int(s.i[AT_WAITING] + d * s.i[USERS_OF_STATE])


@inner
def seen_of(s: State, d: int) -> int:
    """What a drone is shown."""
    return int(s.i[AT_SEEN] + d * s.i[WIDTH_OF_SEEN])


@inner
def mask_of(s: State, d: int) -> int:
    """What a drone may be told."""
    return int(s.i[AT_MASKS] + d * s.i[ACTIONS_OF_STATE])


@inner
def station_of(s: State, station: int) -> int:
    """How many drones are at a station, and who."""
    return int(s.i[AT_STATION] + station * (s.i[DRONES_OF_STATE] + 1))


@inner
def crossing_of(s: State, d: int, k: int) -> int:
    """A crossing of a drone's leg."""
    return int(s.i[AT_CROSSINGS] + (d * s.i[MOST_CROSSINGS] + k) * CROSSING_COLUMNS)


@inner
def spot_of(s: State, d: int) -> int:
    """Where a drone is, as real numbers."""
    return int(s.i[AT_PLACE] + d * PLACE_COLUMNS)


@inner
def terms_of(s: State, d: int) -> int:
    """The terms of a drone's reward."""
    return int(s.i[AT_TERMS] + d * (s.i[SERVICES_OF_STATE] + 3))


# ---- Fixed


@inner
def move_of(w: Fixed, action: int) -> int:
    """A move."""
    return int(w.i[AT_MOVES] + action * 5)


@inner
def transit_of(w: Fixed, transit: int) -> int:
    """A transit."""
    return int(w.i[AT_TRANSITS] + transit * 2)


@inner
def profile_of(w: Fixed, transit: int) -> int:
    """A transit's profile, rows of 4."""
    return int(w.i[AT_PROFILES] + transit * 4 * w.i[PROFILE_ROWS])


@inner
def plan_of(w: Fixed, d: int, node: int) -> int:
    """A drone's way back from a node."""
    nodes = w.i[LEVELS] * w.i[NX] * w.i[NY]
    return int(w.i[AT_PLANS] + (w.i[w.i[AT_CEILINGS] + d] * nodes + node) * 5)


@inner
def hop_of(w: Fixed, hop: int) -> int:
    """A hop of a way back."""
    return int(w.i[AT_HOPS] + hop * 3)


# ---- Path


@inner
def request_of(p: Path, row: int) -> int:
    """A request to come."""
    return int(p.i[AT_ROWS] + row * 4)
