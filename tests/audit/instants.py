"""Checks of the invariants of an episode that concern more than one event.

The invariants are the order of admission in an instant, changes of drones, and outages. What the
audit has seen is kept here from one event to the next.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from desim_uav.engine.base import EpisodeLog
from desim_uav.rules.admission import FirstCome
from desim_uav.rules.rows import Request, State, User
from desim_uav.rules.words import ON_ATTACH, ON_HANDOVER, ON_LEG, ON_OUTAGE, ON_OUTAGE_END, ON_SERVE

if TYPE_CHECKING:
    from desim_uav.engine.des import Simulation

BACK_US = 100
"""The least time in µs before a user is handed back to a drone, if levels change steadily. Their
difference first has to change its direction, for which drones have to brake."""


@dataclass
class InstantRecord:
    """What an audit has seen of an episode until ``now_us``.

    ``read`` events of the present ``step`` have been read, the last of them in ``phase``.
    ``attached`` counts those of this instant by phase and user, and ``served`` holds those served
    in this phase by drone and user. ``handed`` maps
    users to their last handover, as its time and the two drones. Users with an open request are
    ``without`` a link, and were before this instant, by user and request; ``logged`` counts events.
    At the last event, ``to_scan`` drones had still to divide their bandwidth.
    """

    log: EpisodeLog
    whole: bool
    now_us: int = 0
    step: int = -1
    read: int = 0
    phase: int = 0
    attached: Counter[tuple[int, int]] = field(default_factory=Counter)
    served: set[tuple[int, int]] = field(default_factory=set)
    handed: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    without: frozenset[tuple[int, int]] = frozenset()
    before: frozenset[tuple[int, int]] = frozenset()
    outages: int = 0
    outage_us: int = 0
    to_scan: int = 0
    logged: Counter[int] = field(default_factory=Counter)


RECORDS: WeakKeyDictionary[Simulation, InstantRecord] = WeakKeyDictionary()
"""What the audit has noted of each simulation so far."""


def audit_instant(simulation: Simulation) -> None:
    """Check what has happened since the last event. Raises AssertionError if it must not have."""
    state, log = simulation.state, simulation.log
    record = RECORDS.get(simulation)
    if record is None or record.log is not log or state.now_us < record.now_us:
        record = RECORDS[simulation] = InstantRecord(log, state.now_us == state.step == 0)
    if state.now_us > record.now_us:
        assert not record.to_scan, "bandwidth was not divided at the end of an instant"
        _elapse(record, state.now_us)
    record.to_scan = state.to_scan
    over = log.duration_us > 0
    if state.keeps_events:
        _read(simulation, record)
        if not over:
            _admission(simulation, record)
    if state.keeps_links:
        asking = [user for user in state.users if user.request.number >= 0 and user.covered == 0]
        record.without = frozenset((user.index, user.request.number) for user in asking)
        if over and record.whole:
            _totals(state, record)


def _elapse(record: InstantRecord, now_us: int) -> None:
    """Count outages until now, and begin an instant."""
    record.outage_us += len(record.without) * (now_us - record.now_us)
    record.outages += len(record.without - record.before)
    record.before, record.now_us = record.without, now_us
    record.attached.clear()
    record.served.clear()


def _read(simulation: Simulation, record: InstantRecord) -> None:
    """Read new events, and check that users change their drones once in a phase, for a reason."""
    state = simulation.state
    if record.step != state.step and simulation.log.duration_us == 0:
        record.step, record.read = state.step, 0
    for event in state.events[record.read :]:
        if event.kind == ON_LEG:
            continue
        if event.t_us == state.now_us and event.phase != record.phase:
            record.phase = event.phase
            record.served.clear()
        if event.kind == ON_ATTACH:
            record.attached[event.phase, event.user] += 1
            once = record.attached[event.phase, event.user] == 1
            assert once, f"user {event.user} is attached twice in phase {event.phase}"
        elif event.kind == ON_SERVE:
            record.served.add((event.drone, event.user))
        elif event.kind == ON_HANDOVER:
            _handover(simulation, record, event.user, event.drone)
        else:
            record.logged[event.kind] += 1
    record.read = len(state.events)


def _handover(simulation: Simulation, record: InstantRecord, number: int, drone: int) -> None:
    """Check that a user is not handed back at once by levels that rounding has made different."""
    state, user = simulation.state, simulation.state.users[number]
    links = state.links[number]
    at_us, came_from, left = record.handed.get(number, (-BACK_US, -1, -1))
    record.handed[number] = state.now_us, links.left, drone
    radios = [links.radio for links in simulation.world.links]
    steady = state.by_level and not any(radio.graded and radio.marked for radio in radios)
    back = (came_from, left) == (drone, links.left) and user.covering[left] >= 0
    if steady and back:
        lasted_us = state.now_us - at_us
        assert not 0 < lasted_us < BACK_US, f"user {number} is handed back after {lasted_us} µs"


def _admission(simulation: Simulation, record: InstantRecord) -> None:
    """Check that no user who would have fitted waits behind one served now who asked later."""
    state, users = simulation.state, simulation.state.users
    fleet = simulation.world.scenario.fleet
    if state.to_scan or not all(isinstance(drones.admission, FirstCome) for drones in fleet):
        return
    for number in {drone for drone, _ in record.served}:
        drone = state.senders[number]
        new = [users[user] for d, user in record.served if d == number]
        lines = [(user, band) for band in (drone, drone.aside) for user in band.waiting]
        for user, band in lines:
            request = users[user].request
            if state.relays and state.tasks[user].site not in (-1, number):
                continue  # it may wait for the backhaul of another drone
            after = [one.request for one in new if _place(one) > _place(users[user])]
            later = [one for one in after if _begins(state, one, number) and not one.queued]
            beside = [one for one in later if drone.band < 0 or one.up == request.up]
            later_hz = sum(one.used_hz for one in beside)
            later_bps = sum(one.bandwidth_bps for one in beside)
            too_wide = request.needs_hz > band.free_hz + later_hz
            too_fast = request.bandwidth_bps > drone.free_bps + later_bps
            waits = later_hz == 0 or too_wide or too_fast
            assert waits, f"user {user} waits behind those who asked later at drone {number}"


def _place(user: User) -> tuple[int, int]:
    """Return the place of a user's request in the order of admission."""
    return user.request.t_request_us, user.index


def _begins(state: State, request: Request, sender: int) -> bool:
    """Return whether a sender has begun to serve a request now."""
    return request.server == sender and request.started_us == state.now_us


def _totals(state: State, record: InstantRecord) -> None:
    """Check the counts of outages, and the events of them, at the end of an episode."""
    observed, counted = (record.outages, record.outage_us), (state.outages, state.outage_us)
    assert observed == counted, f"outages and their time: {observed}, counted as {counted}"
    if state.keeps_events:
        logged = record.logged[ON_OUTAGE], record.logged[ON_OUTAGE_END]
        assert logged == (state.outages,) * 2, f"{state.outages} outages, logged as {logged}"
