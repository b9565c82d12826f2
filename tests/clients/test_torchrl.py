"""TorchRL's wrapper around the parallel environment (extra marl-test)."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import MultiDiscrete, flatten
from pettingzoo.utils import parallel_to_aec

from desim_uav.env import SkipForcedParallel, UavEnv, UavParallelEnv
from tests.env.helpers import BRITTLE

pytestmark = [
    pytest.mark.skipif(not find_spec("torchrl"), reason="needs torchrl: the extra marl-test"),
    pytest.mark.filterwarnings("ignore"),  # TorchRL has many
]

LOCAL = {"observation.kind": "local"}
CONFIGS: list[tuple[str, dict[str, Any]]] = [
    ("case1", {}),
    ("case8", {}),
    ("case8", {**BRITTLE, **LOCAL}),
    ("case8", {"demand": {"kind": "poisson", "rate_per_hour": 0.1}}),
]
IDS = ["case1", "case8", "case8-brittle-local", "case8-seldom-asked"]
ENGINES = ["des", "batch"]


def wrapped(env: Any, **settings: Any) -> Any:
    from torchrl.envs.libs.pettingzoo import PettingZooWrapper

    return PettingZooWrapper(env, **settings)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("case", "config"), CONFIGS, ids=IDS)
def test_specs_hold(case: str, config: dict[str, Any], engine: str):
    from torchrl.envs.utils import MarlGroupMapType, check_env_specs

    env = UavParallelEnv(case, config, engine=engine)
    check_env_specs(wrapped(env, return_state=True))
    each = wrapped(env, group_map=MarlGroupMapType.ONE_GROUP_PER_AGENT, seed=3)
    check_env_specs(each)
    assert list(each.group_map) == each.possible_agents


def test_specs_hold_without_forced_steps():
    from torchrl.envs.utils import check_env_specs

    env = UavParallelEnv("case8", BRITTLE, engine="batch")
    check_env_specs(wrapped(SkipForcedParallel(env, 0.9), return_state=True))


def test_specs_hold_for_agents_that_act_one_at_a_time():
    from torchrl.envs.utils import check_env_specs

    check_env_specs(wrapped(parallel_to_aec(UavParallelEnv("case8")), use_mask=True))


def test_specs_hold_for_the_joint_environment():
    from torchrl.envs import GymWrapper
    from torchrl.envs.utils import check_env_specs

    for engine in ("des", "batch"):
        check_env_specs(
            GymWrapper(UavEnv("case8", engine=engine), categorical_action_encoding=True)
        )


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("case", "config"), CONFIGS, ids=IDS)
def test_two_whole_episodes_are_those_of_the_environment(
    case: str, config: dict[str, Any], engine: str
):
    env = wrapped(UavParallelEnv(case, config, engine=engine), seed=5, return_state=True)
    env.set_seed(5)
    told = env.rollout(60, break_when_any_done=False, auto_reset=True)
    assert told["next", "truncated"].flatten().nonzero().flatten().tolist() == [29, 59]
    assert not told["next", "terminated"].any()
    plain = UavParallelEnv(case, config)
    first = int(told["drone", "info", "episode_number"][0, 0])
    seen, _ = plain.reset(seed=5)
    for _ in range(first):  # TorchRL begins episodes that it does not play
        seen, _ = plain.reset()
    for step in told:
        assert np.allclose(step["state"].numpy(), plain.state())
        for k, agent in enumerate(plain.possible_agents):
            row = step["drone", "observation", "observation"][k].numpy().flatten()
            assert np.allclose(row, encoded(plain, agent, seen))
            mask = step["drone", "action_mask"][k].numpy()
            assert np.array_equal(mask, seen[agent]["action_mask"].astype(bool))
        actions = step["drone", "action"].tolist()
        assert step["drone", "action_mask"].gather(1, step["drone", "action"][:, None]).all()
        seen, rewards, _, truncated, infos = plain.step(
            dict(zip(plain.agents, actions, strict=True))
        )
        assert np.allclose(step["next", "drone", "reward"].flatten(), list(rewards.values()))
        for k, info in enumerate(infos.values()):
            for key, value in info.items():
                assert float(step["next", "drone", "info", key][k]) == pytest.approx(
                    value, rel=1e-6
                )
        if any(truncated.values()):
            seen, _ = plain.reset()


def encoded(env: UavParallelEnv, agent: str, seen: Any) -> Any:
    """An observation as TorchRL has it: whole numbers as one-hot codes, one after the other."""
    space, values = env.observation_space(agent)["observation"], seen[agent]["observation"]
    return flatten(space, values) if isinstance(space, MultiDiscrete) else values
