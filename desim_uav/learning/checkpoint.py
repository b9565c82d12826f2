"""Checkpoints: a training is saved between two episodes and continues exactly as without it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav import array_file
from desim_uav.engine.base import CarriedDrone
from desim_uav.errors import PolicyError
from desim_uav.learning.training import Decision, Memory, Progress
from desim_uav.model.rules import Mode

FORMAT = 2


class Checkpoint(NamedTuple):
    """The state of a training between two episodes, its rows so far, and its identity."""

    identity: str
    memory: Memory
    rows: list[Progress]


def to_bytes(checkpoint: Checkpoint) -> bytes:
    """Return the bytes of a checkpoint file, which holds arrays and text but no code."""
    memory = checkpoint.memory
    about = {
        "format": FORMAT,
        "identity": checkpoint.identity,
        "episode": memory.episode,
        "pending": memory.pending,
        "carried": memory.carried,
    }
    rows = np.array(checkpoint.rows, np.float64).reshape(-1, len(Progress._fields))
    sums = np.array(memory.sums, np.float64)
    return array_file.pack(about, q=memory.q, sums=sums, rows=rows)


def read(path: Path, q_shape: tuple[int, ...] | None = None) -> Checkpoint:
    """Read a checkpoint whose Q-tables must have the shape ``q_shape``.

    Raises PolicyError, which names the file, if it cannot be read or has another shape.
    """
    stored = array_file.Stored(path, "checkpoint", ["q", "sums", "rows"], FORMAT)
    about, shape = stored.about, stored.forms["q"].shape
    if q_shape is not None and shape != q_shape:
        raise PolicyError(f"{path}: the table must have the shape {q_shape}, not {shape}")
    arrays = stored.arrays()
    try:
        carried = _tuples(about["carried"])
        memory = Memory(
            int(about["episode"]),
            arrays["q"],
            tuple(arrays["sums"].tolist()),
            tuple(Decision(*(decision or ())) for decision in about["pending"]),
            carried and tuple(CarriedDrone(Mode(mode), *rest) for mode, *rest in carried),
        )
        return Checkpoint(str(about["identity"]), memory, _progress(arrays["rows"]))
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise PolicyError(f"{path}: not a readable checkpoint: {error!r}") from error


def identity(path: Path) -> str:
    """Return the identity of a checkpoint's training. Raises PolicyError, which names the file."""
    stored = array_file.Stored(path, "checkpoint", ["q", "sums", "rows"], FORMAT)
    return str(stored.about.get("identity"))


def _tuples(value: Any) -> Any:
    """Return a value of JSON, which has no tuples, with tuples in the place of lists."""
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _progress(rows: NDArray[np.float64]) -> list[Progress]:
    """Return the rows of a file, in which a missing measure is NaN."""
    return [Progress(*map(_number, Progress._fields, row)) for row in rows.tolist()]


def _number(name: str, value: float) -> Any:
    if name in ("episode", "drone", "crashes"):
        return int(value)
    return None if math.isnan(value) else value
