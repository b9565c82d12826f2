"""The scripts of analysis/ run and say something sound."""

import importlib
import json
import math
import os
import re
import runpy
import shutil
import signal
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

import desim_uav as du
from analysis.runs import read_runs
from desim_uav.engine.base import RunSettings
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.experiment.bench.kept import bound_of, reference_of
from desim_uav.experiment.bench.score import measures_of, score
from desim_uav.experiment.bench.submission import read
from desim_uav.experiment.bench.tasks import tasks
from desim_uav.experiment.bench.verify import differences
from desim_uav.experiment.compare_runs import compare_runs
from desim_uav.experiment.interrupt import asking
from desim_uav.model.rules import MOVES
from desim_uav.sample_path import draw
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.run_to_folder import run_to_folder

SCRIPTS = Path(__file__).parents[1] / "analysis"


@pytest.fixture(autouse=True)
def beside_the_scripts(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a script imports from its folder is found, as if Python had been called with it."""
    monkeypatch.syspath_prepend(SCRIPTS)


@pytest.mark.thorough
def test_learned_against_optimum(capsys: pytest.CaptureFixture[str], monkeypatch):
    script = str(SCRIPTS / "learned_against_optimum.py")
    monkeypatch.setattr(sys, "argv", [script, "1", "20"])
    runpy.run_path(script, run_name="__main__")
    rows = re.findall(r"^\| 100 \| (\w+) \| (.*) \|$", capsys.readouterr().out, re.MULTILINE)
    assert [algorithm for algorithm, _ in rows] == ["q_learning", "sarsa"]
    for _, cells in rows:
        reward, best, share, qoe3, best_qoe3 = map(float, cells.split(" | "))
        assert share == pytest.approx(reward / best, abs=2e-3) and share <= 1
        assert qoe3 <= best_qoe3


@pytest.mark.slow
def test_other_readings_of_the_paper_are_those_of_the_page(ask):
    page = (SCRIPTS.parent / "docs" / "explanation" / "readings.md").read_text(encoding="utf-8")
    code, printed, _ = ask("readings", "4")
    rows = printed.splitlines()[2:]
    assert (code, len(rows)) == (0, 5)
    assert all(row in page.splitlines() for row in rows)


def test_rewards_are_compared_seed_by_seed():
    script = runpy.run_path(str(SCRIPTS / "rewards.py"), run_name="rewards")

    def of(qoe: list[float], crashes: float) -> list[dict[str, float]]:
        names = script["MEASURES"]
        return [dict(zip(names, (one, one - 10, crashes), strict=True)) for one in qoe]

    kept = of([80.0, 82.0, 84.0], 0.0)
    line = script["line"]("case8", "qoe", of([81.0, 84.0, 87.0], 0.05), kept)
    half = stats.t.ppf(0.975, 2) / math.sqrt(3)
    gain = f"+2.0 ± {half:.1f}"
    assert line == f"| 8 | qoe | 84.0 | {gain} | 74.0 | {gain} | 0.050 ± 0.000 |"
    lone = script["line"]("case8", "qoe", of([81.0], 0.0), kept[:1])
    assert lone == "| 8 | qoe | 81.0 | +1.0 | 71.0 | +1.0 | 0.000 |"


def test_rewards_are_asked_for_in_any_order(monkeypatch):
    script = runpy.run_path(str(SCRIPTS / "rewards.py"), run_name="rewards")
    asked = ["2", "3", "--seeds", "2", "--against", "qoe", "mine={kind: coverage, capped: false}"]
    monkeypatch.setattr("sys.argv", ["rewards.py", *asked])
    cases, seeds, rewards, against = script["arguments"]()
    assert (cases, seeds, against) == (["case2", "case3"], range(9000, 9002), "qoe")
    assert rewards["mine"] == {"kind": "coverage", "capped": False}
    assert rewards.keys() - script["REWARDS"].keys() == {"mine"}


@pytest.mark.parametrize(
    ("script", "asked", "told"),
    [
        ("rewards", ["--seeds", "0"], "must be a whole number from 1"),
        ("cruise", ["--seeds", "0"], "must be a whole number from 1"),
        ("cruise", ["8.4 m/s"], "must be one of fill_epoch, 8.3 m/s"),
        ("learned_against_optimum", ["-1"], "-1"),
        ("learned_against_optimum", ["1", "0"], "must be a whole number from 1"),
        ("bench_references", ["uav-v1/nowhere"], "uav-v1/nowhere: unknown task"),
        ("bench_references", ["--seeds", "0"], "must be a whole number from 1"),
        ("edge_schedule", ["--seeds", "11"], "must be a whole number from 1 to 10"),
        ("harvest_schedule", ["--trials", "1e9"], "must be a whole number from 1"),
    ],
)
def test_what_a_script_cannot_do_is_a_usage_error(ask, script, asked, told):
    code, printed, error = ask(script, *asked)
    assert (code, printed) == (2, "")
    assert told in error


SMALL = ["users.count=16", "episode.steps=20"]
SEEDS = (0, 1, 2)
QUESTIONS = ("waiting", "distance", "interruptions", "fairness", "paired_difference")


@pytest.fixture
def cruise():
    """The names of analysis/cruise.py."""
    return runpy.run_path(str(SCRIPTS / "cruise.py"), run_name="cruise")


def test_hops_at_cruise_speeds(cruise):
    rows = {speed: cruise["hop"](speed) for speed in (cruise["FILLING_MPS"], 8.3, 18.3)}
    assert rows[8.3] == ("8.3 m/s", "31.0 s", "4,062 J", "16.92 J/m", "131.1 W", "8,949 J")
    filling = rows[cruise["FILLING_MPS"]]
    assert filling == ("4.07 m/s", "60.0 s", "9,032 J", "37.63 J/m", "150.5 W", "9,032 J")
    assert rows[18.3][1:3] == ("17.7 s", "2,678 J")


def test_times_of_flights_are_shares_of_the_drones_time(cruise):
    hop_s = 240 / 8.3 + 8.3 / 4
    rows = [(0.0, hop_s, "flying", 0), (1790.0, hop_s, "flying", 0), (60.0, 12.0, "flying", 20)]
    rows += [(100.0, 45.0, "returning", 0), (0.0, 0.0, "flying", 0)]
    legs = pd.DataFrame(rows, columns=["t_s", "duration_s", "mode", "z_to_m"]).assign(z_from_m=0)
    shares = cruise["times"](legs, 1800.0)
    assert shares == pytest.approx(
        {"8.3 m/s": (hop_s + 10) / 1800, "climb": 12 / 1800, "return": 45 / 1800}, abs=1e-4
    ), "what begins in an episode and ends after it counts up to its end"


def test_cruise_speeds_are_compared_seed_by_seed(cruise):
    def of(qoe3, j_per_mbit):
        each = {"power_w": 130.0, "time": {"8.3 m/s": 0.5}}
        pairs = zip(qoe3, j_per_mbit, strict=True)
        return [{"qoe3": one, "j_per_mbit": used, **each} for one, used in pairs]

    own, chosen = of([80.0, 82.0, 84.0], [50.0, 40.0, 60.0]), of([81.0, 84.0, 87.0], [45.0] * 3)
    half = stats.t.ppf(0.975, 2) / math.sqrt(3)
    ratios = np.array([0.9, 1.125, 0.75])
    wide = ratios.std(ddof=1) * half
    assert cruise["line"]("8.3 m/s", own, chosen) == (
        *("8.3 m/s", "82.0", f"2.00 ± {half:.2f}", "50.00"),
        *(f"{ratios.mean():.3f} ± {wide:.3f}", "130.0", "8.3 m/s 50 %"),
    )


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Two policies on three seeds, in one world."""
    return [
        played(tmp_path_factory.mktemp("runs"), policy, seed, "world_seed=0")
        for policy in ("baseline", "random")
        for seed in SEEDS
    ]


def played(place, policy, seed, *overrides, case="case8"):
    done = run_to_folder(
        load(scenario_path(case), [*(SMALL if case != "tiny" else []), f"seed={seed}", *overrides]),
        policy,
        episodes=2,
        warmup=1,
        keep_events=False,
        out=place / f"{policy}-{seed}",
        command=[],
    )
    return Path(done.summary["run_dir"])


@pytest.fixture
def ask(capsys, monkeypatch):
    """Run a script; what it printed, or how it failed."""

    def run(question, *arguments):
        script = str(SCRIPTS / f"{question}.py")
        monkeypatch.setattr(sys, "argv", [script, *map(str, arguments)])
        capsys.readouterr()
        code = 0
        try:
            runpy.run_path(script, run_name="__main__")
        except SystemExit as end:
            code = end.code
        return code, *capsys.readouterr()

    return run


@pytest.fixture(scope="module")
def answers():
    """What each script said of all folders."""
    return {}


@pytest.fixture
def answer(ask, folders, answers):
    """What a script says of all folders, which it is asked once."""

    def said(question):
        if question not in answers:
            code, out, _ = ask(question, *folders)
            assert code == 0
            answers[question] = out
        return answers[question]

    return said


def table(out):
    """Its rows, split where two blanks or more stand, or one: cells hold single blanks too."""
    return [re.sub(r" ± ", "±", line).split() for line in out.splitlines()]


def requests_of(folder):
    found = pd.read_parquet(folder / "requests.parquet")
    return found[found["episode"] >= 0]


def interval(values, digits):
    """Mean and half-width of a 95 % t-interval, by SciPy, as printed."""
    low, high = stats.t.interval(0.95, len(values) - 1, np.mean(values), stats.sem(values))
    return f"{np.mean(values):.{digits}f}±{(high - low) / 2:.{digits}f}"


def place(folder, request):
    """Where a request's user was, by linear interpolation over the walk."""
    users = pd.read_parquet(folder / "users.parquet")
    walk = users[(users["episode"] == request.episode) & (users["user"] == request.user)]
    return [np.interp(request.t_request_s, walk["t_s"], walk[axis]) for axis in ("x_m", "y_m")]


def test_where_users_were(folders, tmp_path):
    static = played(tmp_path, "hover", 0, case="case7")
    for folder in (folders[1], static):
        world = json.loads((folder / "world.json").read_text())
        read = read_runs([folder])
        assert len(read) == len(requests_of(folder)) > 0
        for request in read.sample(min(25, len(read)), random_state=0).itertuples():
            x_m, y_m = place(folder, request)
            centre = world["clusters"][request.user % len(world["clusters"])]
            assert (request.x_m, request.y_m) == pytest.approx((x_m, y_m))
            assert request.from_centre_m == pytest.approx(
                math.dist((x_m, y_m), (centre["x_m"], centre["y_m"]))
            )
            assert request.cell == f"{int(x_m // 240)}, {int(y_m // 240)}"


def test_waiting(folders, answer):
    out = answer("waiting")
    waits = [requests_of(f).groupby("service")["wait_s"].mean() for f in folders[:3]]
    rows = {tuple(row[:3]): row[3:] for row in table(out)[1:]}
    for service in ("throughput", "edge_computing", "data_gathering"):
        count, wait, _ = rows["baseline", service, "anywhere"]
        assert wait == interval([mean[service] for mean in waits], 1)
        assert int(count) == sum((requests_of(f)["service"] == service).sum() for f in folders[:3])
    means = [float(row[-2].partition("±")[0]) for row in table(out)[1:] if row[0] == "random"]
    assert means == sorted(means, reverse=True)


def test_waiting_knows_no_common_cluster_of_two_worlds(ask, tmp_path):
    apart = [played(tmp_path, "hover", seed) for seed in (0, 1)]
    _, out, _ = ask("waiting", *apart)
    assert "anywhere" in out and "cluster" not in out
    assert "cluster 0" in ask("waiting", apart[0])[1]


def test_distance(folders, answer):
    out = answer("distance")
    first = out.partition("random")[0]
    rows = {row[0]: row[2:] for row in table(first)[2:-1]}
    read = read_runs(folders[:3])
    assert sum(int(count) for _, count in rows.values()) == len(read)
    middle = read[(read["from_centre_m"] >= 120) & (read["from_centre_m"] < 180)]
    of_seeds = [100 * np.mean(of["qoe1"]) for _, of in middle.groupby("seed")]
    assert rows["120"] == [interval(of_seeds, 1), str(len(middle))]
    ranks = [
        stats.spearmanr(of["from_centre_m"], of["qoe1"]).statistic for _, of in read.groupby("seed")
    ]
    assert table(first)[-1][-1] == interval(ranks, 3)


def test_distance_needs_clusters(ask, tmp_path):
    bare = played(tmp_path, "hover", 0, case="tiny")
    code, out, err = ask("distance", bare)
    assert (code, out) == (4, "") and "no clusters" in err


def test_interruptions(folders, answer):
    out = answer("interruptions")
    (row,) = [row for row in table(out) if row[:2] == ["random", "all"]]
    found = []
    for folder in folders[3:]:
        served = [r for r in requests_of(folder).itertuples() if r.outcome != "never_served"]
        costs = []
        for one in (r for r in served if r.interruptions > 0):
            alike = [
                r.qoe2_iterations
                for r in served
                if (r.service, r.requested_s) == (one.service, one.requested_s)
                and r.interruptions == 0
            ]
            costs += [one.qoe2_iterations - np.mean(alike)] if alike else []
        found.append(np.mean(costs))
    assert row[-1] == interval(found, 2)
    assert int(row[2]) == sum(
        (requests_of(f)["outcome"] != "never_served").sum() for f in folders[3:]
    )


def test_fairness(folders, answer):
    out = answer("fairness")
    (row,) = [row for row in table(out) if row[0] == "random"]
    users = [requests_of(f).groupby("user")["qoe1"].mean() for f in folders[3:]]
    jain = [u.sum() ** 2 / (len(u) * (u**2).sum()) for u in users]
    gini = [np.abs(np.subtract.outer(u, u)).mean() / (2 * u.mean()) for u in map(np.array, users)]
    worst = [100 * u.nsmallest(2).mean() for u in users]
    assert row[1:] == [
        "3",
        interval(jain, 3),
        interval(gini, 3),
        interval(worst, 1),
        interval([100 * u.mean() for u in users], 1),
    ]


@pytest.mark.thorough
def test_paired_difference_is_what_compare_says(folders, answer):
    out = answer("paired_difference")
    (said,) = compare_runs(folders).content()["differences"]
    for name, label, scale in (("qoe1_percent", "QoE1,", 1), ("qoe2_iterations", "QoE2,", 1)):
        (row,) = [row for row in table(out) if row[0] == label]
        found = said["measures"][name]
        assert row[5] == "3" and row[2:5] == ["random", "-", "baseline"]
        assert row[6] == f"{scale * found['mean']:.3f}±{found['half_width']:.3f}"
        assert ("≠" in row) is found["excludes_zero"]


def test_paired_difference_needs_two_policies(folders, ask):
    code, out, err = ask("paired_difference", *folders[:3])
    assert (code, out) == (4, "") and "all runs are of one policy, baseline" in err


@pytest.mark.parametrize("question", QUESTIONS)
class TestEach:
    def test_stands_in_the_documentation(self, question, ask):
        asked, _, usage, *_ = ask(question, "--help")[1].splitlines()
        page = (SCRIPTS.parent / "docs" / "howto" / "report.md").read_text(encoding="utf-8")
        assert f"| {asked} | `{usage}` |" in page

    @pytest.mark.thorough
    def test_draws(self, question, folders, ask, tmp_path):
        picture = tmp_path / "picture.png"
        assert ask(question, *folders, picture)[0] == 0
        assert picture.read_bytes().startswith(b"\x89PNG")
        nowhere = tmp_path / "no" / "picture.png"
        assert ask(question, folders[0], folders[3], nowhere)[0] == 2

    def test_of_one_seed_says_that_it_has_no_interval(self, question, folders, ask, answer):
        _, out, _ = ask(question, folders[0], folders[3])
        assert "no interval from a single seed" in out and "±" not in out
        assert "no interval" not in answer(question)

    def test_says_what_is_wrong(self, question, folders, ask, tmp_path):
        code, out, err = ask(question, tmp_path / "nope")
        assert (code, out) == (4, "") and "no such run folder" in err
        assert ask(question, tmp_path)[0] == 4
        assert ask(question)[0] == ask(question, "picture.png")[0] == 2
        code, out, _ = ask(question, "--help")
        assert code == 0 and f"analysis/{question}.py RUN_DIR…" in out
        other = played(tmp_path, "hover", 0, "stations.pads=2")
        code, out, err = ask(question, folders[0], other)
        assert (code, out) == (4, "") and "its scenario is not that of" in err

    @pytest.mark.thorough
    def test_a_name_is_no_formula(self, question, folders, ask, tmp_path):
        renamed = []
        for folder in (folders[0], folders[3]):
            renamed.append(shutil.copytree(folder, tmp_path / folder.name))
            manifest = json.loads((folder / "manifest.json").read_text())
            manifest["policy"] += r" $\frac$"
            (renamed[-1] / "manifest.json").write_text(json.dumps(manifest))
            (renamed[-1] / "SHA256SUMS").unlink()
        code, out, _ = ask(question, *renamed, tmp_path / "picture.svg")
        assert code == 0 and r"$\frac$" in out


@pytest.fixture
def leaderboard(monkeypatch, tmp_path):
    """The script with a plan of one seed of a task for two policies, in a folder of its own."""
    script = importlib.import_module("leaderboard")
    contenders = tuple(script.Contender(name, name, "") for name in ("hover", "baseline"))
    for name, value in {
        "FOLDER": tmp_path / "kept",
        "PAGES": tmp_path / "pages",
        "MADE": tmp_path / "made",
        "FAMILIES": ("coverage",),
        "PLAN": (script.Field("small", "one", 1),),
        "CONTENDERS": contenders,
        "complete": lambda *_, **__: None,  # which writes to the tasks
    }.items():
        monkeypatch.setattr(script, name, value)
    return script


@pytest.fixture
def lead(leaderboard, monkeypatch, capsys):
    """Call the script with arguments; return its exit code and what it printed."""

    def called(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["leaderboard.py", *arguments])
        return leaderboard.main(), *capsys.readouterr()

    return called


def test_the_leaderboard_has_every_task():
    script = importlib.import_module("leaderboard")
    names = [entry.name for entry in script.entries()]
    assert len({*names}) == len(names)
    assert {*names} >= {
        f"{task.family}-{field.size}-{field.track}-{name}"
        for field in script.PLAN
        for task in tasks().values()
        if task.size == field.size
        for name in ("random", "hover", "baseline", "greedy")
    }
    assert not [name for name in names if "dispatch" in name and "q-learning" in name]


@pytest.mark.thorough
def test_the_leaderboard_is_made_once_and_what_was_changed_is_made_anew(leaderboard, lead):
    assert lead("--list")[:2] == (0, "coverage-small-one-hover\ncoverage-small-one-baseline\n")
    assert lead("hover")[0] == 0
    hover = leaderboard.FOLDER / "coverage-small-one-hover" / "rows.csv"
    made, page = hover.stat().st_mtime_ns, leaderboard.PAGES / "coverage.md"
    assert re.search(r"\| hover \| -\d", page.read_text(encoding="utf-8"))
    code, out, _ = lead()
    assert code == 0 and "2 of 2 submissions" in out and "hover:" not in out
    assert hover.stat().st_mtime_ns == made
    overview = (leaderboard.PAGES / "overview.md").read_text(encoding="utf-8")
    assert re.search(
        r"\| \[coverage\]\(.*\| small \| one \| 1 \| -.* \| \*\*0.000\*\* \|", overview
    )
    assert "| verification | 2 |" in overview and "| decided again |" in overview
    assert (leaderboard.PAGES / "coverage.png").read_bytes().startswith(b"\x89PNG")
    hover.write_text(hover.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    assert lead("--list")[1] == "coverage-small-one-hover\n"
    assert lead()[0] == 0 and lead("--list")[1].strip() == ""


@pytest.fixture
def handlers():
    """Leave the handling of signals as it was."""
    before = {number: signal.getsignal(number) for number in asking()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.thorough
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_leaderboard_goes_on(leaderboard, lead, monkeypatch, handlers, number):
    flown, calls = leaderboard.flown, []

    def interrupted(entry):
        if calls:
            os.kill(os.getpid(), number)
            time.sleep(60)
        calls.append(entry.name)
        return flown(entry)

    monkeypatch.setattr(leaderboard, "flown", interrupted)
    assert lead()[0] == 130
    monkeypatch.setattr(leaderboard, "flown", flown)
    assert lead("--list")[1] == "coverage-small-one-baseline\n"
    code, out, _ = lead()
    assert code == 0 and "runs 1 of 1: coverage-small-one-baseline" in out


@pytest.mark.thorough
def test_a_submission_that_differs_from_its_replay_fails(leaderboard, lead, monkeypatch):
    asked = {}
    monkeypatch.setattr(
        leaderboard, "differences", lambda _, **how: asked.update(how) or ["seed 100: digest"]
    )
    code, _, err = lead("hover")
    assert (code, err) == (6, "coverage-small-one-hover: seed 100: digest\n")
    assert asked == {"decide": True}
    page = (leaderboard.PAGES / "overview.md").read_text(encoding="utf-8")
    assert "| claimed |" in page and "| replayed |" not in page


@pytest.mark.thorough
def test_who_decides_again_is_noted(leaderboard, lead, monkeypatch, tmp_path):
    """A planner is only replayed, and so is a policy whose training is not here."""
    contenders = [
        leaderboard.Contender("slow", "hover", "", plans=True),
        leaderboard.Contender("table", leaderboard.TRAINED, "", "q_learning"),
    ]
    monkeypatch.setattr(leaderboard, "CONTENDERS", contenders)
    monkeypatch.setattr(leaderboard, "trained", kept_table)
    assert lead()[0] == 0
    slow, table = leaderboard.entries()
    assert checks(leaderboard) == {slow.name: "replayed", table.name: "decided again"}
    receipts = leaderboard.FOLDER / leaderboard.RECEIPTS
    receipts.write_text(receipts.read_text().replace("decided again", "replayed"))
    assert lead()[0] == 0
    assert checks(leaderboard)[table.name] == "decided again"
    receipts.unlink()
    shutil.rmtree(leaderboard.MADE)
    monkeypatch.setattr(leaderboard, "MADE", tmp_path / "elsewhere")  # not what the manifest names
    kept_table(*table.trainings())
    assert lead()[0] == 0
    assert set(checks(leaderboard).values()) == {"replayed"}


def kept_table(training):
    """Train quickly, instead of ``leaderboard.trained``."""
    du.train(training.task.path, ["learning.episodes=1"], world_seed=0, progress=False).save(
        training.file.parent
    )
    return 1.0


def checks(script):
    """How the submissions of a leaderboard were verified."""
    noted = script.read_receipts(script.FOLDER / script.RECEIPTS)
    return {one.name: noted[script.digest_of(script.FOLDER / one.name)] for one in script.entries()}


@pytest.mark.thorough
def test_a_training_that_fails_is_told(leaderboard, lead, monkeypatch):
    contender = leaderboard.Contender("PPO", leaderboard.TRAINED, "", "ppo")
    monkeypatch.setattr(leaderboard, "CONTENDERS", [contender])
    monkeypatch.setattr(leaderboard, "SETTINGS", ("--steps", "0"))
    code, _, err = lead()
    assert code == 1 and "coverage-small-ppo-0: --steps 0: must be from 1" in err


def test_a_training_is_done_once_for_all_rows_that_need_it(leaderboard, lead, monkeypatch):
    trained = leaderboard.TRAINED
    rows = [("Q", trained), ("rollout", f"rollout:{trained}")]
    contenders = [leaderboard.Contender(*row, "", "q_learning", 2) for row in rows]
    monkeypatch.setattr(leaderboard, "CONTENDERS", contenders)
    made = []
    monkeypatch.setattr(leaderboard, "trained", lambda one: made.append(one.name) or 1.5)
    monkeypatch.setattr(leaderboard, "flown", lambda entry: made.append(entry.policies()) or 2.5)
    monkeypatch.setattr(leaderboard, "_verify", lambda *_: [])
    assert lead()[0] == 4  # nothing was flown, so there are no pages
    names = [f"coverage-small-q_learning-{seed}" for seed in range(2)]
    of_task = tasks()["uav-v1/coverage/small"].scenario_hash[:8]
    files = [str(leaderboard.MADE / f"{name}-{of_task}" / "policy.npz") for name in names]
    assert made == [*names, files, [f"rollout:{file}" for file in files]]
    assert (
        "training,coverage-small-q_learning-1,1.5" in (leaderboard.FOLDER / "times.csv").read_text()
    )


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["nonesuch"], 2, "nonesuch: no part of the leaderboard has such a name"),
        (
            ["--list", "coverage", "hovr", "nonesuch"],
            2,
            "hovr (did you mean 'hover'?), nonesuch: no part of the leaderboard has such a name",
        ),
        (["-j", "0"], 2, "-j 0: must be at least 1"),
        (["--pages"], 4, "there are no pages without a submission"),
    ],
)
def test_what_the_leaderboard_refuses(lead, arguments, code, message):
    exit_code, out, err = lead(*arguments)
    assert (exit_code, out) == (code, "") and message in err


