"""The backhaul of a sender: what requests that share may get of the capacity that is left.

Requests that hold a rate are admitted only if it fits (``service.fits``). What they leave is for
those that share. Their rates are proposed by the drone's sharing, which knows nothing of the
backhaul, as if there were none. If the sum is too large, all of them are reduced in the same
proportion, and so are the bandwidths. So the cap stands once, here, for each way of sharing, one's
own included, and each keeps what it is about: equal bandwidths, equal times or equal rates remain
equal, and whoever waits for the best link goes on waiting.

The result of a task can come from its site, the sender whose processor has computed it, to another
sender that its user is attached to, over the backhauls of both. It is sent at one rate, all the way
to the user, which counts at both. So that neither has to know what the other gives, the site keeps
an equal part of what held rates leave for each such result, as if all who share it had the same.

Updates in the store of a drone are sent to the ground at the rate that all of these leave: links
come first, because their users move on, while what is stored can wait.
"""

from __future__ import annotations

from desim_uav.model.backhaul import UNLIMITED_BPS
from desim_uav.model.services import SHARING
from desim_uav.rowcode.compiled_rows import call
from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rowcode.rows import Queue
from desim_uav.rules.bands import count_bands, count_sharing, divide_anew, show_band
from desim_uav.rules.rows import Constants, Drone, State, User

ASKING = -1
"""What is left of the capacity while rates are proposed, but not given."""


@rule
def has_one(world: Constants, drone: Drone) -> bool:
    """Return whether a sender has a backhaul of a capacity."""
    return bool(world.radios[drone.radio].backhaul_bps < UNLIMITED_BPS)


@rule
def divide(world: Constants, state: State, drone: Drone, phase: int) -> None:
    """Let a drone divide its bandwidth, and its backhaul, among requests that share."""
    if has_one(world, drone):
        _propose(world, state, drone, phase)
    _divide_bands(world, state, drone, phase)


@rule
def _divide_bands(world: Constants, state: State, drone: Drone, phase: int) -> None:
    """Let a drone divide each of its bands among the requests that share it."""
    for band in range(count_bands(drone)):
        show_band(drone, band)
        if len(drone.sharing) > 0:
            call(world.radios[drone.radio].divide, (world, state, drone, phase))


@rare_rule
def _propose(world: Constants, state: State, drone: Drone, phase: int) -> None:
    """Add up the rates that a drone's sharing gives, before any of them is given.

    Both times they are those of all users, because each depends on the sum.
    """
    drone.proposed_bps, drone.left_bps = 0, ASKING
    divide_anew(drone)
    _divide_bands(world, state, drone, phase)
    divide_anew(drone)
    drone.left_bps = max(for_sharing_bps(drone), 0)


@rule
def is_too_much(drone: Drone) -> bool:
    """Return whether the rates that were proposed exceed what is left of a drone's backhaul."""
    return drone.proposed_bps > for_sharing_bps(drone)


@rule
def reduced(drone: Drone, amount: int) -> int:
    """Return a bandwidth or rate in the proportion of what is left to what was proposed."""
    return int(float(amount) * float(for_sharing_bps(drone)) / float(drone.proposed_bps))


@rule
def for_sharing_bps(drone: Drone) -> int:
    """Return what a drone's backhaul has for those who share its bandwidth."""
    if drone.relayed == 0:
        return drone.free_bps
    return drone.free_bps - drone.relayed * part_bps(drone)


@rule
def for_store_bps(state: State, drone: Drone) -> int:
    """Return what the links of a drone leave of its backhaul for the updates in its store."""
    return max(
        for_sharing_bps(drone)
        - _shared_bps(state, drone, drone.sharing)
        - _shared_bps(state, drone, drone.aside.sharing),
        0,
    )


@rule
def _shared_bps(state: State, drone: Drone, sharing: Queue[int]) -> int:
    """Return the sum of the rates of those who share a band of a drone, and are served by it."""
    shared_bps = 0
    for k in range(len(sharing)):
        request = state.users[sharing[k]].request
        if request.server == drone.index:
            shared_bps += request.rate
    return shared_bps


@rule
def part_bps(drone: Drone) -> int:
    """Return what a drone's backhaul has for each result that it relays."""
    return max(drone.free_bps, 0) // (count_sharing(drone) + drone.relayed)


@rule
def reaches(world: Constants, state: State, drone: Drone, site: int) -> bool:
    """Return whether results come from a site to a drone: it is this one, or both have backhauls.

    A drone that has crashed has no results.
    """
    if site == drone.index:
        return True
    there = world.radios[state.senders[site].radio].backhaul_bps < UNLIMITED_BPS
    return there and world.radios[drone.radio].backhaul_bps < UNLIMITED_BPS


@rule
def relay_of(state: State, drone: Drone, user: User) -> int:
    """Return the site whose backhaul is used by what a drone sends to a user, or -1."""
    if not state.relays or user.request.line > SHARING:
        return -1
    site = state.tasks[user.index].site
    return site if site != drone.index else -1
