"""The benchmark: frozen tasks, scores worked by hand, submissions that replay, and errors."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from desim_uav.errors import PolicyError, ScenarioError
from desim_uav.experiment.bench import submission
from desim_uav.experiment.bench import tasks as frozen
from desim_uav.experiment.bench.board import board, markdown, profile
from desim_uav.experiment.bench.bounds import CRASH_PRICE, compute, has_bound
from desim_uav.experiment.bench.commands import ARRAYS, Commands
from desim_uav.experiment.bench.kept import BOUNDS, REFERENCES, bound_of, kept
from desim_uav.experiment.bench.measure import Measured
from desim_uav.experiment.bench.profile import figure, panels, shares
from desim_uav.experiment.bench.score import (
    QOE,
    RESAMPLES,
    Scored,
    interquartile_mean,
    paired,
    resampled,
    score,
)
from desim_uav.experiment.bench.submission import FORMAT, ROWS, columns_of, read
from desim_uav.experiment.bench.tasks import TRACKS, find_task, tasks
from desim_uav.experiment.bench.verify import FIXED, _of_protocol, differences
from desim_uav.measures.known import KNOWN
from desim_uav.scenario.description import described
from desim_uav.scenario.load import load, scenario_hash
from desim_uav.shipped import bench_folder, find_table
from tests.command_line import runner

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
    same = load("case8", ["reward={kind: qoe}"])
    assert find_task("uav-v1/multi-service").scenario_hash == scenario_hash(same)


def test_all_tasks_reward_what_counts_in_scores():
    """QoE, deadlines or ages, and not what the paper's rewards look at."""
    assert {described(load(task.path).reward)["kind"] for task in tasks().values()} == {"qoe"}


def test_an_edited_task_is_refused(monkeypatch, tmp_path):
    task = find_task("uav-v1/coverage")
    text = task.path.read_text(encoding="utf-8")
    assert "count: 48" in text
    edited = text.replace("count: 48", "count: 49")
    (tmp_path / task.path.name).write_text(edited, encoding="utf-8")
    monkeypatch.setattr(frozen, "bench_folder", lambda: tmp_path)
    with pytest.raises(ScenarioError, match="frozen and has been changed"):
        task.scenario(TRACKS["one"])


def test_no_policy_is_trained_in_the_worlds_of_a_track():
    trained = {*frozen.WORLDS["train"], *frozen.WORLDS["validation"], 0}
    assert not trained & {TRACKS["any"].world_of(seed) for seed in TRACKS["any"].seeds}
    assert {TRACKS["one"].world_of(seed) for seed in TRACKS["one"].seeds} == {0}


@pytest.mark.thorough
def test_references_and_bounds_are_kept_for_runs_of_the_protocol_only():
    references, bounds = (kept(name, bench_folder()) for name in (REFERENCES, BOUNDS))
    for (task, track, seed, measure), bound in bounds.items():
        assert has_bound(find_task(task), TRACKS[track])
        assert seed in TRACKS[track].seeds
        reference = references[task, track, seed, measure]
        assert reference == bound or KNOWN[measure].verdict(bound - reference) == "better"
        if measure in ("qoe1_percent", "qoe3_percent"):
            assert bound - reference >= 100.0 * CRASH_PRICE  # so that a crash costs as much
    assert not has_bound(find_task("uav-v1/urban"), TRACKS["one"])
    assert compute(find_task("uav-v1/urban"), TRACKS["one"], 100) == {}


@pytest.mark.thorough
def test_every_reference_of_a_task_with_a_proof_has_its_bound():
    references, bounds = (kept(name, bench_folder()) for name in (REFERENCES, BOUNDS))
    bounded = {key[:3] for key in bounds}
    for task, track, seed in {key[:3] for key in references}:
        if has_bound(find_task(task), TRACKS[track]):
            assert (task, track, seed) in bounded


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["coverage", "multi-service"])
def test_a_kept_bound_is_the_one_that_is_computed_today(name):
    task, track = find_task(f"uav-v1/{name}/small"), TRACKS["one"]
    assert compute(task, track, 105) == pytest.approx(bound_of(task, track, 105), abs=1e-6)


def test_the_list(cli):
    listed = cli("bench", "list").out
    assert "uav-v1/dispatch/large" in listed and "\\n" not in listed
    assert listed.splitlines()[-1].startswith("training: 10 seeds")
    found = cli("bench", "list", "--json").json
    assert len(found["tasks"]) == 24
    assert found["protocol"]["tracks"]["any"]["seeds"][0] == 3_000_000


