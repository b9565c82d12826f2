"""The rows of the model: the constants of a run, then a sample path, then the state of an episode.

Times are whole microseconds since the start of the episode, and negative in an earlier episode.
The time, index or number of what does not exist is -1. ``asks_at`` holds the offsets of ``asks``:
those of user u are ``asks[asks_at[u]:asks_at[u + 1]]``; ``legs_at`` and ``known_at`` are similar.
"""

from __future__ import annotations

from desim_uav.model.rows import Queue, Row, Table, row
from desim_uav.model.walking import Walking


@row
class Cell(Row):
    """A cell of the map, by its indices from the west (x) and the south (y)."""

    x: int
    y: int


@row
class Place(Row):
    """A position on the map, in metres."""

    x_m: float
    y_m: float


@row
class Move(Row):
    """An action: the cells and levels by which it moves a drone, and the number of its transit."""

    action: int
    dx: int
    dy: int
    dlevel: int
    transit: int


@row
class Piece(Row):
    """A part of a transit with constant acceleration: time, distance and speed at its start."""

    start_s: float
    from_m: float
    speed_mps: float
    acceleration_mps2: float


@row
class TransitRow(Row):
    """A flight of a drone from rest to rest (see ``model.motion.Transit``)."""

    duration_us: int
    distance_m: float
    rises: float
    tail_mps: float
    side_mps: float
    pieces: Table[Piece]


@row
class Plan(Row):
    """The planned return from a place; its hops are ``Constants.hops[first:end]``."""

    station: int
    duration_us: int
    drained_us: int
    first: int
    end: int


@row
class WaysRow(Row):
    """The ways home at one altitude in free flight (see ``model.free.space.Ways``)."""

    altitude_m: float
    nodes_m: Table[float]
    lengths_m: Table[float]
    following: Table[int]
    times_us: Table[int]
    drains: Table[int]


@row
class SpaceRow(Row):
    """What a type of drones needs for free flight (see ``model.free.space.Space``).

    The fields from ``corners_m`` to ``members`` are its obstacles (``model.free.prisms.Prisms``).
    Commands choose a cruise speed from ``lowest_mps`` to ``highest_mps`` (infinity: none).
    """

    level_mps: float
    level_mps2: float
    climb_mps: float
    descent_mps: float
    vertical_mps2: float
    wind_x_mps: float
    wind_y_mps: float
    lowest_mps: float
    highest_mps: float
    corners_m: Table[float]
    walls: Table[float]
    offsets: Table[int]
    heights_m: Table[float]
    boxes_m: Table[float]
    shape_x: int
    shape_y: int
    side_x_m: float
    side_y_m: float
    heads: Table[int]
    members: Table[int]
    levels: Table[WaysRow]


@row
class Hop(Row):
    """A hop of a return, which leads to a neighbouring cell or level."""

    dx: int
    dy: int
    dlevel: int


@row
class Change(Row):
    """The change of a link between a drone and a user to another class.

    ``change`` is the new class if the link rises to it, and minus the new class if it falls to it.
    Class 0 is no link. With the paper's disc, which has one class, 1 is the entry of a user into
    the footprint and 0 its exit.
    """

    t_us: int
    user: int
    change: int


@row
class Radio(Row):
    """A radio: that of a type of drones, by its number, or after these that of an access point.

    ``bandwidth_hz`` is -1 if it is unlimited. ``efficiencies`` has the millionths of a bit/s that a
    link of each class carries per hertz, class 0 (none) first. ``rings`` has the radii of all
    classes from 1 on, by level and then by the ``groups`` into which users fall by their heights;
    an access point has one level. If it is ``flat``, the radii are the same on all levels.
    ``terms`` to ``bounds_m`` are the fits between levels, with so many ``slabs`` between two of
    them (``model.radio.fits.Fits``), or empty. If links
    are ``marked``, ``sight`` is the kind of line of sight (``model.radio.marks``), and
    ``los_shadow_db`` and ``nlos_shadow_db`` are the standard deviations of the shadowing.
    The fields from ``divide`` on are functions, or in compiled code their addresses;
    ``sharing_values`` and ``loss_values`` are the addresses of the components' fields.
    """

    bandwidth_hz: int
    classes: int
    levels: int
    flat: int
    efficiencies: Table[int]
    rings: Table[float]
    slabs: int
    terms: Table[float]
    ranges: Table[float]
    bounds_m: Table[float]
    carrier_ghz: float
    power_dbm: float
    noise_dbm: float
    marked: int
    sight: int
    los_shadow_db: float
    nlos_shadow_db: float
    sharing_values: int
    loss_values: int
    divide: int
    level: int
    rates: int
    p_los: int


