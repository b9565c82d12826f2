"""The paper's table: jobs, rows, estimates, claims and files."""

import csv
import json
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from desim_uav import checksums
from desim_uav.cli import app
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.engine.des import Simulation
from desim_uav.errors import UsageError
from desim_uav.experiment import reproduce
from desim_uav.experiment.paper_table import _over_cases, claims, lines, markdown
from desim_uav.experiment.published import POLICIES, PUBLISHED, best_qoe3
from desim_uav.experiment.reproduce import Job, best_cover, jobs, numbers, run_job, run_jobs
from desim_uav.parquet_file import read_table as read_parquet
from desim_uav.policies.tabular import read_table
from desim_uav.records import EPISODES

SEEDS = ("--seeds", 2, "--first-seed", 0)


def run_cli(*args: object) -> Any:
    return CliRunner().invoke(app, [str(arg) for arg in args])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Case 1 on two seeds, hardly trained."""
    out = tmp_path_factory.mktemp("reproduce")
    run_jobs(jobs([1], range(2), 20, [None]), out, 1)
    return out


def test_cases_are_written_as_people_write_them():
    assert numbers("1-9") == list(range(1, 10))
    assert numbers("8") == [8]
    assert numbers("1-3, 8,2") == [1, 2, 3, 8]


@pytest.mark.parametrize(
    "text", ["", "0", "10", "1-10", "one", "1-2-3", "3-1", "1,,2", "-1", "1-99999999999", "\uff11"]
)
def test_other_cases_are_refused(text: str):
    with pytest.raises(UsageError, match="--cases"):
        numbers(text)


def test_jobs_are_every_policy_in_every_case_on_every_seed():
    found = jobs([1, 8], range(3), None, [None, "paper"])
    assert len(set(found)) == len(found) == 2 * 3 * 3 * 2
    assert {job.policy for job in found} == set(POLICIES)
    job = Job(8, "sarsa", 2, "paper", 11)
    learning = job.scenario().learning
    assert (learning.algorithm, learning.episodes, learning.alpha.start) == ("sarsa", 11, 1.0)
    assert job.scenario().effective_world_seed == 2
    assert job.scenario().reward.cost_sign == 1.0


def test_a_job_trains_and_evaluates(folder: Path):
    row = json.loads((folder / "jobs" / "case1-q_learning-default-s1.json").read_text())["row"]
    assert (row["case"], row["policy"], row["seed"], row["episodes"]) == (1, "q_learning", 1, 20)
    assert row["crashes_per_drone_episode"] == 0
    assert row["qoe1_percent"] == pytest.approx(row["qoe3_percent"])
    table = read_table(folder / "policies" / "case1-q_learning-default-s1.npz")
    assert table.about["world_seed"] == 1 and table.about["episodes"] == 20


def test_its_row_is_what_run_says_of_the_policy(folder: Path, tmp_path: Path):
    policy = folder / "policies" / "case1-sarsa-default-s1.npz"
    command = ("run", "case1", "--seed", 1, "--policy", policy, "--episodes", 20, "--warmup", 2)
    result = run_cli(*command, "--out", tmp_path / "run", "--json")
    summary = json.loads(result.stdout)
    row = json.loads((folder / "jobs" / "case1-sarsa-default-s1.json").read_text())["row"]
    for name in ("qoe1_percent", "qoe2_iterations", "qoe3_percent", "reward_mean"):
        assert summary[name] == pytest.approx(row[name], rel=1e-12)
    episodes = read_parquet(tmp_path / "run", "episodes", EPISODES)
    assert (episodes["episode"] >= 0).sum() == 20


def test_the_table_is_of_seeds_that_no_default_was_chosen_on(monkeypatch: pytest.MonkeyPatch):
    asked: list[Job] = []
    monkeypatch.setattr(reproduce, "run_jobs", lambda todo, *_: asked.extend(todo) or [])
    monkeypatch.setattr(reproduce, "report", lambda *_: None)
    run_cli("reproduce", "--cases", "1,8")
    assert {job.seed for job in asked} == set(range(100, 110))
    asked.clear()
    run_cli("reproduce", "--cases", "8", "--seeds", 3, "--first-seed", 7)
    assert {job.seed for job in asked} == {7, 8, 9}


def test_finished_jobs_are_not_run_again(folder: Path, monkeypatch: pytest.MonkeyPatch):
    ran: list[Job] = []
    monkeypatch.setattr(reproduce, "run_job", lambda job, *_: ran.append(job) or {})
    again = run_jobs(jobs([1], range(2), 20, [None]), folder, 1)
    assert not ran and len(again) == 6
    run_jobs(jobs([1], range(2), 21, [None]), folder, 1)
    assert {job.policy for job in ran} == {"q_learning", "sarsa"} and len(ran) == 4


def test_a_damaged_row_is_made_again(folder: Path, tmp_path: Path):
    job = Job(1, "baseline", 0, None, 20)
    (tmp_path / "jobs").mkdir()
    file = tmp_path / "jobs" / f"{job.name}.json"
    file.write_text('{"identity": "half')
    (row,) = run_jobs([job], tmp_path, 1)
    assert json.loads(file.read_text())["row"] == row
    there = json.loads((folder / "jobs" / f"{job.name}.json").read_text())["row"]
    assert row == there


@pytest.mark.thorough
def test_any_number_of_processes_gives_the_same(folder: Path, tmp_path: Path):
    todo = [job for job in jobs([1], range(2), 20, [None]) if job.policy != "sarsa"]
    for rows in (run_jobs(todo, tmp_path, 2), run_jobs(todo, folder, 1)):
        rows.sort(key=lambda row: (row["policy"], row["seed"]))
        todo.append(rows)
    assert todo[-1] == todo[-2]


def test_the_engine_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(reproduce, "EPISODES", 2)
    command = ("reproduce", "--cases", 1, "--seeds", 1, "--episodes", 4, "-q", "--out")
    with monkeypatch.context() as patched:
        patched.setattr(BatchSimulation, "__init__", lambda *_: pytest.fail("compiled"))
        assert run_cli(*command, tmp_path / "des", "--engine", "des").exit_code == 0
    monkeypatch.setattr(Simulation, "__init__", lambda *_: pytest.fail("not compiled"))
    assert run_cli(*command, tmp_path / "batch", "--engine", "batch").exit_code == 0
    assert run_cli(*command, tmp_path / "unsaid").exit_code == 0, "the compiled one unless told"
    made = list((tmp_path / "des").rglob("*-s100.*"))
    assert len(made) == 3 + 2, "the rows of three policies, and what two have learned"
    for file in [*made, *(tmp_path / "des" / f"{name}.csv" for name in ("rows", "table"))]:
        within = file.relative_to(tmp_path / "des")
        for other in ("batch", "unsaid"):
            assert (tmp_path / other / within).read_bytes() == file.read_bytes(), within


def test_the_command_writes_the_table(folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr(sys, "argv", ["desim-uav", "reproduce", "--cases", "1"])
    result = run_cli("reproduce", "--cases", 1, *SEEDS, "--episodes", 20, "--out", folder)
    assert result.exit_code == 0, result.output
    assert "75, 0, 100" in result.stdout and "best cover" in result.stdout
    with (folder / "rows.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["policy"], row["seed"]) for row in rows] == [
        (policy, seed) for policy in POLICIES for seed in "01"
    ]
    with (folder / "table.csv").open() as file:
        table = {row["policy"]: row for row in csv.DictReader(file)}
    mean = sum(float(r["qoe3_percent"]) for r in rows if r["policy"] == "sarsa") / 2
    assert float(table["sarsa"]["qoe3_percent"]) == pytest.approx(mean)
    assert table["q_learning"]["published_qoe3_percent"] == "100"
    text = (folder / "table.md").read_text()
    assert text.startswith("`desim-uav reproduce --cases 1`\n") and "| 1 | q-learning |" in text


def test_a_gate_that_does_not_hold(tmp_path: Path):
    """A drone that was trained for an episode is not at 0.99 of the best cover."""
    command = ("reproduce", "--cases", 1, *SEEDS, "--episodes", 1, "--out", tmp_path)
    assert run_cli(*command, "-q").exit_code == 0, "it is asked for"
    reached = [
        json.loads(file.read_text())["row"]["qoe3_percent"]
        for file in (tmp_path / "jobs").glob("*q_learning*")
    ]
    assert sum(reached) / 2 < 99 and best_cover(1, 0)["cover_qoe3_percent"] == 100
    failed = run_cli(*command, "--check", "-q")
    assert failed.exit_code == 6
    assert "gate: case 1: Q-learning's QoE3 is at least 0.99" in failed.stderr


def test_gates_that_hold(folder: Path, tmp_path: Path):
    for file in (folder / "jobs").glob("*.json"):
        content = json.loads(file.read_text())
        content["row"]["qoe3_percent"] = 100.0
        content["sha256"] = checksums.of_row(content["row"])
        (tmp_path / "jobs").mkdir(exist_ok=True)
        (tmp_path / "jobs" / file.name).write_text(json.dumps(content))
    command = ("reproduce", "--cases", 1, *SEEDS, "--episodes", 20, "--out", tmp_path)
    assert run_cli(*command, "--check", "-q").exit_code == 0


def test_nothing_is_trained_for_a_folder_that_cannot_be(tmp_path: Path, monkeypatch):
    (tmp_path / "file").write_text("mine")
    monkeypatch.setattr(reproduce, "run_job", lambda *_: pytest.fail("trained"))
    with pytest.raises(UsageError, match="--out"):
        run_jobs(jobs([1], range(1), 20, [None]), tmp_path / "file", 1)
    result = run_cli("reproduce", "--preset", "paper", "--check", "--out", tmp_path / "new")
    assert isinstance(result.exception, UsageError) and not (tmp_path / "new").exists()


# ---- what is claimed


def row(case: int, policy: str, seed: int, **measures: float) -> dict[str, Any]:
    usual = {
        "case": case,
        "policy": policy,
        "preset": "default",
        "seed": seed,
        "qoe1_percent": 90.0 + seed,
        "qoe1_feasible_percent": 91.0 + seed,
        "qoe2_iterations": 1.0,
        "qoe3_percent": 70.0 + seed,
        "qoe3_active_percent": 70.0,
        "crashes_per_drone_episode": 0.0,
        "reward_mean": 1.0,
        "cover_qoe3_percent": 90.0,
    }
    return usual | measures


def made(case: int, learned: dict[str, float], baseline: dict[str, float]) -> list[dict[str, Any]]:
    return [
        row(case, policy, seed, **{key: value + 0.1 * seed for key, value in given.items()})
        for policy, given in (("q_learning", learned), ("sarsa", learned), ("baseline", baseline))
        for seed in range(3)
    ]


def holding(rows: list[dict[str, Any]]) -> dict[str, bool]:
    return {claim.text: claim.holds for claim in claims(rows)}


def test_the_share_of_the_best_cover():
    text = "case 3: Q-learning's QoE3 is at least 0.93 of the best cover"
    assert holding(made(3, {"qoe3_percent": 84.0}, {})) == {text: True}
    assert holding(made(3, {"qoe3_percent": 83.0}, {})) == {text: False}


def test_beating_the_baseline_means_an_interval_above_zero():
    found = holding(made(4, {"qoe1_percent": 50.0}, {"qoe1_percent": 40.0}))
    assert found["case 4: Q-learning beats the baseline on QoE1"]
    assert not found["case 4: Q-learning beats the baseline on QoE3"], "they are equal"
    noisy = made(4, {"qoe3_percent": 75.0}, {"qoe3_percent": 70.0})
    noisy[0]["qoe3_percent"] = 30.0
    assert not holding(noisy)["case 4: Q-learning beats the baseline on QoE3"]


def test_cases_8_and_9_look_at_feasible_qoe1():
    rows = made(8, {"qoe1_feasible_percent": 95.0}, {"qoe1_feasible_percent": 91.0})
    assert holding(rows)["case 8: Q-learning beats the baseline on feasible QoE1"]


def test_the_published_floor_and_crashes():
    found = holding(made(7, {"qoe3_percent": 64.0, "crashes_per_drone_episode": 0.2}, {}))
    assert not found["case 7: Q-learning reaches the best published QoE3, 65 %"]
    assert not found["case 7: at most 0.05 crashes per drone and episode"]
    found = holding(made(9, {"qoe3_percent": 46.0, "crashes_per_drone_episode": -0.2}, {}))
    assert found["case 9: Q-learning reaches the best published QoE3, 45 %"]
    assert found["case 9: at most 0.1 crashes per drone and episode"]


def test_what_the_paper_claims_is_reported_and_no_gate():
    calm = {"crashes_per_drone_episode": 0.01, "qoe1_percent": 95.0}
    wild = {"crashes_per_drone_episode": 0.5, "qoe1_percent": 95.0}
    worst = {"qoe3_percent": 20.0, "crashes_per_drone_episode": 0.0, "qoe1_percent": 50.0}
    found = [c for c in claims(made(8, calm, worst) + made(9, wild, worst)) if not c.gate]
    assert len(found) == 8 and all(claim.holds for claim in found)


def test_what_the_paper_claims_can_be_wrong():
    calm = {"crashes_per_drone_episode": 0.01, "qoe1_percent": 50.0, "qoe3_percent": 20.0}
    best = {"qoe3_percent": 60.0, "crashes_per_drone_episode": 0.5, "qoe1_percent": 95.0}
    found = [c for c in claims(made(8, calm, best) + made(9, calm, best)) if not c.gate]
    assert len(found) == 8 and not any(claim.holds for claim in found)


def test_safety_is_of_the_cases_with_batteries():
    """Cases 1-3 have nothing to crash for: they would only water the difference down."""
    rows = made(1, {}, {}) + made(8, {"crashes_per_drone_episode": 0.4}, {}) + made(9, {}, {})
    for row in rows:
        row["fair_reward"] = None
    text = "the paper: the baseline is the safest (mean over cases 4-9, against sarsa)"
    (claim,) = [claim for claim in claims(rows) if claim.text == text]
    assert claim.found.startswith("0.250"), "the mean of 0.5 and 0, on the seeds' mean"


def test_the_paper_preset_is_shown_and_not_judged():
    rows = [row | {"preset": "paper"} for row in made(4, {"qoe3_percent": 1.0}, {})]
    assert claims(rows) == []
    assert "q-learning (paper)" in markdown(lines(rows), [], {0, 1, 2}, "command")


def test_one_seed_has_no_interval():
    (line,) = lines([row(4, "sarsa", 0)])
    assert line.estimates["qoe3_percent"].half_width is None
    assert "| 4 | sarsa | 90.0 | 91.0 |" in markdown([line], [], {0}, "command")


def test_the_published_table():
    assert [best_qoe3(case) for case in range(1, 10)] == [100, 100, 80, 60, 68, 65, 65, 55, 45]
    assert PUBLISHED[9]["baseline"] == (52, 215184, 9)


def test_the_best_cover_is_known_of_users_that_stand_still():
    known = best_cover(3, 0)
    assert 0 < known["cover_qoe3_percent"] <= 100
    assert known["fair_least_qoe3_percent"] <= known["fair_qoe3_percent"]
    assert known["fair_qoe3_percent"] <= known["cover_qoe3_percent"]
    assert best_cover(4, 0)["fair_reward"] is None, "with a battery nobody hovers forever"
    assert set(best_cover(8, 0).values()) == {None}


def test_a_policy_is_evaluated_where_it_was_trained(folder: Path):
    again = run_job(Job(1, "q_learning", 0, None, 20), folder)
    there = json.loads((folder / "jobs" / "case1-q_learning-default-s0.json").read_text())["row"]
    assert again == there


def test_a_mean_over_cases_is_the_same_on_every_python():
    """Python 3.12 and later add 0.1 ten times to exactly 1.0 by ``sum``."""
    rows = [{"policy": "sarsa", "seed": 3, "qoe1_percent": 0.1} for _ in range(10)]
    assert _over_cases(rows, "sarsa", "qoe1_percent") == [0.09999999999999999]
