"""Conservation laws, checked after every event under random commands."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.sample_path import draw
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.audit.invariants import audit
from tests.engine.helpers import some_command
from tests.verification.figure import Exact, Figure


def figures(quick: bool = False) -> Iterator[Figure]:
    """The nine cases under random commands."""
    events = broken = 0

    def look(engine: Simulation) -> None:
        nonlocal events, broken
        events += 1
        try:
            audit(engine)
        except AssertionError:
            broken += 1

    for case in range(1, 10):
        for seed in range(1 if quick else 5):
            _play(case, seed, look)
    yield Exact("events after which a law is violated", broken, 0, cases=events)


def _play(case: int, seed: int, look: Callable[[Simulation], None]) -> None:
    world = build_world(load(scenario_path(f"case{case}")), seed)
    rng = np.random.default_rng([case, seed])
    ceilings = (True,) * world.scenario.drones.count
    engine = Simulation(world, RunSettings(ceilings, True, keep_events=True), audit=look)
    for episode in range(2):
        shown = engine.reset(draw(world, seed, episode))
        while not (shown.terminated or shown.truncated):
            shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
