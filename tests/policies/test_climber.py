"""The example of a policy of one's own runs, obeys its mask, and does better than chance."""

import pytest

from desim_uav.experiment.run import play
from desim_uav.policies import load_policy
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world


def attached_us(case, name):
    world = build_world(load(scenario_path(case)), 0)
    logs = [log for log, _ in play(world, load_policy(name), name, 0, episodes=5, warmup=1)]
    return sum(log.attached_us for log in logs[1:]), logs


@pytest.mark.parametrize("case", ["case1", "case4", "case8"])
def test_it_finds_users_and_the_way_home(case):
    climbed, logs = attached_us(case, "policies.climber:Climber")
    by_chance, _ = attached_us(case, "random")
    assert climbed > by_chance
    assert all(step.action == step.action_taken for log in logs for step in log.steps)
    assert sum(log.crashes for log in logs) == 0
    if case != "case1":
        assert sum(log.charges for log in logs) > 0
