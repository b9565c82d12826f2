"""How many tasks of the benchmark's `edge` can be done in time? A schedule that knows the future.

python analysis/edge_schedule.py [small] [--seeds 4] [--episodes 4] [--trials 1500]

Flies forks of the exact engine in world 0, from the first seed of the track on. In each episode the
schedule begins with drones that hover. It is changed at random: one or all drones fly elsewhere for
some steps, or one commands another part of tasks to be offloaded. A change is kept if more tasks
are done in time until the end of the episode and, with drones that hover, at the beginning of the
next one; at first it may also be kept if slightly fewer are (simulated annealing: Kirkpatrick,
Gelatt and Vecchi, 1983, "Optimization by simulated annealing"). Prints the share in time of each
seed, what the baseline reaches there, and for which share of the time the links of a drone are
busy. No policy reaches more than 100 %.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from script import count

from desim_uav.engine.base import ClosedRequest, RunSettings
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.experiment.bench.kept import reference_of
from desim_uav.experiment.bench.tasks import TRACKS, find_task
from desim_uav.model.rules import MOVES, Outcome
from desim_uav.sample_path import SamplePath, draw
from desim_uav.world import World, build_world

MEASURE = "deadlines_met_percent"
FIRST_SHARE = 0.75
"""The part of tasks that is offloaded at first; with less, no task of 4 Mbit is done in time."""

NEXT_STEPS = 6
"""The steps of the next episode that count."""

WARMTH = 0.15
"""The loss that is accepted at first with a probability of 1/e, in the unit of the reward: what a
drone is paid if it does its fair share in a step. It falls to 0 in equal steps."""

TOGETHER, DETOURS, WHOLE = 0.15, 0.8, 0.3
"""The share of changes that send all drones to other cells until the end of the episode; of the
other ones, the shares of detours, and of those that last until the end."""

LONGEST, FARTHEST = 10, 3
"""How many steps the others last at most, and how far a detour leads from the route, in cells of
each direction."""


class Plan(NamedTuple):
    """Where drones are over the map at all epochs, and what each step offloads.

    ``cells`` has the shape (drones, steps + 1, 2), and ``shares`` (drones, steps).
    """

    cells: NDArray[np.int64]
    shares: NDArray[np.float64]


class Flown(NamedTuple):
    """What a plan is paid in each step from some step on, and in the next episode.

    ``states`` are those of the engine after each of these steps.
    """

    paid: list[float]
    after: float
    states: list[Any]


def main() -> None:
    """Print the shares of all seeds and their mean."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("size", nargs="?", default="small", choices=("small", "medium"))
    parser.add_argument("--seeds", type=count(len(TRACKS["one"].seeds)), default=4)
    parser.add_argument("--episodes", type=count(), default=4)
    parser.add_argument("--trials", type=count(), default=1500)
    asked = parser.parse_args()
    task, track, shares = find_task(f"uav-v1/edge/{asked.size}"), TRACKS["one"], []
    world = build_world(task.scenario(track), 0)
    for seed in track.seeds[: asked.seeds]:
        engine = BatchSimulation(world, RunSettings((True,) * len(world.starts), True))
        paths = [draw(world, seed, episode) for episode in range(asked.episodes)]
        busy, own = [], []
        for _ in schedules(engine, paths, asked.trials, seed):
            own.append(share_in_time(engine.log.requests))
            busy.append(busy_percent(engine))
        shares.append(np.mean(own))
        reached = reference_of(task, track, seed).get(MEASURE, float("nan"))
        print(
            f"seed {seed}: {shares[-1]:.1f} % in time; baseline {reached:.1f} %; "
            f"links busy for {np.mean(busy):.1f} % of the time",
            flush=True,
        )
    print(f"mean {np.mean(shares):.1f} %: 100 % is {100 / np.mean(shares) - 1:.1%} above it")


def schedules(
    engine: BatchSimulation, paths: Sequence[SamplePath], trials: int, seed: int
) -> Iterator[Plan]:
    """Fly a schedule in each episode, and give its plan when the episode is over."""
    cells, rng = np.array(engine.world.starts)[:, :2], np.random.default_rng(seed)
    for path, following in zip(paths, [*paths[1:], None], strict=True):
        engine.reset(path)
        search = Schedule(engine, cells, following)
        search.improve(trials, rng)
        engine.restore(search.states[0])
        search.fly(search.plan, 0)
        yield search.plan
        engine.restore(search.states[-1])
        cells = search.plan.cells[:, -1]


