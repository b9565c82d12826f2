"""How low can the mean age of the benchmark's `harvest` be? A schedule that knows the future.

python analysis/harvest_schedule.py [small|medium] [--seeds 1] [--episodes 4] [--trials 10000]
                                    [--rounds 200] [-j 2]

Flies forks of the exact engine in world 0, from the first seed of the track on, and searches for
plans by simulated annealing: a random change is kept if the mean age is lower, or with a
probability that falls with its rise and with the trials. At first every drone repeats a trip of up
to three legs from a station for the whole episode, and a change is another station, trip and wait
before it for one drone. Every episode then begins with the best of the trips that were found in any
of them, and single commands are changed, in so many trials. Prints the mean age of each seed, and a
proven bound, for which prices are changed in so many rounds.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from itertools import product

import numpy as np
from numpy.random import Generator
from script import count

from desim_uav.engine.base import RunSettings
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.experiment.bench.tasks import TRACKS
from desim_uav.experiment.processes import results_of
from desim_uav.model.rules import MOVES, Action
from desim_uav.optimum.run.ages import ROUNDS, BoundedAges
from desim_uav.sample_path import SamplePath, draw
from desim_uav.scenario.load import load
from desim_uav.shipped import bench_folder
from desim_uav.world import World, build_world

LEGS, WAITS, TRIPS = 3, 4, 20000
"""The most legs of a trip that is repeated, how many waits before the first one are tried, and the
trials in which trips are changed."""

TRIPS_S, COMMANDS_S, COLD_S = 5.0, 0.1, 0.02
"""A rise of the mean age by so much is kept with a probability of 1/e: while trips are changed and
while commands are changed, at first, and at the end of either."""

EVERY = 6
"""The steps between the states from which plans are flown."""

Plan = list[list[int]]
"""The commands of each drone, which takes the next one whenever it has a choice, then hovers."""

Change = Callable[[int, list[int], int], tuple[list[int], int]]
"""Returns other commands of a drone, and how many of them come before the change, given its number,
its commands and how many of these it uses."""


def main() -> None:
    """Print the mean ages and bounds of all seeds."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("size", nargs="?", default="small", choices=("small", "medium"))
    parser.add_argument("--seeds", type=count(len(TRACKS["one"].seeds)), default=1)
    parser.add_argument("--episodes", type=count(), default=4)
    parser.add_argument("--trials", type=count(), default=10000)
    parser.add_argument("--rounds", type=count(), default=ROUNDS)
    parser.add_argument("-j", dest="jobs", type=count(256), default=1, help="episodes at a time")
    asked = parser.parse_args()
    ages, bounds = [], []
    for seed in TRACKS["one"].seeds[: asked.seeds]:
        episodes = [(asked.size, seed, episode) for episode in range(asked.episodes)]
        plans = results_of(repeating, episodes, asked.jobs)
        work = [(*one, plans, asked.trials) for one in episodes]
        ages.append(np.mean(results_of(lowest, work, asked.jobs)))
        run = BoundedAges(world_of(asked.size), seed, asked.episodes, asked.rounds)
        bounds.append(run.age_at_least_s())
        print(f"seed {seed}: {ages[-1]:.1f} s, no policy is below {bounds[-1]:.1f} s", flush=True)
    print(f"mean {np.mean(ages):.1f} s, {np.mean(ages) / np.mean(bounds) - 1:.1%} above the bound")


def world_of(size: str) -> World:
    """Return world 0 of a task."""
    return build_world(load(bench_folder() / f"harvest-{size}.yaml"), 0)


class Forks:
    """Forks of an episode. Plans are flown from ``states``, each with the commands used so far."""

    def __init__(self, world: World, path: SamplePath) -> None:
        self.world, self.drones = world, len(world.starts)
        settings = RunSettings((False,) * self.drones, False, keep_steps=False)
        self.engine = BatchSimulation(world, settings)
        self.engine.reset(path)
        self.states = [(self.engine.save(), [0] * self.drones)]
        self.next_states, self.counts = self.states, [0] * self.drones
        self.hover = list(world.actions).index(Action.HOVER)

    def age_s(self, plan: Plan, alike: list[int]) -> float:
        """Fly a plan, and return the mean age in seconds.

        The first commands of the drones, so many of each, are those of the plan that was accepted
        last. ``counts`` become the numbers of commands that were used.
        """
        behind = sum(all(map(int.__le__, counts, alike)) for _, counts in self.states)
        self.next_states = self.states[:behind]
        state, counts = self.next_states[-1]
        self.engine.restore(state)
        self.counts, running, step = list(counts), True, EVERY * (behind - 1)
        while running:
            snapshot = self.engine.step([self._next(drone, own) for drone, own in enumerate(plan)])
            running, step = not (snapshot.terminated or snapshot.truncated), step + 1
            if running and step % EVERY == 0:
                self.next_states.append((self.engine.save(), list(self.counts)))
        log = self.engine.log
        return float(np.mean([one.area_us2 for one in log.sensors])) / 2e6 / log.duration_us

    def accept(self) -> None:
        """Fly from the states of the plan that was flown last from now on."""
        self.states = self.next_states

    def _next(self, drone: int, commands: list[int]) -> int:
        """Return the next command of a drone, which is used up if it has a choice."""
        at = self.counts[drone]
        if not self.engine.state.observations[drone].forced:
            self.counts[drone] += 1
        return commands[at] if at < len(commands) else self.hover


