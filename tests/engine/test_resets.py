"""A reset leaves nothing of the episode before: all fields of all rows are as in a new engine."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import ENGINES, make_engine
from desim_uav.engine.compiled.pack import lacking
from desim_uav.rowcode.rows import Maybe, held_by, is_number, is_row, number, origin_of
from desim_uav.rules.rows import Course, Drone, State, Update
from desim_uav.rules.words import REST
from desim_uav.sample_path import draw
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests.engine import random_all, random_everything
from tests.engine.helpers import some_command

OF_THE_LOG = {"records", "point_records"}
"""What a step writes for the log, which is not read before the next step has written it."""

MEMORY = {"look", "sky", "away_m", "before", "before_us", "slot_times", "slot_keys", "winners"}
"""Memory, which is derived from the rest or made anew."""

LEFT_OUT = {
    State: {"drones", *OF_THE_LOG, *MEMORY},
    Drone: {"route", "route_end"},  # the hops are compared instead of their numbers
    Course: {"probe"},
}


class Resting:
    """The fields of the course of a drone that rests, whose transit is memory."""

    kinds: ClassVar = {
        name: kind for name, kind in Course.kinds.items() if name not in ("flight", "probe")
    }


QOE = ("reward={kind: qoe, energy: 0.1}", "episode.steps=5")
SHIPPED: dict[str, tuple[str, ...]] = {
    "case8": QOE,
    "case9": ("position_noise={probability: 0.5}", *QOE),
    "delivery_watch": QOE[1:],
    "festival": QOE[1:],
    "interference": QOE[1:],
    "urban_downlink": QOE[1:],
}
BY_DEFAULT = {("case8", "des"), ("case8", "batch"), ("festival", "des"), ("delivery_watch", "des")}


def found_in(one: Any, cls: Any, path: str = "") -> dict[str, Any]:
    """The numbers in a row and in the rows within it, by their paths."""
    numbers: dict[str, Any] = {}
    if cls is Update and one.number < 0:
        return numbers  # an empty place in a buffer
    for name, own in cls.kinds.items():
        value, at = getattr(one, name), f"{path}.{name}"
        if name in LEFT_OUT.get(cls, ()) or value is None:
            continue
        kind = held_by(own) if origin_of(own) is Maybe else own
        if name == "course" and one.transit == REST:
            numbers |= found_in(value, Resting, at)
            continue
        if is_number(kind):
            numbers[at] = number(kind, value)
        elif is_row(kind):
            numbers |= found_in(value, kind, at)
        else:
            of = held_by(kind)
            numbers[f"{at} (entries)"] = len(value)
            for k, each in enumerate(value):
                numbers |= found_in(each, of, f"{at}[{k}]") if is_row(of) else {f"{at}[{k}]": each}
    return numbers


def state_of(engine: Any) -> dict[str, Any]:
    """All numbers of an engine's state, and the hops of drones that return."""
    routes = {f"route of {k}": hops for k, hops in enumerate(engine.routes())}
    return found_in(engine.state, State) | routes


def left(name: str, world: World, steps: int, carry_over: bool) -> dict[str, Any]:
    """What is another number in the second episode of an engine than in the first of a new one.

    The first episode of the other is left after ``steps`` steps, or at its end.
    """
    settings = RunSettings((True,) * world.scenario.drone_count, carry_over, keep_events=True)
    old, new = (make_engine(name, world, settings) for _ in range(2))
    rng, shown = np.random.default_rng(1), old.reset(draw(world, 3, 0))
    while not (shown.terminated or shown.truncated) and shown.step < steps:
        shown = old.step([some_command(world, mask, rng) for mask in shown.masks])
    new.carry(old.carried())
    for engine in (old, new):
        engine.reset(draw(world, 3, 1))
    one, other = state_of(old), state_of(new)
    assert set(one) == set(other)
    return {
        path: (one[path], other[path])
        for path in one
        if one[path] != other[path] and one[path] == one[path]
    }


def check(name: str, world: World) -> None:
    """Hold every field to that of a new engine, however the episode before has ended."""
    for steps in (2, 10**6):
        for carry_over in (False, True):
            assert left(name, world, steps, carry_over) == {}


@pytest.mark.parametrize(
    ("scenario", "name"),
    [
        pytest.param(
            scenario,
            name,
            marks=() if (scenario, name) in BY_DEFAULT else pytest.mark.thorough,
        )
        for scenario in SHIPPED
        for name in ENGINES
    ],
)
def test_nothing_is_left_in_shipped_scenarios(scenario: str, name: str):
    check(name, build_world(load(scenario_path(scenario), SHIPPED[scenario]), 1))


@pytest.mark.thorough
@pytest.mark.parametrize("name", ENGINES)
@pytest.mark.parametrize("seed", [0, 7, 15])
def test_nothing_is_left_of_tasks_and_sensors(seed: int, name: str):
    """In seed 15 drones that fly freely have been commanded shares."""
    check(name, random_everything.world_of(seed))


@pytest.mark.thorough
@pytest.mark.parametrize("name", ENGINES)
@pytest.mark.parametrize("first", range(0, 20, 5))
def test_nothing_is_left_in_random_scenarios(first: int, name: str):
    for seed in range(first, first + 5):
        world = random_all.world_of(seed)
        if name == "des" or not lacking(world):
            check(name, world)
