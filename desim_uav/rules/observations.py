"""The built-in observations of learners: the paper's state, or a drone's surroundings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Ge, Le

from desim_uav.model.geometry.grid import cell_index
from desim_uav.model.observations import Feature, RowObservation
from desim_uav.model.rules import US
from desim_uav.model.state import Facts
from desim_uav.registry import register
from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rowcode.rows import Table
from desim_uav.rules.battery import capacity_of, drain_per_s_of, is_limited
from desim_uav.rules.flight import position, way_back
from desim_uav.rules.offloading import backlog_us
from desim_uav.rules.rows import Constants, Drone, ObservationRow, State


@register("observation", "position")
@dataclass(frozen=True)
class Position(RowObservation):
    """The paper's state: cell x and y, in 3D the level, with a battery its full minutes left.

    What is in the drone's store is the last one, if it is asked for.
    """

    load_mbit: Annotated[float, Ge(0), Le(1e6)] = 0.0
    """The volume of updates in the drone's store at which the feature `load` has its highest value.
    More of them have this value, too. 0: there is no such feature.
    """
    load_levels: Annotated[int, Ge(1), Le(1000)] = 3
    """The highest value of the feature `load`, which is 0 only if nothing is in the store."""
    information = "local"
    later: ClassVar = ("load_mbit", "load_levels")

    def features(self, facts: Facts) -> tuple[Feature, ...]:
        """Return the two to four features, which are whole numbers from 0."""
        nx, ny = facts.grid.cells
        sizes = {"cell_x": nx, "cell_y": ny}
        if facts.three_d:
            sizes["level"] = facts.grid.levels_under_ceiling
        if facts.capacity_s is not None:
            sizes["battery_min"] = 1 + int(facts.capacity_s // 60)
        if self.load_mbit > 0.0:
            sizes["load"] = 1 + self.load_levels
        return tuple(Feature(name, 0, size - 1, True) for name, size in sizes.items())

    def write(self, world: Constants, state: State, drone: Drone) -> None:
        """Write the features, all whole numbers, into ``drone.features``."""
        k = write_position(world, state, drone)
        if self.load_mbit > 0.0:
            load = load_of(drone, self.load_mbit)
            drone.features[k] = float(math.ceil(self.load_levels * load))


@register("observation", "local")
@dataclass(frozen=True)
class Local(RowObservation):
    """The drone's surroundings as numbers from 0 to 1 (the bearing: from -1 to 1).

    These are the believed position, the attached users, if links have classes their mean
    efficiency (over that of the best class), the requests served and the open requests
    in the footprint, by service (all over the number of users), the free bandwidth and the time
    left. In free flight the position is that in metres and not that of the cell's centre. With a
    battery they also include its charge and n_B, and the bearing (sine and cosine
    from north) and flight time of the nearest charging station; charge and times are divided by
    the capacity. The backlog of the drone's processor and what is in its store are the last ones,
    if they are asked for.
    """

    backlog_s: Annotated[float, Ge(0), Le(1e6)] = 0.0
    """The time for which the feature `backlog` is 1: that which the drone's processor needs for the
    tasks that are there. Longer ones are 1, too. 0: there is no such feature.
    """
    load_mbit: Annotated[float, Ge(0), Le(1e6)] = 0.0
    """The volume of updates in the drone's store for which the feature `load` is 1. For more of
    them it is 1, too. 0: there is no such feature.
    """
    information = "local"
    later: ClassVar = ("backlog_s", "load_mbit")

    def features(self, facts: Facts) -> tuple[Feature, ...]:
        """Return the features, all real numbers."""
        names = ["x", "y"] + ["altitude"] * facts.three_d + ["attached"]
        names += ["link_quality"] * facts.graded
        names += [f"served_{name}" for name in facts.services]
        names += [f"asking_{name}" for name in facts.services]
        names += ["bandwidth_left", "time_left"]
        lows = dict.fromkeys(names, 0.0)
        if facts.capacity_s is not None:
            lows |= {"battery": 0.0, "n_b": 0.0}
            lows |= {"bearing_sin": -1.0, "bearing_cos": -1.0, "flight_time": 0.0}
        if self.backlog_s > 0.0:
            lows["backlog"] = 0.0
        if self.load_mbit > 0.0:
            lows["load"] = 0.0
        return tuple(Feature(name, low, 1.0, False) for name, low in lows.items())

    def write(self, world: Constants, state: State, drone: Drone) -> None:
        """Write the features, all real numbers, into ``drone.features``."""
        k = write_local(world, state, drone)
        if self.backlog_s > 0.0:
            drone.features[k] = backlog_of(world, state, drone, self.backlog_s)
            k += 1
        if self.load_mbit > 0.0:
            drone.features[k] = load_of(drone, self.load_mbit)


@rule
def backlog_of(world: Constants, state: State, drone: Drone, full_s: float) -> float:
    """Return how long a drone's processor needs for the tasks there, over a time; at most 1."""
    if not state.keeps_tasks:
        return 0.0
    return min(backlog_us(world, state, drone) / (full_s * US), 1.0)


