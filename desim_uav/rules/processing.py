"""Processors: how they divide their cycles among tasks, when they stand still, and what is lost."""

from __future__ import annotations

from dataclasses import dataclass

from desim_uav.model.processing import RowProcessing
from desim_uav.model.services import NOWHERE
from desim_uav.registry import register
from desim_uav.rowcode.kernels import rare_rule, rule
from desim_uav.rules.migration import call_back, is_moving_to
from desim_uav.rules.note import note_stage
from desim_uav.rules.power import power
from desim_uav.rules.rows import Constants, Drone, State
from desim_uav.rules.service import give_rate, stop, wait
from desim_uav.rules.stages import begin_anew, leave, scan_later
from desim_uav.rules.tasks import progress_of, stands_at


@register("processing", "first_come")
@dataclass(frozen=True)
class FirstComeTasks(RowProcessing):
    """Each core computes one task at a time, in the order of their arrival."""

    def process(self, world: Constants, state: State, drone: Drone, phase: int) -> None:
        """Give a core to each of the first tasks."""
        serve_first(world, state, drone, phase)


@register("processing", "earliest_deadline")
@dataclass(frozen=True)
class EarliestDeadline(RowProcessing):
    """Each core computes one task at a time; one with an earlier deadline interrupts another one.

    Of tasks with the same deadline, the one that arrived first comes first.
    """

    by_deadline = True

    def process(self, world: Constants, state: State, drone: Drone, phase: int) -> None:
        """Give a core to each of the first tasks."""
        serve_first(world, state, drone, phase)


@register("processing", "processor_sharing")
@dataclass(frozen=True)
class ProcessorSharing(RowProcessing):
    """All tasks are computed at the same rate, each by one core at most."""

    def process(self, world: Constants, state: State, drone: Drone, phase: int) -> None:
        """Give each of n tasks min(1, cores / n) of a core."""
        processor, count = world.processors[drone.radio], len(drone.computing)
        rate = processor.clock
        if count > processor.cores:
            rate = processor.clock * processor.cores // count
        for k in range(count):
            give_rate(world, state, drone, state.users[drone.computing[k]], 0, rate, phase)


@rule
def serve_first(world: Constants, state: State, drone: Drone, phase: int) -> None:
    """Let each core compute one of the first tasks in the line; the others wait."""
    processor = world.processors[drone.radio]
    for k in range(processor.cores, len(drone.computing)):
        give_rate(world, state, drone, state.users[drone.computing[k]], 0, 0, phase)
    for k in range(min(processor.cores, len(drone.computing))):
        user = state.users[drone.computing[k]]
        give_rate(world, state, drone, user, 0, processor.clock, phase)


@rare_rule
def start_processor(world: Constants, state: State, drone: Drone) -> None:
    """Let the processor of a drone that serves users compute, if it has stood still."""
    if not drone.computes:
        drone.computes = 1
        if len(drone.computing) > 0:
            scan_later(state, drone)
        power(world, state, drone)


@rare_rule
def halt_processor(world: Constants, state: State, drone: Drone, phase: int) -> None:
    """Let the processor of a drone that serves no longer stand still, unless it goes on so."""
    if not world.processors[drone.radio].on_ground:
        drone.computes = 0
        for k in range(len(drone.computing)):
            user = state.users[drone.computing[k]]
            if user.request.server >= 0:
                stop(state, user, phase)
        power(world, state, drone)


@rare_rule
def lose_tasks(world: Constants, state: State, drone: Drone, phase: int) -> None:
    """Let all tasks that a drone has received begin anew, because it has crashed.

    The part of a task of which the result has come down is not lost, though the user may still be
    computing the rest. A task that is on its way to the drone is still where it was.
    """
    drone.computes = 0
    for u in range(len(state.users)):
        user, task = state.users[u], state.tasks[u]
        is_here = task.site == drone.index and user.request.line != NOWHERE
        if user.request.number >= 0 and is_here:
            if user.request.server >= 0:
                stop(state, user, phase)
            line = stands_at(state, user)
            if line >= 0:
                leave(state, state.senders[line], user)
            begin_anew(world, state, user, task.part)
            task.site = -1
            task.restarts += 1
            user.share = progress_of(state, user, 0)
            note_stage(state, phase, drone.index, user)
            if user.holder >= 0 and user.holder != drone.index:
                wait(world, state, state.senders[user.holder], user)
        elif user.request.number >= 0 and is_moving_to(state, user, drone):
            call_back(world, state, user, phase)
    power(world, state, drone)
