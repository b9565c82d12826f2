"""Checks of the links' lines: Little's law, no idle band beside a request, and conserved bits.

What a sender's lines hold is integrated over time, and so is what users say of themselves.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from desim_uav.engine.base import EpisodeLog
from desim_uav.model.services import SHARING
from desim_uav.registry import kind_name
from desim_uav.rules.admission import FirstCome
from desim_uav.rules.bands import BOTH
from desim_uav.rules.rows import Constants, Drone, State, User
from desim_uav.rules.rows.drones import Band

if TYPE_CHECKING:
    from desim_uav.engine.des import Simulation

LINES = ("sharing", "waiting")
BUILT_IN = {"equal", "proportional_fair", "max_min", "max_rate"}


@dataclass
class LineRecord:
    """What an audit has seen of an episode until ``now_us``; ``whole``: from its start.

    Each sender has ``held`` requests at its links, by its own count, which adds up to ``held_us``.
    Users are ``there`` by their own fields, each at a sender and since a time; those that left had
    been there for ``visits_us``. What is sent of a request and a stage now has one of ``rates`` in
    1e-6 bit per microsecond, and needs an amount; ``sent`` has what has been sent.
    """

    log: EpisodeLog
    whole: bool
    now_us: int = 0
    held: Counter[int] = field(default_factory=Counter)
    held_us: Counter[int] = field(default_factory=Counter)
    there: dict[int, tuple[int, int]] = field(default_factory=dict)
    visits_us: Counter[int] = field(default_factory=Counter)
    rates: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)
    sent: defaultdict[int, Counter[int]] = field(default_factory=lambda: defaultdict(Counter))


RECORDS: WeakKeyDictionary[Simulation, LineRecord] = WeakKeyDictionary()
"""What the audit has noted of each simulation so far."""


def audit_lines(simulation: Simulation) -> None:
    """Check the lines of all links now. Raises AssertionError if something is wrong."""
    world, state, log = simulation.constants, simulation.state, simulation.log
    record = RECORDS.get(simulation)
    if record is None or record.log is not log or state.now_us < record.now_us:
        record = RECORDS[simulation] = LineRecord(log, state.now_us == state.step == 0)
        record.now_us = state.now_us
    _elapse(record, state.now_us)
    over = log.duration_us > 0
    _visit(record, {} if over else {u.index: u.holder for u in state.users if _is_linked(u)})
    if over:
        if record.whole:
            _totals(simulation, record)
        return
    for drone in state.senders:
        record.held[drone.index] = _count(state, drone)
        if not state.to_scan:
            _never_idle(simulation, drone)
    record.rates = {
        (user.request.number, user.request.stage): (user.request.rate, user.request.required)
        for user in state.users
        if _sends_bits(world, user)
    }


def _elapse(record: LineRecord, now_us: int) -> None:
    """Send and wait until now."""
    elapsed_us, record.now_us = now_us - record.now_us, now_us
    for sender, count in record.held.items():
        record.held_us[sender] += count * elapsed_us
    for (number, stage), (rate, required) in record.rates.items():
        sent = record.sent[number]
        sent[stage] = min(sent[stage] + rate * elapsed_us, required)


def _is_linked(user: User) -> bool:
    """Whether a user says that its request is sent over a link, or stands in a line of one."""
    request = user.request
    in_line = bool(request.queued) or request.server >= 0
    return request.number >= 0 and request.line <= SHARING and in_line


def _sends_bits(world: Constants, user: User) -> bool:
    """Whether bits of a user are sent now; a service of time has none."""
    request = user.request
    if request.number < 0 or request.server < 0 or request.line > SHARING:
        return False
    return not world.stages[world.first_stages[request.service] + request.stage].timed


def _visit(record: LineRecord, senders: dict[int, int]) -> None:
    """Count the visits of those who have left a sender's links, and begin new ones."""
    for user, (sender, since_us) in list(record.there.items()):
        if senders.get(user) != sender:
            record.visits_us[sender] += record.now_us - since_us
            del record.there[user]
    for user, sender in senders.items():
        record.there.setdefault(user, (sender, record.now_us))


def _count(state: State, drone: Drone) -> int:
    """How many requests a sender has at its links by its own lines and counts."""
    sharing, waiting = ([*getattr(drone, line), *getattr(drone.aside, line)] for line in LINES)
    in_lines = [*sharing, *drone.computing, *drone.moving]
    served = sum(state.users[user].request.server == drone.index for user in in_lines)
    return len(waiting) + len(sharing) + sum(drone.served) - served


def _never_idle(simulation: Simulation, drone: Drone) -> None:
    """Check that nobody waits for what is left of a sender's bandwidth and of its backhaul.

    Whole hertz are left where these are divided, less than one for each who shares.
    """
    world = simulation.constants
    radio = world.radios[drone.radio]
    if drone.band == BOTH:
        _band_never_idle(simulation, drone, drone, radio.bandwidth_hz)
        return
    widths_hz = radio.bandwidth_hz, radio.uplink_hz
    _band_never_idle(simulation, drone, drone, widths_hz[drone.band])
    _band_never_idle(simulation, drone, drone.aside, widths_hz[1 - drone.band])


def _band_never_idle(
    simulation: Simulation, drone: Drone, band: Drone | Band, width_hz: int
) -> None:
    """Check a band of a sender (see ``_never_idle``)."""
    world, state = simulation.constants, simulation.state
    radio = simulation.world.links[drone.radio].radio
    admission = simulation.world.scenario.fleet[drone.type].admission if drone.point < 0 else None
    if isinstance(admission, FirstCome):
        for user in (state.users[number] for number in band.waiting):
            request = user.request
            if state.relays and state.tasks[user.index].site not in (-1, drone.index):
                continue  # it may wait for the backhaul of another drone
            fits = request.needs_hz <= band.free_hz or width_hz < 0
            fits = fits and request.bandwidth_bps <= drone.free_bps
            assert not fits, f"user {user.index} waits for an idle link of {drone.index}"
    sharing = [state.users[user].request for user in band.sharing]
    if not sharing or not radio.graded or kind_name(radio.sharing) not in BUILT_IN:
        return
    if state.relays or drone.proposed_bps > drone.free_bps:
        return  # the backhaul is full, see tests.audit.invariants
    left_hz = band.free_hz - sum(request.used_hz for request in sharing)
    least_hz = max(
        -(-1_000_000 // world.radios[drone.radio].efficiencies[state.users[u].classes[drone.index]])
        for u in band.sharing
    )
    most_hz = len(sharing) * (least_hz + 1)
    assert left_hz <= most_hz, f"{left_hz} Hz of {drone.index} are idle beside {len(sharing)}"


def _totals(simulation: Simulation, record: LineRecord) -> None:
    """Check Little's law and, where no bits are lost, those of each request, at the end."""
    assert +record.held_us == +record.visits_us, "requests at links and visits: Little's law"
    if simulation.state.keeps_tasks:
        return  # see tests.audit.tasks
    for one in simulation.log.requests:
        sent = sum(record.sent[one.request_id].values())
        assert one.sent_ubit == sent, f"bits of request {one.request_id}: {one.sent_ubit}, {sent}"
