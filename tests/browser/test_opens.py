"""A replay opens in a browser and moves; all else that the page does is tested thoroughly."""

import pandas as pd
import pytest

from desim_uav.experiment.replay.page import write_replay
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from tests.run_to_folder import run_to_folder


def test_drones_are_where_the_table_says(page, tmp_path):
    run = tmp_path / "run"
    run_to_folder(
        load(scenario_path("tiny")),
        "random",
        episodes=1,
        warmup=0,
        keep_events=True,
        out=run,
        command=[],
    )
    write_replay(run)
    page.open(run / "replay.html")
    steps = pd.read_parquet(run / "steps.parquet")
    assert len(steps) == 5
    for step in steps.itertuples():
        (drone,) = page.seek(step.episode, step.t_s)["drones"]
        assert (drone["x_m"], drone["y_m"]) == pytest.approx((step.x_m, step.y_m), abs=1e-6)
