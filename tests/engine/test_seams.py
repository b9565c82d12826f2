"""Where parts meet: episodes broken off, plug-ins that use their freedom, odd maps."""

from dataclasses import dataclass

import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError, SimulationError
from desim_uav.experiment.run import play
from desim_uav.model.energy.battery import Endurance
from desim_uav.model.motion.motion import REST
from desim_uav.policies import load_policy
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.audit.invariants import audit


def world_of(**keys):
    scenario = from_mapping({"name": "seam"} | keys)
    return build_world(scenario, scenario.effective_world_seed)


@pytest.mark.thorough
@pytest.mark.parametrize("steps", [0, 1, 7])
def test_an_episode_broken_off_is_followed_by_a_fresh_start(steps):
    world = build_world(load(scenario_path("case8")), 0)
    settings = RunSettings((True,) * 3, carry_over=True, keep_events=True)
    logs = []
    for broken_off in (True, False):
        engine = Simulation(world, settings, audit)
        if broken_off:
            engine.reset(draw(world, 0, 0))
            for _ in range(steps):
                engine.step([2, 0, 4])
        shown = engine.reset(draw(world, 0, 1))
        while not shown.truncated:
            shown = engine.step([4, 4, 4])
        logs.append(engine.log)
    assert logs[0].events == logs[1].events
    assert logs[0].steps == logs[1].steps


def test_no_step_outside_an_episode():
    engine = Simulation(world_of(episode={"steps": 1}), RunSettings((True,) * 3, False))
    with pytest.raises(SimulationError, match="call reset first"):
        engine.step([4, 4, 4])
    engine.reset(draw(engine.world, 0, 0))
    engine.step([4, 4, 4])
    with pytest.raises(SimulationError, match="call reset first"):
        engine.step([4, 4, 4])


@dataclass(frozen=True)
class ServeAll:
    """An admission that returns the very sequence it was given."""

    def scan(self, waiting, free_hz):
        return waiting, ()


def test_an_admission_may_return_what_it_was_given():
    world = world_of(
        drones={
            "count": 1,
            "bandwidth_kbps": None,
            "battery": None,
            "start_cells": [[5, 5]],
            "admission": {"kind": f"{__name__}:ServeAll"},
        },
        stations={"count": 0},
        map={"dimensions": 2},
        users={"positions_m": [[1300, 1300]] * 4, "mobility": {"kind": "static"}},
        demand={"kind": "static"},
    )
    (log, _), *_ = play(world, load_policy("hover"), "hover", 0)
    assert [r.outcome for r in log.requests] == ["completed"] * 4


def test_a_sweep_goes_on_over_the_end_of_an_episode():
    world = world_of(
        drones={"count": 2, "battery": None},
        stations={"count": 0},
        map={"dimensions": 2},
        episode={"steps": 12, "carry_over": True},
    )
    logs = [log for log, _ in play(world, load_policy("baseline"), "baseline", 0, episodes=3)]
    ys = [step.y_m for log in logs for step in log.steps if step.drone == 1]
    turns = [y for before, y, after in zip(ys, ys[1:], ys[2:], strict=False) if before == after]
    assert turns
    assert set(turns) <= {120.0, 2280.0}


@dataclass(frozen=True)
class Thirsty(Endurance):
    """Moving takes three times what hovering takes."""

    def drain_of(self, flight, elapsed_us):
        return elapsed_us if flight is REST else 3 * elapsed_us

    def lasts_us(self, flight, charge):
        return charge if flight is REST else -(-charge // 3)


def test_n_b_is_the_battery_a_return_takes():
    world = world_of(
        drones={"count": 1, "start_cells": [[0, 0]], "battery": {"kind": f"{__name__}:Thirsty"}},
        stations={"count": 1, "radius_m": 0},
        map={"dimensions": 2},
    )
    engine = Simulation(world, RunSettings((True,), False), audit)
    shown = engine.reset(draw(world, 0, 0))
    plan = world.only_type.planner.plan((0, 0, 0))
    assert plan is not None
    assert plan.duration_us == 10 * 30_990_663
    assert shown.observations[0].return_s == pytest.approx(3 * plan.duration_us / 1e6)
    before = shown.observations[0].battery_s
    shown = engine.step([2])
    assert before - shown.observations[0].battery_s == pytest.approx(180.0)


@pytest.mark.parametrize("cells", [[10, 1], [1, 10], [1, 1]])
def test_a_map_of_one_row(cells):
    size = [240.0 * n for n in cells]
    world = world_of(
        map={"size_m": size, "cells": cells, "dimensions": 2},
        stations={"count": 1, "radius_m": 0},
        drones={"count": 2},
        users={"count": 5, "clusters": {"count": 1, "radius_m": [50, 60]}},
    )
    for policy in ("baseline", "random"):
        engine_runs = list(play(world, load_policy(policy), policy, 0, episodes=2))
        assert all(log.duration_us == world.horizon_us for log, _ in engine_runs)


def test_a_cluster_far_wider_than_the_map():
    scenario = from_mapping(
        {
            "name": "seam",
            "map": {"size_m": [1, 1], "cells": [1, 1], "dimensions": 2},
            "stations": {"count": 1, "radius_m": 0},
            "users": {"clusters": {"radius_m": [10_000, 10_000]}},
        }
    )
    with pytest.raises(ScenarioError, match="radius_m: none of 10000 places"):
        build_world(scenario, 0)


def test_a_full_battery_is_charged_where_it_lands():
    world = world_of(
        drones={"count": 1, "battery": {"return_below": 1.0}},
        stations={"count": 1},
        episode={"steps": 1},
    )
    engine = Simulation(world, RunSettings((True,), False, keep_events=True), audit)
    engine.reset(draw(world, 0, 0))
    engine.step([world.actions.index(7)])
    rows = [(t, int(phase), kind) for t, phase, kind, *_ in engine.log.events]
    assert [row for row in rows if row[2] in ("land", "charge", "charged")] == [
        (0, 10, "land"),
        (0, 10, "charge"),
        (0, 10, "charged"),
    ]


def test_distance_is_counted_where_it_is_flown():
    # Told to return ten hops away, at 31 s a hop: the episode ends between two cells.
    world = world_of(
        drones={
            "count": 1,
            "start_cells": [[0, 0]],
            "battery": {"autonomy_min": 30, "return_below": 1.0},
        },
        stations={"count": 1, "radius_m": 0},
        map={"dimensions": 2},
        episode={"steps": 2, "carry_over": True},
    )
    engine = Simulation(world, RunSettings((True,), True), audit)
    flown = []
    for episode in range(4):
        shown = engine.reset(draw(world, 0, episode))
        while not shown.truncated:
            shown = engine.step([world.actions.index(7)])
        flown.append(engine.log.distance_m)
    assert 240 * 3 < flown[0] < 240 * 4
    assert sum(flown) == pytest.approx(2400.0)
