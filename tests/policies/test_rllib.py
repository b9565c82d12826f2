"""Networks of RLlib act in a run as in their training, and their files run no code."""

from __future__ import annotations

import dataclasses
import json
import logging
import os
import pickle
import resource
import sys
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import desim_uav as du
from desim_uav.env import UavParallelEnv
from desim_uav.env.configure import configured
from desim_uav.errors import MissingExtraError, PolicyError
from desim_uav.experiment.run import play, run
from desim_uav.experiment.sweep.plan import policy_digest
from desim_uav.measures.tally import headline
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.policies import load_policy
from desim_uav.policies.rllib import RLlib, save
from desim_uav.policies.rllib.file import NAME, NetworkFile, Saved
from desim_uav.world import World, build_world
from tests.command_line import elsewhere
from tests.env.helpers import BRITTLE
from tests.policies.test_sb3 import Lawful, most_users

pytestmark = pytest.mark.filterwarnings("default")  # Ray has many

HERE = all(find_spec(name) for name in ("ray", "torch", "tree"))
needs_rllib = pytest.mark.skipif(
    not HERE, reason='needs the extra rllib: pip install -e ".[rllib]"'
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
        pytest.skip('needs the extra rllib: pip install -e ".[rllib]"')
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    import ray
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    ray.init(
        address="local",
        num_cpus=2,
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
    name = f"small-{folder.parent.name}"
    tune.register_env(name, lambda _: ParallelPettingZooEnv(UavParallelEnv(chosen)))
    drones = [f"drone_{drone}" for drone in range(chosen.drones.count)]
    algorithm = (
        PPOConfig()
        .environment(name)
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
    saved = NetworkFile(one.folder).saved()
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
    env = UavParallelEnv("case8", {**LOCAL, "seed": 11})
    env.reset(seed=11)
    for mine, its_own in zip(here, there, strict=True):
        masks = env.action_masks().reshape(3, -1)
        lawful = [masks[drone, command] for drone, command in enumerate(its_own)]
        assert all(m == o for m, o, fine in zip(mine, its_own, lawful, strict=True) if fine)
        if not all(lawful):
            return
        env.step(dict(zip(env.agents, mine, strict=True)))
    raise AssertionError("masks have not mattered")


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
def test_filters_that_others_have_filled(trained: Any, tmp_path: Path):
    """With remote EnvRunners the local one has no environment, and its filters are empty."""
    from ray.rllib.utils.filter import RunningStat

    config = trained("case1", CASE_1).algorithm.config.copy(copy_frozen=False)
    algorithm = config.env_runners(num_env_runners=1).build_algo()
    algorithm.train()
    assert algorithm.env_runner.env is None
    save(algorithm, tmp_path)
    saved = NetworkFile(tmp_path).saved()
    (state,) = algorithm.env_runner_group.foreach_env_runner(
        lambda runner: runner.get_state(), local_env_runner=False
    )
    (filtered,) = state["env_to_module_connector"].values()
    (running,) = filtered["drone_0"]["running_stats"]
    known = RunningStat.from_state(running)
    assert known.num_pushes >= 120
    assert saved.statistics[0] == known.num_pushes
    assert saved.statistics[1:21].tolist() == known.mean_array.tolist()
    names = [name for name, _ in saved.about["modules"]["drone_0"]["weights"]]
    own = state["rl_module"]["drone_0"]
    assert np.concatenate([own[name].ravel() for name in names]).tolist() == saved.weights.tolist()
    algorithm.stop()


@needs_rllib
def test_nothing_of_torch_is_changed(trained: Any):
    import torch

    one = trained("case1", CASE_1)
    before = torch.get_rng_state(), torch.get_num_threads(), torch.is_grad_enabled()
    one.commands_in_a_run(1, 1)
    assert torch.equal(torch.get_rng_state(), before[0])
    assert (torch.get_num_threads(), torch.is_grad_enabled()) == before[1:]
    assert logging.root.manager.disable == 0


# ---- from the command line


@needs_rllib
def test_the_command_line_flies_it_where_it_was_trained(trained: Any, tmp_path: Path):
    one = trained("case1", CASE_1)
    policy, out = f"rllib:{one.folder}", tmp_path / "out"
    seeds = ("--seed", 11, "--world-seed", CASE_1["world_seed"])
    done = elsewhere("run", "case1", "--policy", policy, *seeds, "--out", out, "--json")
    assert (done.code, done.err) == (0, "")
    assert done.json["policy"] == policy
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["world_seed"] == CASE_1["world_seed"]
    results = run(one.world, one.policy(), "mine", 11)
    here = headline(results.requests, results.episodes)
    told = done.json
    assert {key: told[key] for key in ("qoe3_percent", "reward_mean")} == {
        key: here[key] for key in ("qoe3_percent", "reward_mean")
    }


@needs_rllib
def test_another_world_is_warned_of(trained: Any, tmp_path: Path):
    one = trained("case1", CASE_1)
    policy = f"rllib:{one.folder}"
    out = tmp_path / "o"
    done = elsewhere("run", "case1", "--world-seed", 4, "--policy", policy, "--out", out)
    assert done.code == 0
    assert f"{one.folder} was trained in another world: case1, world seed 3" in done.err
    assert one.policy().notice(one.world) == ""


@needs_rllib
def test_a_sweep_knows_it_by_its_content(trained: Any, tmp_path: Path):
    one = trained("case1", CASE_1)
    before = policy_digest(f"rllib:{one.folder}")
    saved = NetworkFile(one.folder).saved()
    put(tmp_path, dataclasses.replace(saved, weights=2 * saved.weights))
    assert policy_digest(f"rllib:{tmp_path}") != before
    assert policy_digest(f"rllib:{one.folder / NAME}") == before


# ---- what does not fit


@needs_rllib
@pytest.mark.parametrize(
    ("scenario", "config", "told"),
    [
        ("case8", LOCAL, r"trained with drones 1; the scenario has 3"),
        (
            "case8",
            {**CASE_8, "drones.count": 1},
            r"trained with actions .*; the scenario has .*charge",
        ),
        (
            "case1",
            {"observation.kind": "local"},
            r"trained with observations .*; the scenario has ",
        ),
        (
            "case1",
            {"map.cells": [5, 5]},
            r"trained with observations .*9.0.*; the scenario has .*4.0",
        ),
    ],
)
def test_other_scenarios(scenario: str, config: dict[str, Any], told: str, trained: Any):
    one = trained("case1", CASE_1)
    world = build_world(configured(scenario, config), 3)
    for what in (one.policy().notice, lambda w: one.policy().begin(w, streams())):
        with pytest.raises(PolicyError, match=told):
            what(world)


@needs_rllib
@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            {"ray": "2.9.1"},
            r"saved with ray 2\.9\.1, but .* is installed: pip install 'ray\[rllib\]==2\.9",
        ),
        ({"connectors": []}, "its pipelines are"),
        ({"pipelines": [[], []]}, "its pipelines are"),
        ({"fcnet_hiddens": [17]}, "the weights of drone_0 do not fit its settings"),
        ({"fcnet_hiddens": [4096] * 32}, "the weights of drone_0 do not fit its settings"),
        ({"use_lstm": True}, "the weights of drone_0 do not fit its settings"),
        ({"statistics": 3}, "it has 3 statistics"),
        ({"statistics": 1000}, "it has 1,000 statistics"),
    ],
)
def test_files_that_do_not_fit_together(
    change: dict[str, Any], told: str, trained: Any, tmp_path: Path
):
    one = trained("case1", CASE_1)
    saved = NetworkFile(one.folder).saved()
    (module,) = saved.about["modules"].values()
    count = change.get("statistics", saved.statistics.size)
    settings = module["settings"] | {k: v for k, v in change.items() if k in module["settings"]}
    about = saved.about | {k: v for k, v in change.items() if k in saved.about}
    about["modules"] = {"drone_0": module | {"settings": settings}}
    put(tmp_path, Saved(about, saved.weights, np.ones(count)))
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(PolicyError, match=told) as problem:
        load_policy(f"rllib:{tmp_path}").begin(one.world, streams())
    grown_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib
    assert grown_kib < 2**19, "layers of 2 GiB are said, not made"
    assert str(tmp_path / NAME) in str(problem.value)


