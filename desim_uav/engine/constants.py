"""A world and its run settings as rows (see ``rules.rows.Constants``)."""

from __future__ import annotations

import math

import numpy as np

from desim_uav.engine.base import RunSettings
from desim_uav.model.coverage import bucket_grid
from desim_uav.model.mobility import RandomWalk
from desim_uav.model.motion import REST, Transit
from desim_uav.model.observations import Local, Position
from desim_uav.model.rewards import (
    Coverage,
    CoverageBattery,
    MultiService,
    RowReward,
    thresholds_us,
)
from desim_uav.model.rows import Table, blank, fill
from desim_uav.model.rules import MOVES, US
from desim_uav.rules import observations, rewards
from desim_uav.rules.rows import Cell, Constants, Move, Piece, Place, TransitRow
from desim_uav.rules.words import CRASHES
from desim_uav.world import World

AXES = ((1, 0, 0), (0, 1, 0), (0, 0, 1))

REWARDS = {
    Coverage: rewards.COVERAGE,
    CoverageBattery: rewards.COVERAGE_BATTERY,
    MultiService: rewards.MULTI_SERVICE,
}
OBSERVATIONS = {Position: observations.POSITION, Local: observations.LOCAL}


def constants_of(world: World, settings: RunSettings) -> Constants:
    """Return the constants; what compiled code alone needs is left blank, and so are plans."""
    scenario, grid, reward = world.scenario, world.grid, world.scenario.reward
    made = blank(Constants)
    made.steps = scenario.episode.steps
    made.step_us, made.horizon_us = world.step_us, world.horizon_us
    made.limited = int(scenario.limited_battery)
    made.capacity_us, made.full_charge_us = world.capacity_us, world.full_charge_us
    made.return_below_us, made.respawn_after_us = world.return_below_us, world.respawn_after_us
    made.on_crash = CRASHES[world.on_crash]
    made.pads = scenario.stations.pads
    unlimited = math.isinf(world.bandwidth_bps)
    made.bandwidth_bps = -1 if unlimited else int(world.bandwidth_bps)
    made.services = len(world.services.names)
    made.nx, made.ny = grid.cells
    made.levels, made.levels_under_ceiling = len(grid.levels_m), grid.levels_under_ceiling
    made.three_d = int(scenario.three_d)
    made.cell_x_m, made.cell_y_m = grid.cell_m
    made.lowest_m, made.level_step_m = grid.levels_m[0], grid.level_step_m
    made.radius_m = scenario.drones.footprint_radius_m
    made.width_m, made.depth_m = world.area
    _set_flights(made, world)
    made.levels_m = Table(grid.levels_m)
    made.blocked = Table(np.asarray(grid.blocked).reshape(-1).astype(int).tolist())
    station_at = np.full(grid.cells, -1, np.int64)
    for index, cell in enumerate(world.stations):
        station_at[cell] = index
    made.station_at = Table(station_at.reshape(-1).tolist())
    made.stations = Table(fill(Cell, cell) for cell in world.stations)
    made.starts = Table(fill(Cell, cell) for cell in world.starts)
    made.ceilings = Table(map(int, settings.ceilings))
    made.homes = Table(fill(Place, home) for home in world.homes[:, :2].tolist())
    made.reward = REWARDS.get(type(reward), -1)
    made.cost_sign = getattr(reward, "cost_sign", 0.0)
    made.weight_users = float(getattr(reward, "users", 0.0))
    weights = getattr(reward, "services", {})
    made.weights = Table(weights.get(name, 0.0) for name in world.services.names)
    low_battery = getattr(reward, "low_battery", 0.0)
    made.c1_us, made.c2_us, made.c3_us, made.c4_us = thresholds_us(low_battery, world.capacity_us)
    made.observation = OBSERVATIONS.get(type(scenario.observation), observations.NONE)
    made.features = len(scenario.observation.features(world.facts))
    buckets = bucket_grid(*world.area, scenario.drones.footprint_radius_m)
    made.buckets_x, made.buckets_y = buckets
    made.bucket_x_m, made.bucket_y_m = (
        size / max(count, 1) for size, count in zip(world.area, buckets, strict=True)
    )
    mobility = scenario.users.mobility
    if isinstance(mobility, RandomWalk):
        made.walk_speed_mps, made.walk_leg_us = mobility.speed_mps, round(mobility.leg_s * US)
    return made


def _set_flights(made: Constants, world: World) -> None:
    """Write the moves and transits."""
    transits = [REST, *world.epoch_transits.values()]
    by_action = {action: 1 + k for k, action in enumerate(world.epoch_transits)}
    made.moves = Table(
        fill(Move, (int(action), *MOVES.get(action, (0, 0, 0)), by_action.get(action, 0)))
        for action in world.actions
    )
    made.first_hop = len(transits)
    transits += [world.fastest_transits[axis] for axis in AXES]
    made.transits = Table(map(_transit, transits))


def _transit(transit: Transit) -> TransitRow:
    pieces = Table(fill(Piece, piece) for piece in transit.profile.tolist())
    return fill(TransitRow, (transit.duration_us, transit.distance_m, pieces))


def term_names(world: World) -> tuple[str, ...]:
    """Return the terms of a reward in their order; none if only its own function knows them."""
    reward = world.scenario.reward
    if isinstance(reward, RowReward):
        return reward.names
    if isinstance(reward, Coverage):
        return ("users",)
    if isinstance(reward, CoverageBattery):
        return ("users", "return")
    if isinstance(reward, MultiService):
        return ("users", *world.services.names, "return", "charging")
    return ()
