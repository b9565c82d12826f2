"""BenchMARL trains the drones, and a run flies its networks (extra benchmarl, of its own)."""

from __future__ import annotations

import csv
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from desim_uav.errors import PolicyError, ScenarioError
from desim_uav.experiment.run import play
from desim_uav.policies import load_policy
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from policies import train_benchmarl
from policies.train_benchmarl import ALGORITHMS, DEFAULTS
from tests.selection import by_default

pytestmark = [
    pytest.mark.skipif(not find_spec("benchmarl"), reason="needs benchmarl: the extra benchmarl"),
    pytest.mark.filterwarnings("ignore"),  # BenchMARL has many
]

BRITTLE = ("drones.battery={autonomy_min: 7, return_below: 0.6, respawn_after_min: 3}",)
"""Drones that are often forced."""

EPISODE, DRONES = 30, 3
Make = Callable[..., Any]


@pytest.fixture
def make(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Make a small experiment of case 8; ``steps`` are those of all drones."""
    torch = pytest.importorskip("torch")
    torch.set_num_threads(1)
    monkeypatch.setattr(train_benchmarl, "ENVS", 4)
    monkeypatch.setattr(train_benchmarl, "ROLLOUT", EPISODE)

    def made(*changes: str, **options: Any) -> Any:
        scenario = load(scenario_path("case8"), [*DEFAULTS, *changes])
        options = {"steps": 1, **options}
        return train_benchmarl.experiment(scenario, tmp_path, **options)

    return made


@pytest.mark.parametrize("name", ALGORITHMS)
def test_training_logs_what_it_earns(name: str, make: Make, tmp_path: Path):
    training = make(name=name, steps=2 * 4 * EPISODE * DRONES)
    training.run()
    assert training.total_frames == 2 * 4 * EPISODE
    for table, least, most in (
        ("collection_reward_reward_mean", 0.0, 1.5),
        ("collection_episode_qoe1_percent", 1.0, 100.0),
        ("collection_episode_qoe3_percent", 1.0, 100.0),
        ("collection_episode_crashes", 0.0, 3.0),
    ):
        (file,) = tmp_path.rglob(f"{table}.csv")
        rows = list(csv.reader(file.open()))
        assert len(rows) == 2
        assert all(least <= float(value) <= most for _, value in rows)


@pytest.mark.parametrize("name", ALGORITHMS)
def test_masked_actions_are_never_chosen(name: str, make: Make):
    """Drawn at random or, by QMIX and the like, chosen at random with a probability."""
    from torchrl.envs.utils import ExplorationType, set_exploration_type

    training = make(*BRITTLE, name=name)
    with set_exploration_type(ExplorationType.RANDOM):
        told = training.test_env.rollout(EPISODE, training.policy, break_when_any_done=False)
    masks, actions = told["drone", "action_mask"], told["drone", "action"]
    assert (masks.sum(-1) == 1).any() and (masks.sum(-1) > 1).any()
    assert masks.gather(-1, actions[..., None]).all()
    assert len(actions.unique()) > 4


@pytest.mark.parametrize("name", ALGORITHMS)
def test_the_critic_sees_the_whole_state(name: str, make: Make):
    training = make(name=name)
    (numbers,) = training.state_spec["state"].shape
    assert numbers == len(training.test_env.vector.state_names)
    networks = training.losses["drone"]
    seen = {"mappo": "critic_network", "qmix": "mixer_network"}.get(name)
    if seen is not None:
        assert "state" in getattr(networks, seen).in_keys
    elif name == "ippo":
        assert networks.critic_network.in_keys == [("drone", "observation")]


@pytest.mark.parametrize("kind", ["radar", "position"])
@pytest.mark.parametrize("name", by_default(["mappo", "qmix"], ALGORITHMS))
def test_a_run_flies_as_benchmarl_does(name: str, kind: str, make: Make, tmp_path: Path):
    """The file commands what the greedy policy commands in BenchMARL's own environment."""
    from torchrl.envs import TransformedEnv
    from torchrl.envs.utils import ExplorationType, set_exploration_type

    from desim_uav.env.benchmarl import UavTask, save

    changes = (f"observation.kind={kind}", *BRITTLE)
    training = make(*changes, name=name, steps=2 * 4 * EPISODE * DRONES)
    training.run()
    file = save(training, tmp_path / "policy.npz")

    scenario = load(scenario_path("case8"), [*DEFAULTS, *changes, "world_seed=0"])
    task = UavTask.of(scenario)
    env = task.get_env_fun(1, False, None, "cpu")()
    env = TransformedEnv(env, task.get_env_transforms(env)[0])
    env.set_seed(9)
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        told = env.rollout(EPISODE, training.policy, break_when_any_done=False)
    expected = told["drone", "action"][0].tolist()

    world, policy = build_world(scenario, 0), load_policy(str(file))
    ((log, _),) = play(world, policy, "mine", 9)
    index = {int(action): k for k, action in enumerate(world.actions)}
    taken = np.array([index[int(step.action)] for step in log.steps]).reshape(-1, DRONES)
    free = (told["drone", "action_mask"][0].sum(-1) > 1).numpy()
    assert (taken == expected)[free].all()
    assert len(np.unique(taken[free])) > 1


def test_what_a_file_tells(make: Make, tmp_path: Path):
    from desim_uav.env.benchmarl import save

    for worlds, world_seed in (("own", 3), ("train", None)):
        file = save(make(seed=3, worlds=worlds), tmp_path / "policy.npz")
        policy = load_policy(str(file))
        assert policy.world_seed == world_seed
        assert (policy.about["world_hash"] is None) == (world_seed is None)
        assert policy.observation.kind == "radar"
        training = policy.about["training"]
        assert (training["algorithm"], training["seed"], training["gamma"]) == ("mappo", 3, 0.97)
        assert training["libraries"].keys() == {"benchmarl", "torchrl", "torch"}


def test_networks_that_no_file_holds(make: Make, tmp_path: Path):
    from benchmarl.experiment import Experiment
    from benchmarl.models.mlp import MlpConfig
    from torch import nn

    from desim_uav.env.benchmarl import SavePolicy, UavTask, network_of

    def of(model: Any, share: bool = True, callbacks: Any = ()) -> Any:
        settings = train_benchmarl.settings_of(1, tmp_path, 0.97)
        settings.share_policy_params = share
        task, algorithm = UavTask.of("case8"), train_benchmarl.algorithm_of("ippo")
        return Experiment(task, algorithm, model, 0, settings, callbacks=list(callbacks))

    def refused(training: Any, why: str) -> None:
        with pytest.raises(PolicyError, match=f"^it cannot be saved: .*{why}") as problem:
            network_of(training)
        assert problem.value.exit_code == 4

    relu = MlpConfig([8], nn.Linear, nn.ReLU)
    fine = of(relu)
    network_of(fine)
    fine.test_env.transform[0].scale.mul_(2)
    refused(fine, "scaled otherwise")
    refused(of(relu, share=False), "share_policy_params must be true")
    refused(of(MlpConfig([8], nn.Linear, nn.Tanh)), "part 1 of its network is Tanh, not ReLU")
    norm = {"norm_class": nn.LayerNorm, "norm_kwargs": {"normalized_shape": 8}}
    refused(of(MlpConfig([8], nn.Linear, nn.ReLU, **norm)), "is LayerNorm, not")
    file = tmp_path / "policy.npz"
    with pytest.raises(PolicyError, match="Tanh"):
        of(MlpConfig([8], nn.Linear, nn.Tanh), callbacks=[SavePolicy(file)])
    assert not file.exists()


def test_an_evaluation_of_benchmarls_own(make: Make, tmp_path: Path):
    from desim_uav.env.benchmarl import UavTask

    training = make()
    assert not training.task.has_render(training.test_env)
    training.close()
    task = UavTask.of("case8", {"episode.steps": 4}, render_mode="rgb_array")
    settings = training.config
    settings.evaluation, settings.render, settings.evaluation_episodes = True, False, 2
    settings.evaluation_interval = settings.on_policy_collected_frames_per_batch
    watched = type(training)(task, training.algorithm_config, training.model_config, 0, settings)
    watched.run()
    (file,) = tmp_path.rglob("eval_reward_episode_len_mean.csv")
    assert float(file.read_text().split(",")[-1]) == 4
    assert task.has_render(watched.test_env)
    frame = task.render_callback(watched, watched.test_env, None)
    assert frame.shape == watched.test_env.render()[0].shape and frame.shape[-1] == 3


def test_the_script_writes_a_policy(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.setattr(train_benchmarl, "ENVS", 2)
    monkeypatch.setattr(train_benchmarl, "ROLLOUT", 5)
    file = tmp_path / "policy.npz"
    assert train_benchmarl.main(["case8", str(file), "--algorithm", "vdn", "--steps", "60"]) == 0
    assert load_policy(str(file)).about["training"]["steps_done"] == 60
    assert capsys.readouterr().out.endswith(f"--policy {file}\n")


def test_free_flight_is_refused_by_name():
    from desim_uav.env.benchmarl import UavTask
    from tests.env.test_free_envs import scenario

    make_env = UavTask.of(scenario()).get_env_fun(2, False, 0, "cpu")
    with pytest.raises(ScenarioError, match="a task of BenchMARL needs drones that fly from cell"):
        make_env()
