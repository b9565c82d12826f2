"""The figure of the delays of tasks shows what the tables say."""

import numpy as np
import pandas as pd
import pytest

from desim_uav.errors import PolicyError, UsageError
from desim_uav.report.figures import delay_figure
from desim_uav.report.figures.delay import PARTS
from tests.report.helpers import make_run

CAMERAS = (
    "services={vision: {kind: compute, input_mbit: [1, 4], cycles_per_bit: [800], deadline_s: 5}, "
    "film: {kind: transfer, volume_mbit: [2]}}",
    *("demand={kind: dynamic, mix: {vision: 3, film: 1}}", "users={count: 8}"),
    *("users.processor={ghz: 0.5}", "drones.processor={ghz: 1}", "episode.steps=3"),
    *("drones.radio={kind: link_classes, sharing: equal}", "access_points=[]"),
)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two rules of offloading, one of them on two seeds."""
    where = tmp_path_factory.mktemp("tasks")
    return [
        make_run(
            where / f"{offloading}{seed}",
            "case8",
            "hover",
            (*CAMERAS, f"offloading={offloading}", f"seed={seed}"),
            events=False,
        )
        for offloading, seed in (("split", 0), ("split", 1), ("never", 0))
    ]


def tasks(*folders):
    table = pd.concat([pd.read_parquet(folder / "requests.parquet") for folder in folders])
    return table[table["service"] == "vision"]


def bars(axes):
    """The parts of each bar, from its left to its right."""
    return np.array([[bar.get_width() for bar in part] for part in axes.containers]).T


def test_a_bar_is_as_long_as_the_mean_delay_and_its_parts_are_those_of_the_table(runs):
    parts, times = delay_figure(runs).axes
    for row, of in enumerate((tasks(*runs[:2]), tasks(runs[2]))):
        done = of[of["outcome"] == "completed"]
        assert len(done)
        found = bars(parts)[row]
        assert found.sum() == pytest.approx(done["completion_s"].mean())
        for width, name in zip(found, PARTS, strict=False):
            if name != "only the user computes":
                assert width == pytest.approx(done[f"{name}_s"].mean())
        x, y = times.lines[row].get_data()
        for within_s in (0.5, 2.0, 5.0):
            assert y[x <= within_s].max() == pytest.approx(
                100 * (done["completion_s"] <= within_s).sum() / len(of)
            )
    assert bars(parts)[1] == pytest.approx([0, 0, 0, bars(parts)[1].sum()])
    assert times.lines[-1].get_xdata() == [5, 5]


def test_runs_that_differ_only_in_their_seeds_are_one_series(runs):
    for folders, series in ((runs, 2), (runs[:2], 1), (runs[2:], 1)):
        parts, times = delay_figure(folders).axes
        assert len(parts.get_yticklabels()) == series == len(times.lines) - 1
    (label,) = (text.get_text() for text in delay_figure(runs[:2]).axes[0].get_yticklabels())
    assert label.startswith("vision\n")
    told = [text.get_text() for text in delay_figure(runs).axes[0].get_yticklabels()]
    assert "split0" in told[0] and "never0" in told[1]


def test_what_is_refused(runs, flat):
    with pytest.raises(PolicyError, match="the run has no tasks: none of its services has the"):
        delay_figure(flat)
    with pytest.raises(PolicyError, match="hover on seed 0 is given twice"):
        delay_figure([runs[0], runs[1], runs[0]])
    with pytest.raises(UsageError, match=r"^episode: 3: "):
        delay_figure(runs, episode=3)


def test_without_colour_parts_differ_in_their_hatches():
    assert len({part["hatch"] for part in PARTS.values()}) == len(PARTS)
