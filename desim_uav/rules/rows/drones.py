"""Drones, what they are worth and observe, pairs of them, and the stations at which they queue."""

from __future__ import annotations

from desim_uav.rowcode.rows import Int16, Int32, Maybe, Queue, Row, Table, row
from desim_uav.rules.rows.flights import PlanRow
from desim_uav.rules.rows.users import Freight, Update, Upload
from desim_uav.sky.rows import Change, TransitRow


@row
class Credit(Row):
    """What a drone adds to the quality of experience (see ``rules.credit``).

    ``held_us`` and ``alone_us`` sum the ends, less the starts, of the times for which users were
    attached to it, and for which it was the only sender that covered them, since the decision
    epoch; the present ones add their number times now: ``Drone.attached_users``, and ``alone``.
    ``served`` and ``served_alone`` sum the shares of requests that it has done, and ``used`` is
    what its battery had used in the episode at the decision epoch. ``in_time`` counts the tasks of
    its attached users that were done by their deadlines, and ``fallen_us`` sums by how much the
    ages of sensors fell when it delivered their updates. The fields from ``step_held_us`` on are
    those of the whole step that ended last.
    """

    alone: int
    held_us: int
    alone_us: int
    served: float
    served_alone: float
    used: int
    in_time: int
    fallen_us: int
    step_held_us: int
    step_alone_us: int
    step_served: float
    step_served_alone: float
    step_used: int
    step_in_time: int
    step_fallen_us: int


