"""Sensors: their updates wait in a buffer, are sent one after the other, and lower the age.

The update at the head of a buffer is the open request of its user, made when it was taken. Whoever
receives the last bit of it delivers it, and the age of the sensor is from then on that of the
freshest update that has been delivered.
"""

from __future__ import annotations

from desim_uav.model.services import FROM_ALL, LAST, OLDEST
from desim_uav.rowcode.kernels import apart, rule
from desim_uav.rules import words
from desim_uav.rules.ages import count_age, deliver, is_sensor, log_update
from desim_uav.rules.delivery import store
from desim_uav.rules.note import note
from desim_uav.rules.rows import Constants, Drone, Path, Sensor, State, Update, User
from desim_uav.rules.service import begin_request, close, scan_if_used, stop, wait
from desim_uav.rules.stages import begin_anew, first_drawn, leave
from desim_uav.rules.stores import copy_update, give_room_back, has_room, is_stored
from desim_uav.rules.wide import clear


@rule
def forget_sensor(state: State, user: User) -> None:
    """Reset what is kept of a user as a sensor: the buffer is empty, and the age is 0."""
    sensor = state.sensors[user.index]
    for k in range(len(sensor.buffer)):
        sensor.buffer[k].number = -1
    sensor.first = sensor.count = 0
    sensor.fresh_us = sensor.since_us = sensor.falls = sensor.over_us = sensor.attached_us = 0
    sensor.generated = sensor.delivered = sensor.dropped = sensor.lost = 0
    clear(sensor.area_us2)
    clear(sensor.peaks_us)


# ---- the buffer


@rule
def _place(sensor: Sensor, k: int) -> int:
    """Return the place in memory of the update that is at place k of a buffer."""
    return (sensor.first + k) % len(sensor.buffer)


@apart
def take_update(world: Constants, path: Path, state: State, user: User, number: int) -> None:
    """Take the update that row ``number`` of the sample path describes, and let it be sent.

    The buffer makes room for it, or it is dropped.
    """
    sensor, first = state.sensors[user.index], number * world.draws
    update = sensor.buffer[_place(sensor, sensor.count)]
    sensor.count += 1
    update.number, update.user, update.generated_us = state.generated, user.index, state.now_us
    update.size, update.bps = path.drawn[first], path.drawn[first + 1]
    update.request = update.sent_us = update.received_us = update.drone = -1
    update.attached_us = sensor.attached_us
    if user.holder >= 0:
        update.attached_us += state.now_us - user.held_since_us
    state.generated += 1
    sensor.generated += 1
    note(state, words.REQUEST, words.ON_GENERATE, -1, user.index, -1, update.number)
    if world.updates[world.senses[user.index]].preempts == FROM_ALL and user.holder >= 0:
        _replace_others(world, path, state, user)
    _make_room(world, path, state, user)
    _send_next(world, state, user)


@rule
def _replace_others(world: Constants, path: Path, state: State, user: User) -> None:
    """Drop the updates of other sensors that stand at the drone of a sensor with a new one."""
    for u in range(len(state.users)):
        other = state.users[u]
        if u == user.index or other.holder != user.holder or not is_sensor(state, other):
            continue
        if state.sensors[u].count > 0 and world.updates[world.senses[u]].preempts == FROM_ALL:
            _drop(world, path, state, other, 0)


@rule
def _make_room(world: Constants, path: Path, state: State, user: User) -> None:
    """Drop updates until the buffer of a sensor, which has just taken one, is not too full.

    Those that wait have not been sent at all. If all of the others have to stay, it is the new one.
    """
    sensor, updates = state.sensors[user.index], world.updates[world.senses[user.index]]
    waiting = int(sensor.count > 1 and _is_being_sent(user))
    if waiting == 0 and updates.sends_last:
        waiting = int(sensor.count > 2)  # the head, which waits, is the latest but one
    if updates.keeps == LAST:
        if updates.preempts:
            waiting = 0
        while waiting < sensor.count - 1:
            _drop(world, path, state, user, waiting)
    elif updates.keeps == OLDEST:
        waiting = sensor.count - 1
    if sensor.count == len(sensor.buffer):
        _drop(world, path, state, user, waiting)


