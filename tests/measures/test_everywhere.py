"""A measure is the same number wherever it is shown."""

import json
from pathlib import Path

import pytest

import desim_uav as du
from desim_uav.errors import UsageError
from desim_uav.measures.known import ALWAYS, KNOWN, compared_in, looks, narrow
from desim_uav.records import TABLES
from desim_uav.report.text import print_run, tables_of
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path

SCENARIO = Path(__file__).with_name("services.yaml")
SEEDS, EPISODES = 2, 2


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Two seeds of two episodes."""
    out = tmp_path_factory.mktemp("services") / "run"
    return du.run(
        SCENARIO,
        policy="hover",
        seeds=SEEDS,
        episodes=EPISODES,
        out=out,
        engine="des",
        progress=False,
    )


@pytest.fixture(scope="module")
def compared(run):
    return du.compare_runs(run.folders)


def test_run_and_compare_and_sweep_have_the_same(run, compared, tmp_path):
    swept = du.sweep(
        SCENARIO,
        ["episode.steps=3,4"],
        out=tmp_path / "sweep",
        policies="hover",
        seeds=SEEDS,
        episodes=EPISODES,
        warmup=0,
        engine="des",
        progress=False,
    )
    swept = [row for row in swept.rows if row["episode.steps"] == 3]
    assert compared.measures == [*compared_in(load(SCENARIO))]
    assert {"completion_p95_s", "throughput_mbps", "drone_j_per_task", "user_j_per_task"} <= {
        *compared.measures
    }
    assert {"age_s", "peak_age_s", "worst_age_s", "age_violation_percent"} <= {*compared.measures}
    of_run = run.qoe("seed")
    for seed, (one, other) in enumerate(zip(compared.rows(), swept, strict=True)):
        for name in compared.measures:
            if name == "qoe1_feasible_percent":  # of service times alone, which none asks for
                assert one[name] is other[name] is None
                continue
            assert one[name] is not None, name
            assert one[name] == pytest.approx(other[name], rel=1e-12), name
            if name != "crashes_per_drone_episode":
                assert one[name] == pytest.approx(of_run.loc[seed, name], rel=1e-12), name


def test_ages_of_one_episode_are_those_of_the_tables(run):
    episodes, sensors = run.episodes, run.sensors
    lasted = episodes.set_index(["seed", "episode"])["duration_s"]
    for seed, summary in enumerate(run.summaries()):
        own = episodes[episodes["seed"] == seed]
        weights = own["duration_s"] / own["duration_s"].sum()
        assert summary["age_s"] == pytest.approx((own["age_s"] * weights).sum())
        rows = sensors[sensors["seed"] == seed]
        area = rows["age_s"] * [lasted[seed, k] for k in rows["episode"]]
        of_users = area.groupby(rows["user"]).sum() / own["duration_s"].sum()
        assert summary["worst_age_s"] == pytest.approx(of_users.max())
        assert summary["updates_delivered"] == own["updates_delivered"].sum() > 0
        falls = (rows["peak_age_s"] * rows["falls"]).sum() / rows["falls"].sum()
        assert summary["peak_age_s"] == pytest.approx(falls)
        (meters,) = [row for row in run.groups("group")[seed] if row["group"] == "meters"]
        (reading,) = [row for row in run.groups("service")[seed] if row["service"] == "reading"]
        for name in ("age_s", "peak_age_s", "worst_age_s", "updates"):
            assert meters[name] == reading[name] == summary[name], name


def test_services_without_a_measure_have_none(run):
    rows = {row["service"]: row for row in run.groups("service")[0]}
    assert rows["voice"]["deadlines_met_percent"] is None
    assert rows["voice"]["user_j_per_task"] is None
    assert rows["vision"]["age_s"] is rows["voice"]["updates"] is None
    assert rows["vision"]["user_j_per_task"] > 0
    json.dumps(list(rows.values()), allow_nan=False)


def test_the_tables_of_a_run_fit_a_terminal_of_80_columns(run, capsys):
    rows = run.groups("service")[0]
    print_run(run.summaries()[0], rows)
    told = capsys.readouterr().out
    tables, _, _ = told.partition(" handover(s)")
    assert max(len(line.rstrip()) for line in tables.splitlines()) <= 80
    of_sensors, own = tables_of([{"service": "all"} | run.summaries()[0], *rows])[-1]
    assert [row["service"] for row in own] == ["all", "reading"]
    assert "peak_age_s" in of_sensors
    for heading in ("peak", "in time", "worst tenth", "J/task"):
        assert heading in told


def test_the_pages_show_them(run, compared, tmp_path):
    page = run._alone(0).report(tmp_path / "one.html", progress=False)
    summary = run.summaries()[0]
    source = (tmp_path / "one.html").read_text()
    assert page is not None
    for name in ("age_s", "peak_age_s", "completion_p95_s", "throughput_mbps"):
        assert format(summary[name], (KNOWN[name].short or KNOWN[name].form)) in source, name
    assert "worst age s" in run._repr_html_().replace("\n", " ")
    assert "Less is better: " not in source, "nothing is compared there"


def test_a_measure_can_be_chosen(run):
    found = du.compare_runs(run.folders, measure=["fairness", "completed"])
    assert found.measures == ["fairness", "completed"]
    assert [row["completed"] for row in found.rows()] == [s["completed"] for s in run.summaries()]
    assert found.content()["better"] == {"fairness": "higher", "completed": "higher"}
    assert len(found.plot(measure="fairness").axes) == 1
    with pytest.raises(UsageError, match="did you mean 'worst_age_s'"):
        du.compare_runs(run.folders, measure="worst_age")
    with pytest.raises(UsageError, match="conflicts: drones have to keep no distance"):
        du.compare_runs(run.folders, measure="conflicts")
    with pytest.raises(UsageError, match="age_s: no users are sensors"):
        du.compare("case1", policies=["hover"], measure="age_s")


@pytest.mark.parametrize("case", ["case1", "case5", "case8"])
def test_the_paper_has_no_other_measures_than_before(case):
    assert compared_in(load(scenario_path(case))) == ALWAYS
    assert len(ALWAYS) == 7


def test_each_measure_is_whole():
    for name, one in KNOWN.items():
        assert one.name == name and one.label and one.meaning.endswith(".")
        assert {table.strip() for table in one.table.split(",")} <= set(TABLES)
        assert one.better in (None, "higher", "lower")
        format(1.0, looks([name])[name][1])
        format(1 if one.form == "d" else 1.0, narrow([name])[name][1])


@pytest.mark.parametrize(
    ("name", "difference", "said"),
    [
        *(("age_s", 1.0, "worse"), ("age_s", -1.0, "better"), ("fairness", 0.1, "better")),
        *(("handovers", 3.0, ""), ("age_s", 0.0, "")),
    ],
)
def test_which_direction_is_better(name, difference, said):
    assert KNOWN[name].verdict(difference) == said
