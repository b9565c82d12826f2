"""Users, and their requests."""

from __future__ import annotations

from desim_uav.rowcode.rows import Int16, Int32, Row, Table, row


@row
class Wide(Row):
    """A whole number from 0 on in two words: ``high`` * 2^62 + ``low`` (see ``rules.wide``)."""

    high: int
    low: int


@row
class Request(Row):
    """The open request of a user; ``number`` is -1 if there is none.

    It is in its stage number ``stage`` of ``stages``, which has to be served until ``done`` is
    ``required``. Both are microseconds of service or millionths of a bit; ``rate`` of them are done
    per microsecond (1, or bit/s) while drone ``server`` serves it, which it has done since
    ``started_us``, at this rate and with a bandwidth of ``used_hz`` since ``counted_us``. While it
    is ``queued``, it stands in the line number ``line`` of its user's drone (see
    ``model.services``), and in the band of uploads if it goes ``up`` and there is one. One that
    holds the rate ``bandwidth_bps`` needs a bandwidth of ``needs_hz`` in its present class.
    Of its services that lasted more than 0 µs, the first began at ``t_first_us``; the last was by
    ``last_server`` and ended at ``stopped_us``.
    """

    number: Int32
    service: Int16
    t_request_us: int
    required: int
    done: int
    rate: int
    stage: Int16
    stages: Int16
    line: Int16
    queued: Int16
    up: Int16
    bandwidth_bps: int
    needs_hz: int
    used_hz: int
    served_us: int
    attached_us: int
    interruptions: Int32
    t_first_us: int
    server: Int16
    started_us: int
    counted_us: int
    stopped_us: int
    last_server: Int16


@row
class User(Row):
    """A user, attached to sender ``holder`` (see ``State.senders``) since ``held_since_us``.

    ``classes`` holds the classes of its links to the senders; ``covering`` holds the times at which
    it entered their footprints, where the class is at least 1, and ``covered`` is the number of
    those that it is in. ``share`` is the served share of its open request when service
    last stopped; ``doing`` is its ``UserState`` at the end of the episode.
    """

    index: Int32
    holder: Int16
    held_since_us: int
    covered: Int16
    next_ask: Int32
    share: float
    doing: Int16
    request: Request
    classes: Table[Int16]
    covering: Table[int]


@row
class Task(Row):
    """What is kept of a user's request as a task (see ``rules.tasks``).

    A ``part`` of it is offloaded, which passes through its stages. The rest is ``own``: so many
    thousandths of a cycle that the user's own processor does from ``own_from_us`` to
    ``own_until_us``, or has done (``own_done``). The offloaded part is computed by sender ``site``
    (-1: none yet), at whose processor it has arrived at ``arrived_us``; if it stands in line
    MOVING, it moves from there to sender ``target``. The task is late at
    ``deadline_us``. It has been sent for ``sending_us``, of which ``uplink_us`` were before its
    site was known, and computed for ``computing_us``, and has begun anew ``restarts`` times because
    a drone has crashed.
    """

    part: float
    own: int
    own_from_us: int
    own_until_us: int
    own_done: int
    site: int
    target: int
    arrived_us: int
    deadline_us: int
    restarts: int
    sending_us: int
    uplink_us: int
    computing_us: int


@row
class Update(Row):
    """An update of a sensor, by its ``number`` in the episode (-1: there is none).

    Sensor ``user`` has taken it at ``generated_us``, when the user had been attached for
    ``attached_us`` in the episode. It has a ``size``, and holds the rate ``bps`` if any: the values
    that its request draws. Its ``request`` has been opened, or not yet (-1). It has been sent from
    ``sent_us`` on, and ``drone`` has received it at ``received_us``.
    """

    number: int
    user: int
    generated_us: int
    attached_us: int
    size: int
    bps: int
    request: int
    sent_us: int
    received_us: int
    drone: int


@row
class Freight(Row):
    """What a drone carries of a sensor, if updates are delivered at the ground.

    There are ``count`` updates, the freshest of which was taken at ``fresh_us``. The drone keeps
    room for ``promised`` millionths of a bit of the one that it receives. ``before_us`` is the age
    of the sensor just before they are delivered.
    """

    count: int
    fresh_us: int
    promised: int
    before_us: int


@row
class Upload(Row):
    """How the first update in the store of a sender goes over its backhaul (``rules.delivery``).

    If it is ``under_way``, ``done`` millionths of a bit have been sent until ``counted_us``, since
    when ``rate`` of them are sent per microsecond. It is number ``first`` in the memory of the
    store; those before it have been delivered.
    """

    under_way: Int32
    first: Int32
    done: int
    rate: int
    counted_us: int


@row
class Sensor(Row):
    """What is kept of a user as a sensor (see ``rules.updates``); other users have an empty buffer.

    ``buffer`` has memory for one update more than the buffer holds; there are ``count`` of them,
    from number ``first`` on and then from the beginning. ``fresh_us`` is when the freshest update
    that has been delivered was taken. Its age has been counted until ``since_us``: twice its
    integral in ``area_us2``, the sum of the ages just before ``falls`` times at which it fell in
    ``peaks_us``, and the time for which it was above the limit in ``over_us``. The others count its
    updates. ``attached_us`` is how long the user has been attached, without the present attachment.
    """

    buffer: Table[Update]
    first: Int32
    count: Int32
    fresh_us: int
    since_us: int
    area_us2: Wide
    peaks_us: Wide
    falls: int
    over_us: int
    generated: int
    delivered: int
    dropped: int
    lost: int
    attached_us: int


@row
class UserLinks(Row):
    """What is kept of the links of a user (see ``rules.links``).

    The user was attached to drone ``left`` until ``left_us``, and at ``came_us`` it was handed over
    from drone ``came_from``. Its latest outage that is not counted yet began at ``outage_since_us``
    in the phase ``outage_began_in``, and ended at ``outage_until_us`` in the phase
    ``outage_ended_in`` (-1: there is none, or it has not ended). If users are associated by level,
    drones have been better for it than its own ``better_since`` (-1: they are not); the next to
    change this is ``rival``, at ``turns_us``.
    """

    left: Int16
    left_us: int
    came_from: Int16
    came_us: int
    outage_since_us: int
    outage_until_us: int
    outage_began_in: Int16
    outage_ended_in: Int16
    unsettled: Int16
    rival: Int16
    turns_us: int
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