KEPT = SCRIPTS / "leaderboard"


@pytest.mark.thorough
def test_the_pages_of_the_leaderboard_are_those_of_the_kept_submissions(monkeypatch, tmp_path):
    script = importlib.import_module("leaderboard")
    pages, written = script.PAGES, tmp_path / "pages"
    monkeypatch.setattr(script, "PAGES", written)
    monkeypatch.setattr(script.Times, "add", lambda *_, **__: None)
    monkeypatch.setattr(sys, "argv", ["leaderboard.py", "--pages"])
    assert script.main() == 0
    names = sorted(page.name for page in pages.glob("*.md"))
    assert names == sorted(page.name for page in written.glob("*.md"))
    for name in names:
        texts = [(folder / name).read_text(encoding="utf-8") for folder in (pages, written)]
        assert texts[0] == texts[1], name
    assert {folder.name for folder in KEPT.iterdir() if folder.is_dir()} == {
        entry.name for entry in script.entries() if entry.submission() is not None
    }


SOON_VERIFIED = ("coverage-small-one-hover", "multi-service-small-one-random")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            folder.name,
            marks=pytest.mark.thorough if folder.name in SOON_VERIFIED else pytest.mark.slow,
        )
        for folder in sorted(KEPT.iterdir())
        if folder.is_dir()
    ],
)
def test_the_kept_submissions_are_verified(name):
    assert differences(read(KEPT / name)) == []