@row
class Point(Row):
    """The position of the antenna of a ground access point, in metres."""

    x_m: float
    y_m: float
    z_m: float


@row
class TypeRow(Row):
    """A type of drones: what all drones of it have in common (see ``drone_type.DroneType``).

    Their transits are those of ``Constants.transits`` from number ``first_transit`` on (number 0,
    the hover, is that of all types), and their planned returns those of ``Constants.plans`` from
    number ``first_plan`` on. Without a ``limited`` battery, ``capacity_us`` and the like are 0.
    Charges (``capacity_us`` and others) are in the units of the energy model, of which a drone
    takes ``per_second`` in a second of hovering; a battery counts as full at ``full_us``. The
    changes of users who stand still are those of ``Constants.known_at`` from number ``first_known``
    on. The fields from ``scan`` on are functions, or in compiled code their addresses;
    ``admission_values`` and ``battery_values`` are the addresses of the components' fields.
    """

    limited: int
    capacity_us: int
    full_us: int
    per_second: int
    return_below_us: int
    respawn_after_us: int
    on_crash: int
    first_transit: int
    first_plan: int
    first_known: int
    admission_values: int
    battery_values: int
    scan: int
    drained_us: int
    lasts_us: int


@row
class Constants(Row):
    """The constants of a run: those of its world and its settings.

    If drones are asked ``by_event``, one hovers for ``patience_us``.
    A place (level, x, y) has the number ``(level * nx + x) * ny + y``. ``blocked`` has an entry per
    place, and ``station_at`` one per cell. ``types`` are the types of drones; some of them have a
    battery that is ``limited``. ``plans`` holds for each type (see ``TypeRow``) one plan per place
    without the drones' ceiling, and then one per place below it. ``transits`` holds the hover, and
    then for each type its moves and, from its number ``first_hop``, its hops in the order of
    ``model.planner.HOPS``; ``Move.transit`` and ``first_hop`` are as if the first type came first
    of those that fly from cell to cell. Types that fly freely have no moves, and do not use them.
    ``radios`` are those of the types of drones, and then those of the access points ``points``.
    Rewards divide users among ``sharers``: the drones, and the access points
    that count. ``groups`` are those of the users by height (see ``Radio``). By service, ``in_bits``
    says that requests ask for a volume instead of a time, and ``elastic`` that they share what
    bandwidth is left. ``expected_requests`` is the number of requests of an episode if all are
    served at once (see ``scenario.cost``). Senders of the same index modulo ``reuse`` interfere (0:
    none do). What
    ``model.radio.air`` needs to know is from ``thresholds_db`` to ``profiles_at``: the thresholds
    of all radios, of which radio r has those from ``thresholds_at[r]`` on, the heights of users
    (``heights_m``), and the ``profiles`` of all transits. The buildings that block lines of sight
    are from ``corners_m`` to ``tallest_m`` (see ``model.radio.sight.Buildings``): building b has
    the corners from ``corners_at[b]`` on, and bucket k the buildings ``built`` from ``built_at[k]``
    on. For ``trigger_us`` and ``margin_db``
    see ``rules.association``. ``known`` holds changes of users who stand still
    (``engine.compiled.standing``). Drones are too near to each other below a distance of
    ``separation_m`` (0: they have not to keep any); one ``gives_way`` to those with lower indices.
    ``features`` is the number of features that a learner observes.
    If drones fly freely, ``spaces`` has an entry for each type; only those of free ones are used.
    The fields from ``foresee`` on are functions, or in compiled code their addresses;
    ``reward_values`` and the like are the addresses of the components' fields.
    """

    steps: int
    step_us: int
    horizon_us: int
    by_event: int
    patience_us: int
    limited: int
    pads: int
    services: int
    sharers: int
    reuse: int
    trigger_us: int
    margin_db: float
    separation_m: float
    gives_way: int
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
    width_m: float
    depth_m: float
    types: Table[TypeRow]
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
    radios: Table[Radio]
    points: Table[Point]
    groups: Table[int]
    thresholds_db: Table[float]
    thresholds_at: Table[int]
    heights_m: Table[float]
    profiles: Table[float]
    profiles_at: Table[int]
    corners_m: Table[float]
    corners_at: Table[int]
    roofs_m: Table[float]
    built_at: Table[int]
    built: Table[int]
    tallest_m: float
    in_bits: Table[int]
    elastic: Table[int]
    expected_requests: float
    reward_values: int
    observation_values: int
    charging_values: int
    mobility_values: int
    features: int
    buckets_x: int
    buckets_y: int
    bucket_x_m: float
    bucket_y_m: float
    known_at: Table[int]
    known: Table[Change]
    spaces: Table[SpaceRow]
    foresee: int
    foresee_all: int
    foresee_rings: int
    find_in_classes: int
    passes_us: int
    part: int
    on_separation: int
    tally: int
    must_wait: int
    pay: int
    describe: int
    charged: int
    until_full_us: int
    walk: int
    steer: int
    home_leg: int
    look_home: int
    run: int


