"""The benchmark: frozen tasks, scores worked by hand, submissions that replay, and errors."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from desim_uav.errors import PolicyError, ScenarioError
from desim_uav.experiment.bench import tasks as frozen
from desim_uav.experiment.bench.board import board, markdown, profile
from desim_uav.experiment.bench.bounds import compute, has_bound, kept
from desim_uav.experiment.bench.measure import worst_tenth
from desim_uav.experiment.bench.score import interquartile_mean, score
from desim_uav.experiment.bench.submission import ROWS, read, read_all
from desim_uav.experiment.bench.tasks import TRACKS, find_task, tasks
from desim_uav.experiment.bench.verify import differences
from desim_uav.scenario.load import load, scenario_hash
from desim_uav.shipped import bench_folder
from tests.command_line import ROOT, runner

SAME = {
    "coverage/small": "case4",
    "coverage/medium": "case5",
    "multi-service/medium": "case8",
    "urban/medium": "urban_downlink",
}
"""Tasks that have the scenario of another shipped file."""

ROW = {
    "qoe1_percent": 90.0,
    "crashes_per_drone_episode": 0.0,
    "fairness": 0.9,
    "worst_tenth_qoe1_percent": 70.0,
    "decision_ms": 1.0,
}


@pytest.fixture
def cli(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    return runner(capsys, monkeypatch)


@pytest.mark.parametrize("task", tasks().values(), ids=lambda task: task.name)
def test_no_task_has_changed(task):
    assert scenario_hash(load(task.path)) == task.scenario_hash


def test_every_task_has_a_file_and_every_file_is_a_task():
    assert {task.path for task in tasks().values()} == {*bench_folder().glob("*.yaml")}
    for name, other in SAME.items():
        assert find_task(f"uav-v1/{name}").scenario_hash == scenario_hash(load(other))


def test_an_edited_task_is_refused(monkeypatch, tmp_path):
    task = find_task("uav-v1/coverage")
    text = task.path.read_text(encoding="utf-8").replace("count: 24", "count: 25")
    (tmp_path / task.path.name).write_text(text, encoding="utf-8")
    monkeypatch.setattr(frozen, "bench_folder", lambda: tmp_path)
    with pytest.raises(ScenarioError, match="frozen and has been changed"):
        task.scenario(TRACKS["one"])


def test_no_policy_is_trained_in_the_worlds_of_a_track():
    trained = {*frozen.WORLDS["train"], *frozen.WORLDS["validation"], 0}
    assert not trained & {TRACKS["any"].world_of(seed) for seed in TRACKS["any"].seeds}
    assert {TRACKS["one"].world_of(seed) for seed in TRACKS["one"].seeds} == {0}


def test_bounds_are_kept_for_runs_of_the_protocol_only():
    for (task, track, seed), bound in kept().items():
        assert has_bound(find_task(task), TRACKS[track])
        assert seed in TRACKS[track].seeds and 0 < bound <= 100
    assert not has_bound(find_task("uav-v1/urban"), TRACKS["one"])
    assert compute(find_task("uav-v1/urban"), TRACKS["one"], 100) is None


def test_the_list(cli):
    assert "uav-v1/rush/large" in cli("bench", "list").out
    found = cli("bench", "list", "--json").json
    assert len(found["tasks"]) == 15
    assert found["protocol"]["tracks"]["any"]["seeds"][0] == 3_000_000


@pytest.mark.parametrize(
    ("code", "arguments", "parts"),
    [
        (2, ("run", "uav-v1/covrage", "--policy", "hover"), ["did you mean 'uav-v1/coverage'"]),
        (2, ("run", "uav-v1/rush", "--policy", "hover", "--track", "anny"), ["mean 'any'"]),
        (2, ("run", "uav-v1/rush", "--policy", "hover", "--seeds", "11"), ["from 1 to 10"]),
        (4, ("run", "uav-v1/rush", "--policy", "greddy"), ["'greddy'", "mean 'greedy'"]),
        (4, ("verify", "none"), ["none: no such folder"]),
        (4, ("board", "none", "-o", "page.md"), ["none: no such folder"]),
    ],
)
def test_errors(cli, tmp_path, code, arguments, parts):
    cli("bench", *arguments).failed(code, *parts)
    assert not [*tmp_path.iterdir()]


def test_scores_by_hand():
    assert score(70.0, 50.0, 90.0) == 0.5
    assert score(40.0, 50.0, 90.0) == -0.25
    assert score(50.0, 90.0, 90.0) is None


def test_the_interquartile_mean_by_hand():
    """Of eight values, two at each end are left out."""
    found = interquartile_mean([[1, 2, 3, 100], [4, 5, 6, -100]])
    assert found.value == (2 + 3 + 4 + 5) / 4
    assert found.low < found.value < found.high
    assert found == interquartile_mean([[1, 2, 3, 100], [4, 5, 6, -100]])
    assert interquartile_mean([[2.0, 2.0], [2.0, 2.0]]) == interquartile_mean([[2.0, 2.0]])
    assert interquartile_mean([[5.0]]).low is None


def test_intervals_draw_each_task_by_itself():
    """Two tasks with constant values have no spread; drawn from one pot, they would have one."""
    found = interquartile_mean([[0.0] * 4, [1.0] * 4])
    assert (found.low, found.value, found.high) == (0.5, 0.5, 0.5)


def test_intervals_are_those_of_rliable():
    """rliable 1.2.0 with 5,000 resamples gave these for 10 seeds in 3 tasks."""
    values = np.random.default_rng(1).normal(0.5, 0.2, (10, 3)) + np.array([0, 0.3, 0.6])
    found = interquartile_mean(list(values.T))
    assert found.value == pytest.approx(0.82471816, abs=1e-8)
    assert (found.low, found.high) == pytest.approx((0.74940762, 0.88346015), abs=0.003)


def test_the_worst_tenth_of_users_by_hand():
    """Of 11 users two are the worst tenth: 10 % and 20 %."""
    qoe1 = [0.9] * 9 + [0.1, 0.2]
    assert worst_tenth(pd.DataFrame({"user": range(11), "qoe1": qoe1})) == pytest.approx(15.0)


def submitted(name, qoe3, bound=90.0, future=False, task="uav-v1/coverage"):
    """A submission with these values of QoE3, on seeds from 100 on."""
    rows = [
        ROW | {"seed": 100 + k, "qoe3_percent": value, "qoe3_at_most_percent": bound}
        for k, value in enumerate(qoe3)
    ]
    about = SimpleNamespace(policy=name, name=name, knows_future=future, information="local")
    return SimpleNamespace(
        folder=name, about=about, rows=rows, task=find_task(task), track=TRACKS["one"]
    )


def test_the_board_by_hand():
    (table,) = board(
        [
            submitted("mine", [70.0, 80.0]),
            submitted("oracle", [90.0, 90.0], future=True),
            submitted("baseline", [50.0, 70.0]),
        ]
    )
    assert [(row["policy"], row["score"].value) for row in table["rows"]] == [
        ("oracle", 1.0),
        ("mine", 0.5),
        ("baseline", 0.0),
    ]
    page = markdown([table])
    assert "| oracle (knows the future: not a competitor) | 1.000 [1.000, 1.000] |" in page
    assert "| 75.00 [70.00, 80.00] |" in page and "| 2 of 10 |" in page


def test_a_board_without_the_baseline_or_a_bound_has_no_scores():
    (table,) = board([submitted("mine", [70.0])])
    assert table["rows"][0]["score"] is None and "baseline is not among" in markdown([table])
    (table,) = board([submitted("mine", [70.0], None), submitted("baseline", [50.0], None)])
    assert table["rows"][0]["policy"] == "mine" and "No bound" in markdown([table])


def test_the_board_of_several_tasks_has_the_policies_that_are_in_all():
    tasks_of = ("uav-v1/coverage", "uav-v1/rush")
    found = [submitted("baseline", [50.0, 50.0], task=task) for task in tasks_of]
    found += [submitted("mine", [70.0, 70.0], task=task) for task in tasks_of]
    *_, last = board([*found, submitted("other", [80.0, 80.0])])
    assert [(row["policy"], row["score"].value) for row in last["rows"]] == [
        ("mine", 0.5),
        ("baseline", 0.0),
    ]
    assert [*last["rows"][0]["profile"].values()] == [1, 1, 1, 0, 0]


def test_a_profile_by_hand():
    """One of two runs reaches 0.5 in the first task, and the only one in the second."""
    assert profile([[0.5, 0.2], [0.8]]) == {
        "0": 1,
        "0.25": 0.75,
        "0.5": 0.75,
        "0.75": 0.5,
        "0.9": 0,
    }


def test_two_submissions_of_one_name_are_refused():
    with pytest.raises(PolicyError, match="are called 'mine'"):
        board([submitted("mine", [1.0]), submitted("mine", [2.0])])


KEPT = ROOT / "analysis" / "leaderboard"


def test_the_kept_submissions_are_whole_and_below_the_bounds():
    found = read_all([KEPT])
    assert len(found) >= 20 and board(found)
    for row in (row for each in found for row in each.rows):
        assert (bound := row["qoe3_at_most_percent"]) is None or row["qoe3_percent"] <= bound


@pytest.mark.thorough
def test_a_kept_submission_of_each_task_replays():
    chosen = {(found.task.name, found.track.name): found for found in read_all([KEPT])}
    for found in chosen.values():
        first = replace(found, rows=found.rows[:1])
        assert not differences(first), found.folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A submission of the table of case 8 on two seeds, and the one of the baseline beside it."""
    from desim_uav.experiment.bench.run import submit
    from desim_uav.run_folder import Place

    here, track = tmp_path_factory.mktemp("bench"), TRACKS["one"]
    for policy, name in (("case8.npz", "table"), ("baseline", "baseline")):
        submit(
            find_task("uav-v1/multi-service"),
            track,
            policy,
            Place(here / name, name),
            name=name,
            seeds=track.seeds[:2],
        )
    return here


