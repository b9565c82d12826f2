"""Libraries discount a transition by its duration, or refuse decisions by event."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from desim_uav.errors import ScenarioError
from tests.semi_markov import DISCOUNTS, DURATIONS, GAMMA, REWARDS, TWO, WAY

pytestmark = pytest.mark.filterwarnings("ignore")  # the libraries have many

ONE = "which has one discount for transitions of any duration, needs decisions: clock"
FREELY = {**TWO, "drones": {**TWO["drones"], "motion": {"space": "free", "max_speed_mps": 8.3}}}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "two.yaml").write_text(json.dumps(TWO))
    return tmp_path / "two.yaml"


def test_stable_baselines_refuses_decisions_by_event(file: Path, capsys: pytest.CaptureFixture):
    pytest.importorskip("sb3_contrib")
    from desim_uav.env import UavVecEnv
    from policies import train_continuous, train_maskable_ppo

    refused = f"decisions: event: stable-baselines3, {ONE}"
    by_event = [(1, {"decisions": {"kind": "event"}})]
    for make in (
        lambda: UavVecEnv(TWO, 2),
        lambda: UavVecEnv("case1", 2, curriculum=by_event),
        lambda: train_continuous.train("sac", FREELY, 8, 0),
    ):
        with pytest.raises(ScenarioError) as error:
            make()
        assert str(error.value) == refused
    assert train_maskable_ppo.main([str(file), str(file.with_name("model.zip"))]) == 3
    assert capsys.readouterr() == ("", f"{refused}\n")
    (file.parent / "free.yaml").write_text(json.dumps(FREELY))
    assert train_continuous.main([str(file.parent / "free.yaml"), "model.zip"]) == 3
    assert capsys.readouterr() == ("", f"{refused}\n")


def test_rllib_refuses_decisions_by_event(file: Path, capsys: pytest.CaptureFixture):
    pytest.importorskip("ray.rllib")
    from policies import train_rllib

    assert train_rllib.main([str(file), str(file.with_name("checkpoint"))]) == 3
    assert capsys.readouterr() == ("", f"decisions: event: RLlib, {ONE}\n")


def test_benchmarl_refuses_decisions_by_event(file: Path, capsys: pytest.CaptureFixture):
    pytest.importorskip("benchmarl")
    from desim_uav.env.benchmarl import UavTask
    from policies import train_benchmarl

    make_env = UavTask.of(TWO).get_env_fun(2, False, 0, "cpu")
    with pytest.raises(ScenarioError, match=f"decisions: event: BenchMARL, {ONE}"):
        make_env()
    assert train_benchmarl.main([str(file), str(file.with_name("mappo.npz"))]) == 3
    assert capsys.readouterr().err == f"decisions: event: BenchMARL, {ONE}\n"


# ---- TorchRL, whose estimators take the steps to the next observation


@pytest.fixture
def told() -> Any:
    """The way of ``tests.semi_markov`` in two environments, with values of 1, 2, 3, …"""
    if not find_spec("torchrl"):
        pytest.skip("needs torchrl: the extra torchrl")
    import torch
    from tensordict.nn import TensorDictModule

    from desim_uav.env.torchrl import UavTorchEnv

    way = iter(WAY)
    fly = TensorDictModule(
        lambda state: torch.full((2, 1), next(way)),
        in_keys=["state"],
        out_keys=[("drone", "action")],
    )
    told = UavTorchEnv(TWO, 2).rollout(len(WAY), fly)
    told["steps_to_next_obs"] = told["next", "info", "duration_steps"][..., None, None]
    values = torch.arange(1.0, len(WAY) + 2).view(1, -1, 1, 1).expand(2, -1, -1, -1)
    told["drone", "state_value"], told["next", "drone", "state_value"] = (
        values[:, :-1],
        values[:, 1:],
    )
    for key in ("done", "terminated"):
        told["next", "drone", key] = told["next", key][..., None]
    return told


def of_first(numbers: Any) -> list[float]:
    assert (numbers[0] == numbers[1]).all()
    return numbers[0].flatten().tolist()


def test_torchrl_is_told_of_durations_and_discounts(told: Any):
    assert of_first(told["next", "drone", "reward"]) == REWARDS
    assert of_first(told["next", "info", "duration_steps"]) == DURATIONS
    assert of_first(told["next", "info", "discount"]) == DISCOUNTS
    assert of_first(told["info", "duration_steps"]) == [0.0, *DURATIONS[:-1]]


@pytest.mark.parametrize("decay", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("vectorized", [False, True])
def test_estimates_of_torchrl_are_those_of_a_semi_markov_process(
    told: Any, decay: float, vectorized: bool
):
    from torchrl.objectives.value import GAE, TD0Estimator, TDLambdaEstimator

    errors = [
        reward + discount * (k + 2) - (k + 1)
        for k, (reward, discount) in enumerate(zip(REWARDS, DISCOUNTS, strict=True))
    ]
    expected = [0.0]
    for error, discount in zip(reversed(errors), reversed(DISCOUNTS), strict=True):
        expected.append(error + discount * decay * expected[-1])
    makers: list[Any] = [
        GAE(gamma=GAMMA, lmbda=decay, value_network=None, vectorized=vectorized),
        TDLambdaEstimator(gamma=GAMMA, lmbda=decay, value_network=None, vectorized=vectorized),
    ]
    if decay == 0.0:
        makers.append(TD0Estimator(gamma=GAMMA, value_network=None))
    for estimator in makers:
        estimator.set_keys(
            **{key: ("drone", key) for key in ("reward", "done", "terminated", "advantage")},
            value=("drone", "state_value"),
            value_target=("drone", "value_target"),
        )
        found = estimator(told.clone())["drone", "advantage"]
        assert np.allclose(of_first(found), expected[:0:-1]), type(estimator).__name__