@row
class Ask(Row):
    """A request to come; ``due_us`` is its time or a think time (see ``model.demand.Requests``).

    ``required`` is a service time in microseconds, or a volume in millionths of a bit.
    """

    due_us: int
    service: int
    required: int
    bandwidth_bps: int


@row
class Path(Row):
    """The sample path of an episode (see ``SamplePath``).

    ``asks`` and ``legs`` (five numbers each) are ordered by user. If users walk ``stepwise``, the
    compiled engine has the initial states of their random streams (four words each) instead of
    legs. ``respawns`` holds ``respawns_drawn`` stations per drone, and ``errors`` the position
    errors in x and y, in cells, per drone and decision epoch, or nothing without noise.
    ``link_key`` holds the key of the draws of links (``model.philox``); the compiled engine has
    nothing there if there are no such draws.
    """

    after_previous: int
    stepwise: int
    respawns_drawn: int
    asks: Table[Ask]
    asks_at: Table[int]
    legs: Table[float]
    legs_at: Table[int]
    streams: Table[int]
    respawns: Table[int]
    errors: Table[float]
    link_key: Table[int]


@row
class Credit(Row):
    """What a drone adds to the quality of experience (see ``rules.credit``).

    ``held_us`` and ``alone_us`` sum the ends, less the starts, of the times for which users were
    attached to it, and for which it was the only sender that covered them, since the decision
    epoch; the present ones add their number times now: ``Drone.attached_users``, and ``alone``.
    ``served`` and ``served_alone`` sum the shares of requests that it has done, and ``used`` is
    what its battery had used in the episode at the decision epoch. The fields from ``step_held_us``
    on are those of the whole step that ended last.
    """

    alone: int
    held_us: int
    alone_us: int
    served: float
    served_alone: float
    used: int
    step_held_us: int
    step_alone_us: int
    step_served: float
    step_served_alone: float
    step_used: int


@row
class Course(Row):
    """The leg of a drone that is not from cell to cell: of free flight, or an access point's rest.

    The leg is from (x0_m, y0_m, z0_m) to (x1_m, y1_m, z1_m), and ``flight`` is its transit.
    ``aim_x`` to ``aim_z`` are the command of free flight, from -1 to 1, and the drone asks for a
    charge if ``aim_charge`` is above 0. ``aim_cruise`` chooses a cruise speed, from the lowest at
    -1 to the highest at 1; the leg is flown at a ground speed of at most ``limit_mps``, which is
    infinite if no speed was chosen. ``blocked`` says that an obstacle cuts the leg short.
    On a return, the next place is ``node`` of the ways at the altitude ``level``, which lead to
    ``station``; the last node is followed by -1. ``home`` is the return from where the drone was at
    the latest decision epoch (station -1: there is none): ``first`` is its first node, and ``end``
    its level. ``probe`` is memory for a transit.
    """

    x0_m: float
    y0_m: float
    z0_m: float
    x1_m: float
    y1_m: float
    z1_m: float
    limit_mps: float
    aim_x: float
    aim_y: float
    aim_z: float
    aim_cruise: float
    aim_charge: float
    blocked: int
    station: int
    node: int
    level: int
    home: Plan
    flight: TransitRow
    probe: TransitRow


@row
class FlownRow(Row):
    """A free leg in the event log (see ``engine.base.FlownLeg``)."""

    t_us: int
    drone: int
    duration_us: int
    mode: int
    x0_m: float
    y0_m: float
    z0_m: float
    x1_m: float
    y1_m: float
    z1_m: float


