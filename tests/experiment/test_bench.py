"""The benchmark: frozen tasks, scores worked by hand, submissions that replay, and errors."""

from __future__ import annotations

import json
import signal
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from desim_uav.errors import PolicyError, ScenarioError
from desim_uav.experiment.bench import submission
from desim_uav.experiment.bench import tasks as frozen
from desim_uav.experiment.bench.board import board, markdown, profile
from desim_uav.experiment.bench.bounds import CLOSE, compute, has_bound, kept
from desim_uav.experiment.bench.measure import Measured
from desim_uav.experiment.bench.profile import figure, panels, shares
from desim_uav.experiment.bench.score import RESAMPLES, interquartile_mean, resampled, score
from desim_uav.experiment.bench.submission import ROWS, columns_of, read, read_all
from desim_uav.experiment.bench.tasks import TRACKS, find_task, tasks
from desim_uav.experiment.bench.verify import differences
from desim_uav.scenario.load import load, scenario_hash
from desim_uav.shipped import bench_folder, find_table
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


@pytest.mark.thorough
def test_bounds_are_kept_for_runs_of_the_protocol_only():
    for (task, track, seed), bound in kept().items():
        assert has_bound(find_task(task), TRACKS[track])
        assert seed in TRACKS[track].seeds and 0 < bound <= 100
    assert not has_bound(find_task("uav-v1/urban"), TRACKS["one"])
    assert compute(find_task("uav-v1/urban"), TRACKS["one"], 100) is None


def test_the_list(cli):
    assert "uav-v1/rush/large" in cli("bench", "list").out
    found = cli("bench", "list", "--json").json
    assert len(found["tasks"]) == 18
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


def test_intervals_draw_trainings_and_seeds_each_by_itself():
    """All spread is between the trainings: four of one value draw their mean again and again.

    The share of the upper of two trainings is 0, 1/2 or 1 with the probabilities 1/4, 1/2 and 1/4,
    and how many seeds there are does not matter. One training of the same values has less spread,
    because its eight seeds are drawn each by itself.
    """
    (drawn,) = resampled([np.array([[0.0] * 4, [1.0] * 4])])
    assert drawn.shape == (RESAMPLES, 8)
    shares, counts = np.unique(drawn.mean(axis=1), return_counts=True)
    assert [*shares] == [0.0, 0.5, 1.0]
    assert counts / RESAMPLES == pytest.approx([0.25, 0.5, 0.25], abs=0.04)
    of_two = interquartile_mean([[[0.0] * 4, [1.0] * 4]])
    of_one = interquartile_mean([[0.0] * 4 + [1.0] * 4])
    assert (of_two.low, of_two.value, of_two.high) == (0.0, 0.5, 1.0)
    assert of_one.value == 0.5 and 0.0 < of_one.high - of_one.low <= 1.0


def test_intervals_of_trainings_and_seeds_have_the_variance_of_both():
    """Of a mean of effects a + b, the pigeonhole variance is var(a) / T + var(b) / E."""
    rng = np.random.default_rng(2)
    trainings, seeds = rng.normal(0, 1, 10), rng.normal(0, 2, 8)
    (drawn,) = resampled([trainings[:, None] + seeds[None, :]])
    expected = trainings.var() / 10 + seeds.var() / 8
    assert drawn.mean(axis=1).var() == pytest.approx(expected, rel=0.1)


def test_intervals_are_those_of_rliable():
    """rliable 1.2.0 with 5,000 resamples gave these for 10 seeds in 3 tasks."""
    values = np.random.default_rng(1).normal(0.5, 0.2, (10, 3)) + np.array([0, 0.3, 0.6])
    found = interquartile_mean(list(values.T))
    assert found.value == pytest.approx(0.82471816, abs=1e-8)
    assert (found.low, found.high) == pytest.approx((0.74940762, 0.88346015), abs=0.003)


