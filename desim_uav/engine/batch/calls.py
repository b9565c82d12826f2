"""The compiled engine as Python calls it, with arrays; inside there are only pointers to them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.batch import airlink, drones, machine
from desim_uav.engine.batch.access import mask_of, seen_of, terms_of
from desim_uav.engine.batch.kernels import inner
from desim_uav.engine.batch.memory import (
    ACTIONS,
    AT_REWARDS,
    CRASHES,
    DRONES,
    EPOCH,
    FEATURES,
    FULL,
    NOW,
    OPENED,
    S_ATTACHED,
    TERMINATED,
    TERMS,
    TRUNCATED,
    Fixed,
    Floats,
    Ints,
    Path,
    State,
)
from desim_uav.engine.batch.observations import encode
from desim_uav.engine.batch.pointers import moved, pointer, real_at, small_at, whole_at
from desim_uav.model.kernels import kernel


@inner
def world(w: Fixed) -> Fixed:
    """A world by pointers."""
    return Fixed(pointer(w.i), pointer(w.f))


@inner
def path_at(p: Path, at_i: int, at_f: int) -> Path:
    """One of several sample paths, by pointers (see ``paths_of``)."""
    return Path(moved(pointer(p.i), at_i), moved(pointer(p.f), at_f))


@inner
def state(s: State) -> State:
    """An environment by pointers."""
    return State(pointer(s.i), pointer(s.f))


ADDRESSES = 11
"""Columns of a table of environments: where the arrays ``i`` and ``f`` of their ``Fixed``, ``Path``
and ``State`` are, and the rows that take what they show (see ``Shown``)."""


class Shown(NamedTuple):
    """What an environment shows, by pointers, which a call takes sooner than arrays.

    ``values`` (drones * features,), ``mask`` (drones * actions,); ``reward`` (1,), the mean over
    the drones; ``told``, the MEASURES (0 if they do not exist yet), COUNTS and mean terms; ``over``
    (3,): terminated, truncated, short of room.
    """

    values: Floats
    mask: NDArray[np.int8]
    reward: Floats
    told: Floats
    over: NDArray[np.int8]


@kernel
def step_all(environments: Ints, commands: Ints, which: NDArray[np.bool_]) -> int:
    """A step of many environments, ``which`` of them; how many have run out of room.

    ``environments`` (n, ADDRESSES), ``commands`` (n, drones). -1, and no step, where a command is
    no index of an action.
    """
    for k in range(len(environments)):
        w, _, _ = _environment(environments, k)
        for d in range(commands.shape[1]):
            if not 0 <= commands[k, d] < w.i[ACTIONS]:
                return -1
    for k in range(len(environments)):
        if which[k]:
            w, p, s = _environment(environments, k)
            machine.step(w, p, s, commands[k])
    return look_at_all(environments, which)


@kernel
def look_at_all(environments: Ints, which: NDArray[np.bool_]) -> int:
    """Write what many environments show, ``which`` of them; how many have run out of room."""
    full = 0
    for k in range(len(environments)):
        if which[k]:
            w, _, s = _environment(environments, k)
            full += _look_at(w, s, _shown(environments, k))
    return full


@inner
def _look_at(w: Fixed, s: State, shown: Shown) -> int:
    drones, actions, terms = w.i[DRONES], w.i[ACTIONS], w.i[TERMS]
    told, begun = shown.told, s.i[EPOCH] > 0
    told[0] = s.i[NOW] / 1_000_000
    first, second, third = airlink.measures(w, s)
    told[1], told[2], told[3] = _number(first), _number(second), _number(third)
    told[4], told[5], told[6] = 0.0, s.i[CRASHES], s.i[OPENED]
    for term in range(terms):
        told[7 + term] = 0.0
    reward = 0.0
    for d in range(drones):
        encode(w, s, d, shown.values, d * w.i[FEATURES])
        for action in range(actions):
            shown.mask[d * actions + action] = s.i[mask_of(s, d) + action]
        told[4] += s.i[seen_of(s, d) + S_ATTACHED]
        if begun:
            reward += s.f[s.i[AT_REWARDS] + d]
            for term in range(terms):
                told[7 + term] += s.f[terms_of(s, d) + term]
    for term in range(terms):
        told[7 + term] /= drones
    shown.reward[0] = reward / drones
    shown.over[0], shown.over[1], shown.over[2] = s.i[TERMINATED], s.i[TRUNCATED], s.i[FULL]
    return int(s.i[FULL])


@inner
def _number(measure: float) -> float:
    """A measure, or 0 if it does not exist yet: an info holds numbers only."""
    return 0.0 if math.isnan(measure) else measure


@inner
def _environment(environments: Ints, k: int) -> tuple[Fixed, Path, State]:
    row = environments[k]
    return (
        Fixed(whole_at(row[0]), real_at(row[1])),
        Path(whole_at(row[2]), real_at(row[3])),
        State(whole_at(row[4]), real_at(row[5])),
    )


@inner
def _shown(environments: Ints, k: int) -> Shown:
    row = environments[k]
    return Shown(
        real_at(row[6]), small_at(row[7]), real_at(row[8]), real_at(row[9]), small_at(row[10])
    )


@kernel
def start_afresh(w: Fixed, s: State) -> None:
    """Put the drones at their starts."""
    machine.start_afresh(world(w), state(s))


@kernel
def reset(w: Fixed, p: Path, s: State) -> None:
    """Begin an episode with the drones as they are, and run up to its first decision epoch."""
    machine.reset(world(w), path_at(p, 0, 0), state(s))


@kernel
def step(w: Fixed, p: Path, s: State, commands: Ints) -> None:
    """Give each drone its command (an index of an action) and run to the next decision epoch."""
    machine.step(world(w), path_at(p, 0, 0), state(s), commands)


@kernel
def measures(w: Fixed, s: State) -> tuple[float, float, float]:
    """QoE1-3 so far, open requests by what they have had so far; nan where nothing was asked."""
    return airlink.measures(world(w), state(s))


@kernel
def position(w: Fixed, s: State, d: int) -> tuple[float, float, float]:
    """Where a drone is now: x, y, z."""
    return drones.position(world(w), state(s), d)


@kernel
def queue_up(s: State, d: int, station: int) -> None:
    """The drone is the last at a station; the first ones there have its pads."""
    drones.queue_up(state(s), d, station)


@kernel
def user_state(s: State, user: int) -> int:
    """What a user is doing (see ``UserState``)."""
    return machine.user_state(state(s), user)
