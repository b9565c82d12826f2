"""PettingZoo's other form of the environment, in which one agent acts at a time, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, seed_test
from pettingzoo.utils import aec_to_parallel, parallel_to_aec

from desim_uav.env import UavParallelEnv
from tests.env.helpers import BRITTLE, play_parallel

LOCAL = {"observation.kind": "local"}
CONFIGS: list[tuple[str, dict[str, Any]]] = [
    ("case1", {}),
    ("case5", LOCAL),
    ("case8", {}),
    ("case8", {**BRITTLE, **LOCAL}),
    ("case8", {"demand": {"kind": "poisson", "rate_per_hour": 0.1}}),
]
IDS = ["case1", "case5-local", "case8", "case8-brittle-local", "case8-seldom-asked"]
EPISODE = 30


@pytest.mark.filterwarnings("ignore:Observation space for each agent probably")  # It is a Dict,
@pytest.mark.filterwarnings("ignore:Observation is not a NumPy array")  # which has a mask.
@pytest.mark.parametrize(("case", "config"), CONFIGS, ids=IDS)
def test_agents_that_act_one_at_a_time(
    case: str, config: dict[str, Any], capsys: pytest.CaptureFixture[str]
):
    drones = UavParallelEnv(case, config).session.scenario.drones.count
    api_test(parallel_to_aec(UavParallelEnv(case, config)), num_cycles=(EPISODE + 2) * drones)
    seed_test(lambda: parallel_to_aec(UavParallelEnv(case, config)), num_cycles=EPISODE * drones)
    assert "Passed" in capsys.readouterr().out


@pytest.mark.parametrize(("case", "config"), CONFIGS, ids=IDS)
def test_there_and_back(case: str, config: dict[str, Any]):
    def both() -> Any:
        return aec_to_parallel(parallel_to_aec(UavParallelEnv(case, config)))

    parallel_api_test(both(), num_cycles=2 * EPISODE)
    parallel_seed_test(both, num_cycles=EPISODE)


@pytest.mark.parametrize(("case", "config"), CONFIGS, ids=IDS)
def test_both_forms_tell_the_same(case: str, config: dict[str, Any]):
    """Two whole episodes, the second of which goes on from where the drones are."""
    rounds = list(play_parallel(UavParallelEnv(case, config), 2, seed=4))
    rng = np.random.default_rng(0)
    aec = parallel_to_aec(UavParallelEnv(case, config))
    last = 0
    for episode in range(2):
        aec.reset(seed=4 if episode == 0 else None)
        assert_told(aec, rounds[last][0], rounds[last][1])
        while not any(aec.truncations.values()):
            for agent in aec.agents[:]:
                assert aec.agent_selection == agent
                mask = aec.observe(agent)["action_mask"]
                aec.step(int(rng.choice(np.flatnonzero(mask))))
            last += 1
            seen, rewards, terminations, truncations, infos = rounds[last]
            assert_told(aec, seen, infos)
            assert aec.rewards == rewards
            assert (aec.terminations, aec.truncations) == (terminations, truncations)
        last += 1
    assert last == len(rounds) == 2 * (EPISODE + 1)


def assert_told(aec: Any, seen: dict[str, Any], infos: dict[str, Any]) -> None:
    for agent in aec.possible_agents:
        np.testing.assert_equal(aec.observe(agent), seen[agent])
        assert aec.infos[agent] == infos[agent]