@pytest.mark.parametrize(
    ("code", "arguments", "parts"),
    [
        (2, ("run", "uav-v1/covrage", "--policy", "hover"), ["did you mean 'uav-v1/coverage'"]),
        (2, ("run", "uav-v1/edge", "--policy", "hover", "--track", "anny"), ["mean 'any'"]),
        (2, ("run", "uav-v1/edge", "--policy", "hover", "--seeds", "33"), ["from 1 to 32"]),
        (2, ("run", "uav-v1/edge", "--policy", "hover", "--seeds", "11"), ["track one has 10"]),
        (
            2,
            ("run", "uav-v1/edge", "--policy", "hover", "--name", " "),
            ["name: ' ': it must not be blank"],
        ),
        (
            2,
            ("run", "uav-v1/edge", "--policy", "hover", "--name", ""),
            ["name: '': it must not be blank"],
        ),
        (4, ("run", "uav-v1/edge", "--policy", "greddy"), ["'greddy'", "mean 'greedy'"]),
        (4, ("verify", "none"), ["none: no such folder"]),
        (4, ("board", "none", "-o", "page.md"), ["none: no such folder"]),
    ],
)
def test_errors(cli, tmp_path, code, arguments, parts):
    cli("bench", *arguments).failed(code, *parts)
    assert not [*tmp_path.iterdir()]


def run_of(qoe1, qoe3, crashes=0.0):
    """The measures of a run that count."""
    values = {"qoe1_percent": qoe1, "qoe3_percent": qoe3}
    return values | {"crashes_per_drone_episode": crashes}


def test_scores_by_hand():
    """QoE1 is 100 % at most, QoE3 90 %; a quarter and a half of what is possible are gained."""
    zero, bound = run_of(80.0, 50.0), {"qoe3_percent": 90.0}
    assert score(QOE, run_of(85.0, 70.0), zero, bound) == 0.375
    assert score(QOE, run_of(80.0, 40.0), zero, bound) == -0.125
    assert score(QOE, run_of(85.0, 70.0, crashes=0.25), zero, bound) == 0.125
    assert score(QOE, run_of(85.0, 70.0), {}, bound) is None
    assert score(QOE, run_of(90.0, 95.0), run_of(80.0, 90.0), bound) == 0.5, "QoE3 leaves nothing"


def test_a_measure_that_should_be_low_scores_as_well():
    """The reference has an age of 60 s, and 20 s are proven to be the least."""
    ages = (Scored("age_s", 0.0),)
    row = {"age_s": 30.0, "crashes_per_drone_episode": 0.0}
    assert score(ages, row, {"age_s": 60.0}, {"age_s": 20.0}) == 0.75
    assert score(ages, row, {"age_s": 60.0}, {}) == 0.5


def test_paired_comparisons_by_hand():
    """On each seed the first policy is better by 0.1, though the seeds differ by far more."""
    first = paired([[0.1, 0.6, 0.9]], [[0.0, 0.5, 0.8]])
    assert first.difference.value == pytest.approx(0.1)
    assert first.difference.low == pytest.approx(0.1) and first.improvement.low == 1.0
    both = paired([[0.0, 1.0], [0.0, 0.0]], [[0.0, 0.5]])
    assert both.difference.value == pytest.approx((0.0 + 0.5 + 0.0 - 0.5) / 4)
    assert both.improvement.value == (0.5 + 1.0 + 0.5 + 0.0) / 4
    assert paired([[0.5]], [[0.0]]).difference.low is None


def test_the_interquartile_mean_by_hand():
    """Of eight values, two at each end are left out; each task has the same weight."""
    values = [1, 2, 3, 100, 4, 5, 6, -100]
    found = interquartile_mean([values])
    assert found.value == (2 + 3 + 4 + 5) / 4
    assert found.low < found.value < found.high
    assert found == interquartile_mean([values])
    assert interquartile_mean([values, [9.5] * 80]).value == (3.5 + 9.5) / 2
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


@pytest.fixture
def zeros(monkeypatch):
    """References of 50 % in all runs, on some boards other ones by seed, and bounds of 90 %."""
    from desim_uav.experiment.bench import board as boards

    zeros = {}

    def of(value):
        return {"qoe1_percent": value, "qoe3_percent": value}

    monkeypatch.setattr(boards, "reference_of", lambda task, track, seed: of(zeros.get(seed, 50.0)))
    monkeypatch.setattr(boards, "bound_of", lambda *_: of(90.0))
    return zeros