def submitted(name, *qoe3, bound=90.0, future=False, task="uav-v1/coverage"):
    """A submission with these values of QoE3 for each training, on seeds from 100 on."""
    rows = [
        ROW | {"training": n, "seed": 100 + k, "qoe3_percent": value, "qoe3_at_most_percent": bound}
        for n, values in enumerate(qoe3)
        for k, value in enumerate(values)
    ]
    about = SimpleNamespace(
        policy=name,
        policy_sha256="0" if len(qoe3) > 1 else None,
        training_steps=None,
        name=name,
        knows_future=future,
        information="local",
    )
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


def test_energy_is_a_column_of_tasks_whose_batteries_hold_it():
    """Two seeds with 2 and 4 J per Mbit; the other policy has served nothing on one of them."""
    told, quiet = (
        submitted(name, [70.0, 80.0], bound=None, task="uav-v1/endurance") for name in ("a", "b")
    )
    for row, per_mbit in zip([*told.rows, *quiet.rows], [2.0, 4.0, None, 5.0], strict=True):
        row["j_per_mbit"] = per_mbit
    (table,) = board([told, quiet])
    assert [row["j_per_mbit"] for row in table["rows"]] == [3.0, 5.0]
    assert "| 70.00 | 3.00 | 1.00 |" in markdown([table])
    assert "| 70.00 | - | 1.00 |" in markdown(board([submitted("c", [70.0])]))
    columns = {
        family: columns_of(1, find_task(f"uav-v1/{family}")) for family in ("endurance", "rush")
    }
    assert [name for name in columns["endurance"] if name not in columns["rush"]] == ["j_per_mbit"]


def test_the_board_counts_trainings_and_seeds():
    (table,) = board(
        [submitted("learner", [70.0, 80.0], [60.0, 90.0]), submitted("baseline", [50.0, 70.0])]
    )
    learner, baseline = table["rows"]
    assert learner["scores"] == [[0.5, 0.5], [0.25, 1.0]]
    assert (learner["score"].value, learner["trainings"], learner["seeds"]) == (0.5, 2, 2)
    assert baseline["trainings"] is None
    page = markdown([table])
    assert "| local | 2 of 10 | 2 of 10 |" in page and "| local | - | 2 of 10 |" in page


def test_a_board_without_the_baseline_or_a_bound_has_no_scores():
    (table,) = board([submitted("mine", [70.0])])
    assert table["rows"][0]["score"] is None and "baseline is not among" in markdown([table])
    (table,) = board(
        [submitted("mine", [70.0], bound=None), submitted("baseline", [50.0], bound=None)]
    )
    assert table["rows"][0]["policy"] == "mine" and "No bound" in markdown([table])


def test_the_board_of_several_tasks_has_first_the_policies_that_are_in_all():
    tasks_of = ("uav-v1/coverage", "uav-v1/rush", "uav-v1/swarm")
    found = [submitted("baseline", [50.0, 50.0], task=task) for task in tasks_of]
    found += [submitted("mine", [70.0, 70.0], task=task) for task in tasks_of]
    found += [submitted("good at two", [80.0, 80.0], task=task) for task in tasks_of[:2]]
    *_, last = tables = board([*found, submitted("good at one", [80.0, 80.0])])
    assert [(row["policy"], row["score"].value, row["tasks"]) for row in last["rows"]] == [
        ("mine", 0.5, 3),
        ("baseline", 0.0, 3),
        ("good at two", 0.75, 2),
    ]
    assert [*last["rows"][0]["profile"].values()] == [1, 1, 1, 0, 0]
    assert "| 0 % | 2 of 3 | 4 |" in markdown(tables)
    (panel,) = panels(tables)
    assert [curve.name for curve in panel.curves] == ["mine", "baseline"]


