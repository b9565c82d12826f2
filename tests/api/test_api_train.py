"""``desim_uav.train``: what is learned, how a callback looks at it, and what it leaves."""

import json
import os
import signal
import sys
from dataclasses import FrozenInstanceError
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import desim_uav as du
from desim_uav import cli
from desim_uav.errors import MissingExtraError, ScenarioError, UsageError
from desim_uav.policies.tabular import read_table

SMALL = {
    "name": "small",
    "map": {"size_m": [960, 960], "cells": [4, 4], "dimensions": 2},
    "drones": {
        "count": 2,
        "footprint_radius_m": 200,
        "battery": {"autonomy_min": 7, "return_below": 0.6, "respawn_after_min": 1},
    },
    "stations": {"count": 1, "radius_m": 0, "full_charge_min": 3},
    "users": {"count": 6, "clusters": {"count": 2, "radius_m": [100, 200]}},
    "demand": {"kind": "dynamic", "think_time_s": 60},
    "episode": {"steps": 12, "carry_over": True},
    "learning": {"episodes": 60, "restart_every": 5},
}


@pytest.fixture(autouse=True)
def _somewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def whole():
    """A training that nothing has looked at."""
    return du.train(SMALL, progress=False)


def same(one, other):
    assert np.array_equal(one.policy._stored.q, other.policy._stored.q)
    pd.testing.assert_frame_equal(one.curve, other.curve)


class TestResult:
    def test_the_folder_is_that_of_the_command_line(self, whole, monkeypatch):
        Path("small.yaml").write_text(json.dumps(SMALL))
        monkeypatch.setattr(sys, "argv", ["desim-uav", "train", "small.yaml", "--out", "there"])
        with pytest.raises(SystemExit):
            cli.main()
        assert whole.save("here") == Path("here")
        names = sorted(path.name for path in Path("there").iterdir())
        assert names == sorted(path.name for path in Path("here").iterdir())
        for name in set(names) - {"manifest.json", "SHA256SUMS"}:
            assert Path("here", name).read_bytes() == Path("there", name).read_bytes(), name
        one, other = (json.loads(Path(f, "manifest.json").read_text()) for f in ("here", "there"))
        assert {key for key in one | other if one.get(key) != other.get(key)} == {
            *("command", "started", "finished")
        }
        assert one["command"][0].startswith("desim_uav.train({'name': 'small'")

    def test_no_file_is_written_unless_asked(self, whole):
        du.train(SMALL, episodes=2)
        assert os.listdir() == []  # noqa: PTH208

    def test_the_curve(self, whole):
        assert len(whole.curve) == 60 * 2
        assert whole.curve["episode"].tolist() == sorted([*range(60)] * 2)
        assert (whole.episodes, whole.stopped) == (60, False)

    def test_it_flies(self, whole):
        result = du.run(SMALL, policy=whole, episodes=2)
        assert result.policy == "q_learning-s0"
        file = whole.save("there") / "policy.npz"
        pd.testing.assert_frame_equal(du.run(SMALL, policy=file, episodes=2).steps, result.steps)

    def test_one_that_was_written_is_named_by_its_file(self):
        done = du.train(SMALL, episodes=4, out="there")
        assert done.folder == Path("there")
        assert du.run(SMALL, policy=done).policy == "there/policy.npz"

    def test_the_options_are_keys_of_the_scenario(self):
        done = du.train(SMALL, {"learning.gamma": 0.5}, algorithm="sarsa", episodes=3, seed=4)
        learning = done.scenario.learning
        assert (learning.algorithm, learning.gamma, learning.episodes) == ("sarsa", 0.5, 3)
        assert done.summary()["seed"] == 4

    def test_a_notebook_shows_its_last_episodes(self, whole):
        shown = whole._repr_html_()
        assert "small, q_learning, seed 0: 60 episode(s), means over the last 60" in shown
        assert shown.count("<td") == 5


