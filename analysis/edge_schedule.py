"""How many tasks of the benchmark's `edge` can be done in time? A schedule that knows the future.

python analysis/edge_schedule.py [small] [--seeds 4] [--episodes 4] [--turns 2]

Flies forks of the exact engine in world 0, from the first seed of the track on. In each step the
drones are given, one after the other, the command after which most tasks are done in time in this
step and the next. Then the commands of the whole episode are changed one at a time, in so many
turns, and a change is kept if more tasks are done in time. Prints the share in time of each seed,
and what the baseline reaches there. No policy reaches more than 100 %.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import product

import numpy as np

from desim_uav.engine.base import ClosedRequest, RunSettings
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.experiment.bench.kept import reference_of
from desim_uav.experiment.bench.tasks import TRACKS, find_task
from desim_uav.model.rules import Action, Outcome
from desim_uav.sample_path import SamplePath, draw
from desim_uav.world import World, build_world

MEASURE = "deadlines_met_percent"
TRIES = 3
"""How often the drones choose in a step, each knowing what the others chose last."""

Plan = list[list[int]]
"""The command of each drone in each step of an episode."""


def main() -> None:
    """Print the shares of all seeds and their mean."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("size", nargs="?", default="small", choices=("small", "medium"))
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--episodes", type=int, default=4)
    parser.add_argument("--turns", type=int, default=2)
    asked = parser.parse_args()
    task, track, shares = find_task(f"uav-v1/edge/{asked.size}"), TRACKS["one"], []
    world = build_world(task.scenario(track), 0)
    for seed in track.seeds[: asked.seeds]:
        engine = BatchSimulation(world, RunSettings((True,) * len(world.starts), True))
        paths = [draw(world, seed, episode) for episode in range(asked.episodes)]
        shares.append(np.mean([flown(engine, path, asked.turns) for path in paths]))
        reached = reference_of(task, track, seed).get(MEASURE, float("nan"))
        print(f"seed {seed}: {shares[-1]:.1f} % in time; baseline {reached:.1f} %", flush=True)
    print(f"mean {np.mean(shares):.1f} %: 100 % is {100 / np.mean(shares) - 1:.1%} above it")


def flown(engine: BatchSimulation, path: SamplePath, turns: int) -> float:
    """Fly the schedule of an episode, and return the percentage of its tasks done in time."""
    engine.reset(path)
    start, plan = engine.save(), list[list[int]]()
    for _ in range(engine.world.scenario.episode.steps):
        plan.append(chosen(engine, plan[-1] if plan else [0] * len(engine.world.starts)))
    for _ in range(turns):
        engine.restore(start)
        improve(engine, plan)
    engine.restore(start)
    in_time(engine, plan)
    return share_in_time(engine.log.requests)


def chosen(engine: BatchSimulation, last: Sequence[int]) -> list[int]:
    """Give the commands after which most tasks are done in time in this step and the next."""
    before, commands, most = engine.save(), list(last), -1.0
    for _ in range(TRIES):
        for drone, action in product(range(len(last)), range(len(engine.world.actions))):
            trial = [*commands[:drone], action, *commands[drone + 1 :]]
            engine.restore(before)
            done = in_time(engine, [trial, hovering(engine.world, trial)])
            if done > most:
                most, commands = done, trial
    engine.restore(before)
    engine.step(commands)
    return commands


def improve(engine: BatchSimulation, plan: Plan) -> None:
    """Change commands of a plan one at a time where more tasks are done in time by its end."""
    for step, commands in enumerate(plan):
        before = engine.save()
        most = in_time(engine, plan[step:])
        for drone, action in product(range(len(commands)), range(len(engine.world.actions))):
            old, commands[drone] = commands[drone], action
            engine.restore(before)
            done = in_time(engine, plan[step:])
            if done > most:
                most = done
            else:
                commands[drone] = old
        engine.restore(before)
        engine.step(commands)


def in_time(engine: BatchSimulation, plan: Plan) -> float:
    """Fly a plan until its end or that of the episode; return how many tasks it pays for.

    The reward of the task pays drones for tasks that are done in time.
    """
    paid = 0.0
    for commands in plan:
        snapshot = engine.step(commands)
        paid += float(np.sum(snapshot.rewards))
        if snapshot.terminated or snapshot.truncated:
            break
    return paid


def hovering(world: World, commands: Sequence[int]) -> list[int]:
    """Return the commands to stay, with the same parts of tasks that are offloaded."""
    stay = {one.share: k for k, one in enumerate(world.actions) if one.action == Action.HOVER}
    return [stay[world.actions[command].share] for command in commands]


def share_in_time(requests: Sequence[ClosedRequest]) -> float:
    """Return the percentage of tasks done in time, of those that were done or are late."""
    completed = [one for one in requests if one.outcome == Outcome.COMPLETED]
    late = sum(one.deadline_us < one.t_end_us for one in completed)
    late_open = sum(
        one.deadline_us <= one.t_end_us for one in requests if one.outcome != Outcome.COMPLETED
    )
    return 100.0 * (len(completed) - late) / (len(completed) + late_open)


if __name__ == "__main__":
    main()
