"""The scenario and the world of each episode: sets of worlds, and curricula over scenario keys."""

from __future__ import annotations

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

from desim_uav.copies import Unchanging
from desim_uav.engine.constants import term_names
from desim_uav.env.arguments import typed
from desim_uav.env.configure import Source, WorldSeed, configured
from desim_uav.errors import ScenarioError, did_you_mean
from desim_uav.model.random.streams import Purpose, uniforms_of
from desim_uav.scenario.schema import Scenario
from desim_uav.spaces import features_of
from desim_uav.world import World, build_world

WORLDS = {
    "train": range(1_000_000, 1_001_024),
    "validation": range(2_000_000, 2_000_128),
    "test": range(3_000_000, 3_000_128),
}
"""The world seeds of the worlds to train in, to choose hyperparameters in, and to report about."""

MOST_WORLDS = 1024
"""The largest number of drawn worlds that a process keeps for later episodes."""

UNITS = ("episodes", "steps")

TaskChange = tuple[int, Mapping[str, Any]]


@typed
@dataclass(frozen=True)
class Curriculum(Unchanging):
    """A schedule over scenario keys: from when on which keys have which values.

    ``stages`` are pairs (from, changes). A stage applies to the episodes that begin when its
    environment has played ``from`` episodes, or has taken ``from`` steps (``unit``), since the
    run began, until the next stage applies. ``changes`` are keys of the scenario and their values,
    as in ``config``; keys that a stage does not name have the values of the scenario.
    """

    stages: Sequence[TaskChange]
    unit: str = "episodes"


@dataclass(frozen=True, eq=False)
class Tasks(Unchanging):
    """What determines the scenario and the world of each episode.

    ``stages`` holds scenarios, each with the number of episodes or steps (``unit``) from which on
    it applies; the first one applies from 0. ``worlds`` are the world seeds of which each episode
    draws one; if it is None, the scenario and the seed of the run determine the world.
    """

    stages: tuple[tuple[int, Scenario], ...]
    unit: str = "episodes"
    worlds: range | None = None

    def require_one_discount(self, library: str) -> None:
        """Raise ScenarioError, unless drones decide by clock, for a library with one discount.

        By event, transitions differ in duration and therefore in their discounts.
        """
        for _, scenario in self.stages:
            scenario.require_one_discount(library)

    def stage(self, episodes: int, steps: int) -> int:
        """Return the index of the stage that applies after so many episodes and steps."""
        count = episodes if self.unit == "episodes" else steps
        return bisect_right(self.stages, count, key=itemgetter(0)) - 1

    def world_seed(self, stage: int, seed: int, episode: int) -> int:
        """Return the world seed of an episode of the run with this seed."""
        fixed = self.stages[stage][1].world_seed
        if fixed is not None:
            return fixed
        if self.worlds is None:
            return seed
        (((uniform,),),) = uniforms_of(seed, Purpose.TASK, [episode], 1, 1)
        return self.worlds[int(uniform * len(self.worlds))]

    def world(self, stage: int, world_seed: int) -> World:
        """Return the world of a stage, which is kept for later if ``worlds`` is given."""
        scenario = self.stages[stage][1]
        if self.worlds is None:
            return build_world(scenario, world_seed)
        return _kept_world(scenario, world_seed)


_KEPT: OrderedDict[tuple[int, int], World] = OrderedDict()
"""Drawn worlds by scenario (which a world holds, so that its ``id`` is not reused) and seed."""


def _kept_world(scenario: Scenario, world_seed: int) -> World:
    """Return a world, which is drawn if it is not among the last MOST_WORLDS."""
    key = id(scenario), world_seed
    if key not in _KEPT:
        _KEPT[key] = build_world(scenario, world_seed)
        if len(_KEPT) > MOST_WORLDS:
            _KEPT.popitem(last=False)
    _KEPT.move_to_end(key)
    return _KEPT[key]


