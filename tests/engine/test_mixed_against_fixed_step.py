"""Mixed fleets in the engine against the simulator with fixed time steps (``tests/reference``).

Drones fly in turn from cell to cell and freely, over the same buildings and users, in wind or not,
with batteries of time or of energy and common stations. For what the two must have in common see
``test_against_fixed_step.py`` and ``test_free_against_fixed_step.py``.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.model.rules import Mode
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import build_world
from tests.engine.test_free_against_fixed_step import check_case
from tests.reference import mixed
from tests.reference.inputs import Record, Result
from tests.selection import by_default
from tests.verification.convergence import (
    FINEST_S,
    Case,
    chosen,
    inputs_of,
    numbers_of,
    wished,
)
from tests.verification.freely import accepted, drawn
from tests.verification.space import space_of

SEEDS = range(48)
BY_CELLS = {"kind": "bang_coast_bang", "max_speed_mps": 14.0, "max_acceleration_mps2": 4.0}


def freely(seed: int) -> dict[str, Any]:
    """A random scenario in which all drones fly freely, without zones."""
    made = drawn(seed)
    made["map"]["no_fly"] = []
    return made


def by_cells(made: dict[str, Any], seed: int) -> dict[str, Any]:
    """The same scenario, in which all drones fly from cell to cell."""
    motion = {**BY_CELLS, "timing": ("minimum_time", "fill_epoch")[seed % 2]}
    return {**made, "drones": {**made["drones"], "motion": motion}}


def both(made: dict[str, Any], seed: int) -> dict[str, Any]:
    """The same scenario, in which drones do one or the other in turn."""
    types = []
    for drone in range(made["drones"]["count"]):
        whole = made if (drone + seed // 2) % 2 else by_cells(made, seed)
        types.append({**whole["drones"], "name": f"drone{drone}", "count": 1})
    return {**made, "drones": types}


@cache
def case_of(seed: int) -> tuple[Case, tuple[bool, ...]]:
    """An episode under random commands, and which drones fly freely in it."""
    made = accepted(lambda number: both(freely(number), seed), seed)
    numbers = range(seed, seed + 10_000, 1000)
    alone = next(freely(number) for number in numbers if both(freely(number), seed) == made)
    world, rng = build_world(from_mapping(made), seed), np.random.default_rng([13, seed])
    free = tuple(world.type_of(d).free for d in range(world.scenario.drone_count))
    ceilings = tuple(bool(rng.random() < 0.6) for _ in world.starts)
    path = draw(world, seed, 0)
    engine = Simulation(world, RunSettings(ceilings, False, keep_events=True))
    shown, commands = engine.reset(path), []
    while not (shown.truncated or shown.terminated):
        told = [
            wished(rng, world) if freely else chosen(rng, world, mask)
            for freely, mask in zip(free, shown.masks, strict=True)
        ]
        commands.append(told)
        numbers = [numbers_of(one, world) if isinstance(one, list) else one for one in told]
        shown = engine.step(numbers)
    twin = by_cells(alone, seed)
    cells = build_world(from_mapping(twin), seed)
    assert (cells.starts, cells.stations) == (world.starts, world.stations)
    inputs = inputs_of(twin, cells, path, ceilings)
    space = space_of(alone, cells, ceilings)
    return Case(world, inputs, commands, engine.log, space), free


def sampled(seed: int, dt_s: float) -> Result:
    case, free = case_of(seed)
    assert case.space is not None
    return mixed.simulate(case.inputs, case.space, free, case.commands, dt_s)


def check_at(seed: int, dt_s: float) -> None:
    check_case(case_of(seed)[0], sampled(seed, dt_s), dt_s, looks_home)


def looks_home(record: Record) -> bool:
    """Return whether both kinds of drones know their way home at the end of the step."""
    return record.mode in ("flying", "charged")


@pytest.mark.parametrize("seed", by_default([], SEEDS))
def test_agrees_at_the_finest_dt(seed: int) -> None:
    check_at(seed, FINEST_S)


@pytest.mark.thorough
def test_the_scenarios_have_everything_in_them() -> None:
    cases = [case_of(seed) for seed in SEEDS]
    for kind in (True, False):
        steps = [s for case, free in cases for s in case.log.steps if free[s.drone] == kind]
        assert {step.mode for step in steps} == set(Mode)
    assert {case.inputs.rotor is None for case, _ in cases} == {True, False}
    assert {case.inputs.wind_mps == (0.0, 0.0) for case, _ in cases} == {True, False}
    assert {"aim_cruise" in case.world.commands.names for case, _ in cases} == {True, False}
