"""The rows of the model: what a world, a sample path and the state of an episode hold.

Times are whole microseconds of the episode, below 0 in an episode before; a time of -1, like a
number of -1, means none.
"""

from __future__ import annotations

from desim_uav.model.rows import Queue, Row, Table, row

# ---- constants


@row
class Cell(Row):
    """A cell of the map."""

    x: int
    y: int


@row
class Place(Row):
    """A position in metres."""

    x_m: float
    y_m: float


@row
class Move(Row):
    """An action: the cells and levels by which it moves a drone, and the transit that does so."""

    action: int
    dx: int
    dy: int
    dlevel: int
    transit: int


@row
class Piece(Row):
    """A piece of a transit of constant acceleration; ``start_s`` and ``from_m`` at its start."""

    start_s: float
    from_m: float
    speed_mps: float
    acceleration_mps2: float


@row
class TransitRow(Row):
    """A transit from rest to rest (see ``model.motion.Transit``)."""

    duration_us: int
    distance_m: float
    pieces: Table[Piece]


@row
class Plan(Row):
    """The way back from a place; ``station`` -1: there is none.

    Its hops are the rows ``first`` … ``end`` - 1 of the hops.
    """

    station: int
    duration_us: int
    drained_us: int
    first: int
    end: int


@row
class Hop(Row):
    """A hop of a return, to a neighbouring cell or level."""

    dx: int
    dy: int
    dlevel: int


@row
class Crossing(Row):
    """A user enters a footprint, or leaves it."""

    t_us: int
    user: int
    enters: int


@row
class Constants(Row):
    """A world and its run settings, which do not change in a run.

    A place (level, x, y) has the number ``(level * nx + x) * ny + y``: ``blocked`` is by place,
    ``plans`` by place, without the ceiling and then under it; ``station_at`` (-1: none) by cell.
    ``transits``: the rest, then those of the moving actions, then those of hops along x, y and
    between levels, which begin at ``first_hop``. ``bandwidth_bps`` -1: unlimited. ``known``: the
    crossings of legs past users who stand still (see ``engine.compiled.standing``).
    ``features``: how many numbers a learner observes. From ``foresee`` on the fields are functions,
    in compiled code their addresses; ``reward_values`` and the like are the addresses of the
    components' fields.
    """

    steps: int
    step_us: int
    horizon_us: int
    limited: int
    capacity_us: int
    full_charge_us: int
    return_below_us: int
    respawn_after_us: int
    on_crash: int
    pads: int
    bandwidth_bps: int
    services: int
    nx: int
    ny: int
    levels: int
    levels_under_ceiling: int
    three_d: int
    first_hop: int
    cell_x_m: float
    cell_y_m: float
    lowest_m: float
    level_step_m: float
    radius_m: float
    width_m: float
    depth_m: float
    moves: Table[Move]
    transits: Table[TransitRow]
    plans: Table[Plan]
    hops: Table[Hop]
    levels_m: Table[float]
    blocked: Table[int]
    station_at: Table[int]
    stations: Table[Cell]
    starts: Table[Cell]
    ceilings: Table[int]
    homes: Table[Place]
    reward_values: int
    admission_values: int
    observation_values: int
    battery_values: int
    features: int
    buckets_x: int
    buckets_y: int
    bucket_x_m: float
    bucket_y_m: float
    walk_speed_mps: float
    walk_leg_us: int
    known_at: Table[int]
    known: Table[Crossing]
    foresee: int
    scan: int
    pay: int
    describe: int
    drained_us: int
    lasts_us: int
    run: int


# ---- a sample path


@row
class Ask(Row):
    """What a user will ask for; ``due_us`` is a time, or a think time (see ``Requests``)."""

    due_us: int
    service: int
    required_us: int
    bandwidth_bps: int


@row
class Path(Row):
    """The sample path of an episode (see ``SamplePath``).

    The asks of user u are ``asks_at[u]`` … ``asks_at[u + 1]`` - 1, its legs likewise, five numbers
    each. If users walk ``at_random``, there are the beginnings of their streams (four words each)
    instead of legs. ``respawns``: ``respawns_drawn`` stations per drone; ``errors``: x and y by
    drone and decision epoch, none without noise.
    """

    after_previous: int
    at_random: int
    respawns_drawn: int
    asks: Table[Ask]
    asks_at: Table[int]
    legs: Table[float]
    legs_at: Table[int]
    streams: Table[int]
    respawns: Table[int]
    errors: Table[float]


# ---- the state of an episode


@row
class Drone(Row):
    """A drone.

    It rests at or flies from (x, y, level) to (to_x, to_y, to_level) since ``since_us``, when its
    battery held ``battery_us``. ``hopping``: it is on a hop of a return, whose next hops are
    ``route`` … ``route_end`` - 1. ``fallen``: it lies at (fallen_x_m, fallen_y_m). ``waits``: it
    can be commanded. ``serving``: it has a footprint, whose next crossings are ``ahead``, the next
    one last. ``waiting``: the users whose requests wait, in order of (request time, user).
    ``served`` and ``asking``, by service: the requests it serves, and the open ones of all users it
    covers. ``scan``: its queue has to be scanned. ``believed``: the place at which it believes to
    be. ``landed_in``: the phase of its landing. ``counted_m``: what has been counted of its leg.
    ``terms``: those of its reward; ``features``: what its learner observes.
    """

    index: int
    mode: int
    x: int
    y: int
    level: int
    to_x: int
    to_y: int
    to_level: int
    transit: int
    since_us: int
    battery_us: int
    counted_m: float
    waits: int
    hopping: int
    route: int
    route_end: int
    landed_in: int
    fallen: int
    fallen_x_m: float
    fallen_y_m: float
    respawns: int
    serving: int
    free_bps: int
    used_bps: int
    attached_users: int
    scan: int
    believed: int
    believed_x: int
    believed_y: int
    believed_level: int
    command: int
    taken: int
    waiting: Queue[int]
    ahead: Queue[Crossing]
    served: Table[int]
    asking: Table[int]
    terms: Table[float]
    features: Table[float]


