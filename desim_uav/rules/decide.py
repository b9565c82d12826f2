"""Decision epochs: the drones' observations, the allowed commands, and the actions taken."""

from __future__ import annotations

from desim_uav.rowcode.kernels import apart, rare_rule, rule
from desim_uav.rules import words
from desim_uav.rules.battery import (
    battery_now,
    count_charge,
    count_computing,
    is_limited,
    type_of,
)
from desim_uav.rules.charging import land, on_full
from desim_uav.rules.flight import (
    arrive,
    end_move,
    fly,
    fly_home,
    position,
    station_under,
    turn_back,
    way_back,
)
from desim_uav.rules.free_flight import (
    fly_freely,
    fly_home_freely,
    turn_back_freely,
)
from desim_uav.rules.rows import Constants, Drone, ObservationRow, Path, State
from desim_uav.rules.shield import shield


@rule
def observe(world: Constants, state: State) -> None:
    """Write each drone's observation at a decision epoch into ``observations`` and ``counts``.

    ``orient`` must have been called before: it sets where a drone believes itself to be.
    """
    services, counts = world.services, state.counts
    for d in range(len(state.drones)):
        drone, observation = state.drones[d], state.observations[d]
        observation.mode = drone.mode
        if state.keeps_tasks:
            count_computing(state, drone)
        observation.charge = battery_now(world, state, drone)
        observation.attached_users = drone.attached_users
        observation.used_hz = drone.used_hz
        observation.link_quality = 0.0
        if not world.radios[drone.radio].flat:
            observation.link_quality = _link_quality(world, state, drone)
        served, first = 0, 2 * services * d
        for k in range(services):
            served += drone.served[k]
            counts[first + k] = drone.served[k]
            counts[first + services + k] = drone.asking[k]
        observation.served_requests = served
    for k in range(services):
        state.asked[k] = state.open_requests[k]


@apart
def _link_quality(world: Constants, state: State, drone: Drone) -> float:
    """Return the mean efficiency of links to attached users, as a share of the best class's."""
    radio, carried = world.radios[drone.radio], 0
    for u in range(len(state.users)):
        user = state.users[u]  # others count as class 0, which carries nothing: without a jump
        carried += radio.efficiencies[user.classes[drone.index] * int(user.holder == drone.index)]
    most = drone.attached_users * radio.efficiencies[radio.classes]
    return carried / most if most > 0 else 0.0


@apart
def record(world: Constants, state: State) -> None:
    """Write the records of all drones and access points at the end of a step, after the rewards."""
    for d in range(len(state.drones)):
        drone, observation, record = state.drones[d], state.observations[d], state.records[d]
        record.step, record.t_us, record.drone = state.step - 1, state.now_us, d
        x_m, y_m, z_m = position(world, state, drone)
        record.x_m, record.y_m, record.z_m = x_m, y_m, z_m
        record.mode, record.charge = observation.mode, observation.charge
        record.action, record.action_taken = drone.command, drone.taken
        record.attached_users = observation.attached_users
        record.served_requests = observation.served_requests
        record.used_hz = observation.used_hz
        record.return_drain = 0
        if is_limited(world, drone):
            plan = way_back(world, drone, observation.believed)
            record.return_drain = plan.drain if plan.station >= 0 else words.NEVER
        count_charge(drone, observation.charge)
        record.used = drone.used
        record.reward = state.rewards[d]
        record.aim_x = record.aim_y = record.aim_z = record.aim_cruise = record.aim_share = 0.0
        if drone.off_grid:
            course = drone.course
            record.aim_x, record.aim_y, record.aim_z = course.aim_x, course.aim_y, course.aim_z
            record.aim_cruise, record.aim_share = course.aim_cruise, course.aim_share
    for k in range(len(world.points)):
        sender, point_record = state.senders[len(state.drones) + k], state.point_records[k]
        point_record.step, point_record.t_us = state.step - 1, state.now_us
        point_record.access_point = k
        point_record.attached_users = sender.attached_users
        point_record.served_requests = 0
        for service in range(world.services):
            point_record.served_requests += sender.served[service]
        point_record.used_hz = sender.used_hz


@rule
def allow(world: Constants, state: State) -> None:
    """Write the masks, which mark the actions that each drone may take, at least one each.

    A move off the map or into a building is allowed, because a drone has no map. A drone that is
    not asked now is allowed to hover only, which stands for going on with what it does. Whether a
    drone is forced, and the time since it was not, are counted here, once per epoch. A mask that
    stays the same is not written again, unless the drone is shielded.
    """
    for d in range(len(state.drones)):
        drone, observation = state.drones[d], state.observations[d]
        before = observation.elapsed_us if observation.forced and state.step > 0 else 0
        observation.elapsed_us = before + state.now_us - state.epoch_us
        own, charge = type_of(world, drone), observation.charge
        may_return = own.limited != 0 and charge <= own.return_charge
        is_full = charge >= own.full
        if world.by_event and is_full:
            may_return = False  # at a station it would be asked again at once, without end
        if may_return and drone.off_grid:
            may_return = drone.course.home.station >= 0
        may_charge = not is_full and station_under(world, drone) >= 0
        mode = words.GOING_ON if is_under_way(world, drone) else drone.mode
        allows = 1 + 4 * mode + 2 * int(may_return) + int(may_charge)
        if allows != observation.allows:
            observation.allows = allows
            _write_mask(world, state, drone, observation)
        if own.shielded and mode in words.DECIDES:
            shield(world, state, drone)


