"""The requests of finished runs in one frame, with the policy and the user's position."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from desim_uav.experiment.compare_runs import compare_runs
from desim_uav.report.run import Run


def read_runs(folders: Sequence[Path]) -> pd.DataFrame:
    """Return the counted requests of runs that can be compared, in one frame.

    In addition to the columns of ``requests.parquet`` it has ``policy``, ``seed`` and
    ``world_seed`` of the run, the user's position at the time of the request (``x_m``, ``y_m``, and
    ``cell`` as "ix, iy"), the user's ``cluster``, and the distance ``from_centre_m`` from that
    cluster's centre; the last two are missing if the scenario has no clusters. Raises PolicyError
    as ``compare_runs`` does.
    """
    frames = [
        _placed(Run(folder)).assign(policy=of.policy, seed=of.seed, world_seed=of.world_seed)
        for folder, of in zip(folders, compare_runs(folders).replications, strict=True)
    ]
    return pd.concat(frames, ignore_index=True)


def _placed(run: Run) -> pd.DataFrame:
    """Return the counted requests with the columns that tell the user's position."""
    requests, world = run.counted("requests"), run.map
    x_m, y_m = _place(requests, run.table("users"))
    (width, depth), (nx, ny) = world["size_m"], world["cells"]
    ix = np.clip(x_m // (width / nx), 0, nx - 1)
    iy = np.clip(y_m // (depth / ny), 0, ny - 1)
    placed = requests.assign(x_m=x_m, y_m=y_m, cluster=pd.NA, from_centre_m=np.nan)
    placed["cell"] = [f"{x:.0f}, {y:.0f}" for x, y in zip(ix, iy, strict=True)]
    if world["clusters"]:
        cluster = requests["user"].to_numpy() % len(world["clusters"])  # assigned round robin
        centres = np.array([(c["x_m"], c["y_m"]) for c in world["clusters"]])[cluster]
        placed["cluster"] = cluster
        placed["from_centre_m"] = np.hypot(x_m - centres[:, 0], y_m - centres[:, 1])
    return placed.astype({"cluster": "Int64"})


def _place(
    requests: pd.DataFrame, way_points: pd.DataFrame
) -> tuple[np.ndarray[tuple[int], np.dtype[np.float64]], ...]:
    """Return x and y of each request's user at its time, on the line between two way points."""
    rows = requests[["episode", "user", "t_request_s"]].reset_index(drop=True)
    rows = rows.reset_index(names="row").sort_values("t_request_s", kind="stable")
    points = way_points[["episode", "user", "t_s", "x_m", "y_m"]].sort_values("t_s", kind="stable")
    before, after = (
        pd.merge_asof(
            rows,
            points,
            left_on="t_request_s",
            right_on="t_s",
            by=["episode", "user"],
            direction=direction,
        ).sort_values("row")
        for direction in ("backward", "forward")
    )
    before, after = before.fillna(after), after.fillna(before)
    passed_s = (before["t_request_s"] - before["t_s"]).to_numpy()
    leg_s = (after["t_s"] - before["t_s"]).to_numpy()
    share = np.divide(passed_s, leg_s, out=np.zeros(len(rows)), where=leg_s > 0)
    starts, ends = (points[["x_m", "y_m"]].to_numpy() for points in (before, after))
    x_m, y_m = (starts + share[:, None] * (ends - starts)).T
    return x_m, y_m
