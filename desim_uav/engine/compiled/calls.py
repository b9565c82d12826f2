"""The kernels of the compiled engine that Python calls, with the addresses of rows."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.base import COUNTS, MEASURES, OF_STEP
from desim_uav.engine.compiled import loop
from desim_uav.engine.compiled.fetching import begin_fetching, end_fetching
from desim_uav.engine.compiled.loop import RESET, START_AFRESH, STEP
from desim_uav.engine.compiled.scratch import use_scratch, words_at
from desim_uav.model.decisions import discount_of
from desim_uav.model.geometry.coverage import leg_at, walked
from desim_uav.rowcode.compiled_rows import (
    address_of,
    call,
    entries_at,
    pointer_to,
)
from desim_uav.rowcode.kernels import kernel, rare_rule, rule
from desim_uav.rowcode.numba_parts import types
from desim_uav.rules import requests
from desim_uav.rules.due import due, nothing_due
from desim_uav.rules.rows import Begun, Constants, Drone, Path, State
from desim_uav.rules.walks import know_walks, look_anew
from desim_uav.rules.whole_state import write_state
from desim_uav.sky import leg_memory, links, separation
from desim_uav.sky.foresee import foresee_discs, foresee_rings

Ints = NDArray[np.int64]

constants_at: Callable[[int], Constants] = pointer_to(Constants)
path_at: Callable[[int], Path] = pointer_to(Path)
state_at: Callable[[int], State] = pointer_to(State)

floats_at, bytes_at = entries_at(float), entries_at(bool)


def set_functions(constants: Constants, graded: bool, in_air: bool) -> None:
    """Write the addresses of the engine's functions, which are valid in this process.

    Those of components are written by ``components.point_at``. What only some worlds need is
    compiled only for them: changes of links with classes (``graded``), those that are not of rings
    (``in_air``), and distances of drones.
    """
    constants.foresee = address_of(foresee_rings if graded else foresee_discs, *[int] * 10)
    if in_air:
        constants.foresee_in_air = address_of(links.foresee_in_air, *[int] * 10)
        constants.foresee_all = address_of(links.foresee_all, *[int] * 7)
        constants.recall_leg = address_of(leg_memory.recall_leg, *[int] * 7)
        constants.remember_leg = address_of(leg_memory.remember_leg, *[int] * 4)
        constants.better_us = address_of(links.better_us, *[int] * 11, float)
        constants.mark = address_of(links.mark, *[int] * 11)
    if constants.separation_m > 0.0:
        constants.meet = address_of(separation.meet, *[int] * 7)
        constants.least_m = address_of(separation.least_m, *[int] * 6)
    constants.run = address_of(loop.run, Constants, Path, State, int)


@kernel
def run(world: int, path: int, state: int, what: int, scratch: int) -> None:
    """Do one of START_AFRESH, RESET and STEP (see ``loop.run``).

    ``scratch`` is what ``scratch.scratch`` returns in the thread of the call.
    """
    at, own = constants_at(world), state_at(state)
    use_scratch(own, scratch)
    if what == RESET:
        _keep_begun(own)
    call(at.run, (at, path_at(path), own, what))


@rule
def _keep_begun(state: State) -> None:
    """Copy the time, and the drones as they begin an episode, into ``before``."""
    state.before_us = state.now_us
    for d in range(len(state.drones)):
        drone, begun = state.drones[d], state.before[d]
        begun.index, begun.mode, begun.off_grid, begun.place = d, drone.mode, drone.off_grid, 0
        begun.x, begun.y, begun.level = drone.x, drone.y, drone.level
        begun.to_x, begun.to_y, begun.to_level = drone.to_x, drone.to_y, drone.to_level
        begun.transit, begun.hopping, begun.taken = drone.transit, drone.hopping, drone.taken
        begun.route, begun.route_end = drone.route, drone.route_end
        begun.since_us, begun.until_us = drone.since_us, drone.until_us
        begun.charge, begun.counted_m, begun.fallen = drone.charge, drone.counted_m, drone.fallen
        begun.fallen_x_m, begun.fallen_y_m = drone.fallen_x_m, drone.fallen_y_m
        if drone.off_grid:
            _keep_course(drone, begun)
    for k in range(len(state.stations)):
        queue = state.stations[k].queue
        for place in range(len(queue)):
            state.before[queue[place]].place = place


@rare_rule
def _keep_course(drone: Drone, begun: Begun) -> None:
    course, kept = drone.course, begun.course
    kept.x0_m, kept.y0_m, kept.z0_m = course.x0_m, course.y0_m, course.z0_m
    kept.x1_m, kept.y1_m, kept.z1_m = course.x1_m, course.y1_m, course.z1_m
    kept.limit_mps, kept.station = course.limit_mps, course.station
    kept.node, kept.level, kept.share = course.node, course.level, course.share


@kernel
def describe(world: int, state: int) -> None:
    """Write the features that learners observe (see ``model.observations.RowObservation``)."""
    at = constants_at(world)
    call(at.describe, (at, state_at(state)))


@kernel
def aim_all(environments: Ints, aims: NDArray[np.float64], which: NDArray[np.bool_]) -> int:
    """Write the numbers (n, drones, AIMS) of commands of free flight; return 0."""
    for k in range(len(environments)):
        if which[k]:
            own = state_at(environments[k, 2])
            for d in range(aims.shape[1]):
                if own.drones[d].off_grid:
                    course = own.drones[d].course
                    course.aim_x, course.aim_y = aims[k, d, 0], aims[k, d, 1]
                    course.aim_z, course.aim_cruise = aims[k, d, 2], aims[k, d, 3]
                    course.aim_share, course.aim_charge = aims[k, d, 4], aims[k, d, 5]
    return 0


@kernel
def resume(world: int, path: int, state: int, scheduled: Ints) -> None:
    """Schedule all events of a state whose rows have been written, and derive the rest of it.

    ``scheduled`` (events, 3) has the slot, the time and the key of each event.
    """
    at, own = constants_at(world), state_at(state)
    nothing_due(own)
    look_anew(at, path_at(path), own)
    for k in range(len(scheduled)):
        due(own, scheduled[k, 0], scheduled[k, 1], scheduled[k, 2])


# ---- many environments

OUTPUTS = 7
"""The number of arrays of ``OutputRow``."""

ADDRESSES = 3 + OUTPUTS
"""The number of columns of a table of environments, which hold the addresses of constants, sample
path and state, and of the arrays of ``OutputRow``."""

OVER = 7
"""The column of the address of ``OutputRow.over``."""

COUNTED = len(MEASURES) + len(COUNTS)
NUMBERS = COUNTED + len(OF_STEP)
"""Where OF_STEP begins in ``OutputRow.numbers``, after MEASURES and COUNTS, and where it ends,
before the mean terms."""


class OutputRow(NamedTuple):
    """The outputs of an environment at a decision epoch, in arrays that a kernel writes.

    ``observations`` (drones * features,) and ``mask`` (drones * actions,) are those of all drones;
    ``reward`` (1,) is the mean over the drones; ``numbers`` (11 + terms,) are the MEASURES (0 if
    they are not defined yet), the COUNTS, OF_STEP and the mean terms; ``over`` (3,) says whether
    the episode is terminated, truncated, or stopped by a fault. ``rewards`` (drones,) are those of
    the drones, and ``own`` (drones * (4 + terms),) the OWN_COUNTS and the terms of each drone.
    """

    observations: NDArray[np.float64]
    mask: NDArray[np.bool_]
    reward: NDArray[np.float64]
    numbers: NDArray[np.float64]
    over: Any
    rewards: NDArray[np.float64]
    own: NDArray[np.float64]


@kernel
def step_all(
    environments: Ints, commands: Ints, which: NDArray[np.bool_], scratch: int, fetched: int
) -> int:
    """Step the environments ``which`` (n,); return the number of those that a fault has stopped.

    ``environments`` has the shape (n, ADDRESSES) and ``commands`` (n, drones). If a command is not
    the index of an action, no environment is stepped, and the number is -1. ``scratch`` is as in
    ``run``. While an environment is stepped, the first ``fetched`` bytes of the state of the next
    one are fetched (see ``fetching``), which is worth its time if all states do not fit in the
    processor's caches; each is then also looked at while it is there.
    """
    for k in range(len(environments)):
        actions = len(constants_at(environments[k, 0]).moves)
        for d in range(commands.shape[1]):
            if not 0 <= commands[k, d] < actions:
                return -1
    stopped, last = 0, len(environments) - 1
    for k in range(len(environments)):
        if which[k]:
            row, following = environments[k], environments[min(k + 1, last)]
            world, own = constants_at(row[0]), state_at(row[2])
            use_scratch(own, scratch)
            for d in range(commands.shape[1]):
                own.drones[d].command = commands[k, d]
            if fetched > 0:
                begin_fetching(own, following[1], following[2], fetched)
            over = bytes_at(row[OVER], 3)
            over[2] = True  # in case that a component of one's own fails
            call(world.run, (world, path_at(row[1]), own, STEP))
            over[2] = False
            if fetched > 0:
                end_fetching(own)
                stopped += _look_at_row(row)
    return stopped if fetched > 0 else look_at_all(environments, which)


@kernel
def begin_all(environments: Ints, afresh: NDArray[np.bool_], scratch: int) -> int:
    """Begin episodes in all environments (n,); return how many a fault has stopped.

    The drones of those that begin ``afresh`` (n,) are put at their starts first. ``scratch`` is as
    in ``run``.
    """
    for k in range(len(environments)):
        row = environments[k]
        world, path, own = constants_at(row[0]), path_at(row[1]), state_at(row[2])
        use_scratch(own, scratch)
        if afresh[k]:
            call(world.run, (world, path, own, START_AFRESH))
        _keep_begun(own)
        over = bytes_at(row[OVER], 3)
        over[2] = True
        call(world.run, (world, path, own, RESET))
        over[2] = False
    stopped = 0
    for k in range(len(environments)):
        stopped += _look_at_row(environments[k])
    return stopped


@kernel
def fork_all(
    world: int, path: int, state: int, words: int, environments: Ints, which: NDArray[np.bool_]
) -> None:
    """Copy a state of this many words into the environments ``which``, with its sample path.

    Each of them must have memory for a state of as many words. Tables in a state are found by their
    distances from it, so nothing but the block is copied.
    """
    source = words_at(state, words)
    for k in range(len(environments)):
        if which[k]:
            row = environments[k]
            row[0], row[1] = world, path
            target = words_at(row[2], words)
            for word in range(words):
                target[word] = source[word]


@kernel
def faults_of(state: int) -> int:
    """Return the faults of a state (see ``rules.words``)."""
    faults: int = state_at(state).faults
    return faults


@kernel
def look_at_all(environments: Ints, which: NDArray[np.bool_]) -> int:
    """Write the outputs of the environments ``which``; return how many a fault has stopped."""
    stopped = 0
    for k in range(len(environments)):
        if which[k]:
            stopped += _look_at_row(environments[k])
    return stopped


@rare_rule
def _look_at_row(row: Ints) -> int:
    """Write the outputs of an environment, given its row; return whether a fault has stopped it."""
    world, state = constants_at(row[0]), state_at(row[2])
    drones, terms = len(state.drones), len(state.drones[0].terms)
    outputs = OutputRow(
        floats_at(row[3], drones * world.features),
        bytes_at(row[4], len(state.masks)),
        floats_at(row[5], 1),
        floats_at(row[6], NUMBERS + terms),
        bytes_at(row[7], 3),
        floats_at(row[8], drones),
        floats_at(row[9], drones * (4 + terms)),
    )
    stopped: int = _look_at(world, state, outputs)
    return stopped


@kernel
def state_all(
    environments: Ints, places: NDArray[np.float64], out: NDArray[np.float64], scratch: int
) -> None:
    """Write the whole states of all environments into ``out`` (n, numbers).

    ``places`` (users, 2) is memory for the places of the users of one environment, and ``scratch``
    is as in ``run``.
    """
    for k in range(len(environments)):
        row = environments[k]
        world, path, own = constants_at(row[0]), path_at(row[1]), state_at(row[2])
        now_us = own.now_us
        use_scratch(own, scratch)
        know_walks(world, path, own, now_us, now_us)
        legs, begins = path.legs, path.legs_at
        if path.stepwise:
            legs, begins = own.look.walking.legs, own.look.walking.legs_at
        for user in range(len(own.users)):
            leg = leg_at(legs, begins[user], begins[user + 1], now_us)
            places[user, 0], places[user, 1] = walked(legs[leg], now_us)
        write_state(world, own, places, out[k])


@rule
def _look_at(world: Constants, state: State, outputs: OutputRow) -> int:
    numbers, over = outputs.numbers, outputs.over
    over[2] = True  # in case that the observation fails
    numbers[0] = state.now_us / 1_000_000
    first, second, third = requests.measures(world, state)
    numbers[1], numbers[2], numbers[3] = _number(first), _number(second), _number(third)
    for k in range(len(state.masks)):
        outputs.mask[k] = state.masks[k]
    call(world.describe, (world, state))
    observations, features = outputs.observations, world.features
    for d in range(len(state.drones)):
        own, begins = state.drones[d].features, d * features
        for k in range(len(own)):  # those who observe less have zeros behind
            observations[begins + k] = own[k]
    _count(world, state, outputs)
    _pay(state, outputs)
    stopped = int(state.faults != 0)
    over[0], over[1], over[2] = state.terminated, state.truncated, stopped
    return stopped


@rule
def _count(world: Constants, state: State, outputs: OutputRow) -> None:
    """Write COUNTS, OF_STEP and each drone's OWN_COUNTS; times and choices of all are the least."""
    step_us = float(world.step_us)
    drones, numbers, own = len(state.drones), outputs.numbers, outputs.own
    columns = 4 + len(state.drones[0].terms)
    numbers[4], numbers[5], numbers[6] = 0.0, state.crashes, state.opened
    numbers[7] = state.observations[0].elapsed_us / step_us
    numbers[8] = state.observations[0].forced
    for d in range(drones):
        observation, first = state.observations[d], columns * d
        own[first], own[first + 1] = observation.attached_users, 0.0
        own[first + 2], own[first + 3] = observation.elapsed_us / step_us, observation.forced
        numbers[4] += observation.attached_users
        numbers[7] = min(numbers[7], own[first + 2])
        numbers[8] = min(numbers[8], observation.forced)
    numbers[COUNTED] = state.share if state.step > 0 else 0.0
    numbers[COUNTED + 1] = discount_of(world.gamma, numbers[COUNTED])
    for crash in range(len(state.crashed)):
        own[columns * state.crashed[crash] + 1] += 1.0