def commanded(*actions):
    """A run of one episode in which a drone takes these actions."""
    epochs = np.array([len(actions)], np.int32)
    return Commands(epochs, np.array(actions, np.int16).reshape(-1, 1), np.empty((0, 0)))


def submitted(name, *values, future=False, task="uav-v1/coverage", crashes=0.0):
    """A submission with these values of QoE for each training, on seeds from 100 on."""
    rows = [
        ROW
        | {"training": n, "seed": 100 + k, "crashes_per_drone_episode": crashes}
        | {"digest": f"{value}"}
        | {"qoe1_percent": value, "qoe3_percent": value}
        for n, one in enumerate(values)
        for k, value in enumerate(one)
    ]
    about = SimpleNamespace(
        trainings=values,
        is_trained=len(values) > 1,
        training_steps=None,
        name=name,
        knows_future=future,
        information="local",
        seeds=[100 + k for k in range(len(values[0]))],
    )
    return SimpleNamespace(
        folder=name,
        about=about,
        rows=rows,
        commands=[commanded(int(value)) for one in values for value in one],
        task=find_task(task),
        track=TRACKS["one"],
    )


def test_the_board_by_hand(zeros):
    zeros[101] = 70.0
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
    oracle, mine, baseline = table["rows"]
    assert mine["to_best"] is None, "it is the best competitor itself"
    assert (oracle["to_best"].value, oracle["better_than_best"].value) == (0.5, 1.0)
    assert (baseline["to_best"].value, baseline["better_than_reference"].value) == (-0.5, 0.5)
    page = markdown([table])
    assert "| oracle (knows the future: not a competitor) | 1.000 [1.000, 1.000] |" in page
    assert "| 75.00 [70.00, 80.00] |" in page and "| 2 of 10 |" in page
    assert "| local | claimed |" in page


def test_policies_with_fewer_seeds_rank_behind(zeros):
    """Whoever flies only the easiest seeds is neither the first nor the best."""
    few, tasks_of = [80.0, 80.0], ("uav-v1/coverage", "uav-v1/urban")
    found = [
        submitted(name, values, task=task, future=name == "oracle")
        for name, values in (("few", few), ("mine", [60.0] * 3), ("oracle", few), ("b", [50.0] * 3))
        for task in tasks_of
    ]
    *tables, last = board(found)
    for table in (*tables, last):
        assert [row["policy"] for row in table["rows"]] == ["mine", "b", "few", "oracle"]
    mine, *_, chosen, _ = tables[0]["rows"]
    assert mine["to_best"] is None and chosen["to_best"].value == 0.5


@pytest.mark.parametrize(
    ("seeds", "fits"),
    [
        ([100], True),
        ([*range(100, 110)], True),
        ([*range(100, 111)], False),
        ([101, 102], False),
        ([100, 102], False),
        ([101, 100], False),
        ([100, 100], False),
    ],
)
@pytest.mark.parametrize("interrupted", [True, False])
def test_the_seeds_must_be_the_first_of_the_track(seeds, fits, interrupted):
    about = SimpleNamespace(
        **FIXED, seeds=seeds, interrupted=interrupted, training_steps=None, trainings=[]
    )
    task = find_task("uav-v1/coverage")
    found = SimpleNamespace(about=about, track=TRACKS["one"], task=task)
    assert (_of_protocol(found) == []) == fits


def test_energy_is_a_column_of_tasks_whose_batteries_hold_it(zeros):
    """Two seeds with 2 and 4 J per Mbit; the other policy has served nothing on one of them."""
    told, quiet = (submitted(name, [70.0, 80.0], task="uav-v1/endurance") for name in ("a", "b"))
    for row, per_mbit in zip([*told.rows, *quiet.rows], [2.0, 4.0, None, 5.0], strict=True):
        row["j_per_mbit"] = per_mbit
    (table,) = board([told, quiet])
    assert [row["j_per_mbit"] for row in table["rows"]] == [3.0, 5.0]
    assert "| 70.00 | 3.00 | 1.00 |" in markdown([table])
    assert "| 70.00 | - | 1.00 |" in markdown(board([submitted("c", [70.0])]))
    columns = {
        family: columns_of(find_task(f"uav-v1/{family}")) for family in ("endurance", "coverage")
    }
    assert {*columns["endurance"]} - {*columns["coverage"]} == {"j_per_mbit"}


