"""Compiled training: the compiled engine and the learners' loop in one kernel.

The rules of learners are the same source that Python runs (see ``learning.learner``), so both give
the same numbers, bit for bit. This module has only the parts that differ in compiled code: they
write the decision epochs of the compiled engine into the rows of the learners.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.compiled.calls import constants_at, path_at, state_at
from desim_uav.engine.compiled.loop import RESET, START_AFRESH, STEP
from desim_uav.engine.compiled.scratch import use_scratch
from desim_uav.learning import learner
from desim_uav.learning.rows import EpisodeRow, Lesson, QValues
from desim_uav.model.observations import row_or_none
from desim_uav.rowcode.bounds import owner_of
from desim_uav.rowcode.compiled_rows import address_of, call, pointer_to
from desim_uav.rowcode.components import own_kernel, ruled
from desim_uav.rowcode.kernels import kernel, rule, stands_in_for
from desim_uav.rules.requests import measures
from desim_uav.rules.words import CRASHED, REMOVES

Floats = NDArray[np.float64]

RESULTS = 6
"""The number of results of a drone's episode: reward, sum of values, QoE1 to QoE3 and crashes."""

episode_at: Any = pointer_to(EpisodeRow)


class CompiledTraining(NamedTuple):
    """The compiled engine: its rows, and the random numbers of an episode (drones, epochs, 3)."""

    world: Any
    path: Any
    state: Any
    draws: Any


@kernel
def play(
    world: int,
    paths: NDArray[np.int64],
    state: int,
    episode: int,
    parameters: Floats,
    draws: Floats,
    results: Floats,
    scratch: int,
) -> None:
    """Play episodes and learn in them.

    ``world``, ``paths`` (episodes,), ``state`` and ``episode`` are the addresses of rows.
    ``parameters`` (episodes, 3) are those of ``learner.Parameters``, and ``draws`` (episodes,
    drones, epochs, 3) the random numbers. The results are written into ``results`` (episodes,
    drones, RESULTS). A fault ends the last episode played. ``scratch`` is as in ``calls.run``.
    """
    w, s, learning = constants_at(world), state_at(state), episode_at(episode)
    use_scratch(s, scratch)
    for k in range(len(paths)):
        engine = CompiledTraining(w, path_at(paths[k]), s, draws[k])
        if k > 0 and (learning.terminated or parameters[k - 1, 2]):
            call(w.run, (w, engine.path, s, START_AFRESH))
        learner.play(engine, learning, parameters[k])
        first, second, third = measures(w, s)
        for d in range(len(learning.learners)):
            one = learning.learners[d]
            results[k, d, 0], results[k, d, 1] = one.rewards, one.q.sum
            results[k, d, 2], results[k, d, 3], results[k, d, 4] = first, second, third
        for crash in range(len(s.crashed)):
            results[k, s.crashed[crash], 5] += 1
        if s.faults or learning.lost:
            return


@stands_in_for(learner.begin)
def _begin(engine: Any, episode: Any) -> None:
    call(engine.world.run, (engine.world, engine.path, engine.state, RESET))
    _show(engine, episode)


@stands_in_for(learner.step)
def _step(engine: Any, episode: Any) -> None:
    state = engine.state
    for d in range(len(state.drones)):
        state.drones[d].command = episode.learners[d].command
    call(engine.world.run, (engine.world, engine.path, state, STEP))
    for d in range(len(state.drones)):
        episode.learners[d].reward, episode.learners[d].share = state.rewards[d], state.share
    _show(engine, episode)


@rule
def _show(engine: CompiledTraining, episode: EpisodeRow) -> None:
    """Write a decision epoch into the rows of the learners."""
    world, state = engine.world, engine.state
    episode.terminated, episode.truncated = state.terminated, state.truncated
    call(world.describe, (world, state))
    for d in range(len(episode.learners)):
        one, mode = episode.learners[d], state.observations[d].mode
        own = world.types[state.drones[d].type]
        lesson = one.lesson
        for k in range(len(lesson.allowed)):
            lesson.allowed[k] = state.masks[d * len(lesson.allowed) + k]
        uniforms = engine.draws[d, state.step]
        one.explore, one.which, lesson.coin = uniforms[0], uniforms[1], uniforms[2]
        one.lost = int(mode == CRASHED and own.on_crash == REMOVES)
        one.decides = 1 - state.observations[d].forced
        if one.decides:
            lesson.next_state = row_or_none(state.drones[d].features, episode.sizes)
            if lesson.next_state < 0:
                one.decides, episode.lost, episode.terminated = 0, 1, 1


@cache
def compiled_update(algorithm: Any) -> int:
    """Compile an algorithm's ``update``; return its address. Raises Numba's errors."""
    update = ruled(algorithm.update)

    def updated(q: Any, lesson: Any) -> None:
        update(q, lesson)

    owner = owner_of(algorithm)
    return address_of(own_kernel(updated, algorithm), QValues, Lesson, owner=owner)
