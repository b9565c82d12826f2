"""The invariants of an episode, which must hold after every event of every scenario.

``Simulation(world, settings, audit=audit)`` checks all of them after each event, which makes a run
many times slower. It raises an AssertionError that names the broken invariant.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.backhaul import UNLIMITED_BPS
from desim_uav.model.catalogue import drawn_amount
from desim_uav.model.geometry.coverage import all_walked
from desim_uav.model.services import COMPUTING, MOVING, SHARING
from desim_uav.rules.bands import BOTH, DOWN, UP
from desim_uav.rules.battery import battery_now, capacity_of, is_limited
from desim_uav.rules.flight import position
from desim_uav.rules.rows import Constants, Drone, Request, State, User
from desim_uav.rules.rows.drones import Band
from desim_uav.rules.words import CHARGING, CRASHED, FLYING, IN_QUEUE, NEVER
from tests.audit.instants import audit_instant
from tests.audit.lines import audit_lines
from tests.audit.sensors import audit_sensors
from tests.audit.sight import possible_levels_dbm
from tests.audit.tasks import audit_tasks

if TYPE_CHECKING:
    from desim_uav.engine.des import Simulation

TOLERANCE_M, TOLERANCE_DB = 1e-4, 1e-3
"""How far from the edge of a footprint, or from the threshold of a class, nothing is checked."""


def audit(simulation: Simulation) -> None:
    """Check every invariant of a simulation now. Raises AssertionError if one does not hold."""
    world, state = simulation.constants, simulation.state
    for drone in state.drones:
        _battery(world, state, drone)
    for sender in state.senders:
        _bandwidth(world, state, sender)
    _demand(state)
    _stations(world, state)
    _energy(simulation)
    if simulation.log.duration_us == 0:
        for user in state.users:
            _one_state(world, state, user)
        _geometry(simulation)
    audit_instant(simulation)
    audit_lines(simulation)
    if state.keeps_tasks:
        audit_tasks(simulation)
    if state.keeps_sensors:
        audit_sensors(simulation)


def _battery(world: Constants, state: State, drone: Drone) -> None:
    """Check that the battery is between empty and full, and empty if the drone has crashed.

    It must hold what it began with, less what is counted as used and with what as gained.
    """
    if is_limited(world, drone):
        held_us = battery_now(world, state, drone)
        assert 0 <= held_us <= capacity_of(world, drone), f"battery of {drone.index}"
        counted = drone.charge - held_us - drone.counted
        balance = drone.began - drone.used + drone.gained - counted
        assert held_us == balance, f"battery of {drone.index}: what it used and gained"
        if drone.mode == CRASHED:
            assert held_us == 0, f"battery of crashed drone {drone.index}"


def _energy(simulation: Simulation) -> None:
    """Check the sums of energy for the log: the microjoules that batteries have lost so far.

    Drones whose batteries are measured otherwise, in time, have no part in them.
    """
    drones = simulation.drones
    in_joules = [one for one in drones if simulation.world.type_of(one.index).in_joules]
    losses = sum(one.began - one.charge + one.counted for one in in_joules)
    used, gained = simulation.energy_uj()
    assert used - gained == losses, "energy of all drones together"


def _bandwidth(world: Constants, state: State, drone: Drone) -> None:
    """Check that the bandwidth in use adds up and fits, and that only flying drones serve."""
    served = [
        user.request
        for user in state.users
        if user.request.number >= 0 and user.request.server == drone.index
    ]
    radio, used_hz = world.radios[drone.radio], sum(request.used_hz for request in served)
    assert used_hz == drone.used_hz, f"bandwidth of {drone.index}"
    if radio.uplink_hz < 0:
        assert drone.band == BOTH and drone.aside.free_hz == 0, f"bands of {drone.index}"
        assert not drone.aside.waiting and not drone.aside.sharing, f"bands of {drone.index}"
        _band(state, drone, drone, radio.bandwidth_hz, served)
    else:
        widths_hz = {DOWN: radio.bandwidth_hz, UP: radio.uplink_hz}
        other = UP if drone.band == DOWN else DOWN
        for band, number in ((drone, drone.band), (drone.aside, other)):
            lines = [state.users[user].request for user in (*band.waiting, *band.sharing)]
            in_lines = [one.up for one in lines if one.number >= 0]
            assert set(in_lines) <= {number}, f"lines of band {number} of {drone.index}"
            own = [request for request in served if request.up == number]
            _band(state, drone, band, widths_hz[number], own)
    _backhaul(world, state, drone, served)
    assert [sum(r.service == s for r in served) for s in range(world.services)] == drone.served
    if drone.mode != FLYING:
        linked = [request for request in served if request.line <= SHARING]
        assert not linked, f"drone {drone.index} serves in mode {drone.mode}"
        assert drone.attached_users == 0, f"drone {drone.index} holds users in mode {drone.mode}"
        assert not any((drone.waiting, drone.sharing, drone.aside.waiting, drone.aside.sharing))


def _band(
    state: State, drone: Drone, band: Drone | Band, width_hz: int, served: Sequence[Request]
) -> None:
    """Check that what is served in a band of a drone adds up, and fits."""
    held_hz = sum(request.used_hz for request in served if not request.queued)
    if width_hz >= 0:
        assert band.free_hz == width_hz - held_hz, f"bandwidth of {drone.index}"
        assert drone.scan or band.free_hz >= 0, f"bandwidth of {drone.index}"
        used_hz = sum(request.used_hz for request in served)
        assert drone.scan or used_hz <= width_hz, f"shares of {drone.index}"


def _backhaul(world: Constants, state: State, drone: Drone, served: Sequence[Request]) -> None:
    """Check that what is served fits the backhaul, of which no more is left than division needs.

    Results count that others send to their users over this backhaul, and tasks that move over it.
    """
    capacity_bps = world.radios[drone.radio].backhaul_bps
    relayed = [user.request for user in state.users if drone.index in _ways(state, user)]
    relayed = [one for one in relayed if one.server not in (-1, drone.index)]
    over = [*served, *relayed]
    held_bps = sum(request.bandwidth_bps for request in over if not request.queued)
    lines = (SHARING, MOVING)
    shared = [request.rate for request in over if request.queued and request.line in lines]
    assert drone.free_bps == capacity_bps - held_bps, f"backhaul of {drone.index}"
    others = [sender for sender in state.senders if sender is not drone]
    coming = [user for one in others for user in (*one.sharing, *one.aside.sharing)]
    coming = [user for user in coming if _site(state, state.users[user]) == drone.index]
    moving = [user for sender in state.senders for user in sender.moving]
    coming += [user for user in moving if drone.index in _ways(state, state.users[user])]
    assert drone.relayed == len(coming), f"results that come from {drone.index}"
    stored = [update.size for update in drone.store[drone.upload.first :]]
    if stored and (capacity_bps < UNLIMITED_BPS or state.keeps_requests):
        promised = sum(freight.promised for freight in drone.freight)
        assert drone.stored_ubit == promised + sum(stored), f"store of {drone.index}"
    uploads = capacity_bps < UNLIMITED_BPS and bool(stored)
    assert bool(drone.upload.under_way) == uploads, f"what {drone.index} uploads"
    if state.to_scan:
        return
    left_bps = capacity_bps - held_bps - sum(shared)
    assert left_bps >= drone.upload.rate, f"backhaul of {drone.index}"
    if uploads and not (state.relays or state.terminated or state.truncated):
        assert drone.upload.rate == left_bps, f"backhaul of {drone.index} is idle"
    sharers = len(drone.sharing) + len(drone.aside.sharing)
    if sharers and drone.proposed_bps > drone.free_bps and not state.relays:
        assert left_bps <= sharers, f"backhaul of {drone.index}: {left_bps} bit/s left"


def _site(state: State, user: User) -> int:
    """Return where the result of a user's task comes from, if it has one to get, or -1."""
    has_result = state.keeps_tasks and user.request.number >= 0 and user.request.line <= SHARING
    return state.tasks[user.index].site if has_result else -1


