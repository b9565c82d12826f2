"""What learners are given, ``position`` and ``local`` of ``model.observations``, compiled."""

from __future__ import annotations

import math

from desim_uav.engine.batch.access import plan_of, seen_of
from desim_uav.engine.batch.kernels import inner
from desim_uav.engine.batch.memory import (
    AT_STATIONS,
    BANDWIDTH_BPS,
    CAPACITY_US,
    CELL_X_M,
    CELL_Y_M,
    COUNTS,
    EPOCH,
    LEVELS_UNDER_CEILING,
    LIMITED,
    NX,
    NY,
    OBSERVATION,
    OBSERVATION_POSITION,
    PLAN_DRAINED_US,
    PLAN_DURATION_US,
    PLAN_STATION,
    S_ATTACHED,
    S_BACK,
    S_BATTERY_US,
    S_LEVEL,
    S_USED_BPS,
    S_X,
    S_Y,
    SERVICES,
    STEPS,
    THREE_D,
    USERS,
    Fixed,
    Floats,
    State,
)

US = 1_000_000


@inner
def encode(w: Fixed, s: State, d: int, out: Floats, first: int) -> None:
    """Write a drone's features into ``out``, from ``first`` on."""
    if w.i[OBSERVATION] == OBSERVATION_POSITION:
        _position(w, s, d, out, first)
    else:
        _local(w, s, d, out, first)


@inner
def _position(w: Fixed, s: State, d: int, out: Floats, k: int) -> None:
    seen = seen_of(s, d)
    out[k], out[k + 1] = s.i[seen + S_X], s.i[seen + S_Y]
    k += 2
    if w.i[THREE_D]:
        out[k] = s.i[seen + S_LEVEL]
        k += 1
    if w.i[LIMITED]:
        out[k] = (s.i[seen + S_BATTERY_US] / US) // 60


@inner
def _local(w: Fixed, s: State, d: int, out: Floats, k: int) -> None:
    seen, users = seen_of(s, d), w.i[USERS]
    out[k] = (s.i[seen + S_X] + 0.5) / w.i[NX]
    out[k + 1] = (s.i[seen + S_Y] + 0.5) / w.i[NY]
    k += 2
    if w.i[THREE_D]:
        out[k] = (s.i[seen + S_LEVEL] + 0.5) / w.i[LEVELS_UNDER_CEILING]
        k += 1
    out[k] = s.i[seen + S_ATTACHED] / users
    k += 1
    for count in range(2 * w.i[SERVICES]):
        out[k + count] = s.i[seen + COUNTS + count] / users
    k += 2 * w.i[SERVICES]
    used = 0.0
    if w.i[BANDWIDTH_BPS] >= 0:
        used = (s.i[seen + S_USED_BPS] / 1000) / (w.i[BANDWIDTH_BPS] / 1000)
    out[k] = 1.0 - used
    out[k + 1] = 1.0 - s.i[EPOCH] / w.i[STEPS]
    if w.i[LIMITED]:
        _way_home(w, s, d, out, k + 2)


@inner
def _way_home(w: Fixed, s: State, d: int, out: Floats, k: int) -> None:
    """Battery, n_B, bearing and flight time."""
    seen, capacity_s = seen_of(s, d), w.i[CAPACITY_US] / US
    plan = plan_of(w, d, s.i[seen + S_BACK])
    station = w.i[plan + PLAN_STATION]
    out[k] = (s.i[seen + S_BATTERY_US] / US) / capacity_s
    out[k + 1] = out[k + 4] = 1.0
    out[k + 2] = out[k + 3] = 0.0
    if station >= 0:
        out[k + 1] = min((w.i[plan + PLAN_DRAINED_US] / US) / capacity_s, 1.0)
        at = w.i[AT_STATIONS] + 2 * station
        east = (w.i[at] - s.i[seen + S_X]) * w.f[CELL_X_M]
        north = (w.i[at + 1] - s.i[seen + S_Y]) * w.f[CELL_Y_M]
        distance = math.sqrt(east * east + north * north)
        if distance > 0.0:
            out[k + 2], out[k + 3] = east / distance, north / distance
        out[k + 4] = min((w.i[plan + PLAN_DURATION_US] / US) / capacity_s, 1.0)
