"""Admission: the paper's rule, and the functions by which any rule serves or refuses a request."""

from __future__ import annotations

from dataclasses import dataclass

from desim_uav.model.admission import RowAdmission
from desim_uav.registry import register
from desim_uav.rowcode.kernels import rule
from desim_uav.rules.ages import is_sensor
from desim_uav.rules.rows import Constants, Drone, Path, State
from desim_uav.rules.service import close, fits, serve
from desim_uav.rules.updates import refuse_update
from desim_uav.rules.words import ON_REFUSE, OVERBOOKED


@register("admission", "first_come")
@dataclass(frozen=True)
class FirstCome(RowAdmission):
    """Serves requests in order of request time, as in the paper.

    A request that does not fit into the free bandwidth does not block those after it.
    """

    def scan_rows(
        self, world: Constants, path: Path, state: State, drone: Drone, phase: int
    ) -> None:
        """Serve, in turn, each request that fits into the drone's free bandwidth; refuse none."""
        waiting, count = drone.waiting, 0
        for k in range(len(waiting)):
            user = state.users[waiting[k]]
            if fits(world, state, drone, user):
                serve(world, state, drone, user, phase)
            else:
                waiting[count] = waiting[k]
                count += 1
        while len(waiting) > count:
            waiting.pop()


@rule
def admit(world: Constants, state: State, drone: Drone, number: int, phase: int) -> None:
    """Serve the waiting request of user ``number``, who is attached to the drone.

    A request that exceeds the free bandwidth is an error of the admission rule: the fault
    OVERBOOKED is set, and the engine raises SimulationError at the end of the step.
    """
    user = state.users[number]
    drone.waiting.remove(number)
    if not fits(world, state, drone, user):
        state.faults |= OVERBOOKED
    serve(world, state, drone, user, phase)


@rule
def turn_away(
    world: Constants, path: Path, state: State, drone: Drone, number: int, phase: int
) -> None:
    """Close the waiting request of user ``number``, who is attached to the drone, unserved.

    An update of a sensor is dropped, and the next one in its buffer waits in its place.
    """
    user = state.users[number]
    drone.waiting.remove(number)
    if is_sensor(state, user):
        refuse_update(world, path, state, drone, user, phase)
    else:
        close(world, path, state, user, phase, ON_REFUSE)
