"""Sensors: their updates wait in a buffer, are sent one after the other, and lower the age.

The update at the head of a buffer is the open request of its user, made when it was taken. Whoever
receives the last bit of it delivers it, and the age of the sensor is from then on that of the
freshest update that has been delivered.
"""

from __future__ import annotations

from desim_uav.model.services import LAST, OLDEST
from desim_uav.rowcode.kernels import apart, rule
from desim_uav.rules import words
from desim_uav.rules.note import note
from desim_uav.rules.rows import Constants, Drone, Path, Sensor, State, Update, User
from desim_uav.rules.service import begin_request, close, scan_if_used, stop, wait
from desim_uav.rules.stages import begin_anew, leave
from desim_uav.rules.stores import empty_store, give_room_back, has_room
from desim_uav.rules.wide import add_product, clear


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
def is_sensor(state: State, user: User) -> bool:
    """Return whether a user is a sensor."""
    return bool(state.keeps_sensors and len(state.sensors[user.index].buffer) > 0)


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
    _make_room(world, path, state, user)
    _send_next(world, state, user)


@rule
def _make_room(world: Constants, path: Path, state: State, user: User) -> None:
    """Drop updates until the buffer of a sensor, which has just taken one, is not too full.

    Those that wait have not been sent at all. If all of the others have to stay, it is the new one.
    """
    sensor, updates = state.sensors[user.index], world.updates[world.senses[user.index]]
    waiting = int(sensor.count > 1 and _is_being_sent(user))
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
    _log(state, update, words.DROPPED, -1, -1)
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


@rule
def _remove(sensor: Sensor, k: int) -> None:
    """Remove the update at place k of a sensor's buffer."""
    last = sensor.count - 1
    if k == last:
        sensor.buffer[_place(sensor, last)].number = -1
    else:
        for j in range(k, 0, -1):
            _copy(sensor.buffer[_place(sensor, j)], sensor.buffer[_place(sensor, j - 1)])
        sensor.buffer[sensor.first].number = -1
        sensor.first = _place(sensor, 1)
    sensor.count = last


@rule
def _copy(to: Update, update: Update) -> None:
    """Copy an update."""
    to.number, to.user, to.generated_us = update.number, update.user, update.generated_us
    to.attached_us, to.size, to.bps = update.attached_us, update.size, update.bps
    to.request, to.sent_us, to.received_us = update.request, update.sent_us, update.received_us
    to.drone = update.drone


@rule
def _send_next(world: Constants, state: State, user: User) -> None:
    """Open the request of the update at the head of a sensor's buffer, if there is one."""
    sensor, request = state.sensors[user.index], user.request
    if sensor.count == 0 or request.number >= 0:
        return
    update = sensor.buffer[sensor.first]
    request.service = world.senses[user.index]
    for k in range(2, len(request.drawn)):
        request.drawn[k] = 0
    request.drawn[0], request.drawn[1] = update.size, update.bps
    begin_anew(world, request, 1.0)
    begin_request(world, state, user, update.generated_us)
    request.attached_us = max(0, sensor.attached_us - update.attached_us)
    update.request = request.number
    note(state, words.REQUEST, words.ON_REQUEST, -1, user.index, request.number, -1)
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
    if len(drone.freight) > 0 and drone.point < 0 and _goes_to_ground(world, user):
        _store(state, drone, user, update)
    else:
        before_us = _let_fall(world, state, user, update.generated_us)
        sensor.delivered += 1
        note(state, words.COMPLETION, words.ON_DELIVER, drone.index, user.index, -1, update.number)
        _log(state, update, words.DELIVERED, before_us, state.now_us - sensor.fresh_us)
    _remove(sensor, 0)
    _send_next(world, state, user)


@rule
def _let_fall(world: Constants, state: State, user: User, generated_us: int) -> int:
    """Let a sensor's age fall to that of an update that is delivered, and return what it was.

    It does not fall if a fresher update was delivered before.
    """
    sensor = state.sensors[user.index]
    count_age(world, state, user)
    before_us = state.now_us - sensor.fresh_us
    if generated_us > sensor.fresh_us:
        sensor.fresh_us = generated_us
        sensor.falls += 1
        add_product(sensor.peaks_us, before_us, 1)
    return before_us


