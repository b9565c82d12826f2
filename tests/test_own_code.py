"""Files of one's own that have changed: they are used as they are now, or an error says how."""

from __future__ import annotations

import importlib
import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import desim_uav as du
from desim_uav import own_code
from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.errors import PolicyError, ScenarioError, SimulationError
from desim_uav.experiment.compare_runs import compare_runs
from desim_uav.experiment.sweep.grid import axes
from desim_uav.experiment.sweep.job import jobs, run_job
from desim_uav.experiment.sweep.plan import SweepPlan, arms, policy_digest
from desim_uav.model.traces import index, read_table
from desim_uav.policies import load_policy
from desim_uav.rowcode.components import check_unchanged
from desim_uav.scenario.load import load, scenario_hash
from desim_uav.scenario.schema import Scenario

SLOW = """
from dataclasses import dataclass
import numpy as np
import own_rates.at_night
from desim_uav.model.demand.asking import RowDemand, ask_for_mix

GAP_S = np.int64({gap})

@dataclass(frozen=True)
class Slow(RowDemand):
    def next_request(self, asker, stream, services):
        asker.wait_us = GAP_S * own_rates.at_night.FACTOR * 1_000_000
        ask_for_mix(asker, stream, services, 0.0)

class Learn:
    tables = 1
    @staticmethod
    def update(q, lesson):
        return None

class Fly:
    ceiling = True
    def begin(self, world, streams, carried=False):
        return None
    def act(self, observation, mask):
        return {act}
"""

YAML = """
name: slow
users: {count: 4}
demand: {kind: "own_slow:Slow"}
episode: {steps: 3}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A project with a component, a module that it imports, and a scenario."""
    made = project(tmp_path / "one")
    monkeypatch.syspath_prepend(made)
    yield made
    for name in ("own_slow", "own_rates", "own_rates.at_night"):
        sys.modules.pop(name, None)


def project(folder: Path) -> Path:
    (folder / "own_rates").mkdir(parents=True)
    (folder / "own_rates" / "__init__.py").write_text("")
    (folder / "own_rates" / "at_night.py").write_text("FACTOR = 1\n")
    (folder / "own_slow.py").write_text(SLOW.format(gap=600, act=0))
    (folder / "slow.yaml").write_text(YAML)
    return folder


CHANGES = {
    "the file": ("own_slow.py", SLOW.format(gap=300, act=0)),
    "a module that it imports": ("own_rates/at_night.py", "FACTOR = 2\n"),
}


# ---- in one process


@pytest.mark.parametrize("change", CHANGES)
def test_a_changed_file_is_refused_until_it_is_imported_again(folder: Path, change: str):
    name, text = CHANGES[change]
    before = scenario_hash(load(folder / "slow.yaml"))
    (folder / name).write_text(text)
    with pytest.raises(ScenarioError) as refused:
        load(folder / "slow.yaml")
    assert str(refused.value) == (
        f"{folder}/slow.yaml:4:16: demand.kind: \"own_slow:Slow\": cannot use 'own_slow:Slow': "
        f"{folder / name} has changed since Python imported it; restart Python (in a notebook, "
        "its kernel), or import it again with importlib.reload"
    )
    importlib.reload(sys.modules[name.removesuffix(".py").replace("/", ".")])
    assert scenario_hash(load(folder / "slow.yaml")) != before


@pytest.mark.parametrize(
    "text", [SLOW.format(gap=600, act=0) + "# more\n", SLOW.format(gap=600, act=0)]
)
def test_a_comment_and_a_new_time_of_change_are_no_change(folder: Path, text: str):
    before = scenario_hash(load(folder / "slow.yaml"))
    (folder / "own_slow.py").write_text(text)
    os.utime(folder / "own_slow.py", (1, 1))
    assert scenario_hash(load(folder / "slow.yaml")) == before