@row
class Drone(Row):
    """A drone on a leg from (x, y, level) to (to_x, to_y, to_level) since ``since_us``.

    An access point is a drone that never leaves its place, ``Constants.points[point]``, and that
    serves without end, for a step at a time (until ``until_us``); ``point`` is -1 for all others.
    ``type`` is the number of a drone's type, and ``radio`` that of its radio; access points admit
    requests as the first type does.

    ``battery_us`` and ``mode`` are those at ``since_us``; ``counted_m`` of its leg are counted. In
    serving flight, it follows its command until ``until_us``. In
    this episode its battery has ``began`` with so much (or had so much more as a replacement), and
    then ``used`` and ``gained`` so much, of which ``counted`` on the present leg (below 0: gained).
    ``hopping`` says that it is on a hop of a return, whose next hops are ``route`` to
    ``route_end`` - 1, ``waits`` that it can be commanded, ``serving`` that it has a footprint, and
    ``scan`` that its queue has to be scanned. A crashed drone has ``fallen`` to (fallen_x_m, …).
    ``landed_in`` is the phase in which it landed, ``taken`` the action on its ``command``.
    ``waiting`` is its queue: the users whose requests wait, by (request time, user). ``sharing``
    holds the users whose elastic requests share what requests for a fixed rate leave of the
    bandwidth (``free_hz``), in the same order. ``ahead`` holds the changes of class to come, the
    next one last. ``served`` counts the requests that it serves, and ``asking`` the open ones in
    its footprint, by service. The marks of its links (``model.radio.marks``) are known from
    ``marked_us`` until ``marked_until_us``, or not at all (-1). ``terms`` are those of its reward;
    a learner observes ``features``.
    """

    index: int
    point: int
    off_grid: int
    type: int
    radio: int
    mode: int
    x: int
    y: int
    level: int
    to_x: int
    to_y: int
    to_level: int
    transit: int
    since_us: int
    until_us: int
    battery_us: int
    began: int
    used: int
    gained: int
    counted: int
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
    free_hz: int
    used_hz: int
    attached_users: int
    scan: int
    command: int
    taken: int
    marked_us: int
    marked_until_us: int
    waiting: Queue[int]
    sharing: Queue[int]
    ahead: Queue[Change]
    served: Table[int]
    asking: Table[int]
    credit: Credit
    course: Course
    terms: Table[float]
    features: Table[float]


@row
class Observation(Row):
    """The observation of a drone at a decision epoch (see ``model.state.Observation``).

    ``believed`` is the number of the place at which it believes itself to be. ``link_quality`` is
    the mean efficiency of its links to attached users, as a share of that of the best class; it is
    0 without any, and for the paper's disc. ``allows`` is a number for what the mask depends on, or
    0 if there is no mask yet; ``forced`` is 1 if the mask allows one action only.
    ``elapsed_us`` is the time since the last earlier epoch at which it was 0, or since the
    beginning of the episode if there was none.
    """

    mode: int
    x: int
    y: int
    level: int
    battery_us: int
    believed: int
    attached_users: int
    used_hz: int
    served_requests: int
    link_quality: float
    allows: int
    forced: int
    elapsed_us: int


@row
class Record(Row):
    """The log's record of a drone at the end of a step; ``return_us`` is n_B (NEVER: no way).

    ``used`` is what it has drained of its battery since the episode began. ``aim_x`` to
    ``aim_cruise`` are the command of a free flight.
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
    used: int
    reward: float
    aim_x: float
    aim_y: float
    aim_z: float
    aim_cruise: float


@row
class PointRecord(Row):
    """The log's record of an access point at the end of a step."""

    step: int
    t_us: int
    access_point: int
    attached_users: int
    served_requests: int
    bandwidth_bps: int


