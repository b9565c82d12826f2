"""Free flight in the compiled engine: functions of their own, and arrays over rows."""

from __future__ import annotations

from typing import Any

from desim_uav.model.geometry.prisms import Prisms
from desim_uav.model.geometry.roads import Roads
from desim_uav.model.motion.limits import Limits
from desim_uav.model.motion.space import Ways
from desim_uav.rowcode.compiled_rows import address_of, as_array
from desim_uav.rowcode.kernels import kernel, stands_in_for
from desim_uav.rules import free_flight as seam
from desim_uav.rules.rows import Constants, Drone, State


@kernel
def steer(world: Constants, state: State, drone: Drone) -> int:
    """Begin the leg of a command (see ``rules.free_flight.steer``)."""
    return seam.steer(world, state, drone)


@kernel
def home_leg(world: Constants, state: State, drone: Drone) -> int:
    """Begin the next leg of a return (see ``rules.free_flight.home_leg``)."""
    return seam.home_leg(world, state, drone)


@kernel
def look_home(world: Constants, state: State, drone: Drone) -> None:
    """Look for the way home (see ``rules.free_flight.look_home``)."""
    seam.look_home(world, state, drone)


def set_free(constants: Any) -> None:
    """Write the addresses of the functions of free flight."""
    arguments = (Constants, State, Drone)
    constants.steer = address_of(steer, *arguments)
    constants.home_leg = address_of(home_leg, *arguments)
    constants.look_home = address_of(look_home, *arguments)


# ---- arrays over rows


@stands_in_for(seam.prisms_of)
def _prisms_of(world: Constants, number: int) -> Any:
    def prisms_of(world: Constants, number: int) -> Any:
        space = world.spaces[number]
        count = len(space.offsets) - 1
        return Prisms(
            as_array(space.corners_m, (len(space.corners_m) // 2, 2)),
            as_array(space.walls, (len(space.walls) // 3, 3)),
            as_array(space.offsets, (count + 1,)),
            as_array(space.heights_m, (count, 2)),
            as_array(space.boxes_m, (count, 4)),
            (space.shape_x, space.shape_y),
            (space.side_x_m, space.side_y_m),
            as_array(space.heads, (len(space.heads),)),
            as_array(space.members, (len(space.members),)),
        )

    return prisms_of


@stands_in_for(seam.ways_of)
def _ways_of(world: Constants, number: int, level: int) -> Any:
    def ways_of(world: Constants, number: int, level: int) -> Any:
        ways = world.spaces[number].levels[level]
        nodes = len(ways.nodes_m) // 2
        shape = (len(ways.lengths_m) // nodes, nodes)
        roads = Roads(
            as_array(ways.nodes_m, (nodes, 2)),
            as_array(ways.lengths_m, shape),
            as_array(ways.following, shape),
            ways.altitude_m,
        )
        return Ways(roads, as_array(ways.times_us, shape), as_array(ways.drains, shape))

    return ways_of


@stands_in_for(seam.memory_of)
def _memory_of(state: State) -> Any:
    def memory_of(state: State) -> Any:
        return seam.Memory(as_array(state.away_m, (len(state.away_m),)))

    return memory_of


@stands_in_for(seam.limits_of)
def _limits_of(world: Constants, number: int) -> Any:
    def limits_of(world: Constants, number: int) -> Any:
        space = world.spaces[number]
        return Limits(
            space.level_mps,
            space.level_mps2,
            space.climb_mps,
            space.descent_mps,
            space.vertical_mps2,
        )

    return limits_of


@stands_in_for(seam.cruise_of)
def _cruise_of(world: Constants, number: int) -> Any:
    def cruise_of(world: Constants, number: int) -> Any:
        return world.spaces[number].lowest_mps, world.spaces[number].highest_mps

    return cruise_of


@stands_in_for(seam.wind_of)
def _wind_of(world: Constants, number: int) -> Any:
    def wind_of(world: Constants, number: int) -> Any:
        return world.spaces[number].wind_x_mps, world.spaces[number].wind_y_mps

    return wind_of