def _ways(state: State, user: User) -> tuple[int, ...]:
    """Return the senders over whose backhauls a task moves, or a result comes."""
    if user.request.number >= 0 and user.request.line == MOVING:
        return state.tasks[user.index].site, state.tasks[user.index].target
    return (_site(state, user),)


def _is_joined(world: Constants, state: State, *senders: int) -> bool:
    """Return whether senders are the same, or have backhauls."""
    capacities = [world.radios[state.senders[one].radio].backhaul_bps for one in senders]
    return len(set(senders)) == 1 or max(capacities) < UNLIMITED_BPS


def _demand(state: Any) -> None:
    """Check the counts of open requests, of those in each footprint, and of covering drones."""
    services = range(len(state.open_requests))
    asking = [user for user in state.users if user.request.number >= 0]
    counts = [sum(user.request.service == service for user in asking) for service in services]
    assert state.open_requests == counts
    for drone in state.senders:
        covered = [user.request.service for user in asking if user.covering[drone.index] >= 0]
        counted = [covered.count(service) for service in services]
        assert drone.asking == counted, f"requests in the footprint of {drone.index}"
    for user in state.users:
        assert user.covered == sum(entered_us >= 0 for entered_us in user.covering)
    if state.keeps_credit:
        for drone in state.senders:
            covered = [user for user in state.users if user.covering[drone.index] >= 0]
            alone = sum(user.covered == 1 for user in covered)
            assert drone.credit.alone == alone, f"users of {drone.index} alone"