def tasks_of(
    source: Source,
    config: Mapping[str, Any] | None = None,
    world_seed: WorldSeed = "scenario",
    curriculum: Curriculum | Sequence[TaskChange] | None = None,
) -> Tasks:
    """Return the tasks of an environment, for whose parameters see ``UavEnv``.

    Raises ScenarioError with every problem found in the scenario, or else in the curriculum.
    """
    worlds = _worlds_of(world_seed)
    scenario = configured(source, config, None if worlds is not None else world_seed)
    if scenario.world_seed is not None:
        worlds = None
    if curriculum is None:
        return Tasks(((0, scenario),), worlds=worlds)
    schedule = curriculum if isinstance(curriculum, Curriculum) else Curriculum(curriculum)
    stages, problems = _stages(scenario, schedule)
    if problems:
        raise ScenarioError(*problems)
    return Tasks(stages, schedule.unit, worlds)


def _worlds_of(world_seed: WorldSeed) -> range | None:
    """Return the set of worlds that a ``world_seed`` names, if it names one."""
    if isinstance(world_seed, range):
        if not world_seed or min(world_seed) < 0:
            raise ScenarioError(f"world_seed: {world_seed} has no world seeds; they are 0 or more")
        return world_seed
    if not isinstance(world_seed, str) or world_seed == "scenario":
        return None
    if world_seed not in WORLDS:
        names = ["scenario", *WORLDS]
        raise ScenarioError(
            f"world_seed: {world_seed!r}{did_you_mean(world_seed, names)}; allowed: a whole "
            f"number, None, a range, or one of {', '.join(map(repr, names))}"
        )
    return WORLDS[world_seed]


def _stages(
    scenario: Scenario, curriculum: Curriculum
) -> tuple[tuple[tuple[int, Scenario], ...], list[str]]:
    """Return the stages of a curriculum after a first one without changes, and all problems."""
    stages, last, problems = [(0, scenario)], -1, []
    if curriculum.unit not in UNITS:
        problems.append(f"curriculum: unit {curriculum.unit!r}: must be 'episodes' or 'steps'")
    for number, stage in enumerate(curriculum.stages):
        try:
            begin, changes = stage
            ordered = type(begin) is int and begin > last and isinstance(changes, Mapping)
        except (TypeError, ValueError):
            ordered = False
        if not ordered:
            problems.append(
                f"curriculum[{number}]: {stage!r}: must be a pair of a whole number, larger than "
                "that of the stage before, and a mapping of keys to values"
            )
            continue
        last = begin
        try:
            changed = configured(scenario, changes)
        except ScenarioError as error:
            problems += [f"curriculum[{number}]: {problem}" for problem in error.problems]
            continue
        problems += [f"curriculum[{number}]: {each}" for each in _misfits(scenario, changes)]
        stages = [*stages[begin == 0 and len(stages) == 1 :], (begin, changed)]
    return tuple(stages), problems


def _misfits(scenario: Scenario, changes: Mapping[str, Any]) -> Iterable[str]:
    """Yield a problem for each key of a stage that changes the spaces or the keys of infos."""
    before = _shape(scenario)
    if _shape(configured(scenario, changes)) == before:
        return
    misfit = False
    for key, value in changes.items():
        try:
            after = _shape(configured(scenario, {key: value}))
        except ScenarioError:  # it needs the other keys
            continue
        differing = [name for name in before if before[name] != after[name]]
        if differing:
            misfit = True
            yield f"{key}: changes the {', '.join(differing)}, which must stay the same"
    if not misfit:
        yield f"{', '.join(changes)}: together they change the spaces, which must stay the same"


def _shape(scenario: Scenario) -> dict[str, Any]:
    """Return what must be the same in all stages, by name."""
    world = build_world(scenario, scenario.world_seed or 0)
    drones = range(scenario.drone_count)
    return {
        "number of drones": scenario.drone_count,
        "actions": [world.type_of(drone).actions for drone in drones],
        "observation space": [features_of(world, drone) for drone in drones],
        "terms of the reward": term_names(world),
        "whole state": (world.services.names, world.grid.cells),
    }