@row
class Request(Row):
    """The open request of a user; ``number`` is -1 if there is none.

    It has to be served until ``done`` is ``required``. Both are microseconds of service or, if the
    request is ``in_bits``, millionths of a bit; ``rate`` of them are done per microsecond (bit/s,
    or 1). Drone ``server`` has served it since ``started_us``, at this rate and with a bandwidth of
    ``used_hz`` since ``counted_us``. A request for the rate ``bandwidth_bps`` that is not
    ``elastic`` needs a bandwidth of ``needs_hz`` in its present class. ``credited`` of it have been
    counted in ``rules.credit``. Of its services that lasted
    more than 0 µs, the first began at ``t_first_us``; the last was by ``last_server`` and ended at
    ``stopped_us``.
    """

    number: int
    user: int
    service: int
    t_request_us: int
    required: int
    done: int
    rate: int
    in_bits: int
    elastic: int
    bandwidth_bps: int
    needs_hz: int
    used_hz: int
    served_us: int
    attached_us: int
    interruptions: int
    t_first_us: int
    server: int
    started_us: int
    counted_us: int
    stopped_us: int
    last_server: int
    credited: int


@row
class User(Row):
    """A user, attached to sender ``holder`` (see ``State.senders``) since ``held_since_us``.

    ``classes`` holds the classes of its links to the senders; ``covering`` holds the times at which
    it entered their footprints, where the class is at least 1, and ``covered`` is the number of
    those that it is in. ``share`` is the served share of its open request when service
    last stopped; ``doing`` is its ``UserState`` at the end of the episode. It was attached to drone
    ``left`` until ``left_us``, and at ``came_us`` it was handed over from drone ``came_from``. It
    has had an open request, but no link, since ``outage_since_us`` (-1: it is not so). If users are
    associated by level, drones have been better for it than its own ``better_since`` (-1: they are
    not); the next to change this is ``rival``, at ``turns_us``.
    """

    index: int
    holder: int
    held_since_us: int
    covered: int
    next_ask: int
    share: float
    doing: int
    left: int
    left_us: int
    came_from: int
    came_us: int
    outage_since_us: int
    unsettled: int
    rival: int
    turns_us: int
    request: Request
    classes: Table[int]
    covering: Table[int]
    better_since: Table[int]


@row
class Spot(Row):
    """A user at a decision epoch: its exact place, and its cell.

    ``following`` is the next user in this cell, ``holder`` the sender to which the user is attached
    (-1: to none), ``doing`` its ``UserState``, and ``left`` the share of its open request that is
    not done yet (0 without one).
    """

    x_m: float
    y_m: float
    cell: int
    following: int
    holder: int
    doing: int
    left: float


@row
class Station(Row):
    """A charging station: the drones that charge and queue there, in the order of their landing."""

    queue: Queue[int]


@row
class Pair(Row):
    """Two drones, of which ``one`` has the lower index (see ``rules.separation``).

    While both are in the air it is ``open``: both have been on their present legs since
    ``since_us``. It is ``near`` while they are nearer to each other than ``separation_m``, and
    ``turns`` are the times at which this will change, the next one last.
    """

    one: int
    other: int
    open: int
    near: int
    since_us: int
    turns: Queue[int]


@row
class Event(Row):
    """An entry of the event log, which is an event or a leg (see ``note_leg``).

    An event of two drones (``words.OF_PAIRS``) has the other one in the place of ``user``.
    ``link_class`` is the new class of the link between ``drone`` and ``user``, if that has changed.
    """

    t_us: int
    phase: int
    kind: int
    drone: int
    user: int
    request: int
    station: int
    link_class: int


@row
class Closed(Row):
    """A request that has been closed (see ``engine.base.ClosedRequest``)."""

    number: int
    user: int
    service: int
    bandwidth_bps: int
    required: int
    done: int
    served_us: int
    attached_us: int
    t_request_us: int
    t_first_us: int
    t_end_us: int
    interruptions: int


@row
class Handover(Row):
    """A drone that served a request which another drone, or none, had served before."""

    number: int
    drone: int


@row
class AirTables(Row):
    """What ``model.radio.air`` knows of drones, and the memory in which it works.

    For ``ways`` (places) to ``looks`` see ``model.radio.scene.Air``. ``held`` are the classes of
    the links to each sender before a span, ``found`` says where their changes are written
    (``model.radio.air.FOUND_COLUMNS``), and ``passed`` are the rows of a pair of levels. ``marks``
    has ``mark_rows`` rows for each sender; ``marks_lost`` says that they were too few, or the
    memory in which marks are made (``model.radio.marks.Memory``), from ``flown`` (tracks) to
    ``visited``. In free flight, ``pieces`` has ``Constants.profiles`` and then the profile of each
    sender, of four rows, which drones in free flight use.
    """

    ways: Table[float]
    senders: Table[int]
    losses: Table[int]
    radios: Table[float]
    marks: Table[float]
    marks_at: Table[int]
    tracks: Table[float]
    table: Table[float]
    bound_db: Table[float]
    link_words: Table[int]
    looks: Table[float]
    held: Table[int]
    found: Table[int]
    passed: Table[int]
    mark_rows: int
    marks_lost: int
    flown: Table[float]
    borders_s: Table[float]
    visits: Table[float]
    seen: Table[int]
    times: Table[float]
    stretches: Table[float]
    visited: Table[int]
    pieces: Table[float]
    pieces_at: Table[int]


