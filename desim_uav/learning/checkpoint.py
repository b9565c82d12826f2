"""A training set down between two episodes, to be taken up again as if nothing had happened."""

from __future__ import annotations

import io
import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.base import CarriedDrone
from desim_uav.errors import PolicyError
from desim_uav.learning.training import Memory, Progress
from desim_uav.model.rules import Mode

FORMAT = 1


class Checkpoint(NamedTuple):
    """What a training remembers, its rows so far, and which training it is."""

    identity: str
    memory: Memory
    rows: list[Progress]


def to_bytes(checkpoint: Checkpoint) -> bytes:
    """The file: arrays and text, no code."""
    memory = checkpoint.memory
    about = {
        "format": FORMAT,
        "identity": checkpoint.identity,
        "episode": memory.episode,
        "pending": memory.pending,
        "carried": memory.carried,
    }
    file = io.BytesIO()
    np.savez(
        file,
        q=memory.q,
        rows=np.array(checkpoint.rows, np.float64).reshape(-1, len(Progress._fields)),
        about=np.frombuffer(json.dumps(about).encode(), np.uint8),
    )
    return file.getvalue()


def read(path: Path) -> Checkpoint:
    """Read a checkpoint. Raises PolicyError, naming the file."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            about = json.loads(arrays["about"].tobytes().decode())
            q, rows = arrays["q"], arrays["rows"]
        if about["format"] != FORMAT:
            raise ValueError(f"its format is {about['format']!r}; this version reads {FORMAT}")
        memory = Memory(
            int(about["episode"]),
            q,
            tuple(None if p is None else (p[0], p[1], p[2], p[3]) for p in about["pending"]),
            None if about["carried"] is None else tuple(map(_drone, about["carried"])),
        )
        return Checkpoint(str(about["identity"]), memory, _progress(rows))
    except Exception as error:  # zipfile, zlib, NumPy and JSON have many ways to refuse a file
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise PolicyError(f"{path}: not a readable checkpoint: {reason}") from error


def _drone(values: list[Any]) -> CarriedDrone:
    """JSON knows neither tuples nor modes."""
    plain = dict(zip(CarriedDrone._fields, values, strict=True))
    tuples: dict[str, Any] = {
        "mode": Mode(plain["mode"]),
        "node": tuple(plain["node"]),
        "hop": None if plain["hop"] is None else tuple(plain["hop"]),
        "route": tuple(tuple(hop) for hop in plain["route"]),
        "fallen_m": None if plain["fallen_m"] is None else tuple(plain["fallen_m"]),
    }
    return CarriedDrone(**plain | tuples)


def _progress(rows: NDArray[np.float64]) -> list[Progress]:
    """The rows again; a measure there was none of is NaN in the file."""
    return [Progress(*map(_number, Progress._fields, row)) for row in rows.tolist()]


def _number(name: str, value: float) -> Any:
    if name in ("episode", "drone", "crashes"):
        return int(value)
    return None if math.isnan(value) else value
