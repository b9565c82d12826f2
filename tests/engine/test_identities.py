"""Cases 1-5: everybody asks at the start for the whole episode, without bandwidth, so that to be
attached is to be served. Then QoE1 = QoE3 and QoE2 = 30 (1 - QoE1) follow from the definitions.
"""

from __future__ import annotations

import pytest

from desim_uav.experiment.run import run
from desim_uav.policies import load_policy
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world


@pytest.mark.parametrize("policy", ["baseline", "random", "hover"])
@pytest.mark.parametrize("case", ["case1", "case2", "case3", "case4", "case5"])
def test_the_measures_of_quality_are_of_one_thing(case: str, policy: str):
    scenario = load(scenario_path(case))
    for seed in range(3):
        world = build_world(scenario, seed)
        results = run(world, load_policy(policy), policy, seed, episodes=2, warmup=1)
        assert len(results.episodes) == 3
        for episode in results.episodes.itertuples():
            assert 0 <= episode.qoe1_percent <= 100
            assert episode.qoe1_percent == pytest.approx(episode.qoe3_percent, abs=1e-9)
            unserved = 30 * (1 - episode.qoe1_percent / 100)
            assert episode.qoe2_iterations == pytest.approx(unserved, abs=1e-9)
            assert episode.qoe3_active_percent == pytest.approx(episode.qoe3_percent, abs=1e-9)
        requests = results.requests
        assert (requests["served_s"] == requests["attached_s"]).all()
        if policy == "baseline":
            assert results.episodes["qoe1_percent"].between(1, 99).any(), "the test sees something"
