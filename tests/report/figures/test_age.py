"""The figure of the age of sensors shows what the tables say."""

import numpy as np
import pandas as pd
import pytest

from desim_uav.errors import PolicyError
from desim_uav.report.figures import age_figure
from desim_uav.report.figures.age import fresh_s
from tests.report.helpers import make_run

SENSORS = (
    "services={reading: {kind: collect, updates: {kind: poisson, mean_s: 20}, size_mbit: [0.5], "
    "buffer: 3}}",
    *("demand={kind: sensing, service: reading}", "users={count: 10}", "episode.steps=4"),
    *("drones.radio={kind: link_classes, sharing: equal}", "access_points=[]"),
)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two policies, one of them on two seeds."""
    where = tmp_path_factory.mktemp("sensors")
    return [
        make_run(
            where / f"{policy}{seed}", "case8", policy, (*SENSORS, f"seed={seed}"), events=False
        )
        for policy, seed in (("hover", 0), ("hover", 1), ("tour", 0))
    ]


def sensors(*folders):
    return pd.concat([pd.read_parquet(folder / "sensors.parquet") for folder in folders])


def test_the_mean_over_time_is_that_of_the_table(runs):
    over_time, shares = age_figure(runs).axes
    for number, of in enumerate((sensors(*runs[:2]), sensors(runs[2]))):
        t_min, ages_s = over_time.lines[number].get_data()
        assert len(of) and (ages_s >= 0).all()
        mean_s = np.trapezoid(ages_s, t_min) / t_min[-1]
        assert mean_s == pytest.approx(of["age_s"].mean(), rel=0.02)
        assert ages_s[-1] == pytest.approx(of["age_end_s"].mean())
        x, y = shares.lines[number].get_data()
        for most_s in of["age_s"].quantile([0.2, 0.5, 0.9]):
            assert y[x <= most_s].max() == pytest.approx(100 * (of["age_s"] <= most_s).mean())


def test_an_older_update_that_comes_later_changes_nothing():
    delivered = pd.DataFrame({"t_generated_s": [5.0, 2.0, 9.0], "t_delivered_s": [6.0, 8.0, 10.0]})
    found = fresh_s(delivered.sample(frac=1, random_state=1), np.array([0.0, 6.0, 8.5, 10.0]))
    assert found.tolist() == [0.0, 5.0, 5.0, 9.0]


def test_runs_that_differ_only_in_their_seeds_are_one_series(runs):
    legends = [[t.get_text() for t in age_figure(f).legends[0].texts] for f in (runs, runs[:2])]
    assert [text.split(":")[0] for text in legends[0]] == ["reading, hover", "reading, tour"]
    assert len(legends[1]) == 1 and legends[1][0].startswith("reading: mean ")


def test_runs_without_sensors_are_refused(runs, flat):
    with pytest.raises(PolicyError, match="the run has no sensors: no users have the demand"):
        age_figure([runs[0], flat])
