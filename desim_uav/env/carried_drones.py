"""The states in which drones begin an episode, from an untrusted source."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from desim_uav.drone_type import DroneType
from desim_uav.engine.base import Carried, CarriedDrone
from desim_uav.env import carried_courses
from desim_uav.env.untrusted import HIGHEST, listed, number, whole
from desim_uav.model.motion.planner import Node
from desim_uav.model.rules import GROUNDED, TIMED, Mode, move_of
from desim_uav.world import World


def plain(drones: Carried | None) -> Any:
    """Return the states of drones as data that JSON has, which ``checked`` reads."""
    return drones and [
        one if one.free is None else [*one[:9], carried_courses.plain(one, one.free), *one[10:]]
        for one in drones
    ]


def checked(value: object, world: World, ceilings: Sequence[bool]) -> Carried:
    """Return plain data as the states of drones. Raises ValueError if no drone can be in one."""
    drones = listed(value, world.scenario.drone_count)
    return tuple(
        _drone(one, world, under, world.type_of(d))
        for d, (one, under) in enumerate(zip(drones, ceilings, strict=True))
    )


def _drone(value: object, world: World, ceiling: bool, own: DroneType) -> CarriedDrone:
    value = listed(value)
    rest_us, taken = value[10:] if len(value) == 12 else (0, 0)
    free = value[9] if len(value) in (10, 12) else None
    if (free is not None) != own.free:
        raise ValueError("a drone has a leg of free flight, or it flies freely and has none")
    if len(value) in (10, 12):
        value = value[:9]
    mode, node, charge, age_us, hop, route, counted_m, place, fallen_m = listed(value, 9)
    returns = mode == Mode.RETURNING  # what another drone has of a route is left from before
    on_hop = returns or (mode == Mode.FLYING and rest_us != 0)
    (nx, ny), levels = world.grid.cells, world.grid.levels(ceiling)
    one = CarriedDrone(
        Mode(whole(mode, 0, HIGHEST)),
        _node(node, (0, 0, 0), (nx - 1, ny - 1, levels - 1)),
        whole(charge, 0, own.capacity),
        whole(age_us, 0, HIGHEST),
        _hop(hop) if on_hop and hop is not None and not own.free else None,
        tuple(map(_hop, listed(route))) if returns and not own.free else (),
        number(counted_m),
        whole(place, 0, world.scenario.drone_count),
        None if fallen_m is None else _place(fallen_m, world),
        rest_us=whole(rest_us, 0, HIGHEST),
        taken=whole(taken, 0, len(world.actions) - 1),
    )
    if (one.mode is Mode.CRASHED) != (one.fallen_m is not None):
        raise ValueError("only a crashed drone has fallen")
    if own.free:
        one = carried_courses.on_leg(one, free, hop, world, ceiling, own)
    if one.rest_us > 0 and one.mode not in TIMED & GROUNDED:
        check_command = carried_courses.check_command if own.free else _check_command
        check_command(one, world, own)
    if one.mode is not Mode.CRASHED:
        _check_way(one, world, ceiling, own)
    return one


def _check_way(one: CarriedDrone, world: World, ceiling: bool, own: DroneType) -> None:
    """Raise ValueError if a drone is not on its way, or not at a station that it needs."""
    at = one.node
    if not own.free:
        _check_hops(one, world, ceiling, own)
    if one.mode in GROUNDED and (at[:2] not in world.stations or at[2] != 0):
        raise ValueError(f"there is no station at {at}")


def _check_hops(one: CarriedDrone, world: World, ceiling: bool, own: DroneType) -> None:
    """Raise ValueError if a drone is not on its way from cell to cell."""
    home = one.hop if one.rest_us == 0 else None
    if home is not None and one.age_us >= own.return_transits[home].duration_us:
        raise ValueError("a hop is over before the episode begins")
    hops = (*([one.hop] if one.hop else []), *one.route)
    for node in _along(one.node, hops):
        if not world.grid.can_enter(*node, ceiling):
            raise ValueError(f"a drone cannot be at {node}")


def _check_command(one: CarriedDrone, world: World, own: DroneType) -> None:
    """Raise ValueError unless a drone follows a command for the time that is left of it."""
    lasts_us, action = world.patience_us, world.actions[one.taken]
    if one.hop is not None:
        if move_of(action) != one.hop or action not in own.epoch_transits:
            raise ValueError(f"a drone that takes {action} does not move by {one.hop}")
        lasts_us = own.epoch_transits[action].duration_us
    if not world.by_event or one.mode is not Mode.FLYING or one.age_us + one.rest_us != lasts_us:
        raise ValueError("a drone does not follow a command for as long as it says")


def _along(node: Node, hops: Sequence[Node]) -> list[Node]:
    """Return a place and those to which hops lead from it."""
    nodes = [node]
    for dx, dy, dlevel in hops:
        x, y, level = nodes[-1]
        nodes.append((x + dx, y + dy, level + dlevel))
    return nodes


def _node(value: object, least: Node, most: Node) -> Node:
    x, y, level = map(whole, listed(value, 3), least, most)
    return x, y, level


def _hop(value: object) -> Node:
    hop = _node(value, (-1, -1, -1), (1, 1, 1))
    if sum(map(abs, hop)) != 1:
        raise ValueError(f"{hop} is no hop")
    return hop


def _place(value: object, world: World) -> tuple[float, float]:
    x_m, y_m = map(number, listed(value, 2))
    if not (0.0 <= x_m <= world.area.width_m and 0.0 <= y_m <= world.area.depth_m):
        raise ValueError(f"({x_m}, {y_m}) m is off the map")
    return x_m, y_m
