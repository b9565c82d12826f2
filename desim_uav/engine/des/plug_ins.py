"""Admission rules and rewards as functions over rows: the built-in ones and one's own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from desim_uav.engine.constants import REWARDS
from desim_uav.errors import SimulationError
from desim_uav.model.admission import FirstCome, RowAdmission
from desim_uav.model.rewards import RowReward
from desim_uav.model.sums import in_order
from desim_uav.rules.rewards import add_up, clear_terms, paper_reward
from desim_uav.rules.service import first_come, refuse, serve
from desim_uav.rules.words import OVERBOOKED
from desim_uav.world import World

LARGEST_REWARD = 1e100
"""The largest magnitude of a drone's reward; sums of such rewards over a run stay finite."""


def admission(world: World) -> Callable[..., None]:
    """Return a function that scans a drone's queue once by the scenario's admission rule."""
    rule = world.scenario.drones.admission
    if type(rule) is FirstCome:
        return first_come

    if isinstance(rule, RowAdmission):

        def scan_rows(constants: Any, path: Any, state: Any, drone: Any, phase: int) -> None:
            rule.scan_rows(constants, path, state, drone, phase)
            if state.full & OVERBOOKED:
                name = type(rule).__name__
                raise SimulationError(f"admission {name!r} served more than a drone's bandwidth")

        return scan_rows

    def scan(constants: Any, path: Any, state: Any, drone: Any, phase: int) -> None:
        if not drone.waiting:
            return
        free_bps = world.bandwidth_bps if constants.bandwidth_bps < 0 else drone.free_bps
        requests = tuple(state.users[user].request for user in drone.waiting)
        served, refused = rule.scan(requests, free_bps)
        for request in served:
            drone.waiting.remove(request.user)
            if constants.bandwidth_bps >= 0 and request.bandwidth_bps > drone.free_bps:
                name = type(rule).__name__
                raise SimulationError(f"admission {name!r} served more than a drone's bandwidth")
            serve(constants, state, drone, state.users[request.user], phase)
        for request in refused:
            drone.waiting.remove(request.user)
            refuse(constants, path, state, state.users[request.user], phase)

    return scan


def reward(world: World) -> Callable[..., None]:
    """Return a function that writes the drones' rewards for a step."""
    own = world.scenario.reward
    if type(own) in REWARDS:
        return paper_reward
    pay = _over_rows(own) if isinstance(own, RowReward) else _of_observations(world, own)

    def write(constants: Any, state: Any) -> None:
        pay(constants, state)
        if not all(-LARGEST_REWARD <= each <= LARGEST_REWARD for each in state.rewards):
            terms = state.named_terms or [drone.terms for drone in state.drones]
            raise SimulationError(
                f"reward {type(own).__name__!r} gave the drones {list(state.rewards)} of the terms "
                f"{tuple(terms)}; a reward must be a number between -{LARGEST_REWARD:g} and "
                f"{LARGEST_REWARD:g}"
            )

    return write


def _over_rows(own: RowReward) -> Callable[..., None]:
    def pay(constants: Any, state: Any) -> None:
        for drone in state.drones:
            clear_terms(drone)
            own.pay(constants, state, drone)
            add_up(state, drone)

    return pay


def _of_observations(world: World, own: Any) -> Callable[..., None]:
    facts = world.facts

    def pay(constants: Any, state: Any) -> None:
        asked = tuple(state.asked)
        terms = [own.terms(seen, asked, facts) for seen in state.observed()]
        state.rewards[:] = [in_order(each.values()) for each in terms]
        state.named_terms = terms

    return pay
