"""The cost of a step of both engines against drones x users and against crossings.

    python benchmarks/scaling.py [--quick] [--rounds 5]

From 1 drone and 14 users to 100 and 10,000 (--quick: to 30 and 2,000). The map grows with the
users, so that everywhere as many of them walk on a square kilometre as in case 8, in as large
clusters, and a drone meets as many; the drones stand the farther apart the more users there are to
each. Demand is dynamic. There are no batteries: the table of ways back to the stations is made
once, before the first step, and grows with the map. Each command is any that its mask allows.

The commands are drawn, and the crossings (users who enter or leave a footprint after the episode's
start) are counted, in a run of its own that nobody times; then each engine is told the same. Only
the steps count, not resets. The kernel is the compiled engine without the observations that Python
is shown. CPU time of one process; medians of the rounds, which go through all sizes and engines. At
last the kernel is timed on the largest size with users in no buckets, so that each drone looks at
all of them, and so is its second pass alone, which finds the crossings of all drones' legs of a
step (with buckets: sorting into them included). Writes scaling.csv and scaling.png beside this file
(--quick: nothing).
"""

from __future__ import annotations

import argparse
import csv
import math
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from desim_uav.engine.base import RunSettings
from desim_uav.engine.compiled import BatchSimulation, calls
from desim_uav.engine.compiled.loop import RESET, STEP
from desim_uav.engine.compiled.pack import forget_packed
from desim_uav.engine.compiled.scratch import scratch
from desim_uav.engine.des import Simulation
from desim_uav.engine.episode import Engine
from desim_uav.model.geometry import coverage, crossings, relative
from desim_uav.model.rules import Action
from desim_uav.rowcode.views import array_of, zeros
from desim_uav.rules.rows import State
from desim_uav.sample_path import SamplePath, SamplePaths, draw
from desim_uav.scenario.load import from_mapping
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World, build_world

SIZES = [(1, 14), (3, 48), (10, 500), (30, 2000), (60, 5000), (100, 10_000)]
QUICK = 4
STEPS, STEPS_A_ROUND, LEAST_EPISODES = 30, 300, 2
CELL_M, CELLS_OF_CASE_8, USERS_OF_CASE_8, USERS_A_CLUSTER = 240, 10, 48, 12
RADIUS = 0.4
"""Of the circle on which the drones begin, over the side of the map: case 8's."""

Commands = NDArray[np.int64]
Floats = NDArray[np.float64]
Timed = Callable[[SamplePath, Commands], float]
"""The CPU time of all steps of an episode, given its commands (steps, drones)."""


class Size(NamedTuple):
    """One size: its world, the episodes played in it, and its engines."""

    drones: int
    users: int
    world: World
    crossings: float
    episodes: list[tuple[SamplePath, Commands]]
    engines: dict[str, Timed]


class Row(NamedTuple):
    """What was found for one size; costs in microseconds a step."""

    drones: int
    users: int
    map_km: float
    crossings: float
    simpy_us: float
    compiled_us: float
    kernel_us: float

    @property
    def pairs(self) -> int:
        return self.drones * self.users


AGAINST: dict[str, Callable[[Row], float]] = {
    "drones x users": lambda row: row.pairs,
    "crossings a step": lambda row: row.crossings,
}
COSTS = {"SimPy": "simpy_us", "compiled": "compiled_us", "kernel": "kernel_us"}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="stop at 30 drones, 2000 users")
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    sizes = [size_of(*size) for size in SIZES[: QUICK if args.quick else None]]
    rows = measured(sizes, args.rounds)
    print_table(rows)
    print_fits(rows)
    print_buckets(sizes[-1], args.rounds)
    if not args.quick:
        write(rows, Path(__file__).with_suffix(".csv"))
        plot(rows, Path(__file__).with_suffix(".png"))


# ---- sizes


def size_of(drones: int, users: int) -> Size:
    world = build_world(scenario_of(drones, users), 0)
    paths = [draw(world, 0, episode) for episode in range(episodes_of(drones))]
    rehearsals = [rehearse(world, path) for path in paths]
    crossings = statistics.mean(crossed for _, crossed in rehearsals) / STEPS
    episodes = [(path, told) for path, (told, _) in zip(paths, rehearsals, strict=True)]
    settings = RunSettings((True,) * drones, carry_over=False, keep_steps=False)
    compiled = BatchSimulation(world, settings)
    engines = {
        "simpy_us": engine_steps(Simulation(world, settings)),
        "compiled_us": engine_steps(compiled),
        "kernel_us": kernel_steps(compiled),
    }
    for path, told in episodes:  # kernels compiled, and room made
        for timed in engines.values():
            timed(path, told)
    return Size(drones, users, world, crossings, episodes, engines)


