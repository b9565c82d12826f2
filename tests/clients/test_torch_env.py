"""The batch of environments for TorchRL tells what each environment alone tells (extra torchrl)."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest

from desim_uav.env import UavParallelEnv
from desim_uav.errors import ScenarioError
from tests.env import test_free_envs, test_mixed_envs
from tests.env.helpers import BRITTLE

pytestmark = [
    pytest.mark.skipif(not find_spec("torchrl"), reason="needs torchrl: the extra torchrl"),
    pytest.mark.filterwarnings("ignore"),  # TorchRL has many
]

ENDING: dict[str, Any] = {
    **BRITTLE,
    "drones.battery": {**BRITTLE["drones.battery"], "on_crash": "end_episode"},
    "observation.kind": "local",
}
"""Episodes that crashes end, so that environments end at different times."""

CONFIGS: list[tuple[str, dict[str, Any]]] = [
    ("case1", {}),
    ("case5", {"observation.kind": "radar", "reward.kind": "qoe"}),
    ("case8", {**BRITTLE, "observation.kind": "local"}),
    ("case8", ENDING),
    ("case8", {"demand": {"kind": "poisson", "rate_per_hour": 0.1}}),
]
IDS = ["case1", "case5-radar", "case8-brittle-local", "case8-ending", "case8-seldom-asked"]
EPISODE = 30


def batch(case: str, num_envs: int, config: dict[str, Any], **settings: Any) -> Any:
    from desim_uav.env.torchrl import UavTorchEnv

    return UavTorchEnv(case, num_envs, config, **settings)


@pytest.mark.parametrize("num_envs", [1, 3])
@pytest.mark.parametrize(("case", "config"), CONFIGS, ids=IDS)
def test_specs_hold(case: str, config: dict[str, Any], num_envs: int):
    """Over ends of episodes: they last two of the three steps that TorchRL's check plays."""
    from torchrl.envs.utils import check_env_specs

    env = batch(case, num_envs, {**config, "episode.steps": 2})
    check_env_specs(env, break_when_any_done="both")
    check_env_specs(env, seed=4)


@pytest.mark.parametrize(("case", "config"), CONFIGS, ids=IDS)
def test_specs_hold_over_whole_episodes(case: str, config: dict[str, Any]):
    env = batch(case, 3, config, seed=1)
    told = env.rollout(3 * EPISODE, break_when_any_done=False)
    assert told["next", "done"].sum() >= 3 * 3
    for step in told.unbind(1):
        assert env.full_observation_spec.is_in(step.select(*env.observation_keys))
        following = step["next"]
        assert env.full_observation_spec.is_in(following.select(*env.observation_keys))
        assert env.full_reward_spec.is_in(following.select(*env.reward_keys))
        assert env.full_done_spec.is_in(following.select(*env.done_keys))
        assert env.full_action_spec.is_in(step.select(*env.action_keys))


@pytest.mark.parametrize("world_seed", [0, "train"])
@pytest.mark.parametrize(("case", "config"), CONFIGS, ids=IDS)
def test_each_environment_is_the_one_with_its_seed(
    case: str, config: dict[str, Any], world_seed: Any
):
    """Row k of a rollout over several episodes is that of ``UavParallelEnv``, seed 5 + k, SimPy."""
    import torch

    torch.manual_seed(0)
    told = batch(case, 3, config, world_seed=world_seed, seed=5).rollout(
        2 * EPISODE + 5, break_when_any_done=False
    )
    ends = [row["next", "done"].flatten().nonzero().flatten().tolist() for row in told]
    assert all(len(one) >= 2 for one in ends)
    assert (config is not ENDING) or len({tuple(one) for one in ends}) > 1
    for k, row in enumerate(told):
        plain = UavParallelEnv(case, config, world_seed=world_seed)
        shown, infos = plain.reset(seed=5 + k)
        for step in row:
            compare(step, plain, shown, infos)
            actions = step["drone", "action"].tolist()
            assert step["drone", "action_mask"].gather(1, step["drone", "action"][:, None]).all()
            shown, paid, terminated, truncated, infos = plain.step(
                dict(zip(plain.agents, actions, strict=True))
            )
            following = step["next"]
            compare(following, plain, shown, infos)
            exactly(following["drone", "reward"].flatten(), list(paid.values()))
            for key, ended in (("terminated", terminated), ("truncated", truncated)):
                assert set(ended.values()) == {bool(following[key])}
            if following["done"]:
                shown, infos = plain.reset()


