"""Rewards at the end of each step: R1, R2 and R3 of the paper (see ``model.rewards``)."""

from __future__ import annotations

from desim_uav.model.kernels import rule
from desim_uav.rules.flight import way_back
from desim_uav.rules.rows import Constants, Drone, Seen, State
from desim_uav.rules.words import CRASHED, QUEUED, US

COVERAGE, COVERAGE_BATTERY, MULTI_SERVICE = range(3)


@rule
def paper_reward(world: Constants, state: State) -> None:
    """Write R1, R2 or R3."""
    for d in range(len(state.drones)):
        drone, seen = state.drones[d], state.seen[d]
        clear_terms(drone)
        if not QUEUED <= seen.mode <= CRASHED:
            _terms(world, state, drone, seen)
        add_up(state, drone)


@rule
def clear_terms(drone: Drone) -> None:
    """Begin with terms of 0."""
    for k in range(len(drone.terms)):
        drone.terms[k] = 0.0


@rule
def add_up(state: State, drone: Drone) -> None:
    """Write a drone's reward: the sum of its terms, in their order."""
    total = 0.0
    for k in range(len(drone.terms)):
        total += drone.terms[k]
    state.rewards[drone.index] = total


@rule
def _terms(world: Constants, state: State, drone: Drone, seen: Seen) -> None:
    terms = drone.terms
    share = seen.attached_users * len(state.drones) / len(state.users)
    share = share if share < 1.0 else 1.0
    if world.reward == COVERAGE:
        terms[0] = share
        return
    service, cost, way_home = _weights(world, drone, seen)
    signed = world.cost_sign * cost
    if world.reward == COVERAGE_BATTERY:
        terms[0] = service * share
        terms[1] = signed * way_home
        return
    services = world.services
    terms[0] = service * world.weight_users * share
    for k in range(services):
        served, asked = state.counts[2 * services * drone.index + k], state.asked[k]
        if served and asked:
            terms[1 + k] = service * world.weights[k] * (served / asked)
    terms[services + 1] = signed * way_home if cost else signed * 0.0
    terms[services + 2] = signed * 0.0


@rule
def _weights(world: Constants, drone: Drone, seen: Seen) -> tuple[float, float, float]:
    """Return (w_s, w_c, r_c): how much service and the way home count, and what that costs."""
    if not world.limited:
        return 1.0, 0.0, 0.0
    battery_s = seen.battery_us / US
    plan = way_back(world, drone, seen.believed)
    return_s, lost = plan.drained_us / US, plan.station < 0
    cost = 1.0
    if battery_s > 0.0 and not lost:
        cost = min(1.0, return_s / battery_s)
    if seen.battery_us > world.c1_us:
        return 1.0, 0.0, cost
    if not lost and battery_s > return_s:
        if seen.battery_us > world.c2_us:
            return 0.8, 0.2, cost
        if seen.battery_us > world.c3_us:
            return 0.5, 0.5, cost
        if seen.battery_us > world.c4_us:
            return 0.2, 0.8, cost
    return 0.0, 1.0, cost