@row
class Seen(Row):
    """What a drone knows at a decision epoch (see ``Observation``)."""

    mode: int
    x: int
    y: int
    level: int
    battery_us: int
    believed: int
    attached_users: int
    used_bps: int
    served_requests: int


@row
class Record(Row):
    """What is logged of a drone at the end of a step.

    ``action``: the command's index, or -1; ``action_taken``: that of the action taken.
    ``return_us``: what the way back takes from the battery, ``NEVER`` if there is none.
    """

    step: int
    t_us: int
    drone: int
    x_m: float
    y_m: float
    z_m: float
    battery_us: int
    mode: int
    action: int
    action_taken: int
    attached_users: int
    served_requests: int
    bandwidth_bps: int
    return_us: int
    reward: float


@row
class Request(Row):
    """The open request of a user; ``number`` -1: there is none.

    ``server`` is the drone that serves it now, since ``started_us``; ``stopped_us`` is the end of
    the last service of more than 0 µs, which was by ``last_server``, and ``t_first_us`` the start
    of the first one.
    """

    number: int
    user: int
    service: int
    t_request_us: int
    required_us: int
    bandwidth_bps: int
    served_us: int
    attached_us: int
    interruptions: int
    t_first_us: int
    server: int
    started_us: int
    stopped_us: int
    last_server: int


@row
class User(Row):
    """A user, attached to drone ``holder`` since ``held_since_us``.

    ``covering``, by drone: when the user entered its footprint; ``covered``: in how many it is.
    ``share``: of what its request needs, what it had when it was served last. ``doing``: what it
    did at the end of the episode.
    """

    index: int
    holder: int
    held_since_us: int
    covered: int
    next_ask: int
    share: float
    doing: int
    request: Request
    covering: Table[int]


@row
class Station(Row):
    """A charging station: the drones that are there, first come first; the first have its pads."""

    queue: Queue[int]


@row
class Event(Row):
    """An event of the log, or a leg (see ``note_leg``)."""

    t_us: int
    phase: int
    kind: int
    drone: int
    user: int
    request: int
    station: int


@row
class Closed(Row):
    """A request that has ended."""

    number: int
    user: int
    service: int
    bandwidth_bps: int
    required_us: int
    served_us: int
    attached_us: int
    t_request_us: int
    t_first_us: int
    t_end_us: int
    interruptions: int


@row
class Handover(Row):
    """A drone that serves a request and is not the one before it."""

    number: int
    drone: int


@row
class Look(Row):
    """Where users are in the span of time that drones look at (see ``engine.compiled.looking``).

    Of users who walk at random also the leg under way, with their streams, the times when it began
    and when they turn, and the legs walked in the span.
    """

    from_us: int
    to_us: int
    far_m: float
    stand: int
    overrun: int
    users: Table[float]
    heads: Table[int]
    following: Table[int]
    streams: Table[int]
    turns: Table[int]
    walking: Table[float]
    walked: Table[float]
    walked_at: Table[int]


@row
class State(Row):
    """An episode under way.

    Integrals over time are kept as sums of ends less beginnings: what n of something add until now
    is n times now. ``attached_us``: of users attached; ``served_us``: of requests served;
    ``open_us``: of open requests; ``bandwidth_us_bps``: of the bandwidth in use. ``loose``: users
    to be attached. ``to_scan``: how many drones' queues have to be scanned. ``asked``: the open
    requests by service at the decision epoch, ``counts`` by drone those it serves and those in
    its footprint. ``masks``: the actions that each drone may be commanded. ``history``: the
    commands of the episode. ``slot_times``, ``slot_keys``, ``winners``: see
    ``engine.compiled.slots``.
    """

    now_us: int
    step: int
    terminated: int
    truncated: int
    opened: int
    in_service: int
    charges: int
    crashes: int
    suppressed: int
    open_us: int
    served_us: int
    attached_us: int
    attached_from_us: int
    queueing_us: int
    bandwidth_us_bps: int
    closed_qoe1: float
    distance_m: float
    to_scan: int
    keeps_events: int
    keeps_requests: int
    faults: int
    drones: Table[Drone]
    users: Table[User]
    stations: Table[Station]
    loose: Queue[int]
    open_requests: Table[int]
    asked: Table[int]
    seen: Table[Seen]
    records: Table[Record]
    counts: Table[int]
    masks: Table[int]
    rewards: Table[float]
    crashed: Queue[int]
    history: Table[int]
    events: Queue[Event]
    closed: Queue[Closed]
    handovers: Queue[Handover]
    look: Look
    slot_times: Table[int]
    slot_keys: Table[int]
    winners: Table[int]