def test_a_profile_by_hand():
    """One of two runs reaches 0.5 in the first task, and the only one in the second."""
    assert profile([[0.5, 0.2], [0.8]]) == {
        "0": 1,
        "0.25": 0.75,
        "0.5": 0.75,
        "0.75": 0.5,
        "0.9": 0,
    }


def test_the_curve_of_a_profile_by_hand():
    """Half of the runs of the first task reach 0.5, all of the second, so three quarters do."""
    found = shares([np.array([0.2, 0.5]), np.array([0.8])], np.array([0.0, 0.5, 0.6, 1.0]))
    assert [*found] == [1.0, 0.75, 0.5, 0.0]


def test_the_figure_has_a_curve_for_each_policy_with_a_score():
    tables = board([submitted("mine", [60.0, 80.0, 85.0]), submitted("baseline", [50.0] * 3)])
    (panel,) = panels(tables)
    assert panel.title == "Track one: uav-v1/coverage/medium"
    mine, baseline = panel.curves
    assert (mine.name, baseline.name) == ("mine", "baseline")
    at = {round(float(x), 2): k for k, x in enumerate(mine.x)}
    assert [mine.y[at[x]] for x in (0.2, 0.5, 0.8, 0.9)] == pytest.approx([1, 2 / 3, 1 / 3, 0])
    assert [baseline.y[at[x]] for x in (-1.0, 0.0, 0.02)] == [1, 1, 0]
    assert (mine.low <= mine.y).all() and (mine.y <= mine.high).all()
    assert mine.low[at[0.8]] == 0 and mine.high[at[0.5]] == 1
    (axes,) = figure(tables).axes
    assert len(axes.lines) == 3  # and one at zero
    (panel,) = panels(
        board([submitted("oracle", [60.0], future=True), submitted("baseline", [50.0])])
    )
    assert [curve.name for curve in panel.curves] == ["oracle*", "baseline"]


def test_the_figure_of_several_tasks_is_of_all_together():
    tasks_of = ("uav-v1/coverage", "uav-v1/rush")
    found = [submitted("baseline", [50.0, 50.0], task=task) for task in tasks_of]
    (panel,) = panels(board(found))
    assert panel.title == "Track one: 2 tasks" and len(panel.curves) == 1


def test_there_is_no_figure_without_scores():
    with pytest.raises(PolicyError, match="no policy has a score"):
        figure(board([submitted("mine", [70.0])]))


def test_two_submissions_of_one_name_are_refused():
    with pytest.raises(PolicyError, match="are called 'mine'"):
        board([submitted("mine", [1.0]), submitted("mine", [2.0])])


KEPT = ROOT / "analysis" / "leaderboard"


@pytest.fixture(scope="module")
def submissions():
    return read_all([KEPT])


@pytest.mark.thorough
def test_the_kept_submissions_are_whole(submissions):
    tables = board(submissions)
    assert {table["task"] for table in tables if "task" in table} == {*tasks()}
    for table in (table for table in tables if "task" in table):
        assert table["scored"] is has_bound(find_task(table["task"]), TRACKS[table["track"]])


def test_no_kept_row_is_above_the_bound_of_its_run(submissions):
    """Neither the bound that it states, which is the one that is kept, nor that one."""
    compared = 0
    for each in submissions:
        bounded = has_bound(each.task, each.track)
        for row in each.rows:
            bound = kept().get((each.task.name, each.track.name, row["seed"]))
            stated = row["qoe3_at_most_percent"]
            if not bounded:
                assert stated is bound is None
                continue
            assert stated == pytest.approx(bound, abs=CLOSE), each.folder
            assert row["qoe3_percent"] <= min(bound, stated), (each.folder, row["seed"])
            compared += 1
    assert compared > 1000


