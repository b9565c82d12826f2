"""SuperSuit's wrappers around the parallel environment (extra marl-test)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import flatten, flatten_space

from desim_uav.env import UavParallelEnv
from tests.env.helpers import play_parallel

supersuit = pytest.importorskip("supersuit", exc_type=ImportError)
pytestmark = pytest.mark.filterwarnings("ignore")  # SuperSuit has some

EPISODE = 30


def drones(kind: str, engine: str = "des") -> UavParallelEnv:
    return UavParallelEnv("case8", {"observation.kind": kind}, world_seed=0, engine=engine)


def flat(kind: str) -> Any:
    """Observation and mask of each agent as one row: SuperSuit's wrappers want a Box."""
    return supersuit.observation_lambda_v0(
        drones(kind),
        lambda seen, space: flatten(space, seen),
        flatten_space,
    )


@pytest.mark.parametrize("engine", ["des", "batch"])
@pytest.mark.parametrize("kind", ["position", "local"])
def test_agents_as_a_vector_of_environments(kind: str, engine: str):
    """Two environments of three drones each: six rows, over two whole episodes."""
    one = supersuit.pettingzoo_env_to_vec_env_v1(drones(kind, engine))
    envs = supersuit.concat_vec_envs_v1(one, 2, num_cpus=0, base_class="gymnasium")
    assert envs.num_envs == 6
    expected = play_parallel(drones(kind), 2, seed=0)
    rng = np.random.default_rng(0)
    seen, _ = envs.reset(seed=0)
    compare(seen, next(expected)[0])
    for step in range(1, 2 * EPISODE):
        actions = [rng.choice(np.flatnonzero(mask)) for mask in seen["action_mask"][:3]]
        seen, rewards, terminated, truncated, _ = envs.step(np.array(actions * 2))
        shown, paid, *_ = next(expected)
        assert np.allclose(rewards[:3], list(paid.values()))
        assert not terminated.any()
        assert truncated[:3].tolist() == [step == EPISODE] * 3
        if step == EPISODE:  # the last step of an episode begins the next one
            shown = next(expected)[0]
        compare(seen, shown)


def compare(seen: dict[str, Any], shown: dict[str, Any]) -> None:
    for k, one in enumerate(shown.values()):
        assert np.array_equal(seen["observation"][k], one["observation"])
        assert np.array_equal(seen["action_mask"][k], one["action_mask"])


@pytest.mark.parametrize("kind", ["position", "local"])
def test_wrappers_of_a_flat_observation(kind: str):
    env = supersuit.pad_observations_v0(supersuit.pad_action_space_v0(flat(kind)))
    env = supersuit.frame_stack_v1(supersuit.flatten_v0(env), 2)
    seen, _ = env.reset(seed=0)
    rounds = play_parallel(drones(kind), 1, seed=0)
    inner = drones(kind).observation_space("drone_0")
    before = next(rounds)[0]
    rng = np.random.default_rng(0)
    steps = 0
    while env.agents:
        actions = [rng.choice(np.flatnonzero(one["action_mask"])) for one in before.values()]
        seen, rewards, *_ = env.step(dict(zip(env.agents, actions, strict=True)))
        shown, paid, *_ = next(rounds)
        steps += 1
        assert rewards == paid
        for agent, row in seen.items():
            assert row in env.observation_space(agent)
            expected = [flatten(inner, part[agent]) for part in (before, shown)]
            assert np.allclose(row, np.concatenate(expected))
        before = shown
    assert steps == EPISODE
