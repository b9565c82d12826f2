"""What a run tells of drones that came too near to each other."""

import pytest

from desim_uav.api.pictures import write_report as report
from desim_uav.experiment.command import read_summary
from desim_uav.measures.tally import Tally
from desim_uav.records import APART
from desim_uav.report.run import Run
from desim_uav.report.text import print_run
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from tests.run_to_folder import run_to_folder


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Two episodes of five drones that often come near."""
    folder = tmp_path_factory.mktemp("near") / "run"
    keys = ["drones.count=5", "separation_m=300", "users.count=5", "episode.steps=10"]
    run_to_folder(
        load(scenario_path("case8"), keys),
        "random",
        episodes=2,
        warmup=1,
        keep_events=False,
        out=folder,
        command=[],
    )
    return folder


def test_the_summary_has_sums_and_the_least_distance(run, capsys):
    summary, _ = read_summary(run)
    rows = Run(run).counted("episodes")
    assert summary["conflicts"] == rows["conflicts"].sum() > 0
    assert summary["conflict_s"] == pytest.approx(rows["conflict_s"].sum())
    assert summary["least_distance_m"] == rows["least_distance_m"].min()
    print_run(summary, [])
    told = f"{summary['conflicts']} conflict(s) between drones, {summary['conflict_s']:.1f} s"
    assert told in capsys.readouterr().out


@pytest.mark.thorough
def test_the_page_tells_them(run):
    page = report([run], run / "page.html", None, None).read_text()
    summary, _ = read_summary(run)
    assert f"{summary['conflicts']}, {summary['conflict_s']:.0f} s" in page
    assert f"{summary['least_distance_m']:.1f} m" in page


def test_episodes_in_parts_give_the_same(run):
    rows, requests = Run(run).table("episodes"), Run(run).table("requests")
    whole, parts = Tally(), Tally()
    whole.add(requests, rows)
    for episode in (0, 1):
        parts.add(requests[requests["episode"] == episode], rows[rows["episode"] == episode])
    assert parts.headline() == pytest.approx(whole.headline())


def test_without_a_least_distance_nothing_is_told(run, capsys):
    summary, _ = read_summary(run)
    print_run({name: value for name, value in summary.items() if name not in APART}, [])
    assert "conflict" not in capsys.readouterr().out
