"""Measure how long it takes to fork, save and restore a state, in CPU time.

The state is that of case 8 (or another scenario, the argument) in the middle of an episode. Each
line shows the median of repeated measurements, in microseconds.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.engine.compiled.forks import Forks
from desim_uav.env import UavVectorEnv
from desim_uav.sample_path import draw
from desim_uav.scenario.load import load
from desim_uav.shipped import find_scenario
from desim_uav.world import World, build_world

FORKS, REPEATED = 64, 31


def measured_us(call: Callable[[], object], per: int, least_s: float = 0.02) -> float:
    """The median CPU time of a call, divided by what it does so many times (``per``)."""
    times = []
    for _ in range(REPEATED):
        count, begun = 0, time.process_time()
        while (elapsed := time.process_time() - begun) < least_s:
            call()
            count += 1
        times.append(elapsed / count / per * 1e6)
    return float(np.median(times))


def begun(name: str, world: World) -> BatchSimulation:
    """An engine in the middle of an episode, in which the drones hover."""
    drones, steps = world.scenario.drone_count, world.scenario.episode.steps
    settings = RunSettings((True,) * drones, carry_over=True, keep_steps=False)
    engine = make_engine(name, world, settings)
    engine.reset(draw(world, 0, 0))
    for _ in range(steps // 2):
        engine.step([4] * drones)
    return engine  # type: ignore[return-value]


def main(scenario: str) -> None:
    """Print a line for each way to copy a state."""
    world = build_world(load(find_scenario(scenario)), 0)
    engine, simpy = begun("batch", world), begun("des", world)
    siblings, forks = engine.fork(FORKS), Forks(engine, FORKS)
    saved, told = engine.save(), simpy.save()
    commands = np.full((FORKS, len(engine.drones)), 4)
    forks.take()
    print(f"{scenario}: a state of {engine.memory.nbytes:,} bytes; µs of CPU time")

    def forked_and_stepped() -> None:
        forks.take()
        forks.step(commands)

    envs = UavVectorEnv(scenario, FORKS, world_seed=0)
    envs.reset(seed=0)
    ways: dict[str, tuple[Callable[[], object], int]] = {
        "Forks.take, per fork": (forks.take, FORKS),
        "Forks.take and a step, per fork": (forked_and_stepped, FORKS),
        "BatchSimulation.fork_into, per sibling": (lambda: engine.fork_into(siblings), FORKS),
        "UavVectorEnv.assign, per environment": (lambda: envs.assign(0), FORKS),
        "BatchSimulation.save": (engine.save, 1),
        "BatchSimulation.take, of its own state": (lambda: engine.take(saved), 1),
        "BatchSimulation.take, of a SimPy state": (lambda: siblings[0].take(told), 1),
        "Simulation.save": (simpy.save, 1),
        "Simulation.restore": (lambda: simpy.restore(told), 1),
        "Simulation.restore, of a compiled state": (lambda: simpy.restore(saved), 1),
    }
    for name, (call, per) in ways.items():
        print(f"{name:42} {measured_us(call, per):10.2f}")


if __name__ == "__main__":
    main(*(sys.argv[1:] or ["case8"]))