@pytest.fixture
def curves(monkeypatch, capsys, tmp_path):
    """Compare programs of ``ppo_curves`` with trainings that are short; the code and the output."""
    script = importlib.import_module("ppo_curves")
    made = []

    def trained(program, folder, seed, steps, central):
        made.append((program.parent.name, seed, steps, central))
        return float(len(made))

    def asked(*arguments):
        made.clear()
        words = ["ppo_curves.py", *map(str, arguments), "--out", str(tmp_path / "kept")]
        monkeypatch.setattr(sys, "argv", words)
        return script.main(), *capsys.readouterr(), list(made)

    monkeypatch.setattr(script, "trained", trained)
    monkeypatch.setattr(script, "measured", lambda network: dict.fromkeys(script.MEASURES, 1.0))
    return asked


def test_curves_are_kept_by_the_text_of_a_program_and_all_options(curves, tmp_path):
    programs = [tmp_path / name / "ppo.py" for name in ("a", "b")]
    for number, program in enumerate(programs):
        program.parent.mkdir()
        program.write_text(f"NUMBER = {number}\n")
    usual, more = ("--seeds", 1, "--steps", 30_000), ("--seeds", 1, "--steps", 40_000)
    assert curves(*programs, *usual)[3] == [("a", 0, 30_000, False), ("b", 0, 30_000, False)]
    assert curves(*programs, *usual)[3] == []
    assert curves(programs[0], *more)[3] == [("a", 0, 40_000, False)]
    assert curves(programs[0], *usual, "--central")[3] == [("a", 0, 30_000, True)]
    programs[0].write_text("NUMBER = 2\n")
    assert curves(*programs, *usual)[3] == [("a", 0, 30_000, False)]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["none.py"], "none.py: no such file"),
        ([SCRIPTS / "ppo_curves.py", "--seeds", 0], "--seeds 0: must be from 1 to"),
        ([SCRIPTS / "ppo_curves.py", "--steps", 9], "--steps 9: must be from 24576 to"),
    ],
)
def test_curves_without_trainings_are_refused(curves, arguments, told):
    code, out, err, made = curves(*arguments)
    assert (code, out, made) == (2, "", []) and told in err


