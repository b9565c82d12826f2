"""The state of an episode, and the memory in which links and walks are looked at."""

from __future__ import annotations

from desim_uav.model.mobility.walks import Walking
from desim_uav.rowcode.rows import Int16, Int32, Queue, Row, Table, row
from desim_uav.rules.rows.drones import Begun, Drone, ObservationRow, Pair, Station
from desim_uav.rules.rows.logs import (
    Closed,
    EventRow,
    FlownRow,
    Handover,
    PointRecord,
    Record,
    UpdateRow,
)
from desim_uav.rules.rows.users import Sensor, Spot, Task, User, UserLinks, Wide
from desim_uav.sky.rows import Sky


@row
class LookRow(Row):
    """The users' walks in the present span of time.

    If users walk step by step, their walks are known until ``walked_us``. They ``stand`` if they
    are at home, and do not walk (see ``rules.standing``), and are ``still`` if they do not walk.
    """

    walked_us: int
    stand: Int16
    still: Int16
    walking: Walking


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
    the time in outages that have ended, and ``links`` are those of its users; else there are none
    (see ``rules.links``). If it ``keeps_credit``, so much of each user's present stage has been
    ``credited`` (see ``rules.credit``). ``drawn`` has the values that the users' open requests have
    drawn for their stages, ``Constants.draws`` of each user, if they may be needed again (see
    ``rules.stages``). If it ``keeps_tasks``, ``tasks`` are those of its users (see
    ``rules.tasks``), whose results come over backhauls if it ``relays``. If it ``keeps_sensors``,
    ``sensors`` are those of its users, so many of whom are ``sensing`` and have taken ``generated``
    updates (see ``rules.updates``), and if it ``uploads``, stored updates come to the ground over
    backhauls (see ``rules.delivery``); ``aged`` sums twice the integrals of their ages, in µs^2,
    since the decision epoch. If drones have to keep a distance, ``pairs`` are drones (0, 1),
    (0, 2), …;
    ``conflicts`` counts how often two came too near, ``conflict_us`` sums the ends of these times
    less their starts, and ``nearest_m`` is the least distance in the windows that have ended. At
    the decision epoch, ``asked`` counts the open requests by service, and ``counts`` by drone those
    that it serves and those in its footprint; ``masks`` has an entry per drone and action.
    ``history`` holds all commands. ``sky`` is for the kernels of the sky. In the compiled engine,
    ``slot_times`` to ``winners`` are the event queue, and ``before`` holds the drones as they
    began the episode, at ``before_us``; while it is stepped, memory from the address ``fetch_at``
    to ``fetch_end`` is fetched, which the next environment needs. In free flight, ``aims``
    holds what belongs to the commands (``Course.aim_x`` and the four after it), ``flown`` the legs
    of a step for the log, and ``away_m`` is memory.
    """

    now_us: int
    step: int
    epoch_us: int
    next_us: int
    fetch_at: int
    fetch_end: int
    share: float
    terminated: Int16
    truncated: Int16
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
    bandwidth_us_hz: Wide
    closed_qoe1: float
    distance_m: float
    to_scan: int
    by_level: Int16
    retunes: Int16
    renews: Int16
    keeps_events: Int16
    keeps_requests: Int16
    keeps_links: Int16
    keeps_credit: Int16
    keeps_tasks: Int16
    relays: Int16
    uploads: Int16
    keeps_sensors: Int16
    sensing: int
    generated: int
    aged: float
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
    credited: Table[int]
    drawn: Table[int]
    links: Table[UserLinks]
    tasks: Table[Task]
    sensors: Table[Sensor]
    stations: Table[Station]
    loose: Queue[Int32]
    unsettled: Queue[Int32]
    open_requests: Table[Int32]
    asked: Table[Int32]
    observations: Table[ObservationRow]
    records: Table[Record]
    point_records: Table[PointRecord]
    counts: Table[Int32]
    spots: Table[Spot]
    firsts: Table[Int32]
    masks: Table[Int16]
    rewards: Table[float]
    crashed: Queue[Int16]
    history: Table[Int16]
    aims: Table[float]
    away_m: Table[float]
    flown: Queue[FlownRow]
    events: Queue[EventRow]
    closed: Queue[Closed]
    handovers: Queue[Handover]
    updates: Queue[UpdateRow]
    look: LookRow
    sky: Sky
    slot_times: Table[int]
    slot_keys: Table[int]
    winners: Table[Int32]
    before: Table[Begun]
    before_us: int