@pytest.mark.parametrize("task", ["uav-v1/coverage/small", "uav-v1/coverage/medium"])
@pytest.mark.parametrize("track", TRACKS)
def test_bounds_of_cases_4_and_5_are_at_most_12_percent_above_the_best(submissions, task, track):
    """On each seed, of all policies on the leaderboard."""
    rows = [
        row
        for each in submissions
        if (each.task.name, each.track.name) == (task, track)
        for row in each.rows
    ]
    for seed in TRACKS[track].seeds:
        best = max(row["qoe3_percent"] for row in rows if row["seed"] == seed)
        assert best <= kept()[task, track, seed] <= 1.12 * best


@pytest.mark.thorough
def test_a_kept_submission_of_each_task_replays():
    chosen = {(found.task.name, found.track.name): found for found in read_all([KEPT])}
    for found in chosen.values():
        first = replace(found, rows=found.rows[:1], commands=found.commands[:1])
        assert not differences(first), found.folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A submission of the table of case 8 on two seeds, and the one of the baseline beside it."""
    from desim_uav.experiment.bench.run import submit
    from desim_uav.run_folder import RunPlace

    here, track = tmp_path_factory.mktemp("bench"), TRACKS["one"]
    for policy, name in (("case8.npz", "table"), ("baseline", "baseline")):
        submit(
            find_task("uav-v1/multi-service"),
            track,
            policy,
            RunPlace(here / name, name),
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
    assert (done.code, "all runs replayed" in done.out) == (0, True), done.err


@pytest.mark.thorough
def test_a_network_flies_with_the_observation_that_it_needs(cli, tmp_path):
    """That of the task is another one."""
    import desim_uav as du

    network = "ppo_case8_any.npz"
    task = ("bench", "run", "uav-v1/multi-service", "--policy", network, "--seeds", 1)
    done = cli(*task, "--out", tmp_path / "net")
    assert done.code == 0, done.err
    found = read(tmp_path / "net")
    flown = du.run(
        "case8",
        policy=network,
        world_seed=0,
        seed=100,
        episodes=5,
        warmup=1,
        engine="batch",
        progress=False,
    )
    assert found.about.information == "radar"
    assert found.rows[0]["qoe3_percent"] == flown.summaries()[0]["qoe3_percent"]
    assert not differences(found, decide=True)


@pytest.mark.thorough
def test_the_board_of_two_folders(cli, folder, tmp_path):
    done = cli("bench", "board", folder / "table", folder / "baseline", "-o", tmp_path / "a.md")
    assert done.code == 0, done.err
    page = (tmp_path / "a.md").read_text(encoding="utf-8")
    table, baseline = page.index("| table | 0."), page.index("| baseline | 0.000")
    assert table < baseline
    assert cli("bench", "board", folder).out == page
    done = cli("bench", "board", folder, "--figure", tmp_path / "a.svg", "--json")
    assert done.json[0]["task"] == "uav-v1/multi-service/medium"
    assert "</svg>" in (tmp_path / "a.svg").read_text(encoding="utf-8")
    cli("bench", "board", folder, "--figure", "a.jpg").failed(2, "--figure a.jpg", "must end in")


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


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A submission of two tables, as if they were those of two trainings, on two seeds."""
    from desim_uav.experiment.bench.run import submit
    from desim_uav.run_folder import RunPlace

    here, track = tmp_path_factory.mktemp("trained"), TRACKS["one"]
    table = Path(find_table("case8.npz"))
    (here / "second.npz").write_bytes(table.read_bytes())
    return submit(
        find_task("uav-v1/multi-service"),
        track,
        ["case8.npz", str(here / "second.npz")],
        RunPlace(here / "both", "both"),
        name="learner",
        seeds=track.seeds[:2],
        training_steps=360_000,
    ).folder