def compare(told: Any, plain: UavParallelEnv, shown: Any, infos: Any) -> None:
    """What TorchRL has been told, and what the environment tells."""
    exactly(told["drone", "observation"], [one["observation"] for one in shown.values()])
    exactly(told["drone", "action_mask"], [one["action_mask"] for one in shown.values()])
    exactly(told["state"], plain.state())
    shared, own = told["info"], told["drone", "info"]
    for k, info in enumerate(infos.values()):
        of_own = set(own.keys())
        assert of_own | set(shared.keys()) == set(info)
        for key, value in info.items():
            exactly(own[key][k] if key in of_own else shared[key], value)


def exactly(told: Any, expected: Any) -> None:
    values = told.numpy()
    assert np.array_equal(values, np.asarray(expected).astype(values.dtype))


# ---- free flight

FREE: dict[str, dict[str, Any]] = {
    "2D": test_free_envs.scenario(),
    "3D": {**test_free_envs.choosing(3), "observation": {"kind": "local"}},
    "unlimited": test_free_envs.scenario(limited=False),
    "by event": {**test_free_envs.scenario(), "decisions": {"kind": "event", "patience_s": 20}},
}


def free(kind: str, num_envs: int, **settings: Any) -> Any:
    from desim_uav.env.torchrl import UavTorchEnv

    return UavTorchEnv(FREE[kind], num_envs, **settings)


@pytest.mark.parametrize("kind", FREE)
def test_specs_hold_in_free_flight(kind: str):
    from torchrl.envs.utils import check_env_specs

    numbers = {"2D": 3, "3D": 5, "unlimited": 2, "by event": 3}[kind]
    env = free(kind, 3, config={"episode.steps": 2})
    check_env_specs(env, break_when_any_done="both")
    assert env.full_action_spec["drone", "action"].shape == (3, 2, numbers)
    told = free(kind, 3, seed=1).rollout(60, break_when_any_done=False)
    assert told["next", "done"].sum() >= 3
    for step in told.unbind(1):
        assert env.full_observation_spec.is_in(step.select(*env.observation_keys))
        assert env.full_action_spec.is_in(step.select(*env.action_keys))
        assert env.full_observation_spec.is_in(step["next"].select(*env.observation_keys))


@pytest.mark.parametrize("kind", FREE)
def test_each_environment_of_free_flight_is_the_one_with_its_seed(kind: str):
    """Row k of a rollout over whole episodes is that of ``UavParallelEnv``, seed 5 + k, SimPy."""
    import torch

    torch.manual_seed(0)
    told = free(kind, 2, seed=5, world_seed=1).rollout(60, break_when_any_done=False)
    assert (told["next", "done"].sum(dim=1) >= 1).all()
    for k, row in enumerate(told):
        plain = UavParallelEnv(FREE[kind], world_seed=1)
        shown, _ = plain.reset(seed=5 + k)
        for step in row:
            exactly(step["drone", "observation"], [one["observation"] for one in shown.values()])
            exactly(step["drone", "allowed"], [one["allowed"] for one in shown.values()])
            exactly(step["state"], plain.state())
            actions = dict(zip(plain.agents, step["drone", "action"].numpy(), strict=True))
            shown, paid, terminated, truncated, infos = plain.step(actions)
            following = step["next"]
            exactly(following["drone", "reward"].flatten(), list(paid.values()))
            assert set(terminated.values()) == {bool(following["terminated"])}
            assert set(truncated.values()) == {bool(following["truncated"])}
            for name in ("qoe3_percent", "sim_time_s", "requests"):
                exactly(following["info", name], infos["drone_0"][name])
            if following["done"]:
                shown, _ = plain.reset()


def test_a_fleet_of_both_kinds_is_refused():
    from desim_uav.env.torchrl import UavTorchEnv

    with pytest.raises(ScenarioError, match="needs drones of one of the two kinds"):
        UavTorchEnv(test_mixed_envs.scenario(), 2)


# ---- the rest


def test_seeds_and_whole_state():
    first, again = (batch("case8", 2, BRITTLE, world_seed=0) for _ in range(2))
    first.set_seed(7)
    one, other = first.reset(), again.reset()
    assert not (one["state"] == other["state"]).all()
    again.set_seed(7)
    assert (one == again.reset()).all()
    assert one["info", "seed"].tolist() == [7, 8]
    assert one["state"].shape[-1] == len(first.vector.state_names)


def test_ended_environments_want_a_reset():
    from gymnasium.error import ResetNeeded

    env = batch("case8", 2, {"episode.steps": 1})
    told = env.rand_step(env.reset())
    assert told["next", "done"].all()
    with pytest.raises(ResetNeeded, match=r"the episode is over in \[0, 1\]"):
        env.rand_step(told)


def test_frames():
    assert batch("case8", 2, {}).render() is None
    env = batch("case8", 2, {}, render_mode="rgb_array")
    env.reset()
    assert env.render().shape[0] == 2
    assert env.render().dtype == np.uint8
