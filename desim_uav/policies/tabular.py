"""Learned tables: a Q-table for each drone, in a file that holds arrays and text, no code."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav import array_file
from desim_uav.errors import PolicyError
from desim_uav.model.observations import Feature, table_row, table_sizes
from desim_uav.model.rules import DECIDES
from desim_uav.model.state import Observation
from desim_uav.model.streams import Streams
from desim_uav.registry import register
from desim_uav.run_folder import world_hash
from desim_uav.shipped import find_table
from desim_uav.world import World

FORMAT = 1
ABOUT: dict[str, type] = {
    "features": list,
    "actions": list,
    "scenario": str,
    "scenario_hash": str,
    "world_seed": int,
    "world_hash": str,
    "algorithm": str,
    "seed": int,
    "episodes": int,
}
"""What a file says of its table, at least."""


@dataclass(frozen=True, eq=False)
class QTable:
    """Values ``q`` (drones, states, actions), and what they are about.

    A state is the row of its features' values, the first feature most significant. ``about`` names
    ``features`` ([name, highest value]), ``actions`` and where the table comes from.
    """

    q: NDArray[np.float32]
    about: dict[str, Any]

    def to_bytes(self) -> bytes:
        """The file: the same table gives the same bytes."""
        return array_file.pack(self.about | {"format": FORMAT}, q=self.q)


def read_table(path: Path) -> QTable:
    """Read a table. Raises PolicyError, naming the file, where it is none."""
    about, arrays = array_file.unpack(path, "policy file", ["q"], FORMAT)
    problem = _misfit(arrays["q"], about)
    if problem:
        raise PolicyError(f"{path}: {problem}")
    return QTable(arrays["q"], about)


def _misfit(q: NDArray[Any], about: dict[str, Any]) -> str:
    """What keeps the content of a file from being a table, or nothing."""
    for key, of_type in ABOUT.items():
        if not isinstance(about.get(key), of_type):
            return f"it says no {key}"
    features = about["features"]
    if not all(isinstance(f, list) and len(f) == 2 and isinstance(f[1], int) for f in features):
        return "features must be [name, highest value]"
    states = math.prod(high + 1 for _, high in features)
    if q.dtype != np.float32 or q.ndim != 3:
        return f"q is {q.dtype} of shape {q.shape}, not float32 (drones, states, actions)"
    if q.shape[1:] != (states, len(about["actions"])):
        return (
            f"q has {q.shape[1]} states and {q.shape[2]} actions, but {states} and "
            f"{len(about['actions'])} are described"
        )
    return "" if np.isfinite(q).all() else "q has values that are not finite"


@register("policy", "table")
class Greedy:
    """The best allowed action by a learned table; of equally good ones the first."""

    ceiling = True

    def __init__(self, file: str = "") -> None:
        if not file:
            raise ValueError("a table needs its file: table:policy.npz, or just policy.npz")
        self.file = file
        self.table = read_table(find_table(file))
        self.world_seed: int = self.table.about["world_seed"]

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Raises PolicyError where the table does not fit the scenario."""
        self._facts = world.facts
        self._encode = world.scenario.observation.encode
        features = world.scenario.observation.features(world.facts)
        about = self.table.about
        self._require("drones", len(self.table.q), world.scenario.drones.count)
        self._require("actions", about["actions"], [a.name.lower() for a in world.actions])
        self._require("states", about["features"], described(features))
        self._sizes = table_sizes(features)

    def _require(self, what: str, learned: Any, here: Any) -> None:
        if learned != here:
            raise PolicyError(f"{self.file}: it has {what} {learned}; the scenario has {here}")

    def notice(self, world: World) -> str:
        """What to warn of before it acts in a world, or nothing."""
        if world_hash(world) == self.table.about["world_hash"]:
            return ""
        about = self.table.about
        return (
            f"{self.file} was learned in another world: {about['scenario']}, world seed "
            f"{about['world_seed']}"
        )

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """What is forced, else the best."""
        if observation.mode not in DECIDES:
            return list(mask).index(True)
        row = table_row(self._encode(observation, self._facts), self._sizes)
        return int(np.where(mask, self.table.q[observation.drone, row], -np.inf).argmax())


def described(features: Sequence[Feature]) -> list[list[Any]]:
    """Features of a table as its file says them."""
    return [[feature.name, int(feature.high)] for feature in features]
