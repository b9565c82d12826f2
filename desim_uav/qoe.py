"""Quality of experience: QoE1-3 and everything derived, from a frame of requests.

A request's basic columns are its times, ``requested_s`` and ``served_s``; ``derive`` adds what
follows from them, ``summary`` averages. Definitions as in the README's model page.
"""

from __future__ import annotations

from typing import Any

import pandas as pd

GROUPS: dict[str, type] = {"service": str, "episode": int, "user": int, "outcome": str}


def derive(requests: pd.DataFrame, duration_s: float, step_s: float) -> pd.DataFrame:
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
    open_s = (requests["t_end_s"] - requests["t_request_s"]).sum()
    counted = requests[requests["completion_s"].notna()]
    return {
        "requests": len(requests),
        "qoe1_percent": _mean(100 * requests["qoe1"]),
        "qoe1_feasible_percent": _mean(100 * requests["qoe1_feasible"]),
        "qoe2_iterations": _mean(requests["qoe2_iterations"]),
        "qoe3_active_percent": (
            float(100 * requests["attached_s"].sum() / open_s) if open_s > 0 else None
        ),
        "wait_s": _mean(requests["wait_s"]),
        "completion_s": _mean(counted["completion_s"]),
        "interruptions": int(requests["interruptions"].sum()),
        "handovers": int(requests["handovers"].sum()),
        "fairness": fairness(requests),
    } | {outcome: int((requests["outcome"] == outcome).sum()) for outcome in OUTCOMES}


OUTCOMES = ("completed", "unfinished", "never_served")


def grouped(requests: pd.DataFrame, by: str) -> list[dict[str, Any]]:
    """``summary`` of each group of requests, in order of ``by``, one of ``GROUPS``."""
    groups = requests.groupby(by, sort=True)
    return [{by: GROUPS[by](value)} | summary(group) for value, group in groups]


def fairness(requests: pd.DataFrame) -> float | None:
    """Jain's index of the users' mean QoE1: 1 where all fare alike, 1/n where one has it all."""
    of_users = requests.groupby("user")["qoe1"].mean()
    squares = float((of_users**2).sum())
    return float(of_users.sum() ** 2 / (len(of_users) * squares)) if squares > 0 else None


def _between(start_s: pd.Series, end_s: pd.Series | float) -> pd.Series:
    """The time between: all times are whole microseconds, and so is their difference."""
    return (end_s - start_s).round(6)


def _mean(values: pd.Series) -> float | None:
    return float(values.mean()) if values.notna().any() else None
