"""The bands of a sender: one for all, or one for downloads and one for uploads.

The fields ``free_hz``, ``waiting``, ``sharing``, ``regraded`` and ``shared_hz`` of a drone are of
the one band that it has. If uploads have a band of their own, the fields are those of one of the
two, and ``Drone.aside`` keeps those of the other. Whatever works on a band shows it first. So
admission and sharing, one's own included, find the band that they are asked about in the fields of
the drone, and know of no other.
"""

from __future__ import annotations

from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rowcode.rows import Queue
from desim_uav.rules.rows import Constants, Drone

BOTH = -1
"""Stands for the one band of a drone whose uploads have none of their own."""
DOWN, UP = range(2)
"""The bands of a drone whose uploads have one of their own."""


@rule
def count_bands(drone: Drone) -> int:
    """Return how many bands a drone has."""
    return 1 if drone.band == BOTH else 2


@rule
def show_band(drone: Drone, band: int) -> None:
    """Let the fields of a drone be those of a band (DOWN or UP), if it has two."""
    if drone.band not in (band, BOTH):
        _exchange(drone)


@rule
def count_sharing(drone: Drone) -> int:
    """Return how many requests share what a drone has, in all of its bands."""
    return len(drone.sharing) + len(drone.aside.sharing)


@rule
def is_used(drone: Drone) -> bool:
    """Return whether there are requests in the lines of a drone's links that may get more."""
    return len(drone.waiting) + len(drone.aside.waiting) + count_sharing(drone) > 0


@rule
def lacks_bandwidth(drone: Drone) -> bool:
    """Return whether more is held in one of a drone's bands than there is."""
    return drone.free_hz < 0 or drone.aside.free_hz < 0


@rule
def divide_anew(drone: Drone) -> None:
    """Let no request of a drone keep the part of the bandwidth that it has."""
    drone.shared_hz = drone.aside.shared_hz = 0


@rule
def clear_lines(drone: Drone) -> None:
    """Remove all requests from the lines of a drone's links."""
    drone.waiting.clear()
    drone.sharing.clear()
    drone.aside.waiting.clear()
    drone.aside.sharing.clear()


@rule
def reset_bands(world: Constants, drone: Drone) -> None:
    """Let all of a drone's bandwidth be free; its fields are those of downloads."""
    radio, aside = world.radios[drone.radio], drone.aside
    drone.band = BOTH if radio.uplink_hz < 0 else DOWN
    drone.free_hz, aside.free_hz = radio.bandwidth_hz, max(radio.uplink_hz, 0)
    drone.regraded = aside.regraded = 0
    divide_anew(drone)
    clear_lines(drone)


@rare_rule
def _exchange(drone: Drone) -> None:
    """Exchange the fields of the band that a drone shows and of the other one."""
    aside = drone.aside
    drone.band = UP if drone.band == DOWN else DOWN
    drone.free_hz, aside.free_hz = aside.free_hz, drone.free_hz
    drone.shared_hz, aside.shared_hz = aside.shared_hz, drone.shared_hz
    drone.regraded, aside.regraded = aside.regraded, drone.regraded
    _exchange_entries(drone.waiting, aside.waiting)
    _exchange_entries(drone.sharing, aside.sharing)


@rule
def _exchange_entries(one: Queue[int], other: Queue[int]) -> None:
    """Exchange the entries of two queues of one size."""
    mine, theirs = len(one), len(other)
    for k in range(min(mine, theirs)):
        one[k], other[k] = other[k], one[k]
    for k in range(mine, theirs):
        one.append(other[k])
    for k in range(theirs, mine):
        other.append(one[k])
    while len(one) > theirs:
        one.pop()
    while len(other) > mine:
        other.pop()