@pytest.mark.thorough
def test_halves_of_a_run_make_its_score():
    """The mean of both halves, but for QoE1, which is a mean over requests."""
    script, kept = importlib.import_module("bench_blocks"), read(KEPT / "handover-small-one-random")
    row, commands = kept.rows[0], kept.commands[0]
    of_run = (kept.task, kept.track, row["seed"])
    found = script.halves_of(*of_run, commands, kept.about.ceiling)
    whole = score(measures_of(kept.task), row, reference_of(*of_run), bound_of(*of_run))
    assert len({*found}) == 2 and np.mean(found) == pytest.approx(whole, abs=0.05)


def test_policies_that_differ_pairwise_are_counted():
    told_apart = importlib.import_module("leaderboard_pages").told_apart

    def row(*scores: float, knows_future: bool = False, policy: str = "own") -> dict[str, object]:
        listed = list(range(len(scores)))
        about = {"policy": policy, "knows_future": knows_future}
        return {"scores": [list(scores)], "listed": listed, **about}

    best, alike, worst = row(0.9, 0.8, 0.9), row(0.8, 0.9, 0.9), row(0.1, 0.2, 0.1)
    seer = row(1.0, 1.0, 1.0, knows_future=True)
    assert told_apart({"rows": [best, alike, worst]}) == 2
    assert told_apart({"rows": [seer, best, worst]}) == 2
    assert told_apart({"rows": [best, row(0.1, 0.2, 0.1, policy="random")]}) == 1
    assert told_apart({"rows": [row(0.9), row(0.1)]}) == 1  # no interval from a single seed