@rare_rule
def _write_mask(world: Constants, state: State, drone: Drone, observation: ObservationRow) -> None:
    """Write a drone's mask, and whether it is forced."""
    allows, options, first = observation.allows - 1, 0, drone.index * len(world.moves)
    for k in range(len(world.moves)):
        move, may_return, may_charge = world.moves[k], allows & 2 > 0, allows & 1 > 0
        allowed = is_allowed(move.action, allows // 4, may_return, may_charge)
        allowed = allowed and can_take(move.action, drone.off_grid)
        allowed = allowed and chooses_share(allows // 4, move.share, world.most_share)
        state.masks[first + k] = int(allowed)
        options += int(allowed)
    observation.forced = int(options == 1)


@rule
def can_take(action: int, off_grid: int) -> bool:
    """Return whether drones that fly freely (``off_grid``), or from cell to cell, have an action.

    It matters if there are both: moves are for the latter, and to fly by numbers for the former.
    """
    if off_grid:
        return action in (words.FLY, words.HOVER, words.GOTO, words.CHARGE)
    return action != words.FLY


@rule
def is_under_way(world: Constants, drone: Drone) -> bool:
    """Return whether a drone follows a command and is asked later, because it is asked by event."""
    return world.by_event == 1 and drone.mode == words.FLYING and drone.waits == 0


@rule
def is_allowed(action: int, mode: int, may_return: bool, may_charge: bool) -> bool:
    """Return whether a drone in this mode may take an action."""
    if mode not in words.DECIDES:
        if mode in words.AIRBORNE:
            return action == words.GOTO
        return action == (words.CHARGE if mode in words.GROUNDED else words.HOVER)
    if action == words.GOTO:
        return may_return
    if action == words.CHARGE:
        return may_charge
    return True


@rule
def chooses_share(mode: int, share: float, most: float) -> bool:
    """Return whether a drone in this mode may take an action with this share of tasks.

    One that has no choice takes an action with the highest share, so that there is one only.
    """
    return mode in words.DECIDES or share == most


@rule
def taken(world: Constants, state: State, drone: Drone) -> int:
    """Return the index of the action that a drone takes on its command.

    A command that the mask forbids is replaced by the only allowed action, or by hover if several
    are allowed; by the last of these if a shield forbids to hover.
    """
    command, actions = drone.command, len(world.moves)
    first = drone.index * actions
    if command >= 0 and state.masks[first + command]:
        return command
    allowed, only, hover = 0, 0, 0
    for k in range(actions):
        if state.masks[first + k]:
            allowed += 1
            only = k
        if world.moves[k].action == words.HOVER:
            hover = k
    return only if allowed == 1 or not state.masks[first + hover] else hover


@rule
def obey(world: Constants, path: Path, state: State, drone: Drone) -> None:
    """Let a drone begin the action that it takes on its command (``drone.taken``)."""
    drone.waits = 0
    action = world.moves[drone.taken].action
    if action == words.GOTO:
        if drone.off_grid:
            turn_back_freely(world, path, state, drone)
        else:
            turn_back(world, path, state, drone)
        go_home(world, path, state, drone, words.COMMAND)
    elif action == words.CHARGE:
        land(world, path, state, drone, words.COMMAND)
    elif drone.off_grid:
        drone.course.share = world.moves[drone.taken].share
        fly_freely(world, path, state, drone, action == words.FLY)
    else:
        fly(world, path, state, drone, drone.taken)


@rare_rule
def go_home(world: Constants, path: Path, state: State, drone: Drone, phase: int) -> None:
    """Begin the next hop of a drone's return, or land if it has reached a station."""
    if drone.off_grid:
        on_its_way = fly_home_freely(world, state, drone, phase)
    else:
        on_its_way = fly_home(world, state, drone, phase)
    if not on_its_way:
        land(world, path, state, drone, phase)


@rule
def on_arrival(world: Constants, path: Path, state: State, drone: Drone) -> None:
    """End the move, the hop of a return or the charge of a drone."""
    if drone.mode == words.CHARGING:
        on_full(world, state, drone)
    elif drone.mode == words.RETURNING:
        arrive(world, state, drone)
        go_home(world, path, state, drone, words.ARRIVAL)
    else:
        end_move(world, state, drone)
