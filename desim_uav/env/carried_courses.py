"""The states in which drones that fly freely begin an episode, from an untrusted source.

A leg is the coordinates of both of its ends, the limit of its speed (None: there is none) and, on a
return, its station, the next node, and the level (see ``engine.base.FreeCarried``). The share of
tasks that is offloaded follows if it is not 1.
"""

from __future__ import annotations

import math
from typing import Any

from desim_uav.drone_type import DroneType
from desim_uav.engine.base import CarriedDrone, FreeCarried
from desim_uav.engine.courses import carried_leg
from desim_uav.env.untrusted import HIGHEST, listed, number, require, whole
from desim_uav.model.geometry.prisms import TOUCH_M, deepest_at, first_entry
from desim_uav.model.radio.tracks import Point
from desim_uav.model.rules import GROUNDED, US, Action, Mode, kind_of
from desim_uav.rules.decide import can_take
from desim_uav.world import World

NOWHERE = (0, 0, 0)
"""The station, the node and the level of a drone that does not return."""


def plain(one: CarriedDrone, leg: FreeCarried) -> list[Any]:
    """Return the leg of a drone as plain data, without values that an earlier leg has left."""
    limited = one.mode is Mode.FLYING and leg[:3] != leg[3:6] and leg.limit_mps < math.inf
    home = leg[7:10] if one.mode is Mode.RETURNING else NOWHERE
    share = [float(leg.share)] if one.rest_us > 0 and leg.share != 1.0 else []
    limit = float(leg.limit_mps) if limited else None
    return [*map(float, leg[:6]), limit, *map(int, home), *share]


def on_leg(
    one: CarriedDrone, value: Any, hop: Any, world: World, ceiling: bool, own: DroneType
) -> CarriedDrone:
    """Return a drone with the leg that plain data describes. Raises ValueError if it has none.

    ``hop`` says where the leg of a return leads, in cells.
    """
    has_share = own.shares and isinstance(value, list) and len(value) == 11
    share = number(value[10]) if has_share else 1.0
    require(0.0 <= share <= 1.0, f"{share} is no share")
    *places, limit = listed(value[:10] if has_share else value, 10)[:7]
    limit_mps = math.inf if limit is None else number(limit)
    home = [whole(each, -1, HIGHEST) for each in value[7:10]]
    free = FreeCarried._make([*map(number, places), limit_mps, *home, share])
    start, stop = free[:3], free[3:6]
    one = one._replace(free=free, hop=_hop(start, stop, hop, world) if hop is not None else None)
    require(one.node == _cell(start, world), f"a drone at {start} m is not in the cell {one.node}")
    returns = one.mode is Mode.RETURNING
    require((hop is not None) == returns, "only a drone that returns is on a hop")
    require(limit is None or one.mode is Mode.FLYING, "only a commanded leg has a limit of speed")
    require(returns or free[7:10] == NOWHERE, "only a drone that returns has a station ahead")
    if one.mode is Mode.CRASHED:
        require(start == stop == (*(one.fallen_m or ()), 0.0), "a crashed drone lies elsewhere")
        return one
    _check_place(start, world, ceiling, own)
    _check_place(stop, world, ceiling, own)
    if one.mode in GROUNDED:
        centre = (*world.grid.centre(*one.node[:2]), world.grid.levels_m[0])
        require(start == stop == centre, f"a drone that has landed is not at {start} m")
    elif start != stop:
        require(first_entry(own.space.prisms, start, stop) == math.inf, "a leg is not free")
        _check_leg(one, free, world, own)
    else:
        require(not returns, "a drone that returns is not at rest")
        require(limit is None, "a drone at rest has no limit of speed")
    if returns:
        _check_home(free, world, ceiling, own)
    return one