@rule
def _is_being_sent(user: User) -> bool:
    """Return whether a part of a user's open request has been sent, or is being sent now."""
    return user.request.server >= 0 or user.request.t_first_us >= 0


@rule
def _drop(world: Constants, path: Path, state: State, user: User, k: int) -> None:
    """Drop the update at place k of a sensor's buffer, and close its request if it has one."""
    sensor = state.sensors[user.index]
    update = sensor.buffer[_place(sensor, k)]
    sensor.dropped += 1
    if update.request < 0:
        note(state, words.REQUEST, words.ON_DROP, user.holder, user.index, -1, update.number)
    else:
        _close_dropped(world, path, state, user, update)
    log_update(state, update, words.DROPPED, -1, -1)
    _remove(sensor, k)


@rule
def _close_dropped(world: Constants, path: Path, state: State, user: User, update: Update) -> None:
    """Close a user's request because its update is dropped, and free what it held."""
    if user.request.server >= 0:
        stop(state, user, words.REQUEST)
    update.sent_us = user.request.t_first_us
    if user.holder >= 0:
        leave(state, state.senders[user.holder], user)
        give_room_back(state, state.senders[user.holder], user)
    close(world, path, state, user, words.REQUEST, words.ON_DROP, update.number)
    if user.holder >= 0:
        scan_if_used(state, state.senders[user.holder])


@apart
def refuse_update(
    world: Constants, path: Path, state: State, drone: Drone, user: User, phase: int
) -> None:
    """Drop the update at the head of a sensor's buffer, which a drone turns away for good."""
    sensor = state.sensors[user.index]
    update = sensor.buffer[sensor.first]
    update.sent_us = user.request.t_first_us
    give_room_back(state, drone, user)
    close(world, path, state, user, phase, words.ON_REFUSE)
    sensor.dropped += 1
    note(state, phase, words.ON_DROP, drone.index, user.index, -1, update.number)
    log_update(state, update, words.DROPPED, -1, -1)
    _remove(sensor, 0)
    _send_next(world, state, user)


@rule
def _remove(sensor: Sensor, k: int) -> None:
    """Remove the update at place k of a sensor's buffer."""
    last = sensor.count - 1
    if k == last:
        sensor.buffer[_place(sensor, last)].number = -1
    else:
        for j in range(k, 0, -1):
            copy_update(sensor.buffer[_place(sensor, j)], sensor.buffer[_place(sensor, j - 1)])
        sensor.buffer[sensor.first].number = -1
        sensor.first = _place(sensor, 1)
    sensor.count = last


@rule
def _send_next(world: Constants, state: State, user: User) -> None:
    """Open the request of the update at the head of a sensor's buffer, if there is one."""
    sensor, request = state.sensors[user.index], user.request
    if sensor.count > 1 and world.updates[world.senses[user.index]].sends_last:
        _put_last_first(world, state, user)
    if sensor.count == 0 or request.number >= 0:
        return
    update = sensor.buffer[sensor.first]
    request.service = world.senses[user.index]
    _ask_for(world, state, user, update)
    begin_request(world, state, user, update.generated_us)
    request.attached_us = max(0, sensor.attached_us - update.attached_us)
    update.request = request.number
    note(state, words.REQUEST, words.ON_REQUEST, -1, user.index, request.number, -1)
    if user.holder >= 0:
        wait(world, state, state.senders[user.holder], user)


@rule
def _ask_for(world: Constants, state: State, user: User, update: Update) -> None:
    """Let a sensor's request be for an update, of which nothing has been sent."""
    first = first_drawn(world, user)
    for k in range(2, world.draws):
        state.drawn[first + k] = 0
    state.drawn[first], state.drawn[first + 1] = update.size, update.bps
    begin_anew(world, state, user, 1.0)