def episodes_of(drones: int) -> int:
    return max(LEAST_EPISODES, round(STEPS_A_ROUND / STEPS / drones))


def scenario_of(drones: int, users: int) -> Scenario:
    cells = round(CELLS_OF_CASE_8 * math.sqrt(users / USERS_OF_CASE_8))
    side_m = CELL_M * cells
    return from_mapping(
        {
            "name": f"scaling-{drones}-{users}",
            "map": {"size_m": [side_m, side_m], "cells": [cells, cells]},
            "drones": {"count": drones, "battery": None},
            "stations": {"count": 0, "radius_m": RADIUS * side_m},
            "users": {
                "count": users,
                "clusters": {"count": math.ceil(users / USERS_A_CLUSTER)},
                "mobility": {"kind": "random_walk"},
            },
            "demand": {"kind": "dynamic"},
            "reward": {"kind": "multi_service"},
            "episode": {"steps": STEPS},
        }
    )


def rehearse(world: World, path: SamplePath) -> tuple[Commands, int]:
    """The commands of an episode, each any that is allowed, and its crossings."""
    ceilings = (True,) * world.scenario.drone_count
    engine = Simulation(world, RunSettings(ceilings, False, keep_events=True))
    rng = np.random.default_rng(path.episode)
    told: list[list[int]] = []
    shown = engine.reset(path)
    while not shown.truncated:
        told.append([int(rng.choice(np.flatnonzero(mask))) for mask in shown.masks])
        shown = engine.step(told[-1])
    events = engine.log.events or []
    inside = [kind for t_us, _, kind, *_ in events if 0 < t_us < world.horizon_us]
    return np.array(told), inside.count("enter") + inside.count("exit")


# ---- engines


def engine_steps(engine: Engine) -> Timed:
    def timed(path: SamplePath, told: Commands) -> float:
        commands = told.tolist()
        engine.reset(path)
        start = time.process_time()
        for command in commands:
            engine.step(command)
        return time.process_time() - start

    return timed


def kernel_steps(engine: BatchSimulation) -> Timed:
    def timed(path: SamplePath, told: Commands) -> float:
        engine.path, _ = engine.prepare(SamplePaths.of(path))
        at, commands = engine.addresses(), array_of(engine.memory, State, "drones")["command"]
        calls.run(*at, RESET, scratch())
        start = time.process_time()
        for command in told:
            commands[:] = command
            calls.run(*at, STEP, scratch())
        elapsed = time.process_time() - start
        engine.check()
        return elapsed

    return timed


def measured(sizes: list[Size], rounds: int) -> list[Row]:
    """The median costs of a step."""
    costs: dict[tuple[int, str], list[float]] = {}
    for _ in range(rounds):
        for index, size in enumerate(sizes):
            for name, timed in size.engines.items():
                elapsed = sum(timed(path, told) for path, told in size.episodes)
                cost = elapsed / (STEPS * len(size.episodes)) * 1e6
                costs.setdefault((index, name), []).append(cost)
    medians = {key: statistics.median(found) for key, found in costs.items()}
    return [
        Row(
            size.drones,
            size.users,
            size.world.area.width_m / 1000,
            size.crossings,
            **{name: medians[index, name] for name in size.engines},
        )
        for index, size in enumerate(sizes)
    ]


# ---- what is told


def print_table(rows: list[Row]) -> None:
    print(f"{'drones':>6}{'users':>7}{'map km':>8}{'crossings':>11}", end="")
    print(f"{'SimPy':>10}{'compiled':>10}{'kernel':>10}   µs/step; SimPy / compiled, kernel")
    for row in rows:
        print(f"{row.drones:6}{row.users:7}{row.map_km:8.1f}{row.crossings:11.1f}", end="")
        print(f"{row.simpy_us:10.1f}{row.compiled_us:10.1f}{row.kernel_us:10.1f}", end="")
        compiled, kernel = row.simpy_us / row.compiled_us, row.simpy_us / row.kernel_us
        print(f"{compiled:10.1f}{kernel:10.1f}")


