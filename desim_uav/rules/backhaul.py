"""The backhaul of a sender: what requests that share may get of the capacity that is left.

Requests that hold a rate are admitted only if it fits (``service.fits``). What they leave is for
those that share. Their rates are proposed by the drone's sharing, which knows nothing of the
backhaul, as if there were none. If the sum is too large, all of them are reduced in the same
proportion, and so are the bandwidths. So the cap stands once, here, for each way of sharing, one's
own included, and each keeps what it is about: equal bandwidths, equal times or equal rates remain
equal, and whoever waits for the best link goes on waiting.
"""

from __future__ import annotations

from desim_uav.model.backhaul import UNLIMITED_BPS
from desim_uav.rowcode.compiled_rows import call
from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rules.rows import Constants, Drone, State

ASKING = -1
"""What is left of the capacity while rates are proposed, but not given."""


@rule
def divide(world: Constants, state: State, drone: Drone, phase: int) -> None:
    """Let a drone divide its bandwidth, and its backhaul, among requests that share."""
    if world.radios[drone.radio].backhaul_bps < UNLIMITED_BPS:
        _propose(world, state, drone, phase)
    call(world.radios[drone.radio].divide, (world, state, drone, phase))


@rare_rule
def _propose(world: Constants, state: State, drone: Drone, phase: int) -> None:
    """Add up the rates that a drone's sharing gives, before any of them is given."""
    drone.proposed_bps, drone.left_bps = 0, ASKING
    call(world.radios[drone.radio].divide, (world, state, drone, phase))
    drone.left_bps = max(drone.free_bps, 0)


@rule
def is_too_much(drone: Drone) -> bool:
    """Return whether the rates that were proposed exceed what is left of a drone's backhaul."""
    return drone.proposed_bps > drone.free_bps


@rule
def reduced(drone: Drone, amount: int) -> int:
    """Return a bandwidth or rate in the proportion of what is left to what was proposed."""
    return int(float(amount) * float(drone.free_bps) / float(drone.proposed_bps))
