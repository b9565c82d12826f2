"""What learners are given: ``position`` and ``local`` (see ``model.observations``)."""

from __future__ import annotations

import math
from typing import Any

from desim_uav.model.kernels import rule
from desim_uav.rules.flight import way_back
from desim_uav.rules.rows import Constants, Drone, Seen, State
from desim_uav.rules.words import US

NONE, POSITION, LOCAL = range(3)


@rule
def encode(world: Constants, state: State, drone: Drone, out: Any, k: int) -> None:
    """Write a drone's features into ``out``, from entry ``k`` on."""
    if world.observation == POSITION:
        _position(world, state.seen[drone.index], out, k)
    else:
        _local(world, state, drone, state.seen[drone.index], out, k)


@rule
def _position(world: Constants, seen: Seen, out: Any, k: int) -> None:
    out[k], out[k + 1] = seen.x, seen.y
    k += 2
    if world.three_d:
        out[k] = seen.level
        k += 1
    if world.limited:
        out[k] = (seen.battery_us / US) // 60


@rule
def _local(world: Constants, state: State, drone: Drone, seen: Seen, out: Any, k: int) -> None:
    users, counts = len(state.users), 2 * world.services
    out[k] = (seen.x + 0.5) / world.nx
    out[k + 1] = (seen.y + 0.5) / world.ny
    k += 2
    if world.three_d:
        out[k] = (seen.level + 0.5) / world.levels_under_ceiling
        k += 1
    out[k] = seen.attached_users / users
    k += 1
    for count in range(counts):
        out[k + count] = state.counts[counts * drone.index + count] / users
    k += counts
    used = 0.0
    if world.bandwidth_bps >= 0:
        used = (seen.used_bps / 1000) / (world.bandwidth_bps / 1000)
    out[k] = 1.0 - used
    out[k + 1] = 1.0 - state.step / world.steps
    if world.limited:
        _way_home(world, drone, seen, out, k + 2)


@rule
def _way_home(world: Constants, drone: Drone, seen: Seen, out: Any, k: int) -> None:
    """Write the battery, n_B, and the bearing and flight time of the nearest station."""
    capacity_s, plan = world.capacity_us / US, way_back(world, drone, seen.believed)
    out[k] = (seen.battery_us / US) / capacity_s
    out[k + 1] = out[k + 4] = 1.0
    out[k + 2] = out[k + 3] = 0.0
    if plan.station >= 0:
        station = world.stations[plan.station]
        out[k + 1] = min((plan.drained_us / US) / capacity_s, 1.0)
        east = (station.x - seen.x) * world.cell_x_m
        north = (station.y - seen.y) * world.cell_y_m
        distance = math.sqrt(east * east + north * north)
        if distance > 0.0:
            out[k + 2], out[k + 3] = east / distance, north / distance
        out[k + 4] = min((plan.duration_us / US) / capacity_s, 1.0)