def repeating(size: str, seed: int, episode: int) -> Plan:
    """Return the best plan of an episode that the search finds in which drones repeat trips."""
    world = world_of(size)
    rng = np.random.default_rng(episode)
    trips = [list(trips_of(world, drone)) for drone in range(len(world.starts))]

    def other_trip(drone: int, _commands: list[int], _count: int) -> tuple[list[int], int]:
        return trips[drone][int(rng.integers(len(trips[drone])))], 0

    forks = Forks(world, draw(world, seed, episode))
    return annealed(forks, [own[0] for own in trips], other_trip, TRIPS, TRIPS_S, rng)[0]


def lowest(size: str, seed: int, episode: int, plans: Sequence[Plan], trials: int) -> float:
    """Return the lowest mean age of an episode that the search reaches, in seconds.

    It begins with the best of some plans.
    """
    world = world_of(size)
    rng = np.random.default_rng(episode)
    forks = Forks(world, draw(world, seed, episode))
    anew = [0] * forks.drones

    def other_commands(_drone: int, commands: list[int], count: int) -> tuple[list[int], int]:
        return variant(commands, count, world, rng)

    best = min(plans, key=lambda plan: forks.age_s(plan, anew))
    return annealed(forks, best, other_commands, trials, COMMANDS_S, rng)[1]


def annealed(
    forks: Forks, plan: Plan, change: Change, trials: int, warm_s: float, rng: Generator
) -> tuple[Plan, float]:
    """Return the best plan of so many random changes, and its mean age in seconds."""
    age = forks.age_s(plan, [0] * forks.drones)
    forks.accept()
    counts, best, low = forks.counts, plan, age
    for trial in range(trials):
        other, alike = list(plan), list(counts)
        drone = int(rng.integers(forks.drones))
        other[drone], alike[drone] = change(drone, plan[drone], counts[drone])
        other_age = forks.age_s(other, alike)
        rise_s = COLD_S + (warm_s - COLD_S) * (1.0 - trial / trials) ** 2
        if other_age <= age or rng.random() < math.exp((age - other_age) / rise_s):
            plan, age, counts = other, other_age, forks.counts
            forks.accept()
            if age < low:
                best, low = plan, age
    return best, low


def variant(commands: list[int], count: int, world: World, rng: Generator) -> tuple[list[int], int]:
    """Return other commands of a drone, which uses so many of these, and how many come before.

    A command is replaced, inserted, removed or moved, or the rest of a trip is replaced.
    """
    other, actions = list(commands), len(world.actions)
    count = min(count, len(commands))
    first, last = map(int, rng.integers(count, size=2))
    kind, action = rng.integers(6), int(rng.integers(actions))
    if kind <= 1:
        other[first] = action
    elif kind == 2:
        other.insert(first, action)
    elif kind == 3 and count > 1:
        del other[first]
    elif kind == 4:
        other.insert(first, other.pop(last))
        first = min(first, last)
    else:
        home = list(world.actions).index(Action.GOTO_CHARGING_STATION)
        end = other.index(home, first) if home in other[first:] else first
        other[first : end + 1] = [*rng.integers(actions, size=rng.integers(1, 4)).tolist(), home]
    return other, first


def trips_of(world: World, drone: int) -> Iterator[list[int]]:
    """Yield the commands of a drone that flies to a station, waits, and then repeats a trip."""
    number = {action: k for k, action in enumerate(world.actions)}
    legs = [number[one] for one in (*MOVES, Action.HOVER) if one in number]
    home, hover, steps = (
        number[Action.GOTO_CHARGING_STATION],
        number[Action.HOVER],
        world.scenario.episode.steps,
    )
    for station in sorted(set(world.only_type.stations)):
        (x, y), (east, north) = world.starts[drone], station
        way = [number[Action.RIGHT if east > x else Action.LEFT]] * abs(east - x)
        way += [number[Action.FORWARD if north > y else Action.BACKWARD]] * abs(north - y)
        way += [home] * bool(way)
        for length in range(1, LEGS + 1):
            for trip, wait in product(product(legs, repeat=length), range(WAITS)):
                yield (way + [hover] * wait + [*trip, home] * steps)[:steps]


if __name__ == "__main__":
    main()
