"""Sharing: how requests for a volume share the bandwidth that held rates leave at a drone."""

from __future__ import annotations

from dataclasses import dataclass

from desim_uav.model.sharing import RowSharing
from desim_uav.registry import register
from desim_uav.rowcode.kernels import rule
from desim_uav.rules.rows import Constants, Drone, State
from desim_uav.rules.service import (
    MILLION,
    efficiency_of,
    give_share,
    needed_hz,
    rate_bps,
)


@register("sharing", "held")
@dataclass(frozen=True)
class Held(RowSharing):
    """Shares nothing: a request for a volume holds a fixed rate, and waits until this fits."""

    divides = False


@register("sharing", "equal")
@dataclass(frozen=True)
class Equal(RowSharing):
    """Gives each request the same bandwidth, in whole Hz."""

    def divide(self, world: Constants, state: State, drone: Drone, phase: int) -> None:
        """Give each request an equal part of the free bandwidth."""
        each_hz = drone.free_hz // len(drone.sharing)
        _give_parts(world, state, drone, each_hz, each_hz, MILLION, phase)


@register("sharing", "proportional_fair")
@dataclass(frozen=True)
class ProportionalFair(RowSharing):
    """Gives each request the whole bandwidth for an equal part of the time.

    These rates have the largest product. They are those of ``equal``, but for rounding, because a
    link of a class carries the same rate in every hertz.
    """

    def divide(self, world: Constants, state: State, drone: Drone, phase: int) -> None:
        """Give each request the free bandwidth for an equal part of the time."""
        count, free_hz = len(drone.sharing), drone.free_hz
        _give_parts(world, state, drone, free_hz // count, free_hz, MILLION * count, phase)


@register("sharing", "max_min")
@dataclass(frozen=True)
class MaxMin(RowSharing):
    """Gives each request the same rate, the largest for which the bandwidth suffices."""

    def divide(self, world: Constants, state: State, drone: Drone, phase: int) -> None:
        """Give each request the largest equal rate, in whole bit/s."""
        hz_per_bps = 0.0
        for k in range(len(drone.sharing)):
            user = state.users[drone.sharing[k]]
            hz_per_bps += MILLION / efficiency_of(world, drone, user)
        rate = int(drone.free_hz / hz_per_bps) + 1
        while occupied_hz(world, state, drone, rate) > drone.free_hz:
            rate -= 1
        for k in range(len(drone.sharing)):
            user = state.users[drone.sharing[k]]
            give_share(world, state, user, needed_hz(world, drone, user, rate), rate, phase)


@register("sharing", "max_rate")
@dataclass(frozen=True)
class MaxRate(RowSharing):
    """Gives all bandwidth to the request whose link has the highest class; the others wait.

    If several have this class, it is the one that was made first, and then the lowest user's.
    """

    def divide(self, world: Constants, state: State, drone: Drone, phase: int) -> None:
        """Give the free bandwidth to one request."""
        best = 0
        for k in range(1, len(drone.sharing)):
            link_class = state.users[drone.sharing[k]].classes[drone.index]
            if link_class > state.users[drone.sharing[best]].classes[drone.index]:
                best = k
        for k in range(len(drone.sharing)):
            if k != best:
                give_share(world, state, state.users[drone.sharing[k]], 0, 0, phase)
        user, most_hz = state.users[drone.sharing[best]], drone.free_hz
        give_share(world, state, user, most_hz, rate_bps(world, drone, user, most_hz), phase)


@rule
def _give_parts(
    world: Constants,
    state: State,
    drone: Drone,
    each_hz: int,
    own_hz: int,
    parts: int,
    phase: int,
) -> None:
    """Give each request ``each_hz``; its rate is its efficiency times ``own_hz`` over ``parts``.

    If the same requests have shared the same bandwidth before, at most one gets another rate.
    """
    first, end = 0, len(drone.sharing)
    if drone.shared_hz == drone.free_hz > 0:
        while first < end and drone.sharing[first] != drone.regraded - 1:
            first += 1
        end = min(first + 1, end)
    drone.shared_hz, drone.regraded = drone.free_hz, 0
    for k in range(first, end):
        user = state.users[drone.sharing[k]]
        rate = own_hz * efficiency_of(world, drone, user) // parts
        give_share(world, state, user, each_hz, rate, phase)


@rule
def occupied_hz(world: Constants, state: State, drone: Drone, rate: int) -> int:
    """Return the bandwidth in Hz that requests which share need together, at one rate for each."""
    total = 0
    for k in range(len(drone.sharing)):
        total += needed_hz(world, drone, state.users[drone.sharing[k]], rate)
    return total