@pytest.fixture(scope="module")
def fairness():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(SCRIPTS)
        return runpy.run_path(str(SCRIPTS / "fairness.py"), run_name="fairness")


class TestLorenz:
    def of(self, *shares):
        return pd.DataFrame({"user": range(len(shares)), "qoe1": shares})

    def test_two_to_one(self, fairness):
        """Below the curve through (0, 0), (1/2, 1/3), (1, 1) lies 5/12."""
        assert fairness["lorenz"](self.of(1.0, 0.5)).tolist() == pytest.approx([0, 1 / 3, 1])
        assert fairness["gini"](self.of(1.0, 0.5)) == pytest.approx(1 - 2 * 5 / 12)

    @pytest.mark.parametrize("users", [1, 2, 10])
    def test_all_alike_or_one_has_it_all(self, fairness, users):
        assert fairness["gini"](self.of(*[0.3] * users)) == pytest.approx(0.0)
        assert fairness["gini"](self.of(0.8, *[0.0] * (users - 1))) == pytest.approx(1 - 1 / users)

    def test_nobody_served_or_nobody_there(self, fairness):
        assert fairness["gini"](self.of(0.0, 0.0)) is None
        assert fairness["gini"](self.of()) is None

    @settings(deadline=None)
    @given(st.lists(st.floats(0.01, 1.0), min_size=1, max_size=30))
    def test_is_half_the_mean_difference_over_the_mean(self, fairness, shares):
        apart = np.abs(np.subtract.outer(shares, shares)).mean()
        found = fairness["gini"](self.of(*shares))
        assert found == pytest.approx(apart / (2 * np.mean(shares)), abs=1e-12)