def test_a_file_of_the_same_length_and_time_has_changed(folder: Path):
    file = folder / "own_slow.py"
    os.utime(file, (10**9, 10**9))
    load(folder / "slow.yaml")
    file.write_text(SLOW.format(gap=700, act=0))
    os.utime(file, (10**9, 10**9))
    with pytest.raises(ScenarioError, match="has changed since Python imported it"):
        load(folder / "slow.yaml")


def test_a_changed_policy_is_refused(folder: Path):
    assert load_policy("own_slow:Fly") is not None
    (folder / "own_slow.py").write_text(SLOW.format(gap=600, act=1))
    with pytest.raises(PolicyError, match="has changed since Python imported it"):
        load_policy("own_slow:Fly")


def test_two_projects_with_modules_of_one_name_need_two_processes(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    load(folder / "slow.yaml")
    other = project(tmp_path / "other")
    monkeypatch.syspath_prepend(other)
    with pytest.raises(ScenarioError) as refused:
        load(other / "slow.yaml")
    assert str(refused.value).endswith(
        f"there are two modules 'own_slow': Python has imported {folder}/own_slow.py, and would "
        f"now import {other}/own_slow.py; rename one of them, or use two processes"
    )


def test_a_constant_that_changes_in_a_process_is_refused_by_compiled_code(folder: Path):
    """Python would use the new value, and compiled code the old one."""
    scenario = load(folder / "slow.yaml")
    check_unchanged(scenario.demand)
    sys.modules["own_rates.at_night"].FACTOR = 2
    with pytest.raises(SimulationError) as refused:
        check_unchanged(scenario.demand)
    assert str(refused.value) == (
        "component 'own_slow:Slow': the code of 'own_slow.Slow.next_request', or a value in it, "
        "has changed in this process after it had been compiled; restart Python (in a notebook, "
        "its kernel), or import its module again with importlib.reload"
    )
    importlib.reload(sys.modules["own_slow"])
    check_unchanged(load(folder / "slow.yaml").demand)


# ---- hashes, by which finished work is known again


def again(folder: Path) -> Scenario:
    """The scenario as a new process loads it."""
    for name in ("own_slow", "own_rates", "own_rates.at_night"):
        sys.modules.pop(name, None)
    own_code._FILES.clear()
    importlib.invalidate_caches()
    return load(folder / "slow.yaml")


@pytest.mark.parametrize("change", CHANGES)
def test_hashes_of_scenarios_and_policies_depend_on_all_files_of_the_project(
    folder: Path, change: str
):
    name, text = CHANGES[change]

    def hashes() -> list[str]:
        scenario = again(folder)
        learning = load(folder / "slow.yaml", {"learning.algorithm": "own_slow:Learn"})
        builtin = load(folder / "slow.yaml", {"demand.kind": "dynamic"})
        digest = policy_digest("own_slow:Fly")
        return [scenario_hash(scenario), scenario_hash(learning), digest, scenario_hash(builtin)]

    before = hashes()
    assert hashes() == before
    (folder / name).write_text(text)
    os.utime(folder / name, (1, 1))
    after = hashes()
    assert all(one != other for one, other in zip(before[:3], after[:3], strict=True))
    assert before[3] == after[3]
    (folder / "unused.py").write_text("X = 1\n")
    assert hashes() == after


def test_a_component_without_a_file_is_described_by_its_code():
    """As one that is written in a cell of a notebook."""

    def hashed(gap: int) -> str:
        space: dict[str, Any] = {"__name__": "no_module"}
        source = SLOW.replace("import own_rates.at_night\n", "")
        source = source.replace("own_rates.at_night.FACTOR", "2").format(gap=gap, act=0)
        sys.modules["no_module"] = type(sys)("no_module")
        exec(compile(source, "<cell>", "exec", dont_inherit=True), space)
        return scenario_hash(Scenario(demand=space["Slow"]()))

    assert hashed(1) == hashed(1)
    assert hashed(1) != hashed(2)
    del sys.modules["no_module"]


def test_a_job_of_a_sweep_is_another_one_after_a_change(folder: Path):
    def job() -> Any:
        again(folder)
        asked = SweepPlan(folder / "slow.yaml", [], ["hover"], False, None, [1], 1, 0, "des")
        return jobs(asked, arms(asked, axes([])))[0]

    before = job()
    assert job().id == before.id
    (folder / "own_rates" / "at_night.py").write_text("FACTOR = 2\n")
    assert job().id != before.id
    # a worker that began after the change: it has imported the new file
    assert run_job(before).failure == (
        "slow: a file or component of it has changed since the sweep began"
    )


@pytest.mark.thorough
def test_a_training_is_not_continued_after_a_change(folder: Path, tmp_path: Path):
    def train(**options: Any) -> None:
        again(folder)
        du.train(
            folder / "slow.yaml", {"learning.episodes": 1}, out=tmp_path / "out", **options
        )  # fmt: skip

    train()
    train(resume=True)
    (folder / "own_slow.py").write_text(SLOW.format(gap=300, act=0))
    with pytest.raises(PolicyError, match="a file or component of it, seeds or learning"):
        train(resume=True)


@pytest.mark.thorough
def test_an_engine_in_a_pickle_is_refused_after_a_change(folder: Path):
    """Its memory may have rows of the component, which are laid out differently now."""
    world = du.build_world(load(folder / "slow.yaml"), 0)
    pickled = pickle.dumps(make_engine("batch", world, RunSettings((False,), False)))
    assert pickle.loads(pickled).world.seed == 0
    (folder / "own_slow.py").write_text(SLOW.format(gap=300, act=0))
    importlib.reload(sys.modules["own_slow"])
    with pytest.raises(pickle.UnpicklingError, match="or of a component of its scenario"):
        pickle.loads(pickled)


@pytest.mark.thorough
def test_runs_before_and_after_a_change_are_not_compared(folder: Path, tmp_path: Path):
    for seed in (1, 2):
        again(folder)
        options = {"seed": seed, "engine": "des", "out": tmp_path / str(seed)}
        du.run(folder / "slow.yaml", policy="hover", **options)
        if seed == 1:
            assert compare_runs([tmp_path / "1"]).episodes == 1
            (folder / "own_rates" / "at_night.py").write_text("FACTOR = 2\n")
    with pytest.raises(PolicyError) as refused:
        compare_runs([tmp_path / "1", tmp_path / "2"])
    assert str(refused.value) == (
        f"{tmp_path}/1: a file or component of its scenario has changed since the run"
    )


# ---- in processes of their own

IN_A_PROCESS = """
import sys
import desim_uav as du
sys.path.insert(0, ".")
for engine in ("des", "batch"):
    print(len(du.run("slow.yaml", policy="hover", seed=1, engine=engine).requests), end=" ")
"""


@pytest.mark.thorough
def test_each_process_runs_the_present_text_of_its_own_folder(tmp_path: Path):
    """Two projects have modules of one name, whose machine code has one file on disk."""

    def run(folder: Path) -> list[str]:
        command = [sys.executable, "-c", IN_A_PROCESS]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert "not kept" not in done.stderr
        return done.stdout.split()

    one, other = project(tmp_path / "one"), project(tmp_path / "other")
    (other / "own_slow.py").write_text(SLOW.format(gap=60, act=0))
    for folder in (one, other):
        text = YAML.replace("steps: 3", "steps: 30")
        (folder / "slow.yaml").write_text(text)
    seldom, often = run(one), run(other)
    assert seldom[0] == seldom[1] and often[0] == often[1]
    assert int(often[0]) > int(seldom[0])
    assert run(one) == seldom
    (one / "own_slow.py").write_text(SLOW.format(gap=30, act=0))
    (one / "own_rates" / "at_night.py").write_text("FACTOR = 2\n")
    assert run(one) == often


# ---- other things that are kept


def test_a_recording_is_read_again_whatever_its_length_and_time(tmp_path: Path):
    file = tmp_path / "table.csv"
    for number in (1, 2):
        file.write_text(f"a\n{number}\n")
        os.utime(file, (10**9, 10**9))
        assert read_table(file, {"a": index}) == [(number, 2)]