@rule
def _put_last_first(world: Constants, state: State, user: User) -> None:
    """Put the latest update of a sensor at the head of its buffer, unless the head is being sent.

    If an older head waits, its open request is for the latest update from now on: it keeps its
    number, its time, and so its place in the line of a drone. The others are in the order of their
    times. The head is the latest one already if the one that came after it has just been dropped.
    """
    sensor = state.sensors[user.index]
    if user.request.number < 0:  # the latest update moves to the free place before all others
        sensor.first = _place(sensor, len(sensor.buffer) - 1)
        last = sensor.buffer[_place(sensor, sensor.count)]
        copy_update(sensor.buffer[sensor.first], last)
        last.number = -1
    elif not _is_being_sent(user):
        head, last = sensor.buffer[sensor.first], sensor.buffer[_place(sensor, sensor.count - 1)]
        if last.number < head.number:
            return
        free = sensor.buffer[_place(sensor, sensor.count)]
        copy_update(free, head)
        copy_update(head, last)
        copy_update(last, free)
        free.number = last.request = -1
        head.request = user.request.number
        if user.holder >= 0:
            leave(state, state.senders[user.holder], user)
            give_room_back(state, state.senders[user.holder], user)
        _ask_for(world, state, user, head)
        if user.holder >= 0:
            wait(world, state, state.senders[user.holder], user)


# ---- delivery, and the age


@apart
def receive(world: Constants, state: State, drone: Drone, user: User) -> None:
    """Deliver the update of which a drone has just received the last bit; send the next one."""
    sensor = state.sensors[user.index]
    update = sensor.buffer[sensor.first]
    update.sent_us = user.request.t_first_us
    update.received_us, update.drone = state.now_us, drone.index
    if is_stored(world, drone, user):
        store(world, state, drone, user, update)
    else:
        deliver(world, state, drone, update, words.COMPLETION)
    _remove(sensor, 0)
    _send_next(world, state, user)


@apart
def offer_room(world: Constants, state: State, drone: Drone) -> None:
    """Let updates for which a drone's store had no room come into its line, if there is room now.

    They are tried by the time at which they were taken, then by user. One for which there is no
    room now finds none either after others have come in.
    """
    best = 0
    while best < len(state.users):
        best, best_us, drone.crowded = len(state.users), words.NEVER, 0
        for u in range(len(state.users)):
            user = state.users[u]
            if _is_refused(world, state, drone, user):
                drone.crowded = 1
                t_us = user.request.t_request_us
                if t_us < best_us and has_room(world, drone, user.request.required):
                    best, best_us = u, t_us
        if best < len(state.users):
            wait(world, state, drone, state.users[best])
    drone.full_ubit = drone.stored_ubit


@rule
def _is_refused(world: Constants, state: State, drone: Drone, user: User) -> bool:
    """Return whether a user's update stands in no line, though the user is attached to a drone."""
    if user.holder != drone.index or user.request.number < 0 or not is_sensor(state, user):
        return False
    return is_stored(world, drone, user) and drone.freight[user.index].promised == 0


@apart
def end_sensors(world: Constants, state: State) -> None:
    """Count the ages until the end of an episode, and log what is in buffers and stores."""
    for u in range(len(state.users)):
        user, sensor = state.users[u], state.sensors[u]
        if is_sensor(state, user):
            count_age(world, state, user)
            for k in range(sensor.count):
                update = sensor.buffer[_place(sensor, k)]
                if update.request >= 0:
                    update.sent_us = user.request.t_first_us
                log_update(state, update, words.BUFFERED, -1, -1)
    for d in range(len(state.senders)):
        drone = state.senders[d]
        for k in range(drone.upload.first, len(drone.store)):
            log_update(state, drone.store[k], words.STORED, -1, -1)
