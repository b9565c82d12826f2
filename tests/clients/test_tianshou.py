"""Tianshou's environments, collector and a learner (in an environment of its own)."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import gymnasium
import numpy as np
import pytest
from pettingzoo.utils import parallel_to_aec

from desim_uav.env import SkipForced, UavEnv, UavParallelEnv
from tests.env.helpers import BRITTLE

pytestmark = [
    pytest.mark.skipif(not find_spec("tianshou"), reason="needs tianshou"),
    pytest.mark.filterwarnings("ignore"),  # Tianshou has some
]

LOCAL = {"observation.kind": "local"}
EPISODE = 30


@pytest.mark.parametrize("engine", ["des", "batch"])
def test_agents_in_turn(engine: str):
    """Two whole episodes: what each agent sees, may do and is paid."""
    from tianshou.env import PettingZooEnv

    parallel = UavParallelEnv("case8", {**BRITTLE, **LOCAL}, world_seed=0, engine=engine)
    turns = PettingZooEnv(parallel_to_aec(parallel))
    plain = UavParallelEnv("case8", {**BRITTLE, **LOCAL}, world_seed=0)
    rng = np.random.default_rng(0)
    for seed in (4, 5):
        seen, _ = turns.reset(seed=seed)
        shown, _ = plain.reset(seed=seed)
        for _ in range(EPISODE):
            actions = {}
            for agent in plain.possible_agents:
                assert seen["agent_id"] == agent
                assert (seen["obs"] == shown[agent]["observation"]).all()
                assert seen["mask"] == shown[agent]["action_mask"].astype(bool).tolist()
                actions[agent] = int(rng.choice(np.flatnonzero(seen["mask"])))
                seen, rewards, _, truncated, _ = turns.step(actions[agent])
            shown, paid, *_ = plain.step(actions)
            assert list(rewards) == list(paid.values())
        assert truncated


class Masked(gymnasium.Wrapper):
    """The mask in the observation, where Tianshou's policies look for it."""

    def reset(self, **settings: Any) -> Any:
        seen, info = self.env.reset(**settings)
        return self.shown(seen, info), info

    def step(self, action: Any) -> Any:
        seen, *told, info = self.env.step(action)
        return self.shown(seen, info), *told, info

    def shown(self, seen: Any, info: dict[str, Any]) -> dict[str, Any]:
        return {"obs": seen, "mask": info["action_mask"].astype(bool)}


def test_a_collector_collects_whole_episodes():
    """A drone alone, with and without forced steps, flown by a policy that is random."""
    from tianshou.algorithm.random import MARLRandomDiscreteMaskedOffPolicyAlgorithm
    from tianshou.data import Collector, VectorReplayBuffer
    from tianshou.env import DummyVectorEnv

    def make() -> Any:
        config = {**BRITTLE, **LOCAL, "drones.count": 1}
        return UavEnv("case8", config, engine="batch", world_seed=0)

    envs = DummyVectorEnv([lambda: Masked(make()), lambda: Masked(SkipForced(make(), 0.95))])
    algorithm = MARLRandomDiscreteMaskedOffPolicyAlgorithm(action_space=envs.action_space[0])
    buffer = VectorReplayBuffer(400, 2)
    told = Collector(algorithm, envs, buffer).collect(n_episode=6, reset_before_collect=True)
    assert told.n_collected_episodes == 6
    assert max(told.lens) == EPISODE > min(told.lens)
    everything, _ = buffer.sample(0)
    assert np.isfinite(everything.rew).all()
    assert everything.obs.mask[np.arange(len(everything)), everything.act].all()
    forced = everything.obs.mask.sum(axis=1) == 1
    assert forced.any() and everything.info.forced.any()