def _stations(world: Constants, state: State) -> None:
    """Check that each queued or charging drone is in one queue, and the number of used pads."""
    queued = [drone for station in state.stations for drone in station.queue]
    there = [drone.index for drone in state.drones if drone.mode in IN_QUEUE]
    assert sorted(queued) == there, f"{queued} in queues, {there} queued or charging"
    for station in state.stations:
        charging = [state.drones[d].mode == CHARGING for d in station.queue]
        assert sum(charging) <= world.pads, "more drones charge than there are pads"


def _one_state(world: Constants, state: State, user: User) -> None:
    """Check that an open request is served by its user's drone or waits there, if there is one.

    A request for a processor does not, and the result of a task may wait for another drone.
    """
    request, holder = user.request, user.holder
    bands = [(drone.index, band) for drone in state.senders for band in (drone, drone.aside)]
    queues = [d for d, band in bands if user.index in band.waiting]
    shares = [d for d, band in bands if user.index in band.sharing]
    if request.number < 0:
        assert not queues and not shares, "a user waits without a request"
        return
    _work(world, state, user)
    computing = [drone.index for drone in state.senders if user.index in drone.computing]
    computing += [drone.index for drone in state.senders if user.index in drone.moving]
    in_line = bool(queues or shares or computing)
    assert bool(request.queued) == in_line, "queued without a line, or in one"
    if request.line >= COMPUTING:
        assert not queues and not shares, "a request for a processor waits for a link"
        return
    site = _site(state, user)
    if min(site, holder) >= 0 and not _is_joined(world, state, site, holder):
        holder = -1
    if state.keeps_sensors and holder >= 0 and _finds_no_room(world, state, user):
        holder = -1
    if request.line == SHARING:
        assert not queues, "a request that shares waits"
        assert shares == [holder] * (holder >= 0), "a share where a user is not attached"
        assert request.server in (-1, holder), "served by another drone"
    elif holder < 0:
        assert request.server < 0 and not queues, "served or queued without a drone"
    elif request.server < 0:
        assert queues == [holder], "a request waits where its user is not attached"
    else:
        assert request.server == holder and not queues, "served by another drone"