class Schedule:
    """A schedule for the episode that an engine has begun, in which drones hover at first.

    ``following`` is the sample path of the next episode, or None.
    """

    def __init__(
        self, engine: BatchSimulation, cells: NDArray[np.int64], following: SamplePath | None
    ) -> None:
        self.engine, self.world, self.following = engine, engine.world, following
        self.steps = self.world.scenario.episode.steps
        self.states = [engine.save()]
        self.plan = Plan(
            np.repeat(cells[:, None], self.steps + 1, axis=1),
            np.full((len(cells), self.steps), FIRST_SHARE),
        )
        self.paid: list[float] = []
        self.after = 0.0
        self.afterwards: dict[bytes, float] = {}
        self._keep(self.plan, 0, self.flown(self.plan, 0))

    @cached_property
    def commands(self) -> dict[tuple[int, int, float | None], int]:
        """The number of each command, by the cells that it moves in x and y, and its share."""
        return {
            (*MOVES.get(one.action, (0, 0, 0))[:2], one.share): number
            for number, one in enumerate(self.world.actions)
        }

    def improve(self, trials: int, rng: np.random.Generator) -> None:
        """Change the plan at random so many times, and keep what is better."""
        for trial in range(trials):
            plan, begin = changed(self.plan, self.world, rng)
            flown = self.flown(plan, begin)
            gain = sum(flown.paid) + flown.after - sum(self.paid[begin:]) - self.after
            warmth = WARMTH * (1.0 - trial / trials)
            if gain >= 0.0 or rng.random() < np.exp(gain / warmth):
                self._keep(plan, begin, flown)

    def _keep(self, plan: Plan, begin: int, flown: Flown) -> None:
        """Replace the plan by one that differs from it from step ``begin`` on."""
        self.plan, self.after = plan, flown.after
        self.paid[begin:], self.states[begin + 1 :] = flown.paid, flown.states

    def flown(self, plan: Plan, begin: int) -> Flown:
        """Fly a plan from step ``begin`` on, and hover at the beginning of the next episode."""
        self.engine.restore(self.states[begin])
        paid, states = self.fly(plan, begin)
        ends = plan.cells[:, -1].tobytes()
        if ends not in self.afterwards:
            self.afterwards[ends] = self._paid_next(len(plan.cells))
        return Flown(paid, self.afterwards[ends], states)

    def _paid_next(self, drones: int) -> float:
        """Return what drones that hover are paid at the beginning of the next episode."""
        if self.following is None:
            return 0.0
        self.engine.reset(self.following)
        hover = [self.commands[0, 0, FIRST_SHARE]] * drones
        return sum(float(sum(self.engine.step(hover).rewards)) for _ in range(NEXT_STEPS))

    def fly(self, plan: Plan, begin: int) -> tuple[list[float], list[Any]]:
        """Fly the steps of a plan from ``begin`` on; return what each is paid, and the states.

        The reward of the task pays drones for tasks that are done in time.
        """
        moves, paid, states = np.diff(plan.cells, axis=1), [], []
        for step in range(begin, self.steps):
            snapshot = self.engine.step(
                [
                    self.commands[(*move.tolist(), float(share))]
                    for move, share in zip(moves[:, step], plan.shares[:, step], strict=True)
                ]
            )
            paid.append(float(sum(snapshot.rewards)))
            states.append(self.engine.save())
        return paid, states


def changed(plan: Plan, world: World, rng: np.random.Generator) -> tuple[Plan, int]:
    """Return a plan that is changed at random, and the first step that may differ."""
    drones, steps = plan.shares.shape
    drone, begin = int(rng.integers(drones)), int(rng.integers(steps))
    cells, map_cells = plan.cells.copy(), np.array(world.grid.cells)
    if rng.random() < TOGETHER:
        for route, aim in zip(cells, rng.integers(0, map_cells, (drones, 2)), strict=True):
            divert(route, aim, begin, steps)
        return plan._replace(cells=cells), begin
    lasts = steps if rng.random() < WHOLE else int(rng.integers(1, LONGEST + 1))
    end = min(steps, begin + lasts)
    if rng.random() >= DETOURS:
        shares = plan.shares.copy()
        shares[drone, begin:end] = rng.choice([one.share for one in world.actions])
        return plan._replace(shares=shares), begin
    away = rng.integers(-FARTHEST, FARTHEST + 1, 2)
    aim = cells[drone, rng.integers(begin, end + 1)] + away
    divert(cells[drone], aim.clip(0, map_cells - 1), begin, end)
    return plan._replace(cells=cells), begin


def divert(route: NDArray[np.int64], aim: NDArray[np.int64], begin: int, end: int) -> None:
    """Change a route (steps + 1, 2): it leads to a cell, and from step ``end`` on back again."""
    goals = route.copy()
    goals[begin + 1 : end + 1] = aim
    for step in range(begin, len(route) - 1):
        route[step + 1] = route[step] + towards(goals[step + 1] - route[step])


def towards(way: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the move to a neighbouring cell that leads a way, along its longer direction."""
    move = np.zeros(2, np.int64)
    longer = int(np.abs(way).argmax())
    move[longer] = np.sign(way[longer])
    return move


def share_in_time(requests: Sequence[ClosedRequest]) -> float:
    """Return the percentage of tasks done in time, of those that were done or are late."""
    completed = [one for one in requests if one.outcome == Outcome.COMPLETED]
    late = sum(one.deadline_us < one.t_end_us for one in completed)
    late_open = sum(
        one.deadline_us <= one.t_end_us for one in requests if one.outcome != Outcome.COMPLETED
    )
    return 100.0 * (len(completed) - late) / (len(completed) + late_open)


def busy_percent(engine: BatchSimulation) -> float:
    """Return for which percentage of an episode drones send or receive, on average.

    As long as any user sends or receives, all bandwidth of its drone is in use.
    """
    log, world = engine.log, engine.world
    hz = sum(world.links[0].bandwidth_hz for _ in world.starts)
    return 100.0 * log.bandwidth_us_hz / (log.duration_us * hz)


if __name__ == "__main__":
    main()
