"""The masks at any place are those that a flight meets there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.engine.masks import Masks
from desim_uav.model.rules import Action, Mode
from desim_uav.sample_path import draw
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.engine.helpers import some_command

SMALL: dict[str, Any] = {"drones.battery.autonomy_min": 12, "episode.carry_over": False}
SHIELDED = {**SMALL, "drones.shielded": True}
WORLDS: dict[str, tuple[str, dict[str, Any]]] = {
    "in 2D": ("case4", SMALL),
    "shielded": ("case4", SHIELDED),
    "shielded, in 3D": ("case8", SHIELDED),
    "cruise speeds": ("case4", {**SHIELDED, "drones.motion.cruise": [5, 8]}),
    "by event": ("case4", {**SMALL, "decisions": {"kind": "event", "patience_s": 45}}),
    "shielded, by event": ("case4", {**SHIELDED, "decisions": {"kind": "event", "patience_s": 45}}),
}


@pytest.mark.parametrize("name", WORLDS)
def test_masks_are_those_of_random_flights(name: str):
    case, changes = WORLDS[name]
    world, rng = build_world(load(scenario_path(case), changes), 3), np.random.default_rng(0)
    ceilings = (True,) * world.scenario.drone_count
    masks = Masks(world, ceiling=True)
    engine = Simulation(world, RunSettings(ceilings, carry_over=False))
    different = set()
    for episode in range(3):
        shown = engine.reset(draw(world, 3, episode))
        while not (shown.terminated or shown.truncated):
            for drone, (seen, mask) in enumerate(zip(shown.observations, shown.masks, strict=True)):
                row = engine.state.drones[drone]
                if (
                    seen.mode == Mode.FLYING
                    and row.transit == 0
                    and not row.fallen
                    and sum(mask) > 1
                ):
                    charge = int(engine.state.observations[drone].charge)
                    node = row.x, row.y, row.level
                    assert masks.at(drone, node, charge) == mask
                    different.add(mask)
            shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
    returns = world.actions.index(Action.GOTO_CHARGING_STATION)
    assert len(different) > 1 and any(mask[returns] for mask in different)
    if "drones.shielded" in changes:
        hover = world.actions.index(Action.HOVER)
        assert any(not mask[hover] for mask in different)
