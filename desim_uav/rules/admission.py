"""Admission: which of the requests that wait at a drone it serves."""

from __future__ import annotations

from dataclasses import dataclass

from desim_uav.model.admission import RowAdmission
from desim_uav.model.kernels import rule
from desim_uav.registry import register
from desim_uav.rules.rows import Constants, Drone, Path, State
from desim_uav.rules.service import refuse, serve
from desim_uav.rules.words import OVERBOOKED


@register("admission", "first_come")
@dataclass(frozen=True)
class FirstCome(RowAdmission):
    """Serves requests in order of request time, as in the paper.

    A request that does not fit into the free bandwidth does not block those after it.
    """

    def scan_rows(
        self, world: Constants, path: Path, state: State, drone: Drone, phase: int
    ) -> None:
        """Serve each request in turn that fits into the free bandwidth, and refuse none."""
        waiting, kept = drone.waiting, 0
        for k in range(len(waiting)):
            user = state.users[waiting[k]]
            if world.bandwidth_bps < 0 or user.request.bandwidth_bps <= drone.free_bps:
                serve(world, state, drone, user, phase)
            else:
                waiting[kept] = waiting[k]
                kept += 1
        while len(waiting) > kept:
            waiting.pop()


@rule
def admit(world: Constants, state: State, drone: Drone, number: int, phase: int) -> None:
    """Serve the request of a user, by its number, that waits at a drone, which has bandwidth."""
    user = state.users[number]
    drone.waiting.remove(number)
    if world.bandwidth_bps >= 0 and user.request.bandwidth_bps > drone.free_bps:
        state.faults |= OVERBOOKED
    serve(world, state, drone, user, phase)


@rule
def turn_away(
    world: Constants, path: Path, state: State, drone: Drone, number: int, phase: int
) -> None:
    """Refuse the request of a user, by its number, that waits at a drone, for good."""
    drone.waiting.remove(number)
    refuse(world, path, state, state.users[number], phase)
