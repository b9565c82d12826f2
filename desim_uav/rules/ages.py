"""The ages of sensors, which rise with time and fall when a fresher update is delivered."""

from __future__ import annotations

from desim_uav.rowcode.kernels import apart, rule
from desim_uav.rules import words
from desim_uav.rules.note import note
from desim_uav.rules.rows import Constants, Drone, State, Update, User
from desim_uav.rules.wide import add_product


@rule
def is_sensor(state: State, user: User) -> bool:
    """Return whether a user is a sensor."""
    return bool(state.keeps_sensors and len(state.sensors[user.index].buffer) > 0)


@rule
def deliver(world: Constants, state: State, drone: Drone, update: Update, phase: int) -> None:
    """Deliver an update that a drone has received, which lets the age of its sensor fall."""
    user = state.users[update.user]
    before_us = let_fall(world, state, drone, user, update.generated_us)
    sensor = state.sensors[update.user]
    sensor.delivered += 1
    note(state, phase, words.ON_DELIVER, update.drone, update.user, -1, update.number)
    log_update(state, update, words.DELIVERED, before_us, state.now_us - sensor.fresh_us)


@rule
def let_fall(world: Constants, state: State, drone: Drone, user: User, generated_us: int) -> int:
    """Let a sensor's age fall to that of an update that is delivered, and return what it was.

    It does not fall if a fresher update was delivered before. What it falls by is to the credit of
    the drone that delivers the update.
    """
    sensor = state.sensors[user.index]
    count_age(world, state, user)
    before_us = state.now_us - sensor.fresh_us
    if generated_us > sensor.fresh_us:
        if state.keeps_credit:
            drone.credit.fallen_us += generated_us - sensor.fresh_us
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


# ---- the log


@rule
def log_update(state: State, update: Update, fate: int, before_us: int, after_us: int) -> None:
    """Log an update whose fate is known now, if requests are logged."""
    if state.keeps_requests:
        _append(state, update, fate, before_us, after_us)


@rule
def _append(state: State, update: Update, fate: int, before_us: int, after_us: int) -> None:
    """Append an update to the log (see ``log_update``)."""
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