def test_what_is_missing_of_the_leaderboard_is_said(tmp_path):
    pages = importlib.import_module("leaderboard_pages")
    times = importlib.import_module("leaderboard_times").Times(tmp_path / "times.csv")
    times.add("runs", "coverage-small-one-hover", 90.0)
    plan = [
        pages.Planned(tasks()[f"uav-v1/{family}/{size}"], "one", policy, there)
        for family, size, policy, there in (
            ("coverage", "small", "hover", True),
            ("edge", "small", "hover", False),
            ("edge", "small", "PPO", False),
            ("urban", "small", "PPO", False),
            ("edge", "medium", "hover", False),
        )
    ]
    said = pages.costs(plan, times)
    assert said.startswith("1 of the 5 submissions of the plan are there.")
    assert "| small | one | 4 | 1 | hover: edge; PPO: edge, urban |" in said
    assert "| medium | one | 1 | 0 | all |" in said
    assert "Missing" not in pages.costs(plan[:1], times)


def test_columns_of_the_leaderboard_without_content_are_left_out():
    filled = importlib.import_module("leaderboard_pages")._filled
    heads = ("Policy", "J per Mbit", "Seeds")
    lines = [["greedy", "-", "10"], ["hover", "-", "-"]]
    assert filled(heads, lines) == (["Policy", "Seeds"], [["greedy", "10"], ["hover", "-"]])
    assert filled(heads[:1], []) == (["Policy"], [])