def print_fits(rows: list[Row]) -> None:
    """Exponents: over all sizes, and over the larger half of them."""
    larger = rows[len(rows) // 2 :]
    print(f"\n{'cost ~ x ** slope':28}{'all sizes':>10}{f'from {larger[0].drones} drones':>18}")
    for against, value in AGAINST.items():
        for name in COSTS:
            print(f"{name + ', ' + against:28}", end="")
            print(f"{slope(rows, value, name):10.2f}{slope(larger, value, name):18.2f}")


def slope(rows: list[Row], value: Callable[[Row], float], name: str) -> float:
    return float(fit(rows, value, name)[0])


def fit(rows: list[Row], value: Callable[[Row], float], name: str) -> NDArray[np.float64]:
    """Slope and intercept of log cost over log value."""
    costs = [getattr(row, COSTS[name]) for row in rows]
    return np.polyfit(np.log([value(row) for row in rows]), np.log(costs), 1)


def print_buckets(size: Size, rounds: int) -> None:
    """How much longer the largest size takes where every drone looks at every user."""
    settings = RunSettings((True,) * size.drones, carry_over=False, keep_steps=False)
    fewest, coverage.FEWEST_BUCKETS = coverage.FEWEST_BUCKETS, 10**9
    forget_packed()
    plain = BatchSimulation(size.world, settings)
    plain.make_room_at_once()
    coverage.FEWEST_BUCKETS = fewest
    forget_packed()
    assert not plain.constants.scene.buckets_x
    engines = {"kernel": size.engines["kernel_us"], "plain": kernel_steps(plain)}
    path, told = size.episodes[0]
    costs = {
        name: statistics.median(timed(path, told) for _ in range(rounds))
        for name, timed in engines.items()
    }
    ratio = costs["plain"] / costs["kernel"]
    print(f"\n{size.drones} drones, {size.users} users: without buckets a step takes {ratio:.1f}")
    near, all_users = second_pass(size, rounds)
    print(f"times as long, its second pass alone {all_users / near:.1f} times (aim: 2.5)")


def second_pass(size: Size, rounds: int) -> tuple[float, float]:
    """CPU time of the second pass for all drones, who fly east, with and without buckets."""
    world, (path, _) = size.world, size.episodes[0]
    legs, offsets = path.walks
    users = coverage.Users(legs, offsets, np.zeros((coverage.SEEN_ROWS, size.users)))
    coverage.look_around(users, 0, world.step_us)
    shape = coverage.bucket_grid(*world.area, world.scenario.drones.footprint_radius_m)
    side = (world.area.width_m / shape[0], world.area.depth_m / shape[1])
    lists = np.empty(shape[0] * shape[1], np.int64), np.empty(size.users, np.int64)
    buckets = coverage.Buckets(shape, side, *lists)
    starts = [world.grid.centre(*cell) for cell in world.starts]
    profile, hop_m = world.only_type.epoch_transits[Action.RIGHT].rows, world.grid.cell_m[0]
    radius_m, span = world.scenario.drones.footprint_radius_m, (0, world.step_us)
    legs = [
        coverage.DroneLeg(profile, (x, y, x + hop_m, y), span, radius_m, fresh=False)
        for x, y in starts
    ]
    room = zeros(relative.Change, 4 * size.users)

    def near() -> int:
        far_m = coverage.sort_into_buckets(users.seen, buckets)
        return sum(crossings.crossings_near(leg, users, buckets, far_m, room) for leg in legs)

    def all_users() -> int:
        return sum(crossings.crossings(leg, users, room) for leg in legs)

    def cost(look: Callable[[], int]) -> float:
        start = time.process_time()
        for _ in range(20):
            look()
        return time.process_time() - start

    assert near() == all_users() > 0
    pairs = [(cost(near), cost(all_users)) for _ in range(rounds)]
    quick, slow = (statistics.median(costs) for costs in zip(*pairs, strict=True))
    return quick, slow


def write(rows: list[Row], path: Path) -> None:
    with path.open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow([*Row._fields[:3], "pairs", *Row._fields[3:]])
        for row in rows:
            numbers = [f"{number:.6g}" for number in row[2:]]
            table.writerow([row.drones, row.users, numbers[0], row.pairs, *numbers[1:]])


def plot(rows: list[Row], path: Path) -> None:
    figure = Figure(figsize=(9, 4), layout="constrained")
    panels = figure.subplots(1, len(AGAINST), sharey=True)
    for axes, (against, value) in zip(panels, AGAINST.items(), strict=True):
        x = np.array([value(row) for row in rows])
        for name, key in COSTS.items():
            exponent, factor = fit(rows, value, name)
            label = f"{name}, slope {exponent:.2f}"
            (line,) = axes.loglog(x, [getattr(row, key) for row in rows], "o", label=label)
            axes.loglog(x, np.exp(factor) * x**exponent, "--", lw=1, color=line.get_color())
        axes.set_xlabel(against)
        axes.grid(which="both", alpha=0.2)
        axes.legend()
    figure.axes[0].set_ylabel("CPU time of a step, µs")
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main()
