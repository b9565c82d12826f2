"""The log of an episode, and other values that engines take and return."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, NamedTuple

from desim_uav.model.motion.planner import Node
from desim_uav.model.rules import Mode
from desim_uav.rowcode.rows import named
from desim_uav.rules.rows import Closed, PointRecord, Record, UpdateRow

Event = tuple[Any, ...]
"""An event: (t_us, phase, kind, drone, user, request_id, station); -1 stands for none.

If the drones' links have classes, the class of the link that the event changed follows. If drones
have to keep a distance, the other drone of an event of two drones follows. If a service has several
stages, the number of the stage that begins follows. If users are sensors, the number of the update
follows.
"""


class ClosedRequest(named(Closed, "drones", "outcome")):  # type: ignore[misc]
    """A closed request; times are in microseconds since the start of the episode.

    ``required`` and ``done`` are microseconds of service, or millionths of a bit, in stage number
    ``stage``, its last one; ``asked_us``, ``asked_ubit`` and ``sent_ubit`` are sums over its stages
    (see ``rules.stages.count_amounts``). ``drones`` lists the drones that served it, in order;
    ``t_first_us`` is the start of service, or None. ``outcome`` is an Outcome. The other fields are
    those of ``rules.rows.Closed``.
    """

    __slots__ = ()


class LoggedUpdate(named(UpdateRow)):  # type: ignore[misc]  # its fields are those of UpdateRow
    """An update whose fate is known (see ``rules.rows.UpdateRow``); times are in microseconds."""

    __slots__ = ()


class SensorTotals(NamedTuple):
    """What an episode was for a sensor; times are in microseconds.

    ``area_us2`` is twice the integral of its age, ``peaks_us`` the sum of its ages just before
    ``falls`` times at which it fell, ``over_us`` the time for which it was above the limit, and
    ``age_us`` the age at the end. The others count its updates.
    """

    user: int
    service: int
    area_us2: int
    peaks_us: int
    falls: int
    over_us: int
    age_us: int
    generated: int
    delivered: int
    dropped: int
    lost: int


class Step(named(Record)):  # type: ignore[misc]  # its fields are declared in Record alone
    """The record of one drone at the end of one step (see ``rules.rows.Record``).

    ``mode`` is a Mode, and ``action`` and ``action_taken`` are Actions; ``action`` is None if there
    was none. ``charge`` and ``return_drain`` are None without a battery, and ``return_drain`` is
    inf if there is no way back.
    """

    __slots__ = ()


class PointStep(named(PointRecord)):  # type: ignore[misc]  # its fields are those of PointRecord
    """The record of one access point at the end of one step (see ``rules.rows.PointRecord``)."""

    __slots__ = ()


Position = tuple[float, float, float]
"""A position: x, y and z in metres."""


class FlownLeg(NamedTuple):
    """A leg that a drone began at ``t_us``, which is negative if this was in an earlier episode.

    It is a transit of ``duration_us``, either commanded (mode FLYING) or a hop of a return
    (RETURNING). With a duration of 0 it is the place at which the drone began the episode, replaced
    a crashed one, or lies after a crash. After a leg, a drone stays at the leg's end.
    """

    t_us: int
    drone: int
    duration_us: int
    mode: Mode
    from_m: Position
    to_m: Position


class LinkCounts(NamedTuple):
    """How many handovers, ping-pongs and outages an episode had, and the time in outages."""

    handovers: int
    ping_pongs: int
    outages: int
    outage_us: int


class Conflicts(NamedTuple):
    """How often two drones came too near to each other, for how long, and the least distance.

    ``conflict_us`` is summed over pairs of drones. ``least_m`` is inf if no two drones were in the
    air at a time.
    """

    conflicts: int
    conflict_us: int
    least_m: float


@dataclass
class EpisodeLog:
    """The log of one episode, which is complete once the episode has ended.

    ``events`` is None if events are not kept; at the end they are sorted by (t_us, phase, drone,
    user). ``legs`` are kept if events are, and sorted by (t_us, drone). ``attached_us`` is the
    integral of the number of attached users over time, and ``bandwidth_us_hz`` that of the
    bandwidth in use. ``queueing_us`` is the drones' time between landing and charging. ``crashed``
    lists the drone of each crash, and ``suppressed`` counts the arrivals that were dropped.
    ``links`` is None if the drones' radio is the paper's disc. The drones whose batteries are in
    microjoules ``used`` and ``gained`` (by charging) so many together. ``apart`` is None unless
    drones have to keep a distance. ``engine`` names the engine that has played the episode.
    """

    episode: int
    events: list[Event] | None = None
    legs: list[FlownLeg] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    point_steps: list[Any] = field(default_factory=list)
    """The records of access points, which are ``PointStep``."""
    requests: list[ClosedRequest] = field(default_factory=list)
    updates: list[LoggedUpdate] = field(default_factory=list)
    sensors: list[SensorTotals] = field(default_factory=list)
    """The totals of the users who are sensors, at the end of the episode."""
    duration_us: int = 0
    attached_us: int = 0
    bandwidth_us_hz: int = 0
    queueing_us: int = 0
    distance_m: float = 0.0
    crashed: list[int] = field(default_factory=list)
    charges: int = 0
    used: int = 0
    gained: int = 0
    suppressed: int = 0
    links: LinkCounts | None = None
    apart: Conflicts | None = None
    engine: str = field(default="", compare=False)

    @property
    def crashes(self) -> int:
        """The number of crashes in the episode."""
        return len(self.crashed)


class RunSettings(NamedTuple):
    """The settings of a run that are not part of its world.

    ``ceilings`` says of each drone whether it must not fly above the tallest building, and
    ``carry_over`` whether drones begin an episode as they ended the one before. ``keep_events``
    puts events and legs into the log, and ``keep_steps`` steps and requests.
    """

    ceilings: tuple[bool, ...]
    carry_over: bool
    keep_events: bool = False
    keep_steps: bool = True


class TaskQueue(NamedTuple):
    """How many tasks the processor of a drone or access point computes, and how many wait there."""

    computed: int = 0
    waiting: int = 0


class UserState(IntEnum):
    """What a user is doing: nothing, attached without a request, waiting with one, or served."""

    IDLE = 0
    ATTACHED = 1
    OPEN = 2
    SERVED = 3


class FreeCarried(NamedTuple):
    """The present leg of a drone that flies freely, and its way home (see ``rows.Course``)."""

    x0_m: float
    y0_m: float
    z0_m: float
    x1_m: float
    y1_m: float
    z1_m: float
    limit_mps: float
    station: int
    node: int
    level: int
    share: float = 1.0


class CarriedDrone(NamedTuple):
    """The state of a drone between two episodes.

    Its present leg or mode began ``age_us`` microseconds ago at ``node``, with ``charge``.
    ``hop`` is its present hop if it returns, and ``route`` the hops after that; ``counted_m`` of
    the hop are already part of a log's distance. ``place`` is the number of drones before it in its
    station's queue, including those on pads. ``fallen_m`` is the position of a crashed drone. A
    drone that flies freely has the leg in ``free``; its ``hop`` says only whether it returns.
    If drones are asked by event, one that follows a command does so for ``rest_us`` more, with the
    action of the index ``taken``; ``hop`` is then its present move from cell to cell, if it moves.
    """

    mode: Mode
    node: Node
    charge: int
    age_us: int
    hop: Node | None
    route: tuple[Node, ...]
    counted_m: float
    place: int
    fallen_m: tuple[float, float] | None
    free: FreeCarried | None = None
    rest_us: int = 0
    taken: int = 0


Carried = tuple[CarriedDrone, ...]
"""All that an episode takes over from the one before it: the states of the drones."""


class Measures(NamedTuple):
    """The quality of experience of an episode so far; None where a measure is not defined yet."""

    qoe1_percent: float | None
    qoe2_iterations: float | None
    qoe3_percent: float | None


MEASURES = ("sim_time_s", *Measures._fields)
"""The names of the measures of an episode under way: the simulated time and QoE1 to QoE3."""

COUNTS = ("attached_users", "crashes", "requests", "elapsed_steps", "forced")
"""The names of the counts of an episode under way: users attached now, crashes, requests, the steps
since the last free decision, and whether there is no choice now."""

OF_STEP = ("duration_steps", "discount")
"""The names of what is told of the step that ends now: how long it has lasted, in steps of the
scenario, and the discount of what follows it (see ``model.decisions.discount_of``)."""

OWN_COUNTS = ("attached_users", "crashes", "elapsed_steps", "forced")
"""The names of those counts that each drone has of its own."""
