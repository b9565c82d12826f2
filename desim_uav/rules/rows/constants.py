"""The constants of a run: radios, access points, types of drones, and all others."""

from __future__ import annotations

from desim_uav.model.catalogue import StageRow
from desim_uav.rowcode.rows import Row, Table, row
from desim_uav.rules.rows.flights import CellRow, Hop, Move, Place, PlanRow, SpaceRow
from desim_uav.sky.rows import Change, Scene, TransitRow


@row
class RadioRow(Row):
    """A radio: that of a type of drones, by its number, or after these that of an access point.

    ``bandwidth_hz`` is -1 if it is unlimited, and ``uplink_hz`` is that of uploads, or -1 if they
    have none of their own. ``backhaul_bps`` is the capacity of the backhaul (``model.backhaul``).
    ``efficiencies`` has the millionths of a bit/s that a link of each class carries per hertz,
    class 0 (none) first. If it is ``flat``, the radii of its classes (``Scene.radios``) are the
    same on all levels. Its links may be ``marked`` (``model.radio.marks``). ``divide`` is a
    function, or in compiled code its address, and ``sharing_values`` is the address of the
    component's fields.
    """

    bandwidth_hz: int
    uplink_hz: int
    backhaul_bps: int
    classes: int
    flat: int
    efficiencies: Table[int]
    marked: int
    sharing_values: int
    divide: int


@row
class ProcessorRow(Row):
    """The processor of the sender whose radio has the same number.

    Each of its ``cores`` does ``clock`` thousandths of a cycle in a microsecond. Tasks stand in its
    line ``by_deadline``, or else by their arrival. It computes ``on_ground`` too, and while the
    drone returns. A busy core draws ``core_uw``, and the rest ``idle_uw``, in microwatts.
    ``process`` is a function, or in compiled code its address, and ``processing_values`` is the
    address of the component's fields.
    """

    cores: int
    clock: int
    by_deadline: int
    on_ground: int
    core_uw: int
    idle_uw: int
    processing_values: int
    process: int


@row
class TermsRow(Row):
    """What holds for all requests for a service (see ``services.Terms``; NEVER: no deadline)."""

    deadline_us: int
    drops: int
    stays_begun: int
    restarts: int
    migrates: int


@row
class UpdatesRow(Row):
    """What holds for the updates of a service (see ``services.Collecting``; NEVER: no limit)."""

    keeps: int
    preempts: int
    sends_last: int
    limit_us: int
    ground: int
    wait_us: int


@row
class PointRow(Row):
    """The position of the antenna of a ground access point, in metres."""

    x_m: float
    y_m: float
    z_m: float


@row
class TypeRow(Row):
    """A type of drones: what all drones of it have in common (see ``drone_type.DroneType``).

    Their transits are those of ``Constants.transits`` from number ``first_transit`` on (number 0,
    the hover, is that of all types), and their planned returns those of ``Constants.plans`` from
    number ``first_plan`` on. Without a ``limited`` battery, ``capacity`` and the like are 0.
    Charges (``capacity`` and others) are in the units of the energy model, of which a drone
    takes ``drain_per_s`` in a second of hovering; a battery counts as full at ``full``. The
    changes of users who stand still are those of ``Constants.known_at`` from number ``first_known``
    on. Its store holds ``store_ubit`` of updates (NEVER: it has no limit). If it is
    ``shielded``, the charges that its drones need at all places, as far as they do not fly freely,
    are those of ``Constants.needs`` from number ``first_need`` on, in the order of the plans; its
    processor draws at most ``draws_uw`` of the battery, in microwatts.
    The fields from ``scan`` on are functions, or in compiled code their addresses;
    ``admission_values`` and ``battery_values`` are the addresses of the components' fields.
    """

    limited: int
    capacity: int
    full: int
    drain_per_s: int
    return_charge: int
    respawn_after_us: int
    on_crash: int
    first_transit: int
    first_plan: int
    first_known: int
    store_ubit: int
    shielded: int
    first_need: int
    draws_uw: int
    admission_values: int
    battery_values: int
    scan: int
    drain_of: int
    lasts_us: int


