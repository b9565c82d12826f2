"""Large swarms: memory grows with users and crossings, not with drones times users."""

import tracemalloc

import pytest

from desim_uav.engine.des import Simulation
from desim_uav.experiment.run import decide, run_settings
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.policies import load_policy
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import build_world


def fly(drones, users, steps, **keys):
    """The log of one episode of the baseline, and the most memory it held, in bytes."""
    scenario = from_mapping(
        {
            "name": "swarm",
            "drones": {"count": drones} | keys,
            "users": {"count": users},
            "demand": {"kind": "static"},
            "episode": {"steps": steps},
        }
    )
    world, policy = build_world(scenario, 0), load_policy("baseline")
    path = draw(world, 0, 0)
    policy.begin(world, Streams(0, Purpose.LEARNER))
    engine = Simulation(world, run_settings(world, policy, keep_events=False))
    tracemalloc.start()
    shown = engine.reset(path)
    while not shown.truncated:
        shown = engine.step(decide(policy, shown, world))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return engine.log, peak


@pytest.mark.thorough
def test_memory_does_not_grow_with_drones_times_users():
    # Footprints of a metre: hardly a crossing, so that only users and drones are left.
    few, of_few = fly(5, 4_000, 3, footprint_radius_m=1)
    many, of_many = fly(100, 4_000, 3, footprint_radius_m=1)
    assert len(few.requests) == len(many.requests) == 4_000
    assert of_many - of_few < 95 * 4_000 * 8 / 2


@pytest.mark.slow
def test_a_hundred_drones_and_ten_thousand_users():
    log, peak = fly(100, 10_000, 30)
    assert len(log.requests) == 10_000
    assert sum(request.served_us for request in log.requests) > 0
    assert peak < 200 * 2**20