def check_command(one: CarriedDrone, world: World, own: DroneType) -> None:
    """Raise ValueError unless a drone follows a command of free flight for as long as it says."""
    action, free = kind_of(world.actions[one.taken]), one.free
    require(world.by_event and one.mode is Mode.FLYING, "a drone follows no command")
    require(bool(can_take(int(action), 1)), f"no drone flies freely by {action.name}")
    lasts_us, at_most_us = one.age_us + one.rest_us, world.patience_us
    if free is not None and free[:3] != free[3:6]:
        require(action is Action.FLY, f"a drone that takes {action.name} has no leg")
        leg_us = carried_leg(own.space, int(one.mode), free).duration_us
        require(one.age_us < leg_us, "a leg is over before the episode begins")
        require(lasts_us == max(leg_us, at_most_us), "a leg does not last as long as it says")
    elif action is Action.FLY:  # it may have arrived before its patience is over
        require(lasts_us <= at_most_us, "a drone hovers for longer than it may")
    else:
        require(lasts_us == at_most_us, "a drone does not hover for as long as it says")


def _hop(start: Point, stop: Point, value: object, world: World) -> tuple[int, int, int]:
    """Return the cells and levels from one place to another, which must be those of ``value``."""
    dx, dy, dlevel = (b - a for a, b in zip(_cell(start, world), _cell(stop, world), strict=True))
    require(value == [dx, dy, dlevel], f"a leg from {start} m to {stop} m is not by {value!r:.40}")
    return dx, dy, dlevel


def _cell(at: Point, world: World) -> tuple[int, int, int]:
    return (*world.grid.cell_of(*at[:2]), world.grid.level_of(at[2]))


def _check_place(at: Point, world: World, ceiling: bool, own: DroneType) -> None:
    """Raise ValueError if no drone can be at a place."""
    (x, y, z), levels_m = at, world.grid.levels_m
    highest_m = levels_m[world.grid.levels(ceiling) - 1]
    on_map = 0.0 <= x <= world.area.width_m and 0.0 <= y <= world.area.depth_m
    require(on_map and levels_m[0] <= z <= highest_m, f"a drone cannot be at {at} m")
    depth_m = deepest_at(own.space.prisms, at)
    require(depth_m <= 2.0 * TOUCH_M, f"a drone cannot be in an obstacle, at {at} m")


def _check_leg(one: CarriedDrone, free: FreeCarried, world: World, own: DroneType) -> None:
    """Raise ValueError unless a drone is on a leg that takes no longer than it may."""
    most_s = own.space.most_s(world.step_us / US)
    if one.mode is Mode.FLYING:
        require(one.rest_us > 0, "a leg is over before the episode begins")
        slowest_mps = math.dist(free[:3], free[3:6]) / (2.0 * most_s)
        require(free.limit_mps >= slowest_mps, "a leg takes more than a step")
        cruises = free.limit_mps < math.inf
        require(own.chooses_cruise or not cruises, "a leg has a limit of speed")
    leg = carried_leg(own.space, int(one.mode), free)
    require(leg.duration_us > one.age_us, "a leg is over before the episode begins")
    if one.mode is Mode.FLYING:
        require(leg.duration_us <= most_s * US, "a leg takes more than a step")


def _check_home(free: FreeCarried, world: World, ceiling: bool, own: DroneType) -> None:
    """Raise ValueError unless a way leads on from the end of a leg to a station."""
    levels = own.space.levels
    is_station = 0 <= free.station < len(world.stations)
    require(
        is_station and 0 <= free.level < min(len(levels), world.grid.levels(ceiling)), "no way home"
    )
    ways, stop = levels[free.level], free[3:6]
    require(-1 <= free.node < len(ways.roads.nodes_m), f"{free.node} is no node of a way home")
    if free.node < 0:
        centre = world.grid.centre(*world.stations[free.station])
        above = stop[2] in (ways.altitude_m, world.grid.levels_m[0])
        require(stop[:2] == centre and above, "a way home ends without a station")
        return
    require(ways.times_us[free.station, free.node] >= 0, "a way home leads to no station")
    require(stop[2] == ways.altitude_m, "a way home is at another altitude")
    ahead = (*ways.roads.nodes_m[free.node].tolist(), stop[2])
    require(first_entry(own.space.prisms, stop, ahead) == math.inf, "a way home is not free")
