"""An episode: how it begins, its steps, and how it ends."""

from __future__ import annotations

import math

from desim_uav.rowcode.compiled_rows import call
from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rules import words
from desim_uav.rules.ages import count_ages
from desim_uav.rules.bands import clear_lines, reset_bands
from desim_uav.rules.battery import begin_count, count_charge
from desim_uav.rules.charging import await_full, count_queueing, hand_on_pads
from desim_uav.rules.coverage import leave_all, track
from desim_uav.rules.crash import ends_episode, respawn
from desim_uav.rules.credit import credit_step, forget_credit
from desim_uav.rules.decide import allow, go_home, is_under_way, obey, observe, record, taken
from desim_uav.rules.due import key, nothing_due, run_until
from desim_uav.rules.epochs import await_epoch
from desim_uav.rules.flight import appear, await_hop, count_distance, go_on_until
from desim_uav.rules.free_flight import hear_freely
from desim_uav.rules.links import forget_links
from desim_uav.rules.note import note_drone, note_leg
from desim_uav.rules.orientation import orient
from desim_uav.rules.points import serve_from_points, serve_on
from desim_uav.rules.power import power
from desim_uav.rules.requests import close_all, doing, foresee_asking
from desim_uav.rules.rewards import clear_terms
from desim_uav.rules.rows import Constants, Drone, Path, State
from desim_uav.rules.separation import begin_pairs, end_pairs
from desim_uav.rules.service import forget_request
from desim_uav.rules.settle import settle, settle_after
from desim_uav.rules.spots import locate
from desim_uav.rules.stores import empty_store
from desim_uav.rules.tasks import forget_task
from desim_uav.rules.updates import end_sensors, forget_sensor
from desim_uav.rules.walks import look_anew
from desim_uav.rules.wide import clear


@rule
def start_afresh(world: Constants, state: State) -> None:
    """Put all drones at their starting cells with full batteries, and empty the stations."""
    state.now_us = 0
    for d in range(len(state.drones)):
        drone = state.drones[d]
        appear(world, state, drone, world.starts[d].x, world.starts[d].y)
        drone.hopping = 0
    for k in range(len(state.stations)):
        state.stations[k].queue.clear()


@rare_rule
def begin(world: Constants, path: Path, state: State) -> None:
    """Begin an episode at time 0 with the drones in their present state, and the users anew."""
    for d in range(len(state.senders)):
        _forget_episode(world, state, state.senders[d])
    _forget(state)
    look_anew(world, path, state)
    for d in range(len(state.drones)):
        if state.drones[d].mode == words.FLYING:
            _serve_again(world, path, state, state.drones[d])
        if state.keeps_tasks:
            power(world, state, state.drones[d])
        begin_count(world, state, state.drones[d])
        orient(world, path, state, state.drones[d])
    if len(world.points) > 0:
        serve_from_points(world, path, state, 0, words.ENTRY)
    settle_after(world, path, state, words.ENTRY)
    for u in range(len(state.users)):
        foresee_asking(world, path, state, state.users[u])
    for d in range(len(state.drones)):
        _go_on(world, path, state, state.drones[d])
    for station in range(len(state.stations)):
        hand_on_pads(world, state, station)
    if world.separation_m > 0.0:
        begin_pairs(state)
    run_until(state, 0, key(words.RESPAWN, -1, -1))


@rule
def _serve_again(world: Constants, path: Path, state: State, drone: Drone) -> None:
    """Let a drone serve the users of a new episode, until its present command is over."""
    track(world, path, state, drone, max(0, drone.until_us - state.now_us), words.ENTRY)