def _finds_no_room(world: Constants, state: State, user: User) -> bool:
    """Whether a user's update is not promised any room in the store of its drone, if it needs some.

    Then there is not enough of it; otherwise all that is stored and promised fits.
    """
    drone, service = state.senders[user.holder], world.senses[user.index]
    if not drone.freight or service < 0 or not world.updates[service].ground:
        return False
    if drone.point >= 0 and world.radios[drone.radio].backhaul_bps == UNLIMITED_BPS:
        return False  # it is at the ground
    stored = sum(update.size for update in drone.store[drone.upload.first :])
    assert drone.stored_ubit == stored + sum(each.promised for each in drone.freight)
    most = NEVER if drone.point >= 0 else world.types[drone.type].store_ubit
    room = most - drone.stored_ubit
    assert room >= 0, "a store is too full"
    promised = drone.freight[user.index].promised
    assert promised == user.request.required or drone.scan or room < user.request.required
    return promised == 0


def _work(world: Constants, state: State, user: User) -> None:
    """Check that no more is done for a request than it requires, within its last microsecond.

    A request has been served for the times of the stages that it has passed through, if they are
    measured in time, and for what is done in this one. If something was lost, it was longer.
    """
    request = user.request
    first = world.first_stages[request.service]
    stages = world.stages[first : first + request.stages]
    if state.keeps_tasks and state.tasks[user.index].part < 1.0:
        return  # see tests.audit.tasks
    assert 0 <= request.stage < request.stages, "a stage that there is not"
    drawn = state.drawn, user.index * world.draws
    amounts = [drawn_amount(one, *drawn) for one in stages[: request.stage]]
    if request.stages > 1:
        needed = drawn_amount(stages[request.stage], *drawn)
        if request.line == MOVING:
            volumes = zip(amounts, stages, strict=False)
            needed = sum(one for one, stage in volumes if stage.line <= SHARING and not stage.timed)
        assert request.required == needed > 0
    assert 0 <= request.done <= request.required, "served more than requested"
    if request.server >= 0:
        amount = request.done + request.rate * (state.now_us - request.counted_us)
        assert amount < request.required + request.rate, "served more than requested"
    times_us = sum(us for us, one in zip(amounts, stages, strict=False) if one.timed)
    times_us += request.done if stages[request.stage].timed else 0
    assert times_us <= request.served_us, "more time is done than served"
    lost = state.keeps_tasks and (
        state.tasks[user.index].restarts > 0 or world.terms[request.service].restarts
    )
    if all(one.timed for one in stages[: request.stage + 1]) and not lost:
        assert times_us == request.served_us, "time served is not what is done"


def _geometry(simulation: Simulation) -> None:
    """Check coverage against distances, and that attached users are covered by their drones."""
    world, state = simulation.constants, simulation.state
    users = all_walked(*simulation.drawn.walks, state.now_us)
    users_of = [0] * len(state.senders)
    for user in state.users:
        if user.holder >= 0:
            users_of[user.holder] += 1
            assert user.covering[user.holder] >= 0, f"user {user.index} attached but not covered"
    for drone in state.senders:
        assert users_of[drone.index] == drone.attached_users
        covered = np.array([user.covering[drone.index] >= 0 for user in state.users])
        classes = np.array([user.classes[drone.index] for user in state.users])
        assert (covered == (classes > 0)).all(), f"classes and coverage of {drone.index}"
        assert drone.serving or not covered.any(), f"drone {drone.index} covers in {drone.mode}"
    serving = [drone for drone in state.senders if drone.serving]
    if state.retunes:  # classes pass to their new values at the end of this instant
        at_epoch = state.now_us == state.epoch_us
        assert at_epoch or simulation.clock.peek() == state.now_us, "interference has changed"
    else:
        graded = [drone for drone in serving if _radio_of(simulation, drone).graded]
        _ratios(simulation, graded, users)
    for drone in serving:
        if not _radio_of(simulation, drone).graded:
            x, y, _ = position(world, state, drone)
            distance_m = np.hypot(users[:, 0] - x, users[:, 1] - y)
            covered = np.array([user.classes[drone.index] > 0 for user in state.users])
            radius_m = float(simulation.world.links[drone.radio].rings_m.max())
            far = np.abs(distance_m - radius_m) > TOLERANCE_M
            wrong = far & (covered != (distance_m < radius_m))
            assert not wrong.any(), f"coverage by {drone.index} of users {np.flatnonzero(wrong)}"


