"""Networks of RLlib act in a run as in their training, and their files run no code."""

from __future__ import annotations

import dataclasses
import json
import logging
import os
import pickle
import subprocess
import sys
import tracemalloc
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from desim_uav.env import UavParallelEnv
from desim_uav.env.configure import configured
from desim_uav.errors import MissingExtraError, PolicyError
from desim_uav.experiment.run import headline, play, run
from desim_uav.experiment.sweep_plan import policy_digest
from desim_uav.model.streams import Purpose, Streams
from desim_uav.policies import load_policy
from desim_uav.policies.rllib import RLlib, save
from desim_uav.policies.rllib.file import NAME, Saved, read
from desim_uav.world import World, build_world
from tests.env.helpers import BRITTLE
from tests.policies.test_sb3 import Lawful, most_users

pytestmark = pytest.mark.filterwarnings("default")  # Ray has many

HERE = all(find_spec(name) for name in ("ray", "torch", "tree"))
needs_rllib = pytest.mark.skipif(
    not HERE, reason="needs the extra rllib: pip install 'desim-uav[rllib]'"
)

SMALL = {"fcnet_hiddens": [16], "vf_share_layers": False}
CASE_1 = {"world_seed": 3}
CASE_8 = {**BRITTLE, "users.count": 12, "world_seed": 3}
LOCAL = {**CASE_8, "observation.kind": "local"}


@dataclasses.dataclass(frozen=True)
class Trained:
    """An algorithm, the folder in which it was saved, and the world."""

    algorithm: Any
    folder: Path
    world: World

    def policy(self) -> RLlib:
        return load_policy(f"rllib:{self.folder}")

    def commands_in_training(self, seed: int, episodes: int, **filters: Any) -> list[list[int]]:
        """What a fresh EnvRunner of RLlib tells the drones greedily, filters at rest: by step."""
        from ray.rllib.env.multi_agent_env_runner import MultiAgentEnvRunner

        config = self.algorithm.config.copy(copy_frozen=False)
        own = config._env_to_module_connector
        config.debugging(seed=seed)
        config.env_runners(
            num_envs_per_env_runner=1,
            env_to_module_connector=lambda *given, **named: at_rest(own(*given, **named)),
        )
        runner = MultiAgentEnvRunner(config=config, worker_index=0)
        runner.set_state(self.algorithm.env_runner.get_state())
        found = []
        for episode in runner.sample(num_episodes=episodes, explore=False):
            told = [one.get_actions() for _, one in sorted(episode.agent_episodes.items())]
            found += np.array(told).T.tolist()
        runner.stop()
        return found

    def commands_in_a_run(self, seed: int, episodes: int) -> list[list[int]]:
        policy = Lawful(self.policy())
        played = play(self.world, policy, "mine", seed, episodes=episodes)
        drones = self.world.scenario.drones.count
        told = [int(step.action) for log, _ in played for step in log.steps]
        index = {int(action): k for k, action in enumerate(self.world.actions)}
        return np.array([index[action] for action in told]).reshape(-1, drones).tolist()


def at_rest(connectors: list[Any]) -> list[Any]:
    for piece in connectors:
        if hasattr(piece, "_update_stats"):
            piece._update_stats = False
    return connectors


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Trained]]:
    """Train for a few steps, and save."""
    if not HERE:
        pytest.skip("needs the extra rllib: pip install 'desim-uav[rllib]'")
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    import ray
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    ray.init(
        num_cpus=1,
        include_dashboard=False,
        log_to_driver=False,
        logging_level=logging.ERROR,
        object_store_memory=10**8,
    )
    known: dict[str, Trained] = {}

    def remembered(scenario: str, config: dict[str, Any], **settings: Any) -> Trained:
        key = repr((scenario, config, settings))
        if key not in known:
            folder = tmp_path_factory.mktemp("checkpoints") / "checkpoint"
            known[key] = train(scenario, config, folder, **settings)
        return known[key]

    yield remembered
    for one in known.values():
        one.algorithm.stop()
    ray.shutdown()
    torch.set_num_threads(threads)