def test_the_board_counts_trainings_and_seeds(zeros):
    zeros[101] = 70.0
    (table,) = board(
        [submitted("learner", [70.0, 80.0], [60.0, 90.0]), submitted("baseline", [50.0, 70.0])]
    )
    learner, baseline = table["rows"]
    assert learner["scores"] == [[0.5, 0.5], [0.25, 1.0]]
    assert (learner["score"].value, learner["trainings"], learner["seeds"]) == (0.5, 2, 2)
    assert baseline["trainings"] is None
    page = markdown([table])
    assert "| claimed | 2 of 10 | 2 of 10 |" in page and "| claimed | - | 2 of 10 |" in page


def test_trainings_whose_runs_are_equal_are_one_training(zeros):
    """A command that is not allowed has no effect, so it makes no training of its own."""
    found = submitted("learner", [70.0, 80.0], [70.0, 80.0], [70.0, 90.0])
    found.commands[2] = commanded(7)
    (row,) = board([found])[0]["rows"]
    assert (row["trainings"], row["scores"]) == (2, [[0.5, 0.75], [0.5, 1.0]])


def test_the_board_says_how_many_runs_differ(zeros):
    """Where nothing is random, all seeds are one run."""
    (table,) = board([submitted("greedy", [70.0, 70.0]), submitted("ppo", [60.0, 61.0])])
    assert [row["different_runs"] for row in table["rows"]] == [1, 2]
    assert "| 2 of 10 (1 different) |" in markdown([table])


def test_a_board_without_references_has_no_scores():
    large = "uav-v1/multi-service/large"
    (table,) = board([submitted("mine", [70.0], task=large)])
    assert table["rows"][0]["score"] is None and "no references are kept" in markdown([table])


def test_a_board_without_a_proven_bound_says_so(monkeypatch):
    from desim_uav.experiment.bench import board as boards

    monkeypatch.setattr(boards, "reference_of", lambda *_: run_of(50.0, 60.0))
    (table,) = board([submitted("mine", [80.0], task="uav-v1/urban")])
    assert table["rows"][0]["score"].value == (30 / 50 + 20 / 40) / 2
    assert "No bound is proven" in markdown([table])


def test_the_board_of_several_tasks_has_first_the_policies_that_are_in_all(zeros):
    tasks_of = ("uav-v1/coverage", "uav-v1/multi-service", "uav-v1/urban")
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


def test_the_figure_has_a_curve_for_each_policy_with_a_score(zeros):
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


def test_the_figure_of_several_tasks_is_of_all_together(zeros):
    tasks_of = ("uav-v1/coverage", "uav-v1/urban")
    found = [submitted("baseline", [50.0, 50.0], task=task) for task in tasks_of]
    (panel,) = panels(board(found))
    assert panel.title == "Track one: 2 tasks" and len(panel.curves) == 1


def test_there_is_no_figure_without_scores():
    with pytest.raises(PolicyError, match="no policy has a score"):
        figure(board([submitted("mine", [70.0], task="uav-v1/multi-service/large")]))


def test_two_submissions_of_one_name_are_refused():
    with pytest.raises(PolicyError, match="are called 'mine'"):
        board([submitted("mine", [1.0]), submitted("mine", [2.0])])


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
        episodes=frozen.EPISODES,
        warmup=frozen.WARMUP,
        engine="batch",
        progress=False,
    )
    assert found.about.information == "radar"
    assert found.rows[0]["qoe3_percent"] == flown.summaries()[0]["qoe3_percent"]
    assert not differences(found, decide=True)


@pytest.mark.thorough
def test_a_shielded_policy_flies_the_frozen_scenario(cli, tmp_path):
    task = ("bench", "run", "uav-v1/endurance/small", "--policy", "shielded:random", "--seeds", 1)
    done = cli(*task, "--out", tmp_path / "safe")
    assert done.code == 0, done.err
    found = read(tmp_path / "safe")
    assert [each.policy for each in found.about.trainings] == ["shielded:random"]
    assert found.about.information.startswith("nothing; for its shield the map")
    assert found.rows[0]["crashes_per_drone_episode"] == 0
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
        (b"0,100,0,", b"0,100,0,1,", "a row is too long"),
        (b"100,0,", b"hundred,0,", "seed: 'hundred' is not a number"),
        (b"100,0,", b"100,inf,", "world_seed: 'inf' is not a number"),
        (b"101,0,", b"102,0,", "its seeds are not those of manifest.json"),
        (b"qoe3_percent,", b"qoe4_percent,", "its columns must be training, seed,"),
    ],
)
def test_rows_that_cannot_be_read(cli, folder, tmp_path, before, after, said):
    copy = changed(folder / "table", tmp_path, ROWS, lambda content: content.replace(before, after))
    cli("bench", "board", copy).failed(4, "rows.csv", said)


