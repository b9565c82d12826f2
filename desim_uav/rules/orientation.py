"""The cell and the level at which a drone believes itself to be."""

from __future__ import annotations

from desim_uav.model.geometry.grid import cell_index, level_index
from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rules import words
from desim_uav.rules.battery import is_limited
from desim_uav.rules.flight import position
from desim_uav.rules.free_flight import look_home
from desim_uav.rules.note import place
from desim_uav.rules.rows import Constants, Drone, Path, State


@rule
def orient(world: Constants, path: Path, state: State, drone: Drone) -> None:
    """Set the cell and level at which a drone believes itself to be, at a decision epoch.

    Its x and y contain the position errors of the sample path, in cells, which are drawn for each
    step; its altitude is exact. In free flight, the way home is looked for too, from where it is.
    """
    x, y, level = drone.x, drone.y, drone.level
    if len(path.errors) > 0 or drone.transit != words.REST or drone.fallen:
        x, y, level = _cell_of(world, path, state, drone)
    observation = state.observations[drone.index]
    observation.x, observation.y, observation.level = x, y, level
    observation.believed = place(world, x, y, level)
    if drone.off_grid and is_limited(world, drone):
        look_home(world, state, drone)


@rare_rule
def _cell_of(world: Constants, path: Path, state: State, drone: Drone) -> tuple[int, int, int]:
    """Return the cell and the level of a drone that flies or has fallen, or with an error."""
    x_m, y_m, z_m = position(world, state, drone)
    if len(path.errors) > 0:
        error = (drone.index * (world.steps + 1) + state.now_us // world.step_us) * 2
        x_m += path.errors[error] * world.cell_x_m
        y_m += path.errors[error + 1] * world.cell_y_m
    x = cell_index(x_m, world.cell_x_m, world.nx)
    y = cell_index(y_m, world.cell_y_m, world.ny)
    return x, y, level_index(z_m, world.lowest_m, world.level_step_m, world.levels)