# ---- files from anyone, which are refused before Ray is asked for


def streams() -> Streams:
    return Streams(0, Purpose.LEARNER, 0)


def put(folder: Path, saved: Saved) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / NAME).write_bytes(saved.to_bytes())
    return folder


def handmade() -> Saved:
    """What could be of a network, of two weights and no filter."""
    about = {
        "ray": "2.60.0",
        "scenario": "tiny",
        "scenario_hash": "",
        "world_seed": None,
        "world_hash": None,
        "features": [["cell_x", 0.0, 2.0, True], ["cell_y", 0.0, 2.0, True]],
        "actions": ["forward", "backward", "right", "left", "hover"],
        "agents": ["all"],
        "modules": {
            "all": {
                "class": "MaskedModule",
                "settings": {"fcnet_hiddens": [8]},
                "weights": [["pi.weight", [1, 2]]],
            }
        },
        "connectors": [{"class": "EncodeObservation", "settings": {}}],
        "pipelines": [[], []],
    }
    return Saved(about, *NUMBERS)


NUMBERS = np.ones(2, np.float32), np.zeros(0)


def with_module(**changes: Any) -> dict[str, Any]:
    return {"modules": {"all": handmade().about["modules"]["all"] | changes}}


def refused(folder: Path, told: str) -> None:
    with pytest.raises(PolicyError, match=told) as problem:
        load_policy(f"rllib:{folder}")
    assert str(folder) in str(problem.value)