class TestScheduleOfEdge:
    steps, seed = 8, 0

    @pytest.fixture
    def scenario(self):
        return load(tasks()["uav-v1/edge/small"].path, [f"episode.steps={self.steps}"])

    @pytest.fixture
    def script(self):
        return importlib.import_module("edge_schedule")

    @pytest.mark.thorough
    def test_counts_what_a_run_with_its_commands_counts(self, script, scenario):
        world = build_world(scenario, 0)
        engine = BatchSimulation(world, RunSettings((True,) * 2, True))
        paths = [draw(world, self.seed, episode) for episode in range(2)]
        commands, shares = [], []
        for plan in script.schedules(engine, paths, 20, self.seed):
            shares.append(script.share_in_time(engine.log.requests))
            moves = np.diff(plan.cells, axis=1)
            commands += [
                [commanded(world, *one) for one in zip(moves[:, t], plan.shares[:, t], strict=True)]
                for t in range(self.steps)
            ]
        left = iter([command for step in commands for command in step])
        flown = du.run(
            scenario,
            policy=lambda *_: next(left),
            seed=self.seed,
            episodes=2,
            warmup=0,
            world_seed=0,
            progress=False,
        )
        late = flown.requests.dropna(subset="late").groupby("episode")["late"]
        assert shares == pytest.approx([100 * (1 - own.astype(bool).mean()) for _, own in late])
        assert next(left, None) is None

    @pytest.mark.thorough
    def test_changes_for_the_better(self, script, scenario):
        world = build_world(scenario, 0)
        engine = BatchSimulation(world, RunSettings((True,) * 2, True))
        engine.reset(draw(world, self.seed, 0))
        schedule = script.Schedule(engine, np.array(world.starts)[:, :2], None)
        hovering = sum(schedule.paid)
        schedule.improve(100, np.random.default_rng(0))
        assert sum(schedule.paid) > hovering + 1.0
        engine.restore(schedule.states[0])
        assert schedule.fly(schedule.plan, 0)[0] == schedule.paid

    def test_a_changed_plan_can_be_flown_and_differs_from_its_first_step_on(self, script, scenario):
        world, rng = build_world(scenario, 0), np.random.default_rng(0)
        cells = np.repeat(np.array(world.starts)[:, None, :2], self.steps + 1, axis=1)
        plan = script.Plan(cells, np.full((2, self.steps), 0.75))
        for _ in range(200):
            after, begin = script.changed(plan, world, rng)
            assert (after.cells[:, : begin + 1] == plan.cells[:, : begin + 1]).all()
            assert (after.shares[:, :begin] == plan.shares[:, :begin]).all()
            assert (np.abs(np.diff(after.cells, axis=1)).sum(-1) <= 1).all()
            assert ((after.cells >= 0) & (after.cells < world.grid.cells)).all()
            plan = after


