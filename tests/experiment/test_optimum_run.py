"""Bounds of runs: by hand, and against every sequence of commands in small random worlds."""

from itertools import product

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.model.rules import MOVES
from desim_uav.optimum.run.bound import Run
from desim_uav.sample_path import draw
from tests.engine.helpers import strip

BATTERY = {"autonomy_min": 3, "return_below": 0.7, "respawn_after_min": 1.5}


def small_world(seed, drones=2, steps=5, **changes):
    """Two drones, up to four cells, users anywhere, one or two stations, batteries of 3 steps."""
    rng = np.random.default_rng(seed)
    cells = [(3, 1), (2, 2), (4, 1)][seed % 3]
    size = 240.0 * np.array(cells)
    users = (rng.random((6, 2)) * size).tolist()
    starts = [[int(rng.integers(n)) for n in cells] for _ in range(drones)]
    changes = {
        "battery": {**BATTERY, "autonomy_min": float(rng.choice([2.5, 3, 3.2]))},
        "stations": {
            "count": 1,
            "radius_m": 0,
            "pads": int(rng.integers(1, 3)),
            "full_charge_min": float(rng.choice([0.5, 2.0])),
        },
        "timing": str(rng.choice(["minimum_time", "fill_epoch"])),
        "radius_m": float(rng.uniform(90, 260)),
        **changes,
    }
    return strip(starts, users, cells, steps, **changes)


def useful(world, engine, drone, mask):
    """The allowed commands of a drone, without moves that are blocked, which are hovers."""
    row = engine.state.drones[drone]
    for index, (action, allowed) in enumerate(zip(world.actions, mask, strict=True)):
        if not allowed:
            continue
        dx, dy, dz = MOVES.get(action, (0, 0, 0))
        there = (row.x + dx, row.y + dy, row.level + dz)
        if action not in MOVES or world.grid.can_enter(*there):
            yield index


def state_of(engine):
    """All that the future of drones depends on."""
    now_us = engine.state.now_us
    return tuple(
        (row.mode, row.x, row.y, row.level, row.to_x, row.to_y, row.battery_us)
        + (now_us - row.since_us, row.transit, row.route, row.route_end, row.respawns, row.fallen)
        for row in engine.state.drones
    ) + tuple(tuple(station.queue) for station in engine.state.stations)


def played(world, path, commands):
    engine = Simulation(world, RunSettings((True,) * world.scenario.drones.count, False))
    shown = engine.reset(path)
    for joint in commands:
        shown = engine.step(joint)
    return engine, shown


def best_qoe3(world, path):
    """The largest QoE3 of all sequences of commands; equal states are continued once.

    Coverage adds up over steps, so of two sequences that lead to the same state of all drones only
    the one with more coverage can be the beginning of the best.
    """
    layer = {(): (0.0, ())}
    best = 0.0
    for step in range(world.scenario.episode.steps):
        following = {}
        for _, commands in layer.values():
            engine, shown = played(world, path, commands)
            choices = [
                list(useful(world, engine, drone, mask)) for drone, mask in enumerate(shown.masks)
            ]
            for joint in product(*choices):
                engine, _ = played(world, path, (*commands, list(joint)))
                reached = (engine.measures().qoe3_percent or 0.0) * (step + 1)
                key = state_of(engine)
                if key not in following or following[key][0] < reached:
                    following[key] = reached, (*commands, list(joint))
                best = max(best, reached)
        layer = following
    return best / world.scenario.episode.steps


def best_qoe1(world, path):
    """The largest QoE1 of all sequences of commands, each of which is played to its end."""
    best, steps = 0.0, world.scenario.episode.steps
    sequences = [()]
    for step in range(steps):
        longer = []
        for commands in sequences:
            engine, shown = played(world, path, commands)
            choices = [
                list(useful(world, engine, drone, mask)) for drone, mask in enumerate(shown.masks)
            ]
            longer += [(*commands, list(joint)) for joint in product(*choices)]
        sequences = longer
    for commands in sequences:
        engine, _ = played(world, path, commands)
        requests = engine.log.requests
        if requests:
            shares = [request.done / request.required for request in requests]
            best = max(best, 100.0 * sum(shares) / len(shares))
    return best


def check_qoe3(world, seed=0):
    run = Run(world, seed, 1)
    found, best = run.bound(), best_qoe3(world, draw(world, seed, 0))
    assert best <= found.qoe3_at_most_percent + 1e-9
    assert found.schedule_qoe3_percent <= best + 1e-9
    return best, found


@pytest.mark.parametrize("seed", range(3))
def test_no_commands_cover_more(seed):
    check_qoe3(small_world(seed, steps=4))


@pytest.mark.parametrize("seed", range(2))
def test_no_commands_cover_more_who_walk(seed):
    check_qoe3(small_world(seed, steps=3, users={"mobility": {"kind": "random_walk"}}), seed)


if __name__ == "__main__":
    import sys
    import time

    for seed in range(int(sys.argv[1]), int(sys.argv[2])):
        t = time.process_time()
        b, f = check_qoe3(small_world(seed, steps=int(sys.argv[3])))
        print(
            seed,
            round(b, 3),
            round(f.qoe3_at_most_percent, 3),
            round(f.schedule_qoe3_percent, 3),
            round(time.process_time() - t, 1),
            flush=True,
        )