@row
class Constants(Row):
    """The constants of a run: those of its world and its settings.

    If drones are asked ``by_event``, one hovers for ``patience_us``. A place (level, x, y) has the
    number ``(level * nx + x) * ny + y``. ``blocked`` has an entry per place, and ``station_at`` one
    per cell. ``types`` are the types of drones; some of them have a battery that is ``limited``.
    ``plans`` holds for each type (see ``TypeRow``) one plan per place without the drones' ceiling,
    and then one per place below it. ``transits`` holds the hover, and then for each type its moves
    and, from its number ``first_hop``, its hops in the order of ``model.motion.planner.HOPS``;
    ``Move.transit`` and ``first_hop`` are as if the first type came first of those that fly from
    cell to cell. Types that fly freely have no moves, and do not use them. ``radios`` are those of
    the types of drones, and then those of the access points ``points``; ``processors`` are theirs
    in the same order, ``terms`` those of the services, and ``clocks`` those of the users' own
    processors (0: none), if there are tasks. ``senses`` are the services whose updates users take
    as sensors (-1: none), and ``updates`` says what holds for those of each service, if there are
    sensors. Rewards divide users among ``sharers``: the drones,
    and the access points that count. The stages of service s are ``stages`` from number
    ``first_stages[s]`` on; a request draws ``draws`` values for them. ``expected_requests`` is the
    number of requests of an episode if all are served at once (see ``scenario.cost``). Senders of
    the same index modulo ``reuse`` interfere (0: none do). ``in_air`` says that changes of class
    are not always those of rings. For ``trigger_us`` and ``margin_db`` see ``rules.association``.
    ``known`` holds changes of users who stand still (``rules.standing``). Drones are too near to
    each other below a distance of ``separation_m`` (0: they have not to keep any); one
    ``gives_way`` to those with lower indices. Commands choose shares of tasks that are
    offloaded from ``least_share`` to ``most_share``, both 1 without a choice. ``features`` is
    the number of features that a learner observes, and ``gamma`` its discount of a step. If
    drones fly freely, ``spaces`` has an entry for each type; only those of free ones are used.
    ``scene`` is for the kernels of the sky. The fields from ``foresee`` on are functions, or in
    compiled code their addresses; ``reward_values`` and the like are the addresses of the
    components' fields.
    """

    steps: int
    step_us: int
    horizon_us: int
    gamma: float
    by_event: int
    patience_us: int
    limited: int
    pads: int
    services: int
    sharers: int
    reuse: int
    in_air: int
    trigger_us: int
    margin_db: float
    separation_m: float
    gives_way: int
    least_share: float
    most_share: float
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
    plans: Table[PlanRow]
    hops: Table[Hop]
    needs: Table[int]
    levels_m: Table[float]
    blocked: Table[int]
    station_at: Table[int]
    stations: Table[CellRow]
    starts: Table[CellRow]
    ceilings: Table[int]
    homes: Table[Place]
    radios: Table[RadioRow]
    processors: Table[ProcessorRow]
    terms: Table[TermsRow]
    clocks: Table[int]
    senses: Table[int]
    updates: Table[UpdatesRow]
    points: Table[PointRow]
    draws: int
    first_stages: Table[int]
    stages: Table[StageRow]
    expected_requests: float
    reward_values: int
    observation_values: int
    charging_values: int
    offloading_values: int
    mobility_values: int
    features: int
    known_at: Table[int]
    known: Table[Change]
    spaces: Table[SpaceRow]
    scene: Scene
    foresee: int
    foresee_in_air: int
    foresee_all: int
    recall_leg: int
    remember_leg: int
    better_us: int
    mark: int
    meet: int
    least_m: int
    pay: int
    describe: int
    charged: int
    until_full_us: int
    walk: int
    share: int
    run: int
