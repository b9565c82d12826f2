"""The tables of a run: their columns and types. Times in seconds from the episode's start."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

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

LEGS = {
    "episode": INT,
    "t_s": FLOAT,
    "drone": INT,
    "duration_s": FLOAT,
    "mode": TEXT,
    "x_from_m": FLOAT,
    "y_from_m": FLOAT,
    "z_from_m": FLOAT,
    "x_to_m": FLOAT,
    "y_to_m": FLOAT,
    "z_to_m": FLOAT,
}
"""Where drones were, exactly: a row where a transit begins (``t_s`` below 0: in the episode before)
and one of duration 0 where a drone is put at an episode's start, on its crash, in place of another.
Between legs a drone is where the last one led.
"""

TRAINING = {
    "episode": INT,
    "drone": INT,
    "reward": FLOAT,
    "epsilon": FLOAT,
    "alpha": FLOAT,
    "mean_q": FLOAT,
    "qoe1_percent": FLOAT,
    "qoe2_iterations": FLOAT,
    "qoe3_percent": FLOAT,
    "crashes": INT,
}
"""One row a drone and episode of a training. ``reward``: the sum over the episode's steps."""


def arrow_schema(columns: dict[str, str]) -> pa.Schema:
    """The types of a table in its Parquet file, the same whatever its rows."""
    import pyarrow as pa

    types = {
        TEXT: pa.string(),
        LIST: pa.list_(pa.int64()),
        INT: pa.int64(),
        "Int64": pa.int64(),
        FLOAT: pa.float64(),
        BOOL: pa.bool_(),
    }
    return pa.schema([(name, types[dtype]) for name, dtype in columns.items()])


def misfit(columns: dict[str, str], table: pa.Table) -> str | None:
    """What keeps a table from being one of ``columns``: one that lacks, or holds something else."""
    import pyarrow.compute as pc
    from pyarrow import types

    fits = {
        TEXT: (types.is_string, types.is_large_string),
        LIST: (types.is_list, types.is_large_list),
        INT: (types.is_integer,),
        "Int64": (types.is_integer,),
        FLOAT: (types.is_floating,),
        BOOL: (types.is_boolean,),
    }
    expected = arrow_schema(columns)
    for name, dtype in columns.items():
        if table.column_names.count(name) != 1:
            return f"no column {name!r}"
        column = table[name]
        if not any(is_one(column.type) for is_one in (types.is_null, *fits[dtype])):
            return f"column {name!r} holds {column.type}, not {expected.field(name).type}"
        if dtype in (INT, BOOL) and column.null_count:
            return f"column {name!r} has empty values"
        if types.is_floating(column.type) and pc.any(pc.is_inf(column)).as_py():
            return f"column {name!r} has infinite values"
    return None


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