@row
class Course(Row):
    """The leg of a drone that is not from cell to cell: of free flight, or an access point's rest.

    The leg is from (x0_m, y0_m, z0_m) to (x1_m, y1_m, z1_m), and ``flight`` is its transit.
    ``aim_x`` to ``aim_z`` are the command of free flight, from -1 to 1, and the drone asks for a
    charge if ``aim_charge`` is above 0. ``aim_cruise`` chooses a cruise speed, from the lowest at
    -1 to the highest at 1; the leg is flown at a ground speed of at most ``limit_mps``, which is
    infinite if no speed was chosen. ``aim_share`` chooses in the same way the ``share`` of tasks
    that is offloaded until the next command. ``blocked`` says that an obstacle cuts the leg short.
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
    share: float
    aim_x: float
    aim_y: float
    aim_z: float
    aim_cruise: float
    aim_share: float
    aim_charge: float
    blocked: int
    station: int
    node: int
    level: int
    home: PlanRow
    flight: TransitRow
    probe: TransitRow


@row
class Band(Row):
    """What a drone keeps of one of its bands while its own fields show the other one.

    See ``Drone``, which has the same fields, and ``rules.bands``.
    """

    free_hz: int
    shared_hz: int
    regraded: Int32
    waiting: Queue[Int32]
    sharing: Queue[Int32]


@row
class Drone(Row):
    """A drone on a leg from (x, y, level) to (to_x, to_y, to_level) since ``since_us``.

    An access point is a drone that never leaves its place, ``Constants.points[point]``, and that
    serves without end, for a step at a time (until ``until_us``); ``point`` is -1 for all others.
    ``type`` is the number of a drone's type, and ``radio`` that of its radio; access points admit
    requests as the first type does.

    ``charge`` and ``mode`` are those at ``since_us``; ``counted_m`` of its leg are counted. In
    serving flight, it follows its command until ``until_us``. In
    this episode its battery has ``began`` with so much (or had so much more as a replacement), and
    then ``used`` and ``gained`` so much, of which ``counted`` on the present leg (below 0: gained).
    ``hopping`` says that it is on a hop of a return, whose next hops are ``route`` to
    ``route_end`` - 1, ``waits`` that it can be commanded, ``serving`` that it has a footprint, and
    ``scan`` that its queue has to be scanned. A crashed drone has ``fallen`` to (fallen_x_m, …).
    ``landed_in`` is the phase in which it landed, ``taken`` the action on its ``command``.
    ``waiting`` is its queue: the users whose requests wait, by (request time, user). ``sharing``
    holds the users whose elastic requests share what requests for a fixed rate leave of the
    bandwidth (``free_hz``) and of the backhaul (``free_bps``), in the same order. All of them have
    their parts of ``shared_hz`` (0: some may not), but for the user whose link has been
    ``regraded`` since (its index plus 1; 0: none), as divisions into equal parts need to know.
    If uploads have a band of their own, these fields are those of ``band``, and ``aside`` has those
    of the other one (see ``rules.bands``; -1: all use one band).
    They were given ``proposed_bps`` together, of which ``left_bps`` are left (see
    ``rules.backhaul``); as many results come over its backhaul to users of others, or tasks move
    over it, as are ``relayed``, and share with its requests. ``computing`` holds those whose tasks
    are at its processor, which ``computes`` unless it stands still (see ``rules.processing``), and
    ``moving`` those whose tasks move there (see ``rules.migration``). It draws ``power_uw`` from
    the battery since ``drawn_us``, until when it was counted but for ``rest_pj`` (see
    ``rules.battery``); the depletion of the battery is foreseen for ``span_us`` of the leg.
    ``freight`` is what it carries of each user's updates, if they are delivered at the ground, and
    ``store`` has these updates if they are logged, or go over its backhaul one after the other,
    which ``upload`` describes. ``stored_ubit`` of its store are taken or promised; it is
    ``crowded`` if it has had no room for an update of a user attached to it, when at most
    ``full_ubit`` were taken.
    ``ahead`` holds the changes of class to come, the next one last. ``served`` counts the requests
    that it serves, and ``asking`` the open ones in its footprint, by service. The marks of its
    links (``model.radio.marks``) are known from ``marked_us`` until ``marked_until_us``, or not at
    all (-1). It is ``steady`` if it hovers and no class changes until it moves (``rules.air``).
    ``terms`` are those of its reward; a learner observes ``features``. Only a drone that is
    ``off_grid`` has a ``course``, and only if the state ``keeps_credit`` it has ``credit``.
    """

    index: Int16
    point: Int16
    off_grid: Int16
    type: Int16
    radio: Int16
    mode: Int16
    x: Int32
    y: Int32
    level: Int32
    to_x: Int32
    to_y: Int32
    to_level: Int32
    transit: Int32
    since_us: int
    until_us: int
    charge: int
    began: int
    used: int
    gained: int
    counted: int
    counted_m: float
    waits: Int16
    hopping: Int16
    route: Int32
    route_end: Int32
    landed_in: Int16
    fallen: Int16
    fallen_x_m: float
    fallen_y_m: float
    respawns: Int32
    serving: Int16
    steady: Int16
    band: Int16
    free_hz: int
    used_hz: int
    free_bps: int
    proposed_bps: int
    left_bps: int
    relayed: Int32
    attached_users: Int32
    scan: Int16
    command: int
    taken: Int32
    marked_us: int
    marked_until_us: int
    waiting: Queue[Int32]
    sharing: Queue[Int32]
    computing: Queue[Int32]
    moving: Queue[Int32]
    computes: Int16
    regraded: Int32
    shared_hz: int
    aside: Band
    power_uw: int
    drawn_us: int
    rest_pj: int
    span_us: int
    freight: Table[Freight]
    store: Queue[Update]
    upload: Upload
    stored_ubit: int
    full_ubit: int
    crowded: Int16
    ahead: Queue[Change]
    served: Table[Int32]
    asking: Table[Int32]
    credit: Maybe[Credit]
    course: Maybe[Course]
    terms: Table[float]
    features: Table[float]


@row
class BegunCourse(Row):
    """The course with which a drone began the episode (see ``engine.base.FreeCarried``)."""

    x0_m: float
    y0_m: float
    z0_m: float
    x1_m: float
    y1_m: float
    z1_m: float
    limit_mps: float
    station: Int32
    node: Int32
    level: Int32
    share: float


@row
class Begun(Row):
    """A drone as it began the episode, as far as an episode takes it over from the one before.

    The fields are those of Drone; ``place`` is the number of drones before it in its station's
    queue.
    """

    index: Int16
    mode: Int16
    off_grid: Int16
    hopping: Int16
    fallen: Int16
    place: Int16
    taken: Int32
    x: Int32
    y: Int32
    level: Int32
    to_x: Int32
    to_y: Int32
    to_level: Int32
    transit: Int32
    route: Int32
    route_end: Int32
    since_us: int
    until_us: int
    charge: int
    counted_m: float
    fallen_x_m: float
    fallen_y_m: float
    course: Maybe[BegunCourse]


@row
class ObservationRow(Row):
    """The observation of a drone at a decision epoch (see ``model.state.ObservationRow``).

    ``believed`` is the number of the place at which it believes itself to be. ``link_quality`` is
    the mean efficiency of its links to attached users, as a share of that of the best class; it is
    0 without any, and for the paper's disc. ``allows`` is a number for what the mask depends on, or
    0 if there is no mask yet; ``forced`` is 1 if the mask allows one action only.
    ``elapsed_us`` is the time since the last earlier epoch at which it was 0, or since the
    beginning of the episode if there was none.
    """

    mode: Int16
    x: Int32
    y: Int32
    level: Int32
    charge: int
    believed: Int32
    attached_users: Int32
    used_hz: int
    served_requests: Int32
    link_quality: float
    allows: int
    forced: Int16
    elapsed_us: int


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
class Station(Row):
    """A charging station: the drones that charge and queue there, in the order of their landing."""

    queue: Queue[Int16]