class TestCallback:
    @pytest.mark.parametrize("engine", ["des", "batch"])
    @pytest.mark.parametrize("every", [7, 60, 100])
    def test_it_changes_no_number(self, whole, engine, every):
        def look(progress):
            progress.evaluate(1)

        same(whole, du.train(SMALL, engine=engine, callback=look, callback_every=every))

    def test_it_is_told_the_means_since_the_last_call(self, whole):
        told = []
        du.train(SMALL, callback=told.append, callback_every=25)
        assert [progress.episode for progress in told] == [25, 50, 60]
        for progress, first in zip(told, (0, 25, 50), strict=True):
            rows = whole.curve[whole.curve["episode"].between(first, progress.episode - 1)]
            assert progress.episodes == 60
            assert progress.reward == pytest.approx(rows["reward"].mean())
            assert progress.crashes == pytest.approx(rows["crashes"].mean())
            assert progress.qoe1_percent == pytest.approx(rows["qoe1_percent"].mean())
            assert progress.epsilon == rows["epsilon"].iloc[-1]
            assert progress.alpha == rows["alpha"].iloc[-1]

    def test_what_it_is_told_cannot_be_changed(self):
        told = []
        du.train(SMALL, episodes=2, callback=told.append)
        with pytest.raises(FrozenInstanceError):
            told[0].reward = 1.0

    def test_the_greedy_policy_is_that_of_the_moment(self):
        policies, found = [], []

        def look(progress):
            policies.append(progress.policy)
            found.append(progress.evaluate(2, seed=3))

        du.train(SMALL, callback=look, callback_every=30)
        short = du.train(SMALL, episodes=30)
        assert np.array_equal(policies[0]._stored.q, short.policy._stored.q)
        assert not np.array_equal(policies[0]._stored.q, policies[1]._stored.q)
        world = du.run(SMALL, policy=short, seed=3, world_seed=0, episodes=2)
        assert found[0]["qoe3_percent"] == world.qoe()["qoe3_percent"]

    @pytest.mark.parametrize("how", ["False", "StopTraining"])
    def test_it_ends_the_training_and_what_was_learned_is_kept(self, how):
        def enough(progress):
            if progress.episode == 20:
                if how == "False":
                    return False
                raise du.StopTraining
            return None

        done = du.train(SMALL, callback=enough, callback_every=10)
        assert (done.episodes, done.stopped) == (20, True)
        same(done, du.train(SMALL, episodes=20))
        folder = done.save("there")
        assert json.loads((folder / "manifest.json").read_text())["stopped"] is True
        assert read_table(folder / "policy.npz").about["episodes"] == 20
        same(du.train(SMALL), du.train(SMALL, out="there", resume=True))

    def test_one_that_ends_a_training_in_a_folder(self):
        done = du.train(SMALL, out="there", callback=lambda p: False, callback_every=10)
        assert (done.episodes, done.folder) == (10, Path("there"))
        assert du.run(SMALL, policy="there/policy.npz").policy == "there/policy.npz"

    def test_any_other_exception_is_raised(self):
        def pruned(progress):
            raise LookupError("pruned")

        with pytest.raises(LookupError, match="pruned"):
            du.train(SMALL, callback=pruned)

    def test_several(self):
        one, other = [], []
        du.train(SMALL, episodes=3, callback=[one.append, other.append], callback_every=2)
        assert [progress.episode for progress in one] == [2, 3]
        assert one == other

    def test_a_resumed_training_tells_of_its_own_episodes(self):
        du.train(SMALL, episodes=30, out="there")
        told = []
        du.train(SMALL, out="there", resume=True, callback=told.append, callback_every=20)
        assert [progress.episode for progress in told] == [40, 60]


def test_ctrl_c_keeps_what_was_learned():
    def interrupt(progress):
        os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(du.Interrupted) as caught:
        du.train(SMALL, callback=interrupt, callback_every=20)
    same(caught.value.result, du.train(SMALL, episodes=20))


@pytest.mark.parametrize(
    ("options", "error", "part"),
    [
        ({"callback_every": 0}, UsageError, "callback_every: 0"),
        ({"checkpoint_every": 0}, UsageError, "checkpoint_every: 0"),
        ({"episodes": 0}, UsageError, "episodes: 0"),
        ({"resume": True}, UsageError, "resume"),
        ({"algorithm": "sarssa"}, ScenarioError, "did you mean 'sarsa'?"),
        ({"engine": "bathc"}, UsageError, "bathc"),
    ],
)
def test_what_cannot_be_asked_for(options, error, part):
    with pytest.raises(error) as caught:
        du.train(SMALL, **options)
    assert part in str(caught.value)


def test_tensorboard_is_an_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "tensorboard.summary", None)
    with pytest.raises(MissingExtraError, match="tensorboard"):
        du.TensorBoardCallback("logs")


def test_tensorboard_reads_what_the_callback_writes():
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    done = du.train(SMALL, callback=du.TensorBoardCallback("logs", evaluate=1), callback_every=30)
    events = accumulator.EventAccumulator("logs", {"tensors": 0})
    events.Reload()
    (first, last) = events.Tensors("training/reward")
    assert (first.step, last.step) == (30, 60)
    rows = done.curve[done.curve["episode"] >= 30]
    assert last.tensor_proto.float_val[0] == pytest.approx(rows["reward"].mean(), rel=1e-5)
    assert len(events.Tensors("greedy/qoe3_percent")) == 2


def test_a_study_of_optuna_prunes_through_the_callback():
    optuna = pytest.importorskip("optuna")
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    ended = []

    def objective(trial):
        gamma = trial.suggest_float("gamma", 0.5, 0.99)

        def report(progress):
            trial.report(-progress.episode if trial.number else progress.episode, progress.episode)
            if trial.should_prune():
                raise optuna.TrialPruned

        learned = du.train(
            SMALL, {"learning.gamma": gamma}, callback=report, callback_every=20, progress=False
        )
        ended.append(learned.episodes)
        return learned.curve["reward"].mean()

    study = optuna.create_study(
        direction="maximize",
        sampler=optuna.samplers.RandomSampler(seed=0),
        pruner=optuna.pruners.MedianPruner(n_startup_trials=1),
    )
    study.optimize(objective, n_trials=2)
    states = [trial.state for trial in study.trials]
    assert states == [optuna.trial.TrialState.COMPLETE, optuna.trial.TrialState.PRUNED]
    assert sorted(study.trials[1].intermediate_values) == [20]
    assert ended == [60]
