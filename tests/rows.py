"""Rows made of an observation, for rules and components that are worked by hand."""

from __future__ import annotations

import math
from typing import Any

from desim_uav.model.rules import US
from desim_uav.model.state import Facts, Observation
from desim_uav.rowcode.components import over_rows
from desim_uav.rowcode.rows import Table, blank, fill
from desim_uav.rules import rows
from desim_uav.rules.rows import CellRow, Constants, Drone, PlanRow, State, User


def rows_of(observation: Observation, facts: Facts, asked: tuple[int, ...] = ()) -> Any:
    """The rows of world, state and drone in which the drone knows what the observation says."""
    world, state, services = blank(Constants), blank(State), len(facts.services)
    nx, ny = facts.grid.cells
    limited = observation.battery_s is not None
    world.limited, own = int(limited), blank(rows.TypeRow)
    own.limited, own.capacity = int(limited), round((observation.capacity_s or 0.0) * US)
    own.drain_per_s = US
    world.types = Table([own])
    world.sharers = facts.drones
    world.services, world.three_d, world.steps = services, int(facts.three_d), facts.steps
    world.nx, world.ny, world.levels = nx, ny, len(facts.grid.levels_m)
    world.cell_x_m, world.cell_y_m = facts.grid.cell_m
    world.levels_under_ceiling = facts.grid.levels_under_ceiling
    unlimited = math.isinf(facts.bandwidth_khz)
    world.stations = Table(fill(CellRow, cell) for cell in facts.stations)
    world.ceilings = Table([0] * facts.drones)
    radio = blank(rows.RadioRow)
    radio.flat = 1  # the paper's disc
    radio.bandwidth_hz = -1 if unlimited else round(facts.bandwidth_khz * 1000)
    world.radios = Table([radio])
    plan = (-1, 0, 0, 0, 0)
    if limited and not math.isinf(observation.return_s or 0.0):
        flight_us = round((observation.flight_s or 0.0) * US)
        plan = (
            observation.station or 0,
            flight_us,
            round((observation.return_s or 0.0) * US),
            0,
            0,
        )
    world.plans = Table([fill(PlanRow, plan)])
    state.drones = Table(blank(Drone) for _ in range(max(facts.drones, observation.drone + 1)))
    state.observations = Table(blank(rows.ObservationRow) for _ in state.drones)
    state.users = Table(blank(User) for _ in range(facts.users))
    state.rewards, state.asked = Table([0.0] * len(state.drones)), Table(asked or [0] * services)
    state.counts = Table([0] * 2 * services * len(state.drones))
    for name, counts in (("served", observation.served), ("asking", observation.asking)):
        first = 2 * services * observation.drone + services * (name == "asking")
        state.counts[first : first + len(counts)] = counts
    state.step, state.share = observation.step, 1.0
    world.step_us = round(facts.step_s * US)
    world.horizon_us = facts.steps * world.step_us
    state.now_us = state.epoch_us = observation.step * world.step_us
    drone, seen = state.drones[observation.drone], state.observations[observation.drone]
    drone.index = observation.drone
    drone.mode = seen.mode = int(observation.mode)
    seen.x, seen.y = observation.cell
    seen.level, seen.attached_users = observation.level, observation.attached_users
    seen.charge = round((observation.battery_s or 0.0) * US)
    seen.used_hz = round(observation.bandwidth_khz * 1000)
    return world, state, drone


def terms_of(
    reward: Any, observation: Observation, asked: tuple[int, ...], facts: Facts
) -> dict[str, float]:
    """The terms that a reward over rows pays."""
    world, state, drone = rows_of(observation, facts, tuple(asked))
    names = reward.term_names(facts.services)
    drone.terms = Table([0.0] * len(names))
    over_rows(reward, facts.services).pay(world, state, drone)
    return dict(zip(names, drone.terms, strict=True))


def features_of(encoding: Any, observation: Observation, facts: Facts) -> tuple[float, ...]:
    """The numbers that an observation over rows writes."""
    world, state, drone = rows_of(observation, facts)
    drone.features = Table([math.nan] * len(encoding.features(facts)))
    over_rows(encoding, facts.services).write(world, state, drone)
    return tuple(drone.features)
