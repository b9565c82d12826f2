"""R1, R2 and R3 of what a drone has been seen to do: the terms of ``model.rewards``, compiled."""

from __future__ import annotations

from desim_uav.engine.batch.access import plan_of, seen_of, terms_of
from desim_uav.engine.batch.drones import CRASHED, QUEUED
from desim_uav.engine.batch.kernels import part
from desim_uav.engine.batch.memory import (
    AT_ASKED,
    AT_REWARDS,
    AT_WEIGHTS,
    C1_US,
    C2_US,
    C3_US,
    C4_US,
    COST_SIGN,
    DRONES,
    LIMITED,
    PLAN_DRAINED_US,
    PLAN_STATION,
    REWARD,
    REWARD_BATTERY,
    REWARD_COVERAGE,
    S_ATTACHED,
    S_BACK,
    S_BATTERY_US,
    S_MODE,
    SERVICES,
    USERS,
    WEIGHT_USERS,
    Fixed,
    State,
)

S_COUNTS = 8


@part
def reward(w: Fixed, s: State, d: int) -> None:
    """Write the terms of a drone's reward, and their sum in order."""
    kind, services = w.i[REWARD], w.i[SERVICES]
    terms = terms_of(s, d)
    count = 1 if kind == REWARD_COVERAGE else 2 if kind == REWARD_BATTERY else services + 3
    for k in range(count):
        s.f[terms + k] = 0.0
    seen = seen_of(s, d)
    if not QUEUED <= s.i[seen + S_MODE] <= CRASHED:
        share = s.i[seen + S_ATTACHED] * w.i[DRONES] / w.i[USERS]
        share = share if share < 1.0 else 1.0
        if kind == REWARD_COVERAGE:
            s.f[terms + 0] = share
        else:
            service, cost, way_home = _weights(w, s, d)
            signed = w.f[COST_SIGN] * cost
            if kind == REWARD_BATTERY:
                s.f[terms + 0] = service * share
                s.f[terms + 1] = signed * way_home
            else:
                s.f[terms + 0] = service * w.f[WEIGHT_USERS] * share
                for k in range(services):
                    served, asked = s.i[seen + S_COUNTS + k], s.i[s.i[AT_ASKED] + k]
                    if served and asked:
                        s.f[terms + 1 + k] = service * w.f[w.i[AT_WEIGHTS] + k] * (served / asked)
                s.f[terms + services + 1] = signed * way_home if cost else signed * 0.0
                s.f[terms + services + 2] = signed * 0.0
    total = 0.0
    for k in range(count):
        total += s.f[terms + k]
    s.f[s.i[AT_REWARDS] + d] = total


@part
def _weights(w: Fixed, s: State, d: int) -> tuple[float, float, float]:
    """(w_s, w_c, r_c): how much service and the way home count, and what the way home costs."""
    if not w.i[LIMITED]:
        return 1.0, 0.0, 0.0
    battery_us = s.i[seen_of(s, d) + S_BATTERY_US]
    battery_s = battery_us / 1_000_000
    plan = plan_of(w, d, s.i[seen_of(s, d) + S_BACK])
    lost = w.i[plan + PLAN_STATION] < 0
    return_s = w.i[plan + PLAN_DRAINED_US] / 1_000_000
    cost = 1.0
    if battery_s > 0.0 and not lost:
        cost = min(1.0, return_s / battery_s)
    if battery_us > w.i[C1_US]:
        return 1.0, 0.0, cost
    if not lost and battery_s > return_s:
        if battery_us > w.i[C2_US]:
            return 0.8, 0.2, cost
        if battery_us > w.i[C3_US]:
            return 0.5, 0.5, cost
        if battery_us > w.i[C4_US]:
            return 0.2, 0.8, cost
    return 0.0, 1.0, cost