@rule
def _pay(state: State, outputs: OutputRow) -> None:
    """Write the rewards and their terms, which are 0 before the first step, and their means."""
    drones, terms = len(state.drones), len(state.drones[0].terms)
    numbers, own, paid, reward = outputs.numbers, outputs.own, state.step > 0, 0.0
    for term in range(terms):
        numbers[NUMBERS + term] = 0.0
    for d in range(drones):
        own_reward = state.rewards[d] if paid else 0.0
        outputs.rewards[d] = own_reward
        reward += own_reward
        first = (4 + terms) * d + 4
        for term in range(terms):
            value = state.drones[d].terms[term] if paid else 0.0
            own[first + term] = value
            numbers[NUMBERS + term] += value
    for term in range(terms):
        numbers[NUMBERS + term] /= drones
    outputs.reward[0] = reward / drones


_I64, _TABLE = types.int64, types.int64[:, ::1]
_NUMBERS, _FLAGS = types.float64[:, ::1], types.boolean[::1]

OF_STEPS: dict[Any, tuple[Any, ...]] = {
    run: (_I64,) * 5,
    step_all: (_TABLE, _TABLE, _FLAGS, _I64, _I64),
    look_at_all: (_TABLE, _FLAGS),
}
"""The kernels that runs and environments call at each step, with the types of their arguments."""

OTHERS: dict[Any, tuple[Any, ...]] = {
    describe: (_I64,) * 2,
    aim_all: (_TABLE, types.float64[:, :, ::1], _FLAGS),
    resume: (_I64, _I64, _I64, _TABLE),
    begin_all: (_TABLE, _FLAGS, _I64),
    fork_all: (_I64, _I64, _I64, _I64, _TABLE, _FLAGS),
    faults_of: (_I64,),
    state_all: (_TABLE, _NUMBERS, _NUMBERS, _I64),
}
"""The other kernels of this module."""


def load(kernels: dict[Any, tuple[Any, ...]]) -> None:
    """Load kernels before they are called; they are compiled if they are not on disk."""
    for one, arguments in kernels.items():
        one.compile(arguments)


@rule
def _number(measure: float) -> float:
    """Return a measure, or 0 if it is not defined yet, because an info holds numbers only."""
    return 0.0 if math.isnan(measure) else measure