@rule
def _forget_episode(world: Constants, state: State, drone: Drone) -> None:
    """Reset what belongs to an episode in a drone's row, but keep its leg, mode and battery."""
    drone.since_us -= state.now_us
    drone.until_us -= state.now_us
    if drone.mode not in words.TIMED or drone.until_us <= 0:
        drone.until_us, drone.taken = 0, words.NO_COMMAND
        if drone.off_grid and drone.point < 0:
            drone.course.share = world.least_share
    if drone.point >= 0:
        drone.since_us = drone.until_us = 0
    if not drone.fallen:
        drone.fallen_x_m = drone.fallen_y_m = 0.0
    drone.respawns = drone.waits = drone.serving = drone.scan = 0
    drone.free_bps = world.radios[drone.radio].backhaul_bps
    drone.proposed_bps = drone.left_bps = drone.relayed = 0
    drone.used_hz = drone.attached_users = drone.command = drone.landed_in = drone.marked_us = 0
    drone.marked_until_us = -1
    reset_bands(world, drone)
    drone.computing.clear()
    drone.moving.clear()
    drone.computes = 0
    drone.power_uw = drone.drawn_us = drone.rest_pj = drone.span_us = 0
    if state.keeps_sensors:
        empty_store(state, drone)
    drone.ahead.clear()
    for service in range(world.services):
        drone.served[service] = drone.asking[service] = 0
    clear_terms(drone)
    if state.keeps_credit:
        forget_credit(drone)
    if drone.off_grid:
        _forget_commands(drone)


@rule
def _forget_commands(drone: Drone) -> None:
    """Reset what the commands of the previous episode have left in a drone's course."""
    course = drone.course
    course.aim_x = course.aim_y = course.aim_z = 0.0
    course.aim_cruise = course.aim_share = course.aim_charge = 0.0
    course.blocked = 0
    if drone.transit == words.REST:
        course.limit_mps = math.inf if drone.point < 0 else 0.0
    if drone.mode != words.RETURNING:
        course.station = course.node = course.level = 0


@rule
def _forget(state: State) -> None:
    """Reset the users, requests and measures of the previous episode, and cancel all events."""
    state.now_us = state.step = state.terminated = state.truncated = 0
    state.epoch_us, state.next_us, state.share = 0, 0, 1.0
    state.opened = state.in_service = state.charges = state.crashes = state.suppressed = 0
    state.open_us = state.served_us = state.attached_us = state.attached_from_us = 0
    state.queueing_us = state.to_scan = state.faults = 0
    clear(state.bandwidth_us_hz)
    state.handed_over = state.ping_pongs = state.outages = state.outage_us = 0
    state.closed_qoe1 = state.distance_m = 0.0
    state.retunes = state.generated = 0
    state.aged = 0.0
    state.loose.clear()
    state.unsettled.clear()
    state.crashed.clear()
    state.events.clear()
    state.closed.clear()
    state.handovers.clear()
    state.updates.clear()
    state.flown.clear()
    for service in range(len(state.open_requests)):
        state.open_requests[service] = 0
    for k in range(len(state.credited)):
        state.credited[k] = 0
    for k in range(len(state.drawn)):
        state.drawn[k] = 0
    for k in range(len(state.rewards)):
        state.rewards[k] = 0.0
    for k in range(len(state.history)):
        state.history[k] = 0
    for k in range(len(state.aims)):
        state.aims[k] = 0.0
    for u in range(len(state.users)):
        user = state.users[u]
        user.holder = -1
        user.held_since_us = user.doing = 0
        user.share = 0.0
        forget_request(user.request)
        d = 0
        while user.covered > 0:  # the previous episode was not played to its end
            user.covered -= int(user.covering[d] >= 0)
            user.covering[d], user.classes[d] = -1, 0
            d += 1
        if state.keeps_links:
            forget_links(state, user)
        if state.keeps_tasks:
            forget_task(state, user)
        if state.keeps_sensors:
            forget_sensor(state, user)
    nothing_due(state)


@rule
def _go_on(world: Constants, path: Path, state: State, drone: Drone) -> None:
    """Continue what a drone was doing at the end of the previous episode."""
    note_leg(world, state, drone)
    if drone.mode == words.RETURNING:
        if drone.hopping:
            await_hop(world, state, drone)
        else:
            go_home(world, path, state, drone, words.ARRIVAL)
    elif drone.mode == words.QUEUED:
        drone.landed_in = words.ARRIVAL
    elif drone.mode == words.CHARGING:
        await_full(world, state, drone)
    elif drone.mode in words.TIMED and drone.until_us > state.now_us:
        go_on_until(world, state, drone)
    elif drone.mode in words.DECIDES:
        drone.waits = 1