@pytest.mark.thorough
def test_a_submission_of_two_trainings_replays(cli, trained, folder):
    found = read(trained)
    assert [(row["training"], row["seed"]) for row in found.rows] == [
        (0, 100),
        (0, 101),
        (1, 100),
        (1, 101),
    ]
    assert [row["digest"] for row in found.rows] == 2 * [
        row["digest"] for row in read(folder / "table").rows
    ]
    done = cli("bench", "verify", trained, "--decide")
    assert (done.code, "all runs replayed" in done.out) == (0, True), done.err
    (table,) = cli("bench", "board", trained, "--json").json
    (row,) = table["rows"]
    assert (row["trainings"], row["seeds"], row["training_steps"]) == (2, 2, 360_000)


@pytest.mark.thorough
def test_a_submission_of_two_trainings_names_the_one_that_differs(cli, trained, tmp_path):
    def other(content):
        header, *rows = content.decode().splitlines()
        cells = rows[3].split(",")
        cells[header.split(",").index("qoe3_percent")] = "12.5"
        return "\n".join([header, *rows[:3], ",".join(cells), ""]).encode()

    copy = changed(trained, tmp_path, ROWS, other)
    done = cli("bench", "verify", copy)
    assert done.code == 6 and "seed 101 of training 1: qoe3_percent" in done.err
    assert done.err.count("seed") == 1


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda about: about | {"format": 1}, "policies: they belong to format 2"),
        (lambda about: about | {"policies": about["policies"][:1]}, "for each training in turn"),
        (lambda about: {k: v for k, v in about.items() if k != "policies"}, "only to it"),
    ],
)
def test_trainings_that_do_not_fit_together(cli, trained, tmp_path, change, said):
    copy = changed(
        trained,
        tmp_path,
        "manifest.json",
        lambda content: json.dumps(change(json.loads(content))).encode(),
    )
    cli("bench", "board", copy).failed(4, said)


def test_a_training_that_was_too_long_is_refused(cli):
    task = ("uav-v1/coverage/small", "--policy", "hover", "--training-steps", "1000001")
    cli("bench", "run", *task).failed(2, "--training-steps 1000001", "at most 1,000,000")
    twice = ("uav-v1/coverage/small", "--policy", "hover", "--policy", "hover")
    cli("bench", "run", *twice).failed(2, "--policy: one is given twice")


def test_policies_that_know_different_things_are_refused(cli):
    mixed = ("uav-v1/coverage/small", "--policy", "greedy", "--policy", "clairvoyant")
    cli("bench", "run", *mixed).failed(2, "--policy clairvoyant", "not use the same as greedy")


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
    from desim_uav.run_folder import RunPlace

    def once(function, work, jobs):
        yield 0, function(*work[0])
        raise KeyboardInterrupt

    monkeypatch.setattr(run, "run_each", once)
    task, place = find_task("uav-v1/multi-service"), RunPlace(tmp_path / "kept", "kept")
    done = run.submit(task, TRACKS["one"], "hover", place)
    assert done.interrupted and read(done.folder).about.seeds == [100]


@pytest.mark.parametrize("where", ["versions", "write"])
@pytest.mark.parametrize("earlier", [True, False])
def test_a_second_ctrl_c_while_the_seeds_are_written(where, earlier, tmp_path, monkeypatch):
    """They are kept, and it is an interruption only if the first one came before the end."""
    from desim_uav.experiment.bench import run
    from desim_uav.run_folder import RunPlace

    def flown(task, track, policies, seeds, jobs, on_run):
        return [Measured({"seed": seeds[0]}, np.zeros(1))], earlier

    def disturbed(*arguments):
        signal.raise_signal(signal.SIGINT)
        return {} if where == "versions" else tmp_path

    monkeypatch.setattr(run, "_measured", flown)
    monkeypatch.setattr(submission, "write", lambda place, *_: place.out)
    monkeypatch.setattr(
        *((run, "versions") if where == "versions" else (submission, "write")), disturbed
    )
    task = find_task("uav-v1/multi-service")
    done = run.submit(task, TRACKS["one"], "hover", RunPlace(tmp_path, "kept"))
    assert (done.folder, done.interrupted, done.manifest["seeds"]) == (tmp_path, earlier, [100])