def changed(folder, tmp_path, file, change):
    """A copy of a submission in which a file was changed, without checksums."""
    copy = tmp_path / "copy"
    copy.mkdir()
    for each in folder.iterdir():
        if each.name != "SHA256SUMS":
            content = each.read_bytes()
            (copy / each.name).write_bytes(change(content) if each.name == file else content)
    return copy


@pytest.mark.thorough
def test_a_policy_that_does_not_fit(cli):
    done = cli("bench", "run", "uav-v1/urban", "--policy", "case8.npz")
    done.failed(4, "drones 3", "the scenario has 4")


@pytest.mark.thorough
def test_a_submission_replays_bit_for_bit(cli, folder):
    done = cli("bench", "verify", folder / "table", "--decide")
    assert (done.code, "2 seeds replayed" in done.out) == (0, True), done.err


@pytest.mark.thorough
def test_the_board_of_two_folders(cli, folder, tmp_path):
    done = cli("bench", "board", folder / "table", folder / "baseline", "-o", tmp_path / "a.md")
    assert done.code == 0, done.err
    page = (tmp_path / "a.md").read_text(encoding="utf-8")
    table, baseline = page.index("| table | 0."), page.index("| baseline | 0.000")
    assert table < baseline
    assert cli("bench", "board", folder).out == page