@rule
def count_age(world: Constants, state: State, user: User) -> None:
    """Count the age of a sensor since it was counted last, which has risen with time.

    A trapezoid's area is half of its width times the sum of its sides.
    """
    sensor, now_us = state.sensors[user.index], state.now_us
    elapsed_us, sides_us = now_us - sensor.since_us, now_us + sensor.since_us - 2 * sensor.fresh_us
    add_product(sensor.area_us2, elapsed_us, sides_us)
    state.aged += float(elapsed_us) * float(sides_us)
    limit_us = world.updates[world.senses[user.index]].limit_us
    if limit_us < words.NEVER:
        sensor.over_us += max(0, now_us - max(sensor.since_us, sensor.fresh_us + limit_us))
    sensor.since_us = now_us


@apart
def count_ages(world: Constants, state: State) -> None:
    """Count the ages of all sensors until now."""
    for u in range(len(state.users)):
        if is_sensor(state, state.users[u]):
            count_age(world, state, state.users[u])


# ---- what drones carry to the ground


@rule
def _goes_to_ground(world: Constants, user: User) -> bool:
    """Return whether a user's updates are delivered at the ground."""
    return bool(world.updates[world.senses[user.index]].ground)


@rule
def _store(state: State, drone: Drone, user: User, update: Update) -> None:
    """Put an update into the store of the drone that has received it; its place was promised."""
    freight = drone.freight[user.index]
    freight.count += 1
    freight.fresh_us = max(freight.fresh_us, update.generated_us)
    freight.promised = 0
    if state.keeps_requests or state.keeps_events:
        _copy(drone.store.added(), update)


@apart
def unload(world: Constants, state: State, drone: Drone, phase: int) -> None:
    """Deliver all updates in a drone's store, as it has landed on a station.

    The age of a sensor falls once, to that of the freshest one.
    """
    for u in range(len(drone.freight)):
        freight, sensor = drone.freight[u], state.sensors[u]
        if freight.count > 0:
            freight.before_us = _let_fall(world, state, state.users[u], freight.fresh_us)
            sensor.delivered += freight.count
    for k in range(len(drone.store)):
        update = drone.store[k]
        note(state, phase, words.ON_DELIVER, drone.index, update.user, -1, update.number)
        after_us = state.now_us - state.sensors[update.user].fresh_us
        before_us = drone.freight[update.user].before_us
        _log(state, update, words.DELIVERED, before_us, after_us)
    empty_store(drone)


@apart
def lose_updates(world: Constants, state: State, drone: Drone) -> None:
    """Lose all updates in the store of a drone that has crashed."""
    for u in range(len(drone.freight)):
        state.sensors[u].lost += drone.freight[u].count
    for k in range(len(drone.store)):
        update = drone.store[k]
        note(state, words.DEPLETION, words.ON_LOSE, drone.index, update.user, -1, update.number)
        _log(state, update, words.LOST_IN_CRASH, -1, -1)
    empty_store(drone)


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
    return _goes_to_ground(world, user) and drone.freight[user.index].promised == 0


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
                _log(state, update, words.BUFFERED, -1, -1)
    for d in range(len(state.drones)):
        store = state.drones[d].store
        for k in range(len(store)):
            _log(state, store[k], words.STORED, -1, -1)


@rule
def _log(state: State, update: Update, fate: int, before_us: int, after_us: int) -> None:
    """Log an update whose fate is known now, if requests are logged."""
    if state.keeps_requests:
        _append(state, update, fate, before_us, after_us)


@rule
def _append(state: State, update: Update, fate: int, before_us: int, after_us: int) -> None:
    """Append an update to the log (see ``_log``)."""
    logged = state.updates.added()
    logged.number, logged.user, logged.generated_us = (
        update.number,
        update.user,
        update.generated_us,
    )
    logged.size, logged.request, logged.sent_us = update.size, update.request, update.sent_us
    logged.received_us, logged.drone = update.received_us, update.drone
    logged.fate, logged.ended_us = fate, state.now_us
    logged.before_us, logged.after_us = before_us, after_us
