"""Quality of experience: QoE1-3 and everything derived, from a frame of requests.

A request's basic columns are its times, ``requested_s`` and ``served_s``; ``derive`` adds what
follows from them, ``summary`` averages. Definitions as in the README's model page.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

OUTCOMES = ("completed", "unfinished", "never_served")
SUMMED = (
    *("t_request_s", "t_end_s", "attached_s", "wait_s", "completion_s", "outcome"),
    *("qoe1", "qoe1_feasible", "qoe2_iterations", "interruptions", "handovers"),
)
GROUPS: dict[str, type] = {"service": str, "episode": int, "user": int, "outcome": str}


def derive(requests: pd.DataFrame, duration_s: pd.Series | float, step_s: float) -> pd.DataFrame:
    """Requests with wait_s, completion_s, handovers, qoe1, qoe1_feasible and qoe2_iterations.

    ``duration_s`` is the length of the episode (a number, or one a row); an iteration is a step.
    """
    derived = requests.copy()
    first = requests["t_first_service_s"].fillna(requests["t_end_s"])
    open_s = _between(requests["t_request_s"], requests["t_end_s"])
    left_s = _between(requests["t_request_s"], duration_s)
    derived["wait_s"] = _between(requests["t_request_s"], first)
    derived["completion_s"] = open_s.where(requests["outcome"] == "completed")
    handovers = [max(len(drones) - 1, 0) for drones in requests["drones"]]
    derived["handovers"] = pd.Series(handovers, requests.index, dtype="int64")
    derived["qoe1"] = requests["served_s"] / requests["requested_s"]
    feasible_s = requests["requested_s"].clip(upper=left_s)
    derived["qoe1_feasible"] = requests["served_s"] / feasible_s.where(feasible_s > 0)
    derived["qoe2_iterations"] = _between(requests["served_s"], open_s) / step_s
    return derived


def summary(requests: pd.DataFrame) -> dict[str, Any]:
    """The measures of a set of requests; a mean over none is None.

    QoE1 and QoE2 average over requests, unserved ones included. ``qoe3_active_percent`` is the
    share of the time open in which the user was attached. ``fairness`` is Jain's index of the
    users' mean QoE1.
    """
    column = {name: requests[name].to_numpy() for name in SUMMED}
    open_s = (column["t_end_s"] - column["t_request_s"]).sum()
    attached_s = column["attached_s"].sum()
    return {
        "requests": len(requests),
        "qoe1_percent": _mean(100 * column["qoe1"]),
        "qoe1_feasible_percent": _mean(100 * column["qoe1_feasible"]),
        "qoe2_iterations": _mean(column["qoe2_iterations"]),
        "qoe3_active_percent": float(100 * attached_s / open_s) if open_s > 0 else None,
        "wait_s": _mean(column["wait_s"]),
        "completion_s": _mean(column["completion_s"]),
        "interruptions": int(column["interruptions"].sum()),
        "handovers": int(column["handovers"].sum()),
        "fairness": fairness(requests),
    } | {outcome: int((column["outcome"] == outcome).sum()) for outcome in OUTCOMES}


def grouped(requests: pd.DataFrame, by: str) -> list[dict[str, Any]]:
    """``summary`` of each group of requests, in order of ``by``, one of ``GROUPS``."""
    groups = requests.groupby(by, sort=True)
    return [{by: GROUPS[by](value)} | summary(group) for value, group in groups]


def fairness(requests: pd.DataFrame) -> float | None:
    """Jain's index of the users' mean QoE1: 1 where all fare alike, 1/n where one has it all."""
    of_users = of_each_user(requests)
    squares = float((of_users**2).sum())
    return float(of_users.sum() ** 2 / (len(of_users) * squares)) if squares > 0 else None


def gini(requests: pd.DataFrame) -> float | None:
    """Gini's index of the users' mean QoE1: 0 where all fare alike, 1 - 1/n where one has it all.

    Twice the area between the Lorenz curve and the diagonal.
    """
    curve = lorenz(requests)
    if len(curve) < 2 or np.isnan(curve).any():
        return None
    return float(1 - (curve[1:] + curve[:-1]).sum() / (len(curve) - 1))


def lorenz(requests: pd.DataFrame) -> NDArray[np.float64]:
    """What share of all QoE1 the worst-off k of n users have, for k from 0 to n."""
    rising = np.sort(of_each_user(requests))
    total = rising.sum()
    return np.append(0.0, np.cumsum(rising)) / (total if total > 0 else np.nan)


def of_each_user(requests: pd.DataFrame) -> NDArray[np.float64]:
    """The mean QoE1 of each user that asked, by user."""
    users, of_request = np.unique(requests["user"].to_numpy(), return_inverse=True)
    sums = np.bincount(of_request, requests["qoe1"].to_numpy(), len(users))
    return np.asarray(sums / np.bincount(of_request, minlength=len(users)))


def _between(start_s: pd.Series, end_s: pd.Series | float) -> pd.Series:
    """The time between: all times are whole microseconds, and so is their difference."""
    return (end_s - start_s).round(6)


def _mean(values: NDArray[np.float64]) -> float | None:
    """The mean of the values there are; None where there are none."""
    there = values[~np.isnan(values)]
    return float(there.mean()) if len(there) else None
