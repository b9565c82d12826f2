"""Minari data sets of ``bench export``: what a policy saw, did and got, as in its runs."""

from __future__ import annotations

import json
import runpy
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import desim_uav as du
from desim_uav.errors import MissingExtraError, PolicyError, UsageError
from desim_uav.experiment.bench.export import SEEDS
from desim_uav.experiment.bench.tasks import EPISODES, WARMUP, find_task, find_track
from desim_uav.experiment.run import run
from desim_uav.policies import load_policy
from desim_uav.world import build_world
from tests.command_line import runner

ROOT = Path(__file__).parents[2]
TASK = "uav-v1/coverage/small"


def test_it_names_the_missing_extra(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "minari", None)
    with pytest.raises(MissingExtraError, match=r'bench export .*pip install -e "\.\[minari\]"'):
        du.bench_export(TASK, "hover")


def test_ctrl_c_is_told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("desim_uav.experiment.bench.export.export", interrupted)
    stopped = runner(capsys, monkeypatch)("bench", "export", TASK, "--policy", "hover")
    assert (stopped.code, stopped.out) == (130, "")
    assert "interrupted; nothing is kept" in stopped.err


def test_no_seed_is_one_of_a_submission():
    assert not {*SEEDS} & {*find_track("one").seeds, *find_track("any").seeds}


@pytest.mark.thorough
def test_a_data_set_has_what_happens_in_the_run(tmp_path: Path):
    minari = pytest.importorskip("minari")
    pytest.importorskip("h5py")
    place = tmp_path / "data"
    folder = du.bench_export(TASK, "baseline", seeds=1, observation="local", out=place)
    data = minari.MinariDataset(folder)
    scenario = find_task(TASK).scenario(find_track("one"))
    world = build_world(scenario, 0)
    results = run(world, load_policy("baseline"), "baseline", SEEDS[0], EPISODES, WARMUP)
    steps = results.steps[results.steps["episode"] >= 0]
    rows = [group for _, group in steps.groupby(["episode", "drone"])]
    episodes = list(data.iterate_episodes())
    assert len(episodes) == EPISODES * scenario.drone_count
    for one, group in zip(episodes, rows, strict=True):
        count, mask = len(group), one.infos["action_mask"]
        assert np.array_equal(one.rewards, group["reward"])
        assert len(one.observations) == len(mask) == count + 1 == len(one.actions) + 1
        assert mask[np.arange(count), one.actions].all(), "every action was allowed"
        assert all(data.observation_space.contains(each) for each in one.observations)
        assert one.truncations[-1] and not one.terminations.any()
        assert one.infos["discount"].tolist() == [1.0, *[scenario.learning.gamma] * count]
    about = json.loads((folder / "manifest.json").read_text())
    assert (about["task"], about["observation"]["kind"]) == (TASK, "local")
    assert about["seeds"] == [SEEDS[0]] and about["versions"]["minari"]


def test_a_clone_learns_the_actions_of_a_policy():
    """The policy takes the first allowed action of two where feature 0 is positive."""
    pytest.importorskip("minari")
    pytest.importorskip("h5py")
    clone = runpy.run_path(str(ROOT / "policies" / "clone.py"))
    rng = np.random.default_rng(0)
    seen = rng.normal(size=(2000, 3)).astype(np.float32)
    masks = np.tile([True, False, True], (2000, 1))
    actions = np.where(seen[:, 0] > 0, 0, 2)
    network = clone["train"](seen, masks, actions, epochs=20, rate=3e-3, seed=0)
    best = np.where(masks, network.forward(seen)[-1], -np.inf).argmax(-1)
    assert (best == actions).mean() > 0.97


def data_set(folder: Path, **changes: object) -> None:
    """Write the manifest of a data set that has no data."""
    task = {"task": TASK, "track": "one", "scenario_hash": find_task(TASK).scenario_hash}
    manifest = {**task, "observation": {"kind": "local"}, **changes}
    (folder / "manifest.json").write_text(json.dumps(manifest))


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({}, "not a readable data set: No data found"),
        ({"task": 1}, "not the manifest of a data set: task: must be text"),
        ({"task": "uav-v1/covrage"}, "unknown task (did you mean 'uav-v1/coverage'?)"),
        ({"observation": {"kind": "lokal"}}, "its observation is lokal; must be one of"),
        ({"scenario_hash": "0"}, f"it is of another version of {TASK}, whose hash is"),
    ],
)
def test_a_data_set_that_cannot_be_cloned_ends_with_code_4(
    changes: dict[str, object], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("minari")
    clone = runpy.run_path(str(ROOT / "policies" / "clone.py"))
    data_set(tmp_path, **changes)
    asked = [str(tmp_path), "--out", str(tmp_path / "clone.npz")]
    assert clone["main"](asked) == 4 and told in capsys.readouterr().err
    (tmp_path / "manifest.json").write_text("no JSON")
    assert clone["main"](asked) == 4 and "not a readable JSON" in capsys.readouterr().err
    assert clone["main"]([*asked, "--epochs", "0"]) == 2
    assert not (tmp_path / "clone.npz").exists()


@pytest.mark.parametrize(
    ("features", "action", "told"),
    [(4, 0, "no steps of 4 features and 3 actions"), (3, 1, "an action was not allowed")],
)
def test_steps_of_another_form_are_not_cloned(
    features: int, action: int, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("minari")
    steps_of = runpy.run_path(str(ROOT / "policies" / "clone.py"))["steps_of"]
    masks = np.tile([1, 0, 1], (3, 1))
    episode = SimpleNamespace(
        observations=np.zeros((3, 3)), actions=np.array([0, action]), infos={"action_mask": masks}
    )
    data = SimpleNamespace(iterate_episodes=lambda: [episode])
    monkeypatch.setitem(steps_of.__globals__, "MinariDataset", lambda folder: data)
    with pytest.raises(PolicyError, match=told):
        steps_of("data", features, 3)


@pytest.mark.thorough
def test_an_observation_that_a_policy_cannot_use_is_refused():
    pytest.importorskip("minari")
    pytest.importorskip("h5py")
    with pytest.raises(UsageError, match=r"observation radr: unknown .did you mean 'radar'"):
        du.bench_export(TASK, "hover", observation="radr")
    with pytest.raises(UsageError, match=r"ppo_case8_any.npz needs an observation of its own"):
        du.bench_export(TASK, "ppo_case8_any.npz", observation="local")
