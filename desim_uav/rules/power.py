"""What a drone's processor draws from its battery."""

from __future__ import annotations

from desim_uav.rowcode.kernels import rare_rule
from desim_uav.rules.battery import draw_power, is_limited
from desim_uav.rules.rows import Constants, Drone, State


@rare_rule
def power(world: Constants, state: State, drone: Drone) -> None:
    """Let a drone's processor draw what it needs for the tasks that are computed now.

    A core that is given a part of its cycles draws the same part of its power.
    """
    if drone.point >= 0 or not is_limited(world, drone):
        return
    processor, rate = world.processors[drone.radio], 0
    if processor.core_uw == 0 and processor.idle_uw == 0:
        return
    for k in range(len(drone.computing)):
        request = state.users[drone.computing[k]].request
        if request.server >= 0:
            rate += request.rate
    busy = float(rate) / float(processor.clock)
    draw_power(world, state, drone, processor.idle_uw + int(busy * float(processor.core_uw)))
