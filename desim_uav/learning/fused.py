"""Compiled training: the compiled engine, choices of actions and updates in one kernel.

It gives the same numbers as ``Training`` with its readable learners, bit for bit, because the same
kernels choose and learn.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.compiled.calls import constants_at, path_at, state_at
from desim_uav.engine.compiled.loop import RESET, START_AFRESH, STEP
from desim_uav.learning.double_q import update as double_q
from desim_uav.learning.expected_sarsa import update as expected_sarsa
from desim_uav.learning.exploration import epsilon_greedy, value_of
from desim_uav.learning.q_learning import update as q_learning
from desim_uav.learning.sarsa import update as sarsa
from desim_uav.model.compiled_rows import call
from desim_uav.model.kernels import kernel, part, rule
from desim_uav.rules.requests import measures
from desim_uav.rules.rows import Constants, State
from desim_uav.rules.words import CHARGED, CRASHED, FLYING, MINUTE_US, REMOVES

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

ALGORITHMS = ("q_learning", "sarsa", "expected_sarsa", "double_q")
"""The algorithms that are compiled into an episode; a kernel knows each by its index."""

PENDING_STATE, PENDING_ACTION = range(2)
GAINED, DISCOUNT, SUM = range(3)
"""Columns of a drone's open decision, and of the sum of its values."""

LEVELS_OF_STATE, MINUTES_OF_STATE = range(2)
"""The numbers of levels and of minutes in a state of the table; 0 if it has none."""


@kernel
def play(
    world_at: int,
    paths_at: Ints,
    own_at: int,
    algorithm: int,
    q: NDArray[np.float32],
    sizes: Ints,
    laws: Floats,
    gamma: float,
    draws: Floats,
    pending: Ints,
    due: Floats,
    restarts: NDArray[np.bool_],
    told: Floats,
    crashes: Ints,
    allowed: NDArray[np.bool_],
) -> None:
    """Play episodes and learn in them.

    ``world_at``, ``paths_at`` (episodes,) and ``own_at``: the addresses of world, sample paths and
    state. ``q``: (drones, tables, states, actions).
    ``laws``: (episodes, 2), ε and α. ``draws``: (episodes, drones, epochs, 3). ``pending``
    (drones, 2) and ``due`` (drones, 3) hold each drone's open decision: state (-1: none), action,
    its gain and its discount so far, and the sum of the drone's values. ``restarts`` (episodes,):
    whether the next episode begins at the starts. The results are written into ``told`` (episodes,
    drones, 5: reward, sum of values, QoE1-3) and ``crashes`` (episodes, drones). ``allowed``
    (actions,) is a buffer.
    """
    w, s = constants_at(world_at), state_at(own_at)
    for episode in range(len(paths_at)):
        p = path_at(paths_at[episode])
        if episode > 0 and (s.terminated or restarts[episode - 1]):
            call(w.run, (w, p, s, START_AFRESH))
        law = (laws[episode, 0], laws[episode, 1])
        call(w.run, (w, p, s, RESET))
        while not (s.terminated or s.truncated):
            drawn = draws[episode, :, s.step]
            _decide(w, s, algorithm, q, sizes, law, drawn, pending, due, allowed)
            call(w.run, (w, p, s, STEP))
            for d in range(len(s.drones)):
                reward = s.rewards[d]
                due[d, GAINED] += due[d, DISCOUNT] * reward
                due[d, DISCOUNT] *= gamma
                told[episode, d, 0] += reward
        if s.terminated or restarts[episode]:
            drawn = draws[episode, :, s.step]
            _close(w, s, algorithm, q, sizes, law, drawn, pending, due, allowed)
        qoe1, qoe2, qoe3 = measures(w, s)
        for d in range(len(s.drones)):
            told[episode, d, 1] = due[d, SUM]
            told[episode, d, 2], told[episode, d, 3], told[episode, d, 4] = qoe1, qoe2, qoe3
        for k in range(len(s.crashed)):
            crashes[episode, s.crashed[k]] += 1
        if s.faults:
            return


@part
def _decide(
    w: Constants,
    s: State,
    algorithm: int,
    q: NDArray[np.float32],
    sizes: Ints,
    law: tuple[float, float],
    drawn: Floats,
    pending: Ints,
    due: Floats,
    allowed: NDArray[np.bool_],
) -> None:
    """Write a command for each drone: its own choice, or the only one that is allowed."""
    for d in range(len(s.drones)):
        _look(s, d, allowed)
        drone = s.drones[d]
        if _decides(s, d):
            row = state_row(w, s, d, sizes)
            drone.command = _act(algorithm, q[d], row, allowed, law, drawn[d], pending[d], due[d])
        else:
            drone.command = _only(allowed)
            if _is_lost(w, s, d):
                _conclude(algorithm, q[d], allowed, law, drawn[d], pending[d], due[d])


