"""Sweeps, the paper's table and optima from Python, and what all functions have in common."""

import inspect
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import desim_uav as du
from desim_uav.errors import UsageError


@pytest.fixture(autouse=True)
def _somewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


HOW = {"seeds": 2, "episodes": 1, "warmup": 0, "policies": ["hover", "random"]}


class TestSweep:
    def test_values_as_lists_and_as_the_command_line_has_them(self):
        lists = {"episode.steps": [3, 4], "drones.footprint_radius_m": 200}
        done = du.sweep("tiny", lists, out="one", **HOW)
        assert sorted(done.frame["episode.steps"]) == [3] * 4 + [4] * 4
        assert set(done.frame["policy"]) == {"hover", "random"}
        kept = pd.read_parquet("one/results")
        assert len(kept) == len(done.frame) == 8
        other = du.sweep(
            "tiny", ["episode.steps=3:4", "drones.footprint_radius_m=200"], out="two", **HOW
        )
        assert done.rows == other.rows
        assert "<table>" in done._repr_html_()

    def test_texts_lists_and_numbers_of_numpy_are_values(self):
        values = {"learning.algorithm": ["sarsa", "q_learning"], "episode.steps": [np.int64(3)]}
        done = du.sweep("tiny", values, out="one", seeds=1, episodes=1, warmup=0)
        assert done.frame["learning.algorithm"].tolist() == ["sarsa", "q_learning"]

    def test_one_that_goes_on(self):
        du.sweep("tiny", {"episode.steps": [3]}, out="one", **HOW)
        with pytest.raises(UsageError, match="resume"):
            du.sweep("tiny", {"episode.steps": [3, 4]}, out="one", **HOW)
        with pytest.warns(du.DesimWarning, match="4 of 8 jobs had ended before"):
            done = du.sweep("tiny", {"episode.steps": [3, 4]}, out="one", resume=True, **HOW)
        assert len(done.rows) == 8

    def test_a_backend_that_is_none(self):
        with pytest.raises(UsageError, match="did you mean 'local'"):
            du.sweep("tiny", out="one", backend="loca")


@pytest.mark.thorough
def test_the_best_possible():
    found = du.find_optimum("case1", {"drones.count": 1}, seed=2)
    assert found["seed"] == 2
    assert found["cover"]["qoe3_percent"] <= found["instant_at_most_percent"]


@pytest.mark.parametrize(
    ("options", "part"),
    [
        ({"cases": "0-3"}, "--cases 0-3"),
        ({"preset": "papr"}, "preset: 'papr' (did you mean 'paper'?)"),
        ({"seeds": 0}, "seeds: 0"),
        ({"jobs": 0}, "jobs: 0"),
        ({"episodes": 0}, "episodes: 0"),
    ],
)
def test_what_cannot_be_reproduced(options, part):
    with pytest.raises(UsageError) as caught:
        du.reproduce(**options)
    assert part in str(caught.value)
    assert list(Path.cwd().iterdir()) == []


def test_every_public_name_is_there_and_documented():
    needs_sb3 = {"UavVecEnv"} if find_spec("stable_baselines3") is None else set()
    for name in sorted(set(du.__all__) - needs_sb3):
        assert getattr(du, name) is not None
        if name not in ("__version__", "Scenario"):
            assert inspect.getdoc(getattr(du, name)), name


def test_importing_it_is_quick():
    code = (
        "import sys, desim_uav\n"
        "heavy = {'numba', 'pandas', 'pyarrow', 'pydantic', 'simpy', 'matplotlib'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