@rule
def load_of(drone: Drone, full_mbit: float) -> float:
    """Return how much of a drone's store is taken or promised, over a volume; at most 1."""
    return min(float(drone.stored_ubit) / (full_mbit * 1e12), 1.0)


@rule
def write_position(world: Constants, state: State, drone: Drone) -> int:
    """Write the paper's state as a drone's first features; return the number of these features."""
    observation, out = state.observations[drone.index], drone.features
    out[0], out[1] = observation.x, observation.y
    k = 2
    if world.three_d:
        out[k] = observation.level
        k += 1
    if is_limited(world, drone):
        out[k] = observation.charge // (60 * drain_per_s_of(world, drone))
        k += 1
    return k


@rule
def write_local(world: Constants, state: State, drone: Drone) -> int:
    """Write the features of ``Local`` as a drone's first ones; return their number."""
    observation, out, users = state.observations[drone.index], drone.features, len(state.users)
    out[0] = (observation.x + 0.5) / world.nx
    out[1] = (observation.y + 0.5) / world.ny
    k = 2
    if world.three_d:
        out[k] = (observation.level + 0.5) / world.levels_under_ceiling
        k += 1
    if drone.off_grid:
        _write_place(world, state, drone, observation)
    out[k] = observation.attached_users / users
    k += 1
    if not world.radios[drone.radio].flat:
        out[k] = observation.link_quality
        k += 1
    counts = 2 * world.services
    for count in range(counts):
        out[k + count] = state.counts[counts * drone.index + count] / users
    k += counts
    used, radio = 0.0, world.radios[drone.radio]
    if radio.bandwidth_hz >= 0:
        bandwidth_hz = radio.bandwidth_hz + max(radio.uplink_hz, 0)
        used = (observation.used_hz / 1000) / (bandwidth_hz / 1000)
    out[k] = 1.0 - used
    out[k + 1] = 1.0 - state.now_us / world.horizon_us
    k += 2
    if is_limited(world, drone):
        _write_way_home(world, drone, observation, k)
        k += 5
    return k


@rule
def clear_from(features: Table[float], first: int) -> None:
    """Set a drone's features from number ``first`` on to 0."""
    for k in range(first, len(features)):
        features[k] = 0.0


@rare_rule
def _write_place(world: Constants, state: State, drone: Drone, observation: ObservationRow) -> None:
    """Write the place of a drone that flies freely, in the units of cells and levels.

    Under position noise, it is as many cells away from the true place as the believed cell is.
    """
    out, (x_m, y_m, z_m) = drone.features, position(world, state, drone)
    wrong_x = observation.x - cell_index(x_m, world.cell_x_m, world.nx)
    wrong_y = observation.y - cell_index(y_m, world.cell_y_m, world.ny)
    out[0] = (x_m / world.cell_x_m + wrong_x) / world.nx
    out[1] = (y_m / world.cell_y_m + wrong_y) / world.ny
    if world.three_d:
        level = max((z_m - world.lowest_m) / world.level_step_m + 0.5, 0.0)
        out[2] = level / world.levels_under_ceiling


@rule
def _write_way_home(world: Constants, drone: Drone, observation: ObservationRow, k: int) -> None:
    """Write the battery, n_B, and the bearing and flight time of the nearest station, from ``k``.

    The bearing is that of the cells; n_B and the flight time are 1 if no station can be reached.
    """
    out, capacity_s = drone.features, capacity_of(world, drone) / US
    plan = way_back(world, drone, observation.believed)
    out[k] = (observation.charge / US) / capacity_s
    out[k + 1] = out[k + 4] = 1.0
    out[k + 2] = out[k + 3] = 0.0
    if plan.station >= 0:
        station = world.stations[plan.station]
        out[k + 1] = min((plan.drain / US) / capacity_s, 1.0)
        east = (station.x - observation.x) * world.cell_x_m
        north = (station.y - observation.y) * world.cell_y_m
        distance = math.sqrt(east * east + north * north)
        if distance > 0.0:
            out[k + 2], out[k + 3] = east / distance, north / distance
        lasts_s = capacity_of(world, drone) / drain_per_s_of(world, drone)
        out[k + 4] = min((plan.duration_us / US) / lasts_s, 1.0)