@rule
def _close(
    w: Constants,
    s: State,
    algorithm: int,
    q: NDArray[np.float32],
    sizes: Ints,
    law: tuple[float, float],
    drawn: Floats,
    pending: Ints,
    due: Floats,
    allowed: NDArray[np.bool_],
) -> None:
    """Learn from open decisions at the end of an episode whose drones are not carried over."""
    for d in range(len(s.drones)):
        _look(s, d, allowed)
        if s.terminated or _is_lost(w, s, d):
            _conclude(algorithm, q[d], allowed, law, drawn[d], pending[d], due[d])
        elif _decides(s, d):
            row = state_row(w, s, d, sizes)
            _act(algorithm, q[d], row, allowed, law, drawn[d], pending[d], due[d])
        _forget(pending[d], due[d])


@part
def state_row(w: Constants, s: State, d: int, sizes: Ints) -> int:
    """Return the row of the paper's state in a table (see ``Position``)."""
    seen = s.seen[d]
    row = seen.x * w.ny + seen.y
    if sizes[LEVELS_OF_STATE]:
        row = row * sizes[LEVELS_OF_STATE] + seen.level
    if w.limited:
        row = row * sizes[MINUTES_OF_STATE] + seen.battery_us // MINUTE_US
    return int(row)


@part
def _look(s: State, d: int, allowed: NDArray[np.bool_]) -> None:
    first = d * len(allowed)
    for k in range(len(allowed)):
        allowed[k] = s.masks[first + k] != 0


@part
def _only(allowed: NDArray[np.bool_]) -> int:
    """Return the first allowed action."""
    for k in range(len(allowed)):
        if allowed[k]:
            return k
    return 0


@part
def _decides(s: State, d: int) -> bool:
    mode = s.seen[d].mode
    return mode in (FLYING, CHARGED)


@part
def _is_lost(w: Constants, s: State, d: int) -> bool:
    """Return whether this drone has crashed and will not be replaced."""
    return s.seen[d].mode == CRASHED and w.on_crash == REMOVES


@part
def _act(
    algorithm: int,
    q: NDArray[np.float32],
    state: int,
    allowed: NDArray[np.bool_],
    law: tuple[float, float],
    drawn: Floats,
    pending: Ints,
    due: Floats,
) -> int:
    """Choose an action, and learn from the previous decision."""
    action = epsilon_greedy(q, state, allowed, law[0], drawn[0], drawn[1])
    _learn(algorithm, q, state, allowed, action, law, drawn[2], pending, due)
    pending[PENDING_STATE], pending[PENDING_ACTION] = state, action
    due[GAINED], due[DISCOUNT] = 0.0, 1.0
    return int(action)


@rule
def _conclude(
    algorithm: int,
    q: NDArray[np.float32],
    allowed: NDArray[np.bool_],
    law: tuple[float, float],
    drawn: Floats,
    pending: Ints,
    due: Floats,
) -> None:
    """Learn from the last decision of a drone, after which there is no state."""
    due[DISCOUNT] = 0.0
    _learn(algorithm, q, 0, allowed, _only(allowed), (0.0, law[1]), drawn[2], pending, due)
    _forget(pending, due)


@part
def _forget(pending: Ints, due: Floats) -> None:
    pending[PENDING_STATE] = -1
    due[GAINED], due[DISCOUNT] = 0.0, 1.0


@part
def _learn(
    algorithm: int,
    q: NDArray[np.float32],
    next_state: int,
    allowed: NDArray[np.bool_],
    next_action: int,
    law: tuple[float, float],
    coin: float,
    pending: Ints,
    due: Floats,
) -> None:
    state, action = pending[PENDING_STATE], pending[PENDING_ACTION]
    if state < 0:
        return
    gained, discount = due[GAINED], due[DISCOUNT]
    before = value_of(q, state, action)
    step = (q, state, action, gained, discount, next_state, allowed, next_action, *law, coin)
    if algorithm == 0:
        q_learning(*step)
    elif algorithm == 1:
        sarsa(*step)
    elif algorithm == 2:
        expected_sarsa(*step)
    else:
        double_q(*step)
    due[SUM] += value_of(q, state, action) - before