def commanded(world, move, share):
    """Return the number of the command that moves a drone so and offloads this part of tasks."""
    return next(
        number
        for number, one in enumerate(world.actions)
        if MOVES.get(one.action, (0, 0, 0))[:2] == tuple(move) and one.share == share
    )


@pytest.mark.thorough
def test_a_schedule_of_harvest_has_the_age_of_a_run_and_becomes_better(monkeypatch):
    """Forks from the middle of an episode have the age that they have from its beginning."""
    script = importlib.import_module("harvest_schedule")
    monkeypatch.setattr(script, "LEGS", 1)
    monkeypatch.setattr(script, "WAITS", 1)
    monkeypatch.setattr(script, "TRIPS", 30)
    scenario = load(tasks()["uav-v1/harvest/small"].path, ["episode.steps=8"])
    world = build_world(scenario, 0)
    forks = script.Forks(world, draw(world, 0, 0))
    flown = du.run(scenario, policy="hover", episodes=1, warmup=0, world_seed=0, progress=False)
    plan = [[], []]
    age = forks.age_s(plan, [0, 0])
    assert age == pytest.approx(flown.episodes["age_s"][0])
    forks.accept()
    assert [counts for _, counts in forks.states] == [[0, 0], [6, 6]]
    home = [action.name for action in world.actions].index("GOTO_CHARGING_STATION")
    plan[1] = [forks.hover] * 6 + [home]
    from_the_middle = forks.age_s(plan, [8, 6])
    assert len(forks.next_states) == 2 and forks.next_states[1] is forks.states[1]
    assert script.Forks(world, draw(world, 0, 0)).age_s(plan, [0, 0]) == from_the_middle < age
    monkeypatch.setattr(script, "world_of", lambda size: world)
    of = ("small", 0, 0)
    plans = [script.repeating(*of)]
    first = script.lowest(*of, plans, 0)
    assert first == forks.age_s(plans[0], [0, 0]) > script.lowest(*of, plans, 100) > 0.0
    monkeypatch.setattr(script, "TRIPS", 0)
    plans.append(script.repeating(*of))
    assert script.lowest(*of, plans[1:], 0) > script.lowest(*of, plans, 0) == first


def box(width, height, roof_m, ridge_m=0.0):
    """The triangles of a house with upright walls, and with a roof that may rise to a ridge."""
    corners = [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)]
    walls = []
    for (x0, y0), (x1, y1) in pairwise([*corners, corners[0]]):
        low, high = ((x0, y0, 0.0), (x1, y1, 0.0)), ((x0, y0, roof_m), (x1, y1, roof_m))
        walls += [(low[0], low[1], high[1]), (low[0], high[1], high[0])]
    top = (width / 2, height / 2, roof_m + ridge_m)
    roof = [
        ((*one, roof_m), (*other, roof_m), top) for one, other in pairwise([*corners, corners[0]])
    ]
    return np.array(walls + roof)


def test_buildings_of_a_scene_are_taken_as_they_are_or_not_at_all():
    script = importlib.import_module("munich")
    outline, roof_m = script.prism_of(box(30.0, 20.0, 10.0))
    assert outline.equals(shapely.box(0, 0, 30, 20)) and roof_m == 10.0
    assert script.prism_of(box(30.0, 20.0, 10.0, ridge_m=2.0)) is None
    assert script.prism_of(np.add(box(30.0, 20.0, 10.0), (0.0, 0.0, 1.0))) is None
    assert script.prism_of(box(30.0, 20.0, 10.0)[:-2]) is None  # half of the roof is missing
    assert script.prism_of(box(30.0, 20.0, 10.0)[-4:]) is None  # a roof without walls


@pytest.mark.thorough
def test_links_past_the_buildings_of_a_scene():
    script = importlib.import_module("munich")
    house = script.prism_of(box(30.0, 20.0, 10.0))
    ends = [(-10.0, 10.0, 1.5), (40.0, 10.0, 60.0)], [(-10.0, 10.0, 1.5), (40.0, 10.0, 20.0)]
    past = [(-10.0, 25.0, 1.5), (40.0, 25.0, 20.0)]
    lines = np.array([*ends, past])
    assert script.blocked([house], lines).tolist() == [False, True, False]
    # They enter the house at 13.2 and 5.2 m, under a roof at 10 m, and the third is 5 m beside.
    deepest = [script.deepest_m([house], line) for line in lines]
    assert deepest == pytest.approx([-3.2, 4.8, -5.0])
