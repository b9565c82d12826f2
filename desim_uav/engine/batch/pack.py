"""A world and its run settings as the compiled engine takes them."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from desim_uav.engine.base import RunSettings
from desim_uav.engine.batch.memory import (
    OBSERVATION_LOCAL,
    OBSERVATION_NONE,
    OBSERVATION_POSITION,
    ON_CRASH_END,
    ON_CRASH_REMOVE,
    ON_CRASH_RESPAWN,
    REWARD_BATTERY,
    REWARD_COVERAGE,
    REWARD_SERVICES,
    WALK_LEG_US,
    Fixed,
    Ints,
)
from desim_uav.engine.batch.standing import tabulate
from desim_uav.errors import ScenarioError
from desim_uav.model.admission import FirstCome
from desim_uav.model.battery import Endurance
from desim_uav.model.coverage import bucket_grid
from desim_uav.model.mobility import RandomWalk
from desim_uav.model.motion import REST, Transit
from desim_uav.model.observations import Local, Position
from desim_uav.model.rewards import Coverage, CoverageBattery, MultiService, thresholds_us
from desim_uav.model.rules import MOVES, US
from desim_uav.world import World

REWARDS = {
    Coverage: REWARD_COVERAGE,
    CoverageBattery: REWARD_BATTERY,
    MultiService: REWARD_SERVICES,
}
OBSERVATIONS = {Position: OBSERVATION_POSITION, Local: OBSERVATION_LOCAL}
CRASHES = {"respawn": ON_CRASH_RESPAWN, "remove": ON_CRASH_REMOVE, "end_episode": ON_CRASH_END}
AXES = ((1, 0, 0), (0, 1, 0), (0, 0, 1))


def lacking(world: World) -> list[str]:
    """What keeps a world out of the compiled engine: each component that has no kernel."""
    scenario = world.scenario
    chosen = {
        "drones.battery": (scenario.drones.battery, (Endurance, type(None))),
        "drones.admission": (scenario.drones.admission, (FirstCome,)),
        "reward": (scenario.reward, tuple(REWARDS)),
    }
    lacks = [
        f"{key}: {type(component).__name__!r} is not compiled"
        for key, (component, known) in chosen.items()
        if type(component) not in known
    ]
    return lacks + _too_large(world)


MOST_PLANNING = 4 * 10**9
"""Places times places for which ways back are planned, at most: some minutes of work."""


def _too_large(world: World) -> list[str]:
    """What its 64-bit sums cannot hold, and the ways back that it would plan for too long."""
    problems = []
    scenario, grid = world.scenario, world.grid
    users, most_us = len(world.homes), 2**62 // world.horizon_us
    if users > most_us:
        problems.append("users.count, episode: the time of all users together is too long")
    widest = int(world.services.bandwidths_bps.max())
    carried = users * widest
    if not math.isinf(world.bandwidth_bps):
        carried = min(carried, scenario.drones.count * int(world.bandwidth_bps))
    if carried > most_us:
        problems.append("services, drones.bandwidth_kbps: the bandwidth in use is too large")
    nx, ny = grid.cells
    places = len(grid.levels_m) * nx * ny
    if scenario.limited_battery and places * places > MOST_PLANNING:
        problems.append(f"map.cells, map.levels: ways back from {places:,} places take too long")
    return problems


def term_names(world: World) -> tuple[str, ...]:
    """The terms of a reward that has a kernel, in its order."""
    reward = world.scenario.reward
    if isinstance(reward, Coverage):
        return ("users",)
    if isinstance(reward, CoverageBattery):
        return ("users", "return")
    return ("users", *world.services.names, "return", "charging")


@lru_cache(maxsize=16)
def pack(world: World, settings: RunSettings) -> Fixed:
    """The arrays. Raises ScenarioError for components that have no kernel."""
    problems = lacking(world)
    if problems:
        raise ScenarioError(*(f"{problem}; --engine des runs it" for problem in problems))
    scenario, grid, reward = world.scenario, world.grid, world.scenario.reward
    transits = [REST, *world.epoch_transits.values()]
    moving = {action: 1 + k for k, action in enumerate(world.epoch_transits)}
    hop_transits = [len(transits) + k for k in range(3)]
    transits += [world.fastest_transits[axis] for axis in AXES]
    moves = [
        (*MOVES.get(action, (0, 0, 0)), moving.get(action, 0), int(action))
        for action in world.actions
    ]
    station_at = np.full(grid.cells, -1, np.int64)
    for index, cell in enumerate(world.stations):
        station_at[cell] = index
    plans, hops = _plans(world, settings)
    weights = getattr(reward, "services", {})
    profiles = _stacked(transits)
    known, known_rows = tabulate(world)
    whole_sections = [
        np.array(world.stations),
        station_at,
        np.array(world.starts),
        np.array(settings.ceilings),
        np.array(moves),
        np.array([(t.duration_us, len(t.profile)) for t in transits]),
        np.array(hop_transits),
        plans,
        hops,
        grid.blocked,
        known,
        known_rows,
    ]
    real_sections = [
        np.array(grid.levels_m),
        profiles,
        np.array([t.distance_m for t in transits]),
        np.array([weights.get(name, 0.0) for name in world.services.names]),
        world.homes[:, :2],
    ]
    mobility = scenario.users.mobility
    walk = mobility if isinstance(mobility, RandomWalk) else None
    buckets = bucket_grid(*world.area, scenario.drones.footprint_radius_m)
    real = [
        *grid.cell_m,
        grid.levels_m[0],
        grid.level_step_m,
        scenario.drones.footprint_radius_m,
        getattr(reward, "cost_sign", 0.0),
        getattr(reward, "users", 0.0),
        *(size / max(count, 1) for size, count in zip(world.area, buckets, strict=True)),
        0.0 if walk is None else walk.speed_mps,
        *world.area,
    ]
    whole = [
        scenario.drones.count,
        len(world.homes),
        len(world.stations),
        len(world.services.names),
        scenario.episode.steps,
        world.step_us,
        world.horizon_us,
        scenario.limited_battery,
        world.capacity_us,
        world.full_charge_us,
        world.return_below_us,
        world.respawn_after_us,
        CRASHES[world.on_crash],
        scenario.stations.pads,
        -1 if math.isinf(world.bandwidth_bps) else world.bandwidth_bps,
        grid.levels_under_ceiling,
        REWARDS[type(reward)],
        *grid.cells,
        len(grid.levels_m),
        len(world.actions),
        OBSERVATIONS.get(type(scenario.observation), OBSERVATION_NONE),
        len(scenario.observation.features(world.facts)),
        scenario.three_d,
        len(term_names(world)),
        *buckets,
        len(known) > 0,
        *thresholds_us(getattr(reward, "low_battery", 0.0), world.capacity_us),
    ]
    whole += _starts(WALK_LEG_US + 1, whole_sections)
    whole += _starts(len(real), real_sections)
    whole += [profiles.shape[1], 0 if walk is None else round(walk.leg_s * US)]
    return Fixed(
        np.concatenate([np.array(whole), *map(np.ravel, whole_sections)]).astype(np.int64),
        np.concatenate([np.array(real), *map(np.ravel, real_sections)]).astype(np.float64),
    )


def _starts(first: int, sections: list[Any]) -> list[int]:
    """Where sections begin, one after the other."""
    sizes = [first, *(section.size for section in sections[:-1])]
    return [int(at) for at in np.cumsum(sizes)]


def _stacked(transits: list[Transit]) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    profiles = np.zeros((len(transits), max(len(t.profile) for t in transits), 4))
    for k, transit in enumerate(transits):
        profiles[k, : len(transit.profile)] = transit.profile
    return profiles


def _plans(world: World, settings: RunSettings) -> tuple[Ints, Ints]:
    """The way back from every node, under the ceiling and without one, where it is needed."""
    nx, ny = world.grid.cells
    plans = np.full((2, len(world.grid.levels_m) * nx * ny, 5), -1, np.int64)
    hops = np.empty((1024, 3), np.int64)
    used = 0
    if world.scenario.limited_battery:
        for ceiling in set(settings.ceilings):
            for level, x, y in np.ndindex(world.grid.levels(ceiling), nx, ny):
                back = world.planner.search((x, y, level), ceiling)
                if back is not None:
                    first, used = used, used + len(back.hops)
                    if used > len(hops):
                        hops = np.concatenate((hops, np.empty((used, 3), np.int64)))
                    hops[first:used] = np.array(back.hops, np.int64).reshape(-1, 3)
                    plans[int(ceiling), (level * nx + x) * ny + y] = (
                        *(back.station, back.duration_us, back.drained_us),
                        *(first, used),
                    )
    return plans, hops[:used]
