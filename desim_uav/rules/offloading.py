"""Offloading: what part of a task a drone or access point computes for its user."""

from __future__ import annotations

from dataclasses import dataclass

from desim_uav.model.catalogue import drawn_amount
from desim_uav.model.offloading import RowOffloading, Shares
from desim_uav.model.services import COMPUTING
from desim_uav.registry import register
from desim_uav.rowcode.kernels import rule
from desim_uav.rules import words
from desim_uav.rules.bands import count_sharing, show_band
from desim_uav.rules.rows import Constants, Drone, State, User
from desim_uav.rules.service import rate_bps
from desim_uav.rules.stages import count_stages, first_drawn
from desim_uav.rules.tasks import cycles_of


@register("offloading", "always")
@dataclass(frozen=True)
class Always(RowOffloading):
    """Drones compute all tasks."""

    alone = False

    def share(self, world: Constants, state: State, user: User) -> float:
        """Return 1."""
        return 1.0


@register("offloading", "never")
@dataclass(frozen=True)
class Never(RowOffloading):
    """Users compute all tasks themselves."""

    def share(self, world: Constants, state: State, user: User) -> float:
        """Return 0."""
        return 0.0


@register("offloading", "shortest")
@dataclass(frozen=True)
class Shortest(RowOffloading):
    """A task is computed where it will be done first, as far as is known when it is made.

    A user who is attached to no drone computes it itself, and so does one for whom both take the
    same time.
    """

    def share(self, world: Constants, state: State, user: User) -> float:
        """Return 1 if the drone of the user would be done before the user, else 0."""
        return 1.0 if offloaded_us(world, state, user) < alone_us(world, state, user) else 0.0


@register("offloading", "split")
@dataclass(frozen=True)
class Split(RowOffloading):
    """Tasks are divisible: both compute a part, such that they would be done at the same time.

    With T_l and T_o, the times that the whole task would take the user and its drone, the part that
    is offloaded is T_l / (T_l + T_o).
    """

    def share(self, world: Constants, state: State, user: User) -> float:
        """Return the part that is offloaded; 0 if the user is attached to no drone."""
        own_us = alone_us(world, state, user)
        return own_us / (own_us + offloaded_us(world, state, user))


@register("offloading", "commanded")
@dataclass(frozen=True)
class Commanded(RowOffloading):
    """Each command of a drone chooses the part of a task that is offloaded, until the next command.

    It holds for tasks of users who are attached to the drone. A task of a user who is attached to
    an access point, or to nothing yet, is offloaded wholly.
    """

    shares: Shares = (0.0, 0.5, 1.0)
    """The parts from which each command chooses, ascending, from 0 to 1. There is an action for
    each move, or hover, and part (`right+0.5`). In free flight, a command has one more number,
    which chooses a part between the first and the last of them.
    """

    def share(self, world: Constants, state: State, user: User) -> float:
        """Return the part that the drone of the user was commanded."""
        return commanded(world, state, user)


@rule
def commanded(world: Constants, state: State, user: User) -> float:
    """Return the share that was commanded the drone to which a user is attached; otherwise 1.

    Before the first command of the drone in an episode it is the lowest share, unless the drone
    goes on with a command of the episode before.
    """
    if user.holder < 0:
        return 1.0
    drone = state.senders[user.holder]
    if drone.off_grid:
        return drone.course.share
    if drone.taken == words.NO_COMMAND:
        return world.least_share
    return world.moves[drone.taken].share


@rule
def alone_us(world: Constants, state: State, user: User) -> float:
    """Return the time that a whole task takes its user, in microseconds."""
    return float(cycles_of(world, state, user, 1.0)) / float(world.clocks[user.index])


@rule
def offloaded_us(world: Constants, state: State, user: User) -> float:
    """Return how long a whole task would take if it were offloaded now, in microseconds.

    It is sent at the rate that the user would get if it shared the bandwidth and the backhaul
    equally with those who share them now, or at that which it holds; then the processor does what
    is left of the tasks that are there, and this one. It is infinite if the user is attached to no
    drone, or gets no rate.
    """
    if user.holder < 0:
        return float("inf")
    drone, request, total = state.senders[user.holder], user.request, 0.0
    processor, first = world.processors[drone.radio], first_drawn(world, user)
    for k in range(count_stages(world, request)):
        stage = world.stages[world.first_stages[request.service] + k]
        amount = float(drawn_amount(stage, state.drawn, first))
        if stage.line == COMPUTING:
            total += amount / float(processor.clock) + backlog_us(world, state, drone)
        elif amount > 0.0:
            rate = 1 if stage.timed else link_bps(world, state, user, stage.rate, stage.up)
            if rate == 0:
                return float("inf")
            total += amount / float(rate)
    return total


@rule
def link_bps(world: Constants, state: State, user: User, held: int, up: int) -> int:
    """Return the rate that an attached user would get now in bit/s.

    ``held`` is the list of a rate to hold, and ``up`` says whether it is one of uploads.
    """
    if held >= 0:
        return state.drawn[first_drawn(world, user) + held]
    drone = state.senders[user.holder]
    show_band(drone, up)
    rate = rate_bps(world, drone, user, drone.free_hz // (len(drone.sharing) + 1))
    return min(rate, drone.free_bps // (count_sharing(drone) + 1))


@rule
def backlog_us(world: Constants, state: State, drone: Drone) -> float:
    """Return how long a drone's processor needs for the tasks that are there, in microseconds."""
    left, processor = 0.0, world.processors[drone.radio]
    for k in range(len(drone.computing)):
        request = state.users[drone.computing[k]].request
        done = request.done
        if request.server >= 0:
            done += (state.now_us - request.counted_us) * request.rate
        left += float(max(request.required - done, 0))
    return left / float(processor.clock) / float(processor.cores)
