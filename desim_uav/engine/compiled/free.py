"""Free flight in the compiled engine: arrays over rows."""

from __future__ import annotations

from typing import Any

from desim_uav.model.geometry.prisms import Prisms
from desim_uav.model.geometry.roads import Roads
from desim_uav.model.motion.limits import Limits
from desim_uav.model.motion.space import Ways
from desim_uav.rowcode.compiled_rows import as_array
from desim_uav.rowcode.kernels import stands_in_for
from desim_uav.rules import free_flight as seam


@stands_in_for(seam.prisms_of)
def _prisms_of(world: Any, number: Any) -> Any:
    def prisms_of(world: Any, number: Any) -> Any:
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
def _ways_of(world: Any, number: Any, level: Any) -> Any:
    def ways_of(world: Any, number: Any, level: Any) -> Any:
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
def _memory_of(state: Any) -> Any:
    def memory_of(state: Any) -> Any:
        return seam.Memory(as_array(state.away_m, (len(state.away_m),)))

    return memory_of


@stands_in_for(seam.limits_of)
def _limits_of(world: Any, number: Any) -> Any:
    def limits_of(world: Any, number: Any) -> Any:
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
def _cruise_of(world: Any, number: Any) -> Any:
    def cruise_of(world: Any, number: Any) -> Any:
        return world.spaces[number].lowest_mps, world.spaces[number].highest_mps

    return cruise_of


@stands_in_for(seam.wind_of)
def _wind_of(world: Any, number: Any) -> Any:
    def wind_of(world: Any, number: Any) -> Any:
        return world.spaces[number].wind_x_mps, world.spaces[number].wind_y_mps

    return wind_of