def test_a_file_holds_what_was_put_in(tmp_path: Path):
    saved, found = handmade(), NetworkFile(put(tmp_path, handmade())).saved()
    assert found.about.items() >= saved.about.items()
    assert found.weights.tolist() == saved.weights.tolist()
    assert found.statistics.size == 0


@pytest.mark.parametrize(
    ("change", "told"),
    [
        *[
            ({key: None}, f"its description has no valid {key!r}")
            for key in ("ray", "agents", "modules", "actions")
        ],
        ({"world_seed": "3"}, "its description has no valid 'world_seed'"),
        ({"world_seed": -5}, "world_seed: -5: must be"),
        ({"world_seed": 2**63}, "world_seed: .*: must be"),
        ({"ray": "2.9'; touch X ; '"}, "ray: .* is not a version"),
        ({"ray": "2.9\n"}, "ray: .* is not a version"),
        ({"modules": {**with_module()["modules"], "more": {}}}, "1 modules that no drone uses"),
        ({"connectors": [{"class": "MeanStdFilter", "settings": {}}] * 9}, "it has 9 connectors"),
        ({"pipelines": [["x" * 2**20], []]}, "its description is larger than 1 MiB"),
        ({"connectors": [{"class": "MeanStdFilter", "settings": {"clip_by_value": 10**400}}]},
         "clip_by_value: 1000.* not among the allowed settings"),
        ({"agents": ["nobody"]}, "agents must name one of the modules"),
        ({"agents": [["all"]]}, "agents must name one of the modules"),
        ({"modules": {"all": None}}, "a module must be a mapping"),
        (with_module(**{"class": "os.system"}), "its module is os.system; must be one of"),
        (with_module(**{"class": ["MaskedModule"]}), "its module is "),
        (with_module(settings={"fcnet_hiddens": [10**9]}), "fcnet_hiddens: .* not among"),
        (with_module(settings={"fcnet_hiddens": [8] * 33}), "fcnet_hiddens: "),
        (with_module(settings={"fcnet_hiddens": [True]}), "fcnet_hiddens: "),
        (with_module(settings={"fcnet_activation": "os.system"}), "fcnet_activation: os.system"),
        (with_module(settings={"fcnet_kernel_initializer": "x"}), "fcnet_kernel_initializer: "),
        (with_module(settings={"lstm_cell_size": 10**9}), "lstm_cell_size: "),
        (with_module(weights=[["pi.weight", [-1, 2]]]), "its weights must be"),
        (with_module(weights=[["pi.weight", [2, 2]]]), "it has 2 weights, which is not the number"),
        (with_module(weights="all"), "its weights must be"),
        ({"connectors": [{"class": "Lambda", "settings": {}}]}, "its connector is Lambda"),
        ({"connectors": [{"class": "MeanStdFilter", "settings": {"update_stats": True}}]},
         "MeanStdFilter: update_stats: True"),
        ({"connectors": ["EncodeObservation"]}, "a connector must be a mapping"),
        ({"pipelines": [[]]}, "pipelines must be two lists"),
    ],
)  # fmt: skip
def test_words_that_cannot_be_trusted(change: dict[str, Any], told: str, tmp_path: Path):
    from desim_uav import array_file

    saved = handmade()
    about = saved.about | change | {"format": 1}
    content = array_file.pack(about, weights=saved.weights, statistics=saved.statistics)
    (tmp_path / NAME).write_bytes(content)
    refused(tmp_path, told)