def train(
    scenario: str,
    config: dict[str, Any],
    folder: Path,
    shared: bool = False,
    masked: bool = True,
    filtered: bool = True,
    **model: Any,
) -> Trained:
    from ray import tune
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.rllib.connectors.env_to_module import FlattenObservations, MeanStdFilter
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
    from ray.rllib.core.rl_module.rl_module import RLModuleSpec
    from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv

    from desim_uav.policies.rllib.masking import AddActionMask, EncodeObservation, MaskedModule

    def connectors(*_: Any, **__: Any) -> list[Any]:
        filters = [MeanStdFilter(multi_agent=True, clip_by_value=5.0)] * filtered
        if masked:
            return [EncodeObservation(), *filters, AddActionMask()]
        return [FlattenObservations(multi_agent=True), *filters]

    chosen = configured(scenario, config)
    tune.register_env("small", lambda _: ParallelPettingZooEnv(UavParallelEnv(chosen)))
    drones = [f"drone_{drone}" for drone in range(chosen.drones.count)]
    algorithm = (
        PPOConfig()
        .environment("small")
        .multi_agent(
            policies={"all"} if shared else set(drones),
            policy_mapping_fn=lambda agent, episode, **_: "all" if shared else agent,
        )
        .env_runners(
            num_env_runners=0,
            num_envs_per_env_runner=2,
            rollout_fragment_length=60,
            env_to_module_connector=connectors,
        )
        .rl_module(
            rl_module_spec=RLModuleSpec(module_class=MaskedModule) if masked else None,
            model_config=DefaultModelConfig(**{**SMALL, **model}),
        )
        .training(train_batch_size_per_learner=120, minibatch_size=60, num_epochs=2, lr=3e-3)
        .debugging(seed=0, log_level="ERROR")
        .build_algo()
    )
    for _ in range(3):
        algorithm.train()
    save(algorithm, folder)
    return Trained(algorithm, folder, build_world(chosen, chosen.world_seed))


# ---- they act as they were trained

SEVERAL = [
    ("case1", CASE_1, {}),
    ("case1", CASE_1, {"use_lstm": True, "lstm_cell_size": 8, "max_seq_len": 10}),
    ("case8", CASE_8, {}),
    ("case8", LOCAL, {"shared": True}),
    ("case8", LOCAL, {"shared": True, "use_lstm": True, "lstm_cell_size": 8}),
    ("case8", LOCAL, {"fcnet_hiddens": [8, 4], "fcnet_activation": "relu", "filtered": False}),
]


@needs_rllib
@pytest.mark.parametrize(("scenario", "config", "settings"), SEVERAL)
def test_a_run_commands_what_the_training_would(
    scenario: str, config: dict[str, Any], settings: dict[str, Any], trained: Any
):
    one = trained(scenario, config, **settings)
    there = one.commands_in_training(seed=11, episodes=3)
    here = one.commands_in_a_run(seed=11, episodes=3)
    assert len(here) == 3 * 30
    assert here == there
    assert len({tuple(commands) for commands in here}) > 1


@needs_rllib
def test_the_filters_matter(trained: Any, tmp_path: Path):
    one = trained("case8", LOCAL, shared=True)
    saved = read(one.folder)
    assert saved.statistics.size > 30 and saved.statistics[0] > 300
    put(tmp_path, dataclasses.replace(saved, statistics=np.ones_like(saved.statistics)))
    other = dataclasses.replace(one, folder=tmp_path)
    assert other.commands_in_a_run(11, 3) != one.commands_in_a_run(11, 3)


@needs_rllib
def test_filters_have_learned_all_they_will(trained: Any):
    one = trained("case8", LOCAL, shared=True)
    policy = one.policy()
    twice = [
        [int(step.action) for log, _ in play(one.world, policy, "mine", 5) for step in log.steps]
        for _ in range(2)
    ]
    assert twice[0] == twice[1]


@needs_rllib
def test_a_network_that_knows_no_masks_takes_the_best_it_may(trained: Any):
    one = trained("case8", LOCAL, masked=False)
    there = one.commands_in_training(seed=11, episodes=1)
    here = one.commands_in_a_run(seed=11, episodes=1)  # all of them lawful
    assert here[0] == there[0] or not all(UavParallelEnv("case8", LOCAL).action_masks())
    assert len(here) == 30


@needs_rllib
def test_the_algorithm_restored_by_rllib_is_saved_alike(trained: Any, tmp_path: Path):
    from ray.rllib.algorithms.algorithm import Algorithm

    one = trained("case1", CASE_1)
    one.algorithm.save_to_path(tmp_path / "checkpoint")
    restored = Algorithm.from_checkpoint(tmp_path / "checkpoint")
    file = save(restored, tmp_path / "checkpoint")
    assert file.read_bytes() == (one.folder / NAME).read_bytes()
    restored.stop()


@needs_rllib
def test_nothing_of_torch_is_changed(trained: Any):
    import torch

    one = trained("case1", CASE_1)
    before = torch.get_rng_state(), torch.get_num_threads(), torch.is_grad_enabled()
    one.commands_in_a_run(1, 1)
    assert torch.equal(torch.get_rng_state(), before[0])
    assert (torch.get_num_threads(), torch.is_grad_enabled()) == before[1:]
    assert logging.root.manager.disable == 0
