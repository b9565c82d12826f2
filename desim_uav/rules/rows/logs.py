"""Rows for the log: records of steps, legs, events, closed requests and handovers."""

from __future__ import annotations

from desim_uav.rowcode.rows import Row, row


@row
class Record(Row):
    """The log's record of a drone at the end of a step; ``return_drain`` is n_B (NEVER: no way).

    ``used`` is what it has drained of its battery since the episode began. ``aim_x`` to
    ``aim_cruise`` are the command of a free flight.
    """

    step: int
    t_us: int
    drone: int
    x_m: float
    y_m: float
    z_m: float
    charge: int
    mode: int
    action: int
    action_taken: int
    attached_users: int
    served_requests: int
    used_hz: int
    return_drain: int
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
    used_hz: int


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
class EventRow(Row):
    """An entry of the event log, which is an event or a leg (see ``note_leg``).

    An event of two drones (``words.OF_PAIRS``) has the other one in the place of ``user``.
    The beginning of a stage has its number in the place of ``station``, and so has an update.
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
    """A request that has been closed by an event of this ``kind``.

    From ``asked_us`` on, its fields are those of ``engine.base.ClosedRequest``.
    """

    request_id: int
    user: int
    service: int
    stage: int
    bandwidth_bps: int
    required: int
    done: int
    served_us: int
    attached_us: int
    t_request_us: int
    t_first_us: int
    t_end_us: int
    interruptions: int
    asked_us: int
    asked_ubit: int
    sent_ubit: int
    asked_cycles: int
    deadline_us: int
    sending_us: int
    uplink_us: int
    computing_us: int
    restarts: int
    kind: int
    part: float
    own_us: int
    own_share: float


@row
class UpdateRow(Row):
    """An update of a sensor whose ``fate`` is known at ``ended_us`` (see ``words.FATES``).

    Its delivery has lowered the user's age from ``before_us`` to ``after_us`` (-1: it has not been
    delivered). The other fields are those of ``Update``.
    """

    number: int
    user: int
    generated_us: int
    size: int
    request: int
    sent_us: int
    received_us: int
    drone: int
    fate: int
    ended_us: int
    before_us: int
    after_us: int


@row
class Handover(Row):
    """A drone that served a request which another drone, or none, had served before."""

    number: int
    drone: int