def _radio_of(simulation: Simulation, drone: Drone) -> Any:
    """Return the radio of a drone or of an access point."""
    return simulation.world.links[drone.radio].radio


def _ratios(simulation: Simulation, serving: Sequence[Any], users: NDArray[np.float64]) -> None:
    """Check the classes of links against the ratio of signal to noise and interference.

    ``serving`` are the drones and access points with classes of links, and ``users`` (users, …) has
    the places of the users in its first two columns. If line of sight or shadowing of links
    changes, what this takes for all users is too long: one of them is checked, by the time.
    """
    radios: list[Any] = [_radio_of(simulation, drone) for drone in serving]
    checked = np.arange(len(users))
    if any(radio.marked for radio in radios):
        checked = checked[simulation.state.now_us % len(users)][None]
    levels_dbm = [_levels(simulation, drone, users, checked) for drone in serving]
    for drone, radio, level_dbm in zip(serving, radios, levels_dbm, strict=True):
        noises_mw = [np.full(len(checked), 10 ** (radio.budget.noise_dbm / 10))] * 2
        for other, disturbing_dbm in zip(serving, levels_dbm, strict=True):
            apart = other.index - drone.index
            if radio.reuse and apart and apart % radio.reuse == 0:
                both = zip(noises_mw, disturbing_dbm, strict=True)
                noises_mw = [noise_mw + 10 ** (level / 10) for noise_mw, level in both]
        noise_dbm = 10 * np.log10(noises_mw)
        low_db, high_db = level_dbm[0] - noise_dbm[1], level_dbm[1] - noise_dbm[0]
        everyone = simulation.state.users
        classes = np.array([everyone[user].classes[drone.index] for user in checked])
        thresholds = [one.snr_db for one in radio.ladder]
        least = np.searchsorted(thresholds, low_db - TOLERANCE_DB, side="right")
        most = np.searchsorted(thresholds, high_db + TOLERANCE_DB, side="right")
        wrong = (classes < least) | (classes > most)
        problem = f"classes of {drone.index}: users {checked[wrong]}, {low_db[wrong]} dB"
        assert not wrong.any(), problem


def _levels(
    simulation: Simulation, drone: Drone, users: NDArray[np.float64], checked: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the lowest and the highest level (2, checked) at which users may receive a drone.

    Both are the same unless it is not certain whether a user sees the drone, and in which cell it
    is. They are in dBm.
    """
    place = position(simulation.constants, simulation.state, drone)
    radio, heights_m = _radio_of(simulation, drone), simulation.world.homes[:, 2].tolist()
    number = drone.index if drone.point < 0 else -1 - drone.point
    levels_dbm = []
    for user in checked.tolist():
        x, y = users[user, :2].tolist()
        if radio.marked:
            ends = (x, y, heights_m[user]), place
            key = simulation.drawn.link_key
            possible = possible_levels_dbm(simulation.world, key, radio, number, user, ends)
        else:
            away_m, above_m = math.hypot(x - place[0], y - place[1]), place[2] - heights_m[user]
            possible = [radio.power_dbm - radio.loss.mean_db(away_m, above_m, radio.carrier_ghz)]
        levels_dbm.append((min(possible), max(possible)))
    return np.array(levels_dbm).T.reshape(2, len(checked))