@pytest.mark.parametrize(
    ("arrays", "told"),
    [
        ({"weights": np.ones(2)}, "not float64"),
        ({"weights": np.ones((1, 2), np.float32)}, "not float32 of shape"),
        ({"weights": np.array([{}, {}], object)}, "not a readable network of RLlib"),
        ({"more": np.ones(1)}, "it must hold exactly"),
        ({"weights": np.ones(2**25, np.float32)}, "bytes become .* when unpacked"),
        ({"statistics": np.ones(2**24)}, "bytes become .* when unpacked"),
    ],
)
def test_numbers_that_cannot_be_trusted(arrays: dict[str, Any], told: str, tmp_path: Path):
    from desim_uav import array_file

    saved = handmade()
    own = {"weights": saved.weights, "statistics": saved.statistics}
    about = saved.about | {"format": 1}
    if "weights" in arrays:
        about |= with_module(weights=[["w", [arrays["weights"].size]]])
    content = array_file.pack(about, **{**own, **arrays})
    (tmp_path / NAME).write_bytes(content)
    del arrays, own
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    refused(tmp_path, told)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib < 100 * 1024


@pytest.mark.parametrize(
    ("weights", "statistics", "told"),
    [
        ([1, np.nan], [], "weights has values that are not finite"),
        ([1, 2], [np.inf], "statistics has values that are not finite"),
    ],
)
def test_numbers_that_are_none(weights: Any, statistics: Any, told: str, tmp_path: Path):
    about, row = handmade().about, np.array(weights, np.float32)
    folder = put(tmp_path, Saved(about, row, np.array(statistics, float)))
    with pytest.raises(PolicyError, match=told):
        NetworkFile(folder).saved()


def test_numbers_are_not_unpacked_before_they_are_wanted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("desim_uav.array_file.Stored.arrays", None)
    assert NetworkFile(put(tmp_path, handmade())).statistics == 0


def test_what_cannot_be_read_again_is_not_saved():
    with pytest.raises(PolicyError, match=r"^its .* too many for a network"):
        dataclasses.replace(handmade(), statistics=np.zeros(2**20)).to_bytes()
    with pytest.raises(PolicyError, match=r"^ray: "):
        dataclasses.replace(handmade(), about=handmade().about | {"ray": "new"}).to_bytes()


def test_what_a_file_says_moves_no_cursor(tmp_path: Path):
    features = [["\x1b[2J\ndesim-uav: all is well", 0.0, 2.0, True]] * 1000
    file = NetworkFile(put(tmp_path, Saved(handmade().about | {"features": features}, *NUMBERS)))
    policy = RLlib.__new__(RLlib)
    policy._file = file
    world = build_world(configured("tiny"), 0)
    with pytest.raises(PolicyError) as problem:
        policy._require("observations", file.about["features"], [])
    assert str(problem.value).isprintable() and len(str(problem.value)) < 400 + len(str(tmp_path))
    policy.folder, policy._fit = "it", lambda world: None
    file.about["scenario"] = "tiny\x1b[2J\ndesim-uav: all is well" + "." * 1000
    assert policy.notice(world).isprintable() and len(policy.notice(world)) < 300


@needs_rllib
def test_the_file_may_be_named_itself(trained: Any, tmp_path: Path):
    one = trained("case1", CASE_1)
    for folder in (tmp_path / "npz.npz", tmp_path / NAME):
        put(folder, NetworkFile(one.folder).saved())
        for name in (folder, folder / NAME):
            load_policy(f"rllib:{name}").begin(one.world, streams())


def test_a_folder_may_be_called_anything(tmp_path: Path):
    refused(put(tmp_path / "npz.npz", handmade()) / NAME / "x.npz", "not a checkpoint")