@pytest.mark.parametrize("name", ["", " ", "\n", "\u200b"])
def test_a_name_that_cannot_be_seen_is_refused(tmp_path, name):
    about = {"format": FORMAT, "benchmark": frozen.BENCHMARK, "name": name, "interrupted": False}
    about |= dict.fromkeys(("task", "track", "seal", "scenario_hash", "information", "engine"), "a")
    about |= {"knows_future": False, "ceiling": True, "episodes": 1, "warmup": 1, "seeds": [1]}
    about["trainings"] = [{"policy": "a", "policy_sha256": None, "decisions_sha256": "a"}]
    (tmp_path / "manifest.json").write_text(json.dumps(about), encoding="utf-8")
    with pytest.raises(PolicyError, match=r"manifest\.json: .*: name: it must not be blank"):
        read(tmp_path)


@pytest.mark.parametrize("time", ["-1000", "-1e-9", "nan", "inf"])
def test_a_time_that_nothing_takes_is_refused(tmp_path, time):
    task = find_task("uav-v1/coverage")
    columns = columns_of(task)
    cells = [time if name == "decision_ms" else "1" for name in columns]
    lines = f"{','.join(columns)}\n{','.join(cells)}\n"
    (tmp_path / ROWS).write_text(lines, encoding="utf-8")
    with pytest.raises(
        PolicyError, match=f"{ROWS}: .*decision_ms: '{time}' is not finite|negative"
    ):
        submission._read_rows(tmp_path / ROWS, task)


@pytest.mark.thorough
def test_changed_commands_are_refused(cli, folder, tmp_path):
    from desim_uav.array_file import Stored, pack

    stored = Stored(folder / "table" / "commands.npz", "file of commands", list(ARRAYS), FORMAT)
    arrays = stored.arrays()
    first = arrays["epochs"][0].sum() + arrays["epochs"][1, :2].sum() + 5
    actions = arrays["actions"].copy()
    actions[first : first + 5] = (actions[first : first + 5] + 1) % 4
    copy = changed(
        folder / "table",
        tmp_path,
        "commands.npz",
        lambda content: pack(stored.about, **arrays | {"actions": actions}),
    )
    done = cli("bench", "verify", copy, "--decide")
    assert done.code == 6 and "seed 101: digest" in done.err and "seed 100" not in done.err
    assert "the policy decides otherwise" in done.err
    assert f"first in episode {2 - frozen.WARMUP}, at decision epoch 5" in done.err
    for bad, said in (
        ({"epochs": np.zeros((1, 20), "<i4")}, "epochs must be int32 of the shape (2, 20)"),
        ({"actions": arrays["actions"].astype("<i8")}, "actions must be int16 of the shape (at"),
        ({"actions": arrays["actions"][1:]}, "epochs: they are not 1199 together"),
    ):
        (copy / "commands.npz").write_bytes(pack(stored.about, **arrays | bad))
        cli("bench", "verify", copy).failed(4, "commands.npz", said)


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
    assert (row["trainings"], row["seeds"], row["training_steps"]) == (1, 2, 360_000)


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
        (lambda about: about | {"trainings": []}, "trainings: "),
        (lambda about: about | {"trainings": about["trainings"][:1]}, "for each training in turn"),
        (lambda about: about | {"seal": "0" * 64}, "see --revealed"),
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


@pytest.mark.parametrize(("ended", "seeds"), [([0, 1, 2, 4, 5], [100]), ([1, 2, 3], None)])
def test_an_interruption_keeps_no_seed_behind_one_that_is_missing(monkeypatch, ended, seeds):
    """Of two policies on three seeds at a time, these runs have ended."""
    from desim_uav.experiment.bench import run

    def some(function, work, jobs):
        for number in ended:
            yield number, Measured({"seed": work[number][3]}, np.zeros(1))
        raise KeyboardInterrupt

    monkeypatch.setattr(run, "run_each", some)
    arguments = (None, None, ["a", "b"], [100, 101, 102], 3, lambda: None)
    if seeds is None:
        with pytest.raises(KeyboardInterrupt):
            run._measured(*arguments)
    else:
        measured, interrupted = run._measured(*arguments)
        assert interrupted and [one.row["seed"] for one in measured] == 2 * seeds


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
    monkeypatch.setattr(run, "_with_decisions", lambda trainings, measured: trainings)
    task = find_task("uav-v1/multi-service")
    done = run.submit(task, TRACKS["one"], "hover", RunPlace(tmp_path, "kept"))
    assert (done.folder, done.interrupted, done.manifest["seeds"]) == (tmp_path, earlier, [100])