@pytest.mark.thorough
def test_a_changed_row_is_refused(cli, folder, tmp_path):
    def raised(content):
        header, first, rest = content.decode().split("\n", 2)
        cells = first.split(",")
        cells[header.split(",").index("qoe3_percent")] = "89.5"
        return "\n".join([header, ",".join(cells), rest]).encode()

    copy = changed(folder / "table", tmp_path, ROWS, raised)
    done = cli("bench", "verify", copy, "--json")
    assert done.code == 6 and not done.json["verified"]
    (line,) = done.json["differences"]
    assert line.startswith("seed 100: qoe3_percent: the folder has 89.5, the replay ")
    (copy / "SHA256SUMS").write_bytes((folder / "table" / "SHA256SUMS").read_bytes())
    cli("bench", "verify", copy).failed(4, "rows.csv", "has changed")


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (b"100,0,", b"100,0,1,", "a row is too long"),
        (b"100,0,", b"hundred,0,", "seed: 'hundred' is not a number"),
        (b"100,0,", b"100,inf,", "world_seed: 'inf' is not a number"),
        (b"101,0,", b"102,0,", "its seeds are not those of manifest.json"),
        (b"qoe3_percent,", b"qoe4_percent,", "its columns must be seed, world_seed,"),
    ],
)
def test_rows_that_cannot_be_read(cli, folder, tmp_path, before, after, said):
    copy = changed(folder / "table", tmp_path, ROWS, lambda content: content.replace(before, after))
    cli("bench", "board", copy).failed(4, "rows.csv", said)


@pytest.mark.thorough
def test_changed_commands_are_refused(cli, folder, tmp_path):
    from desim_uav.array_file import Stored, pack

    stored = Stored(folder / "table" / "commands.npz", "file of commands", ["commands"], 1)
    commands = stored.arrays()["commands"].copy()
    commands[1, 2, 5:10] = (commands[1, 2, 5:10] + 1) % 4
    copy = changed(
        folder / "table",
        tmp_path,
        "commands.npz",
        lambda content: pack(stored.about, commands=commands),
    )
    done = cli("bench", "verify", copy, "--decide")
    assert done.code == 6 and "seed 101: digest" in done.err and "seed 100" not in done.err
    assert "the policy decides otherwise, first in episode 1, step 5" in done.err
    bad = np.zeros((1, 2, 3, 3), np.int8)
    (copy / "commands.npz").write_bytes(pack(stored.about, commands=bad))
    cli("bench", "verify", copy).failed(4, "commands.npz", "shape (2, 6, 30, 3)")


@pytest.mark.thorough
def test_a_submission_of_another_protocol_is_refused(cli, folder, tmp_path):
    def shorter(content):
        return json.dumps(json.loads(content) | {"engine": "des"}).encode()

    copy = changed(folder / "table", tmp_path, "manifest.json", shorter)
    done = cli("bench", "verify", copy)
    assert done.code == 6 and "engine: the folder has 'des', the protocol 'batch'" in done.err


@pytest.mark.thorough
def test_an_interruption_keeps_the_seeds_that_have_ended(tmp_path, monkeypatch):
    from desim_uav.experiment.bench import run
    from desim_uav.run_folder import Place

    def once(function, work, jobs):
        yield 0, function(*work[0])
        raise KeyboardInterrupt

    monkeypatch.setattr(run, "run_each", once)
    task, place = find_task("uav-v1/multi-service"), Place(tmp_path / "kept", "kept")
    done = run.submit(task, TRACKS["one"], "hover", place)
    assert done.interrupted and read(done.folder).about.seeds == [100]