@rule
def show_first(world: Constants, path: Path, state: State) -> None:
    """Prepare the snapshot of the first decision epoch: observations and masks."""
    observe(world, state)
    _replace_crashed(world, path, state)
    locate(world, path, state)
    allow(world, state)


@rare_rule
def _replace_crashed(world: Constants, path: Path, state: State) -> None:
    """Replace crashed drones whose downtime is over, and observe them."""
    if respawn(world, path, state):
        observe(world, state)


@rule
def hear(world: Constants, path: Path, state: State) -> None:
    """Turn the commands of all drones (an action's index, or -1 if it is none) into actions.

    A drone that is asked later, by event, goes on with its action.
    Access points serve on.
    """
    state.epoch_us = state.now_us
    await_epoch(world, state)
    for d in range(len(state.drones)):
        drone = state.drones[d]
        state.history[state.step * len(state.drones) + d] = drone.command
        if drone.off_grid:
            hear_freely(world, state, drone)
        if is_under_way(world, drone):
            drone.command = -1
            continue
        drone.taken = taken(world, state, drone)
        if drone.waits:
            note_drone(state, words.COMMAND, words.ON_DECIDE, drone)
    if len(world.points) > 0:
        serve_on(world, path, state)


@rule
def command(world: Constants, path: Path, state: State) -> None:
    """Let the drones that can be commanded act in turn; then attach users and admit requests."""
    hear(world, path, state)
    for d in range(len(state.drones)):
        if state.drones[d].waits:
            obey(world, path, state, state.drones[d])
    settle(world, path, state, words.COVERAGE, words.ADMISSION)


@rule
def end_step(world: Constants, path: Path, state: State) -> None:
    """End a step: record it, reward the drones, and end the episode or replace crashed drones.

    These are phases 8 and 9 of the instant; the masks of the next decision epoch follow.
    """
    state.step += 1
    if world.by_event:
        state.share = (state.now_us - state.epoch_us) / world.step_us
    any_crashed = ended = False
    for d in range(len(state.drones)):
        orient(world, path, state, state.drones[d])
        any_crashed = any_crashed or state.drones[d].mode == words.CRASHED
        ended = ended or ends_episode(world, state.drones[d])
    observe(world, state)
    locate(world, path, state)
    if state.keeps_credit:
        credit_step(state)
    if state.keeps_sensors:
        count_ages(world, state)
    call(world.pay, (world, state))
    state.aged = 0.0
    if state.keeps_requests:
        record(world, state)
    state.terminated = int(ended)
    state.truncated = int(is_last(world, state))
    if state.terminated or state.truncated:
        allow(world, state)
        _end_episode(world, path, state)
        return
    if any_crashed:
        _replace_crashed(world, path, state)
    allow(world, state)


@rule
def is_last(world: Constants, state: State) -> bool:
    """Return whether the step that ends now is the last one of an episode."""
    return state.now_us == world.horizon_us if world.by_event else state.step == world.steps


@rare_rule
def _end_episode(world: Constants, path: Path, state: State) -> None:
    """Close all requests, detach all users, and complete the totals of the episode."""
    for u in range(len(state.users)):
        state.users[u].doing = doing(state.users[u])
    close_all(world, path, state)
    if state.keeps_sensors:
        end_sensors(world, state)
    leave_all(state, words.RECORD)
    if world.separation_m > 0.0:
        end_pairs(world, state)
    for d in range(len(state.senders)):
        sender = state.senders[d]
        sender.serving = 0
        clear_lines(sender)
        sender.computing.clear()
        sender.moving.clear()
        sender.relayed = 0
        if state.keeps_tasks:
            power(world, state, sender)
    for d in range(len(state.drones)):
        drone = state.drones[d]
        count_distance(world, state, drone)
        count_charge(drone, state.observations[d].charge)
        if drone.mode == words.QUEUED:
            count_queueing(state, drone)