@row
class Look(Row):
    """The users' walks in the present span of time (only in ``engine.compiled.looking``).

    They are known until ``walked_us`` if users walk step by step. ``windows``, ``found`` and
    ``order`` are memory for the changes on a leg, and ``apart`` and ``turns`` for the tracks of two
    drones and the changes of their distance.
    """

    from_us: int
    to_us: int
    walked_us: int
    far_m: float
    stand: int
    users: Table[float]
    heads: Table[int]
    following: Table[int]
    windows: Table[float]
    found: Table[int]
    order: Table[int]
    apart: Table[float]
    turns: Table[int]
    walking: Walking
    air: AirTables


@row
class State(Row):
    """The state of an episode.

    ``senders`` are the drones and, after them, the access points; ``drones`` are the former alone.
    ``step`` counts the decision epochs; the latest one before now was at ``epoch_us``, and the next
    one is at ``next_us``. ``share`` is the time between two epochs as a share of a step.
    ``open_us`` and ``served_us`` sum the ends of open and of served intervals of requests, less
    their starts; intervals under way add their number times now. ``attached_us`` sums the
    attachments that have ended, and ``attached_from_us`` the starts of the others;
    ``bandwidth_us_hz`` is the integral of bandwidth over ended services. ``loose`` holds the users
    who may have to be attached, ``unsettled`` those whose levels have to be looked at, if users are
    associated ``by_level``; ``retunes`` says that interference has changed. If access points have
    to be looked at between decision epochs, it ``renews``. ``to_scan`` counts the drones whose
    queues have to be scanned. If
    the run ``keeps_links``, it counts handovers between drones, ping-pongs and outages, and sums
    the time in outages that have ended (see ``rules.links``). If drones have to keep a distance,
    ``pairs`` are drones (0, 1), (0, 2), …; ``conflicts`` counts how often two came too near,
    ``conflict_us`` sums the ends of these times less their starts, and ``nearest_m`` is the least
    distance in the windows that have ended. At
    the decision epoch, ``asked`` counts the open requests by service, and ``counts`` by drone those
    that it serves and those in its footprint; ``masks`` has an entry per drone and action.
    ``history`` holds all commands. In the compiled engine, ``slot_times`` to ``winners`` are the
    event queue, and ``before`` holds the time and the rows of drones and stations (with their
    queues) with which the episode began. In free flight, ``aims`` holds what belongs to the
    commands (``Course.aim_x`` and the four after it), ``flown`` the legs of a step for the log, and
    ``away_m`` is memory.
    """

    now_us: int
    step: int
    epoch_us: int
    next_us: int
    share: float
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
    bandwidth_us_hz: int
    closed_qoe1: float
    distance_m: float
    to_scan: int
    by_level: int
    retunes: int
    renews: int
    keeps_events: int
    keeps_requests: int
    keeps_links: int
    keeps_credit: int
    handed_over: int
    ping_pongs: int
    outages: int
    outage_us: int
    conflicts: int
    conflict_us: int
    nearest_m: float
    faults: int
    senders: Table[Drone]
    drones: Table[Drone]
    pairs: Table[Pair]
    users: Table[User]
    stations: Table[Station]
    loose: Queue[int]
    unsettled: Queue[int]
    open_requests: Table[int]
    asked: Table[int]
    observations: Table[Observation]
    records: Table[Record]
    point_records: Table[PointRecord]
    counts: Table[int]
    spots: Table[Spot]
    firsts: Table[int]
    masks: Table[int]
    rewards: Table[float]
    crashed: Queue[int]
    history: Table[int]
    aims: Table[float]
    away_m: Table[float]
    flown: Queue[FlownRow]
    events: Queue[Event]
    closed: Queue[Closed]
    handovers: Queue[Handover]
    look: Look
    slot_times: Table[int]
    slot_keys: Table[int]
    winners: Table[int]
    before: Table[int]