@needs_rllib
def test_a_lie_about_its_layers_is_not_unpacked(
    trained: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    one = trained("case1", CASE_1)
    saved = NetworkFile(one.folder).saved()
    put(tmp_path, dataclasses.replace(saved, statistics=np.ones(3)))
    policy = load_policy(f"rllib:{tmp_path}")
    monkeypatch.setattr(NetworkFile, "saved", None)
    with pytest.raises(PolicyError, match="it has 3 statistics"):
        policy.begin(one.world, streams())


@needs_rllib
def test_what_cannot_decide_is_not_saved(
    trained: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    from desim_uav.policies.rllib.network import Network

    def fail(*_: Any) -> None:
        raise OverflowError("too large")

    one = trained("case1", CASE_1)
    policy = one.policy()
    monkeypatch.setattr(Network, "decide", fail)
    with pytest.raises(PolicyError, match=r"it cannot be saved: .* too large"):
        save(one.algorithm, tmp_path)
    assert not list(tmp_path.iterdir())
    with pytest.raises(PolicyError, match=f"{NAME}: the network does not fit: too large"):
        policy.begin(one.world, streams())


def test_what_is_no_checkpoint(tmp_path: Path):
    refused(tmp_path / "nowhere", "not a checkpoint: no such folder")
    refused(tmp_path, f"the folder has no {NAME}, .*desim_uav.policies.rllib.save")
    (tmp_path / "file").touch()
    refused(tmp_path / "file", "not a checkpoint: it is not a folder")
    for content in (b"", b"not a zip", put(tmp_path, handmade()).joinpath(NAME).read_bytes()[:-9]):
        (tmp_path / NAME).write_bytes(content)
        refused(tmp_path, "not a readable network of RLlib")
    (tmp_path / NAME).unlink()
    (tmp_path / NAME).mkdir()
    refused(tmp_path, "not a readable network of RLlib")


class Touch:
    """Unpickled, it makes a file."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def __reduce__(self) -> Any:
        return Path.touch, (self.file,)


@needs_rllib
def test_the_pickles_beside_it_are_not_read(trained: Any, tmp_path: Path):
    one, touched = trained("case1", CASE_1), tmp_path / "touched"
    folder = put(tmp_path / "checkpoint", NetworkFile(one.folder).saved())
    trap = pickle.dumps(Touch(touched))
    parts = ("", "env_runner", "env_runner/env_to_module_connector", "learner_group/learner")
    for part in parts:
        (folder / part).mkdir(parents=True, exist_ok=True)
        for name in ("class_and_ctor_args.pkl", "state.pkl", "algorithm_state.pkl"):
            (folder / part / name).write_bytes(trap)
    other = dataclasses.replace(one, folder=folder)
    assert other.commands_in_a_run(1, 1) == one.commands_in_a_run(1, 1)
    assert not touched.exists()
    pickle.loads(trap)
    assert touched.exists(), "the trap works"


@pytest.mark.parametrize("name", ["rllib", "rllib:"])
def test_a_network_needs_its_folder(name: str):
    with pytest.raises(PolicyError, match="rllib:DIR"):
        load_policy(name)


def test_a_missing_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "desim_uav.policies.rllib.network", None)
    with pytest.raises(MissingExtraError) as problem:
        load_policy(f"rllib:{put(tmp_path, handmade())}")
    assert problem.value.exit_code == 5
    assert 'pip install -e ".[rllib]"' in str(problem.value)
    with pytest.raises(MissingExtraError):
        save(None, tmp_path)


# ---- an algorithm in memory

PPO = "ray.rllib.algorithms.ppo.ppo:PPO"
"""What an algorithm of RLlib is called in tables and messages."""


@needs_rllib
@pytest.mark.parametrize("engine", ["des", "batch"])
@pytest.mark.parametrize(
    ("config", "settings"),
    [(CASE_8, {}), (LOCAL, {"shared": True, "use_lstm": True, "lstm_cell_size": 8})],
)
def test_an_algorithm_in_memory_flies_as_its_checkpoint_does(
    config: dict[str, Any], settings: dict[str, Any], engine: str, trained: Any
):
    one = trained("case8", config, **settings)
    flown = {"episodes": 2, "engine": engine, "progress": False}
    mine = du.run("case8", config, policy=one.algorithm, **flown)
    saved = du.run("case8", config, policy=f"rllib:{one.folder}", **flown)
    assert mine.policy == PPO
    assert mine.steps.equals(saved.steps) and mine.requests.equals(saved.requests)
    assert mine.steps["action"].nunique() > 1


@needs_rllib
def test_what_an_algorithm_has_learned_since_is_flown_too(tmp_path: Path, trained: Any):
    """A run reads the algorithm as it is, and leaves its weights and filters as they are."""
    one = train("case8", CASE_8, tmp_path / "before")
    first = du.run("case8", CASE_8, policy=one.algorithm, progress=False).steps
    save(one.algorithm, tmp_path / "after")
    before, after = (NetworkFile(tmp_path / name).saved() for name in ("before", "after"))
    assert np.array_equal(before.weights, after.weights)
    assert np.array_equal(before.statistics, after.statistics)
    for _ in range(4):
        one.algorithm.train()
    save(one.algorithm, tmp_path / "later")
    later = du.run("case8", CASE_8, policy=one.algorithm, progress=False).steps
    file = du.run("case8", CASE_8, policy=f"rllib:{tmp_path / 'later'}", progress=False).steps
    one.algorithm.stop()
    assert later.equals(file) and not later.equals(first)


@needs_rllib
def test_an_algorithm_for_other_drones_is_named(trained: Any):
    algorithm = trained("case8", CASE_8).algorithm
    with pytest.raises(PolicyError) as problem:
        du.run("case8", CASE_8 | {"drones.count": 2}, policy=algorithm, progress=False)
    assert str(problem.value).startswith(f"policy '{PPO}': the network was trained with drones 3;")


# ---- what cannot be saved


@needs_rllib
def test_connectors_and_mappings_that_cannot_be_saved(
    trained: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    from ray.rllib.connectors.env_to_module import MeanStdFilter

    algorithm = trained("case1", CASE_1).algorithm
    with monkeypatch.context() as patch:

        class Mine(MeanStdFilter):
            pass

        (found,) = [
            piece
            for piece in algorithm.env_runner._env_to_module.connectors
            if isinstance(piece, MeanStdFilter)
        ]
        patch.setattr(found, "__class__", Mine)
        with pytest.raises(PolicyError, match=r"Mine is not one of .*MeanStdFilter"):
            save(algorithm, tmp_path)
    with monkeypatch.context() as patch:
        patch.setitem(
            algorithm.config.__dict__, "policy_mapping_fn", lambda agent, episode: episode.id_
        )
        with pytest.raises(PolicyError, match="policy_mapping_fn must depend on the agent alone"):
            save(algorithm, tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(algorithm.env_runner.env.envs[0].unwrapped, "par_env", None)
        with pytest.raises(
            PolicyError, match=r"^it cannot be saved: it was not trained on a UavPar"
        ):
            save(algorithm, tmp_path)
        with pytest.raises(PolicyError, match=f"^policy '{PPO}': it was not trained on a UavPar"):
            load_policy(algorithm)
    (tmp_path / "file").touch()
    with pytest.raises(Exception, match="cannot make"):
        save(algorithm, tmp_path / "file" / "folder")
    assert not list(tmp_path.rglob(NAME))


# ---- the recipe


@needs_rllib
def test_the_recipe(trained: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any):
    from policies.train_rllib import main

    monkeypatch.chdir(tmp_path)
    main(["case8", "checkpoint", "--steps", "800", "--seed", "4", "--shared"])
    assert "desim-uav run case8 --seed 4 --policy rllib:checkpoint" in capsys.readouterr().out
    assert (tmp_path / "checkpoint" / "rllib_checkpoint.json").exists(), "RLlib can go on with it"
    world = build_world(configured("case8", {"seed": 4}), 4)
    ((log, _),) = play(world, Lawful(load_policy("rllib:checkpoint")), "mine", 4)
    assert all(step.action == step.action_taken for step in log.steps)


@needs_rllib
@pytest.mark.parametrize(
    ("where", "told"),
    [("train", "no file has been written"), ("save", "the checkpoint in new may be incomplete")],
)
def test_ctrl_c_ends_the_recipe(
    where: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
):
    from policies import train_rllib

    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    algorithm = SimpleNamespace(save_to_path=lambda path: path.mkdir())
    monkeypatch.setattr(train_rllib, "train", lambda *_: algorithm)
    monkeypatch.setattr(train_rllib, where, interrupted)
    assert train_rllib.main(["case8", "new"]) == 130
    assert capsys.readouterr() == ("", f"interrupted; {told}\n")
    assert (tmp_path / "new").exists() == (where == "save")


@needs_rllib
@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_ppo_finds_the_best_cell_of_case_1(seed: int, trained: Any, tmp_path: Path):
    from policies.train_rllib import train as train_long

    save(train_long("case1", 20_000, seed), tmp_path)
    world = build_world(configured("case1"), seed)
    policy = Lawful(load_policy(f"rllib:{tmp_path}"))
    results = run(world, policy, "mine", seed, episodes=20, warmup=2)
    assert policy.commands == 22 * 30
    done = headline(results.requests, results.episodes)
    best = most_users(world) / 14
    assert best > 0.5
    assert done["qoe3_percent"] >= 0.95 * 100 * best
