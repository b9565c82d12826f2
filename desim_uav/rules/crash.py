"""Crashes: drones whose batteries are empty in the air, and the drones that replace them."""

from __future__ import annotations

from desim_uav.model.geometry.grid import cell_index
from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rules import words
from desim_uav.rules.battery import change_mode, type_of
from desim_uav.rules.coverage import silence
from desim_uav.rules.delivery import lose_updates
from desim_uav.rules.due import arrival_slot, undo
from desim_uav.rules.epochs import ask_at, asked_after_crash_us
from desim_uav.rules.flight import appear, count_distance, hover_at, position, stay_at
from desim_uav.rules.note import note, note_drone, note_leg
from desim_uav.rules.orientation import orient
from desim_uav.rules.processing import lose_tasks
from desim_uav.rules.rows import Constants, Drone, Path, State
from desim_uav.rules.settle import settle_after


@rare_rule
def crash(world: Constants, path: Path, state: State, drone: Drone) -> None:
    """Let a drone whose battery is empty fall to the ground beneath it, and detach its users."""
    note_drone(state, words.DEPLETION, words.ON_DEPLETE, drone)
    x_m, y_m, _ = position(world, state, drone)
    count_distance(world, state, drone)
    change_mode(world, state, drone, words.CRASHED)
    x = cell_index(x_m, world.cell_x_m, world.nx)
    y = cell_index(y_m, world.cell_y_m, world.ny)
    hover_at(drone, x, y, 0)
    drone.fallen = 1
    drone.fallen_x_m, drone.fallen_y_m = x_m, y_m
    if drone.off_grid:
        stay_at(drone, x_m, y_m, 0.0)
    drone.waits = drone.hopping = 0
    drone.route = drone.route_end = 0
    undo(state, arrival_slot(state, drone.index))
    if state.keeps_tasks:
        lose_tasks(world, state, drone, words.DEPLETION)
    silence(world, path, state, drone, words.DEPLETION)
    if state.keeps_sensors:
        lose_updates(world, state, drone)
    settle_after(world, path, state, words.DEPLETION)  # lost tasks may wait at other drones now
    state.crashed.append(drone.index)
    state.crashes += 1
    note_drone(state, words.DEPLETION, words.ON_CRASH, drone)
    note_leg(world, state, drone)
    if world.by_event:
        ask_at(state, asked_after_crash_us(world, drone))


@rule
def respawn(world: Constants, path: Path, state: State) -> bool:
    """Replace crashed drones whose downtime is over; return whether there were any."""
    any_back = False
    for d in range(len(state.drones)):
        drone = state.drones[d]
        own, down_us = type_of(world, drone), state.now_us - drone.since_us
        is_down = drone.mode == words.CRASHED and own.on_crash != words.REMOVES
        if is_down and down_us >= own.respawn_after_us:
            _replace(world, path, state, drone)
            any_back = True
    return any_back


@rule
def ends_episode(world: Constants, drone: Drone) -> bool:
    """Return whether a drone has crashed, and its type's crashes end the episode."""
    return drone.mode == words.CRASHED and type_of(world, drone).on_crash == words.ENDS_EPISODE


@rule
def _replace(world: Constants, path: Path, state: State, drone: Drone) -> None:
    """Put a new drone with a full battery above the station that the sample path names for it."""
    station = path.respawns[drone.index * path.respawns_drawn + drone.respawns]
    cell = world.stations[station]
    appear(world, state, drone, cell.x, cell.y)
    note(state, words.RESPAWN, words.ON_RESPAWN, drone.index, -1, -1, station)
    note_leg(world, state, drone)
    drone.waits = 1
    drone.respawns += 1
    orient(world, path, state, drone)
