"""The tables of a run: their columns and types. Times in seconds from the episode's start."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

TEXT, LIST = "str", "object"
INT, FLOAT, BOOL = "int64", "float64", "bool"

REQUESTS = {
    "episode": INT,
    "request_id": INT,
    "user": INT,
    "service": TEXT,
    "t_request_s": FLOAT,
    "t_first_service_s": FLOAT,
    "t_end_s": FLOAT,
    "requested_s": FLOAT,
    "served_s": FLOAT,
    "bandwidth_kbps": FLOAT,
    "wait_s": FLOAT,
    "completion_s": FLOAT,
    "interruptions": INT,
    "handovers": INT,
    "drones": LIST,
    "outcome": TEXT,
    "qoe1": FLOAT,
    "qoe1_feasible": FLOAT,
    "qoe2_iterations": FLOAT,
    "attached_s": FLOAT,
}
"""``attached_s``: the time attached while open, from which QoE3 of the active users follows."""

STEPS = {
    "episode": INT,
    "step": INT,
    "t_s": FLOAT,
    "drone": INT,
    "x_m": FLOAT,
    "y_m": FLOAT,
    "z_m": FLOAT,
    "battery_s": FLOAT,
    "mode": TEXT,
    "action": TEXT,
    "action_taken": TEXT,
    "attached_users": INT,
    "served_requests": INT,
    "bandwidth_kbps": FLOAT,
    "n_b_s": FLOAT,
    "crashed": BOOL,
    "reward": FLOAT,
}

EPISODES = {
    "episode": INT,
    "qoe1_percent": FLOAT,
    "qoe2_iterations": FLOAT,
    "qoe3_percent": FLOAT,
    "qoe3_active_percent": FLOAT,
    "crashes": INT,
    "requests": INT,
    "reward": FLOAT,
    "qoe1_feasible_percent": FLOAT,
    "suppressed": INT,
    "charges": INT,
    "queueing_s": FLOAT,
    "distance_m": FLOAT,
    "bandwidth_percent": FLOAT,
    "fairness": FLOAT,
    "duration_s": FLOAT,
}

USERS = {"episode": INT, "user": INT, "t_s": FLOAT, "x_m": FLOAT, "y_m": FLOAT, "z_m": FLOAT}

EVENTS = {
    "episode": INT,
    "t_us": INT,
    "phase": INT,
    "kind": TEXT,
    "drone": "Int64",
    "user": "Int64",
    "request_id": "Int64",
    "station": "Int64",
}
"""Sorted by (t_us, phase, drone, user); what an event does not concern is null."""


def to_frame(columns: dict[str, str], rows: Iterable[tuple[Any, ...]]) -> pd.DataFrame:
    """A table from its rows, each value in the order of ``columns``; None is null."""
    import pandas as pd

    by_column = list(zip(*rows, strict=True)) or [()] * len(columns)
    return pd.DataFrame(
        {
            name: pd.Series(values, dtype=dtype)
            for (name, dtype), values in zip(columns.items(), by_column, strict=True)
        }
    )
