"""What the fixed-step simulator is given, and what it returns, in plain numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tests.reference.energy import Charger, Rotor
from tests.reference.radio import AccessPoint, Disc, Radio

US = 1_000_000
NEVER = 2**62

Node = tuple[int, int, int]
"""(cell x, cell y, level)."""


@dataclass(frozen=True)
class Request:
    """What a user will ask for; ``due_us`` counts as ``Inputs.follows`` says.

    A request without a volume is a hold of ``bandwidth_bps`` for ``required_us``. One with
    ``volume_ubit`` (whole 1e-6 bit) is a transfer. It has a rate of ``bandwidth_bps`` where
    bandwidth is held, and elsewhere what sharing gives it. ``then`` are the stages that follow this
    one, whose ``due_us`` says nothing; a stage of nothing is left out. One with ``cycles``, in
    thousandths, is computed by the processor of whoever has received the stage before.

    Of a first stage, ``on_deadline`` says what happens ``deadline_us`` after it was made: it goes
    on (count), is closed (drop), or is closed unless a processor has begun it (leave). If it
    ``restarts``, a stage that another transmitter goes on with begins anew. If it ``migrates``,
    what waits at a processor moves to that of another transmitter of its user, over the backhauls
    of both. A stage that goes ``up`` is in the band of uploads, where there is one.
    """

    due_us: int
    required_us: int
    bandwidth_bps: int
    volume_ubit: int = 0
    then: tuple[Request, ...] = ()
    cycles: int = 0
    deadline_us: int = NEVER
    on_deadline: str = "count"
    restarts: bool = False
    migrates: bool = False
    up: bool = False

    @property
    def amount(self) -> int:
        """The amount of this stage: millionths of a bit, cycles or microseconds."""
        return self.volume_ubit or self.cycles or self.required_us

    def part(self, share: float) -> Request:
        """Return a share of this stage, rounded down."""
        if share == 1.0:
            return self
        volume, cycles = int(self.volume_ubit * share), int(self.cycles * share)
        return replace(self, volume_ubit=volume, cycles=cycles)


@dataclass(frozen=True)
class Processor:
    """The processor of a transmitter: ``clock`` is in thousandths of a cycle per microsecond.

    ``sharing``: first_come, processor_sharing or earliest_deadline. One that is not ``on_ground``
    stands still unless its drone flies and serves.
    """

    cores: int
    clock: int
    sharing: str = "first_come"
    on_ground: bool = False


@dataclass(frozen=True)
class Sensing:
    """How a sensor keeps its updates: up to ``buffer``, and the ``newest``, ``oldest`` or ``last``.

    ``preempt``: with last, the one that is being sent is replaced as well, and with
    ``preempts_all`` so are those of all such sensors at the same transmitter. The next to be sent
    is the first one in the buffer, or the one that was taken last (``sends_last``). Drones deliver
    those ``at_ground`` when they land; others are delivered when they are received. One who takes
    updates at will waits until an update has been sent for ``wait_us``.
    """

    buffer: int
    keeps: str
    preempt: bool = False
    at_ground: bool = False
    wait_us: int = 0
    preempts_all: bool = False
    sends_last: bool = False


@dataclass(frozen=True)
class Association:
    """Which of the covering transmitters a user is attached to.

    ``kind``: entered_first, strongest, or a3. With a3 a user leaves its transmitter for one whose
    level has been ``margin_db`` higher for ``trigger_us``.
    """

    kind: str = "entered_first"
    margin_db: float = 0.0
    trigger_us: int = 0


@dataclass(frozen=True)
class Inputs:
    """One episode in plain numbers. ``levels_m``: all altitudes; ``levels``: how many a drone has.

    ``wind_mps`` is the velocity of the air along x and y; speeds are limited and energy is taken by
    the speed through the air. With a ``rotor`` batteries are in µJ, else in µs. A ``charger``
    replaces ``charge_us``.
    ``links``: the radio of each drone. ``legs``: for each user an array of rows t0_s, x0, y0, vx,
    vy. ``users_height_m`` None: all users stand on the ground. ``capacity`` None is an
    unlimited battery, ``respawn_after_us`` None is no respawn. ``plan`` settles what the model
    leaves open, which of several equally short ways is flown: a way (hops) from a node for a drone
    with so many levels, checked here against Dijkstra's time; without it any shortest way is flown.
    ``cruise``: the speeds from which commands choose, ascending; none: ``fill_epoch`` says it.
    ``processors``: that of each transmitter; ``clocks``: that of each user, of whom none computes
    without. ``offloading``: always, never, shortest or split. ``sensors``: how each user keeps
    updates, None for others; ``store_ubit``: what a drone can carry of them.
    With ``patience_us`` a drone is asked when it is free, and a reward (R1) is paid, which is
    discounted by ``gamma`` per step.
    """

    cell_m: tuple[float, float]
    height_m: np.ndarray
    levels_m: tuple[float, ...]
    level_step_m: float
    three_d: bool
    levels: tuple[int, ...]
    stations: Sequence[tuple[int, int]]
    starts: Sequence[tuple[int, int]]
    links: Sequence[Disc | Radio]
    max_speed_mps: float
    max_acceleration_mps2: float
    fill_epoch: bool
    returns_fill_epoch: bool
    capacity: int | None
    return_below: float
    respawn_after_us: int | None
    charge_us: int
    pads: int
    steps: int
    step_us: int
    legs: Sequence[np.ndarray]
    requests: Sequence[Sequence[Request]]
    follows: Sequence[bool]
    position_error: np.ndarray | None
    respawn: np.ndarray
    plan: Callable[[Node, int], Sequence[Node]] | None = None
    users_height_m: np.ndarray | None = None
    association: Association = Association()
    access_points: Sequence[AccessPoint] = ()
    rotor: Rotor | None = None
    charger: Charger | None = None
    cruise: Sequence[float] = ()
    wind_mps: tuple[float, float] = (0.0, 0.0)
    patience_us: int | None = None
    gamma: float = 0.9
    processors: Sequence[Processor] = ()
    clocks: Sequence[int] = ()
    offloading: str = "always"
    sensors: Sequence[Sensing | None] = ()
    store_ubit: float = math.inf


@dataclass
class Record:
    """A drone at the end of a step.

    ``return_drain``: what the way home from its believed cell takes from the battery, in its unit;
    infinity if there is none. A drone that flies freely knows its place, and has a way at rest.
    """

    mode: str
    node: Node
    position_m: tuple[float, float, float]
    charge: float | None
    action_taken: str
    attached: tuple[int, ...]
    return_drain: float | None


@dataclass
class Decision:
    """A drone that is free, and the action that it takes.

    ``charge``, ``attached`` and ``return_drain`` are those of the moment before. ``gained``: the
    rewards since the drone's previous decision, discounted to that decision.
    """

    t_us: int
    action_taken: str
    position_m: tuple[float, float, float] | None
    charge: float | None
    attached: tuple[int, ...]
    return_drain: float | None
    gained: float


@dataclass
class Closed:
    """A request that has ended.

    ``passed`` counts the part that a user computes itself as one more stage.
    ``served_us``: the time of service, which is the time with progress of a transfer. It and
    ``delivered_ubit`` are those of all stages. Of its ``stages``, ``passed`` have been done, and
    ``done`` is the share of the next one. Processors of transmitters have computed it for
    ``computing_us``, and that of its user for ``own_us``.
    """

    user: int
    served_us: int
    delivered_ubit: int
    done: float
    passed: float
    stages: int
    t_request_us: int
    t_end_us: int
    completed: bool
    computing_us: int = 0
    own_us: int = 0

    @property
    def share(self) -> float:
        """The stages that were done, with the share of the last one, over all of them."""
        return (self.passed + self.done) / self.stages


@dataclass
class Result:
    """What became of the episode; ``records[step][drone]`` or ``decisions[drone][which]``.

    ``rest``: what each drone has gained between its last decision and the end.
    ``handovers``: how often a user went from one transmitter to another without a time between.
    ``ages_us``: the mean age of each sensor; ``delivered``: the user of each update that was
    delivered, when it was taken, and when it was delivered.
    """

    records: list[list[Record]] = field(default_factory=list)
    decisions: list[list[Decision]] = field(default_factory=list)
    rest: list[float] = field(default_factory=list)
    requests: list[Closed] = field(default_factory=list)
    attached_us: int = 0
    handovers: int = 0
    crashes: int = 0
    charges: int = 0
    suppressed: int = 0
    restarts: int = 0
    late: int = 0
    ages_us: list[float] = field(default_factory=list)
    delivered: list[tuple[int, int, int]] = field(default_factory=list)
    dropped: int = 0
    lost: int = 0
    qoe1: float = 0.0
    qoe2: float = 0.0
    qoe3: float = 0.0
