"""The figures of a report say what the tables say."""

from pathlib import Path

import pandas as pd
import pytest
from matplotlib.colors import to_hex

from desim_uav.experiment.command import run_to_folder
from desim_uav.report import page_figures
from desim_uav.report.text import COMPARED
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory):
    """A run in which drones charge."""
    done = run_to_folder(
        load(scenario_path("case8"), ["users.count=12", "episode.steps=35"]),
        "baseline",
        episodes=3,
        warmup=1,
        keep_events=False,
        out=tmp_path_factory.mktemp("runs") / "run",
        command=[],
        show_progress=False,
    )
    return Path(done.summary["run_dir"])


def counted(run_dir, table):
    found = pd.read_parquet(run_dir / f"{table}.parquet")
    return found[found["episode"] >= 0]


def test_qoe_over_episodes(run_dir):
    episodes = counted(run_dir, "episodes")
    figure = page_figures.qoe_over_episodes(run_dir)
    for axes, name in zip(
        figure.axes, ("qoe1_percent", "qoe2_iterations", "qoe3_percent"), strict=True
    ):
        assert axes.lines[0].get_xdata().tolist() == [0, 1, 2]
        assert axes.lines[0].get_ydata().tolist() == episodes[name].tolist()
        assert len(axes.lines[1].get_xdata()) == (episodes["crashes"] > 0).sum()


def test_service_outcomes(run_dir):
    requests = counted(run_dir, "requests")
    (axes,) = page_figures.service_outcomes(run_dir).axes
    names = [label.get_text().split("\n")[0] for label in axes.get_yticklabels()]
    assert sorted(names) == sorted(requests["service"].unique())
    for bars, outcome in zip(
        axes.containers, ("completed", "unfinished", "never_served"), strict=True
    ):
        for bar, name in zip(bars, names, strict=True):
            of_service = requests[requests["service"] == name]
            share = 100 * (of_service["outcome"] == outcome).mean()
            assert bar.get_width() == pytest.approx(share)


def test_battery(run_dir):
    steps = counted(run_dir, "steps")
    steps = steps[steps["episode"] == 0]
    figure = page_figures.battery(run_dir)
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    for drone in range(3):
        of_drone = steps[steps["drone"] == drone]
        assert lines[f"drone {drone}"].get_ydata().tolist() == (of_drone["battery_s"] / 60).tolist()
    squares = [line for line in figure.axes[0].lines if line.get_marker() == "s"]
    marked = sum(len(line.get_xdata()) for line in squares)
    assert marked == steps["mode"].isin(["charging", "queued"]).sum() > 0
    assert "charging, or in the queue" in lines


def test_the_map_is_of_the_first_counted_episode(run_dir):
    figure = page_figures.run_map(run_dir)
    steps = counted(run_dir, "steps")
    path = steps[(steps["episode"] == 0) & (steps["drone"] == 2)]
    assert figure.axes[0].lines[-2].get_xdata()[1:].tolist() == path["x_m"].tolist()


def test_intervals_keep_each_policy_its_colour():
    def row(policy, mean):
        return {
            "policy": policy,
            "measures": {name: {"mean": mean, "half_width": 0.5} for name in COMPARED},
        }

    names = ["first", "second", "third"]
    alone = page_figures.interval_panels([row("second", 2.0), row("third", None)], names, True)
    assert [axes.get_title(loc="left") for axes in alone.axes] == [
        label for label, _ in COMPARED.values()
    ]
    for axes in alone.axes:
        (bar,) = axes.containers
        assert bar.lines[0].get_xdata().tolist() == [2.0]
        ends = bar.lines[2][0].get_segments()[0][:, 0].tolist()
        assert ends == [1.5, 2.5]
        assert to_hex(bar.lines[0].get_color()) == page_figures.DRONE_COLOURS[1].lower()
