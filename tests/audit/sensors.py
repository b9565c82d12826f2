"""Checks of sensors after every event: updates are conserved, and ages rise as fast as time.

The tables of an episode are checked in ``tests.audit.ages``; this looks at what is there meanwhile.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from desim_uav.engine.base import EpisodeLog
from desim_uav.rules.rows import Sensor, State, User

if TYPE_CHECKING:
    from desim_uav.engine.des import Simulation


@dataclass
class SensorRecord:
    """What an audit has seen of an episode: the time, and the age of each sensor at it."""

    log: EpisodeLog
    now_us: int = 0
    ages_us: dict[int, int] = field(default_factory=dict)


RECORDS: WeakKeyDictionary[Simulation, SensorRecord] = WeakKeyDictionary()
"""What the audit has noted of each simulation so far."""


def audit_sensors(simulation: Simulation) -> None:
    """Check all sensors now. Raises AssertionError if something is wrong."""
    state, log = simulation.state, simulation.log
    record = RECORDS.get(simulation)
    if record is None or record.log is not log or state.now_us < record.now_us:
        record = RECORDS[simulation] = SensorRecord(log, state.now_us)
    elapsed_us, record.now_us = state.now_us - record.now_us, state.now_us
    sensors = [user for user in state.users if len(state.sensors[user.index].buffer) > 0]
    for user in sensors:
        sensor = state.sensors[user.index]
        age_us = state.now_us - sensor.fresh_us
        assert age_us >= 0, f"the age of user {user.index} is negative"
        before_us = record.ages_us.get(user.index, age_us)
        assert age_us <= before_us + elapsed_us, f"the age of user {user.index} rises too fast"
        record.ages_us[user.index] = age_us
        _updates(state, sensor, user)
        if log.duration_us == 0:
            updates = simulation.constants.updates[simulation.constants.senses[user.index]]
            _buffer(sensor, user, bool(updates.sends_last))
    assert state.generated == sum(state.sensors[user.index].generated for user in sensors)


def _updates(state: State, sensor: Sensor, user: User) -> None:
    """Check that each update is at one place: delivered, dropped, lost, in a buffer or a store."""
    stored = sum(drone.freight[user.index].count for drone in state.senders if drone.freight)
    left = sensor.delivered + sensor.dropped + sensor.lost
    there = sensor.count + stored
    assert sensor.generated == left + there, f"updates of user {user.index} are not conserved"
    if state.keeps_requests or state.keeps_events:
        kept = [one for drone in state.senders for one in drone.store[drone.upload.first :]]
        logged = [one for one in kept if one.user == user.index]
        assert len(logged) == stored, f"updates of user {user.index} in stores"


def _buffer(sensor: Sensor, user: User, last_first: bool) -> None:
    """Check that a buffer is not too full, in order, and that its first update is the request.

    If the last one is sent first, it takes the place, and the request, of one that waits.
    """
    assert sensor.count < len(sensor.buffer), f"the buffer of user {user.index} is too full"
    assert (user.request.number >= 0) == (sensor.count > 0), f"an update of {user.index} is idle"
    places = [(sensor.first + k) % len(sensor.buffer) for k in range(sensor.count)]
    numbers = [sensor.buffer[place].number for place in places]
    in_order = sorted(numbers) if last_first else numbers
    assert in_order == sorted(set(numbers)), f"the order of the buffer of user {user.index}"
    if numbers:
        first = sensor.buffer[sensor.first]
        assert first.request == user.request.number, f"another update of {user.index} is sent"
        same = first.generated_us == user.request.t_request_us
        assert same or last_first, "made at another time"
