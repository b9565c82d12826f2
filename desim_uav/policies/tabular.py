"""Learned Q-tables, one per drone, in a file that holds arrays and text but no code."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav import array_file
from desim_uav.checksums import verify
from desim_uav.errors import PolicyError, in_short
from desim_uav.model.observations import Feature, common_features, table_row, table_sizes
from desim_uav.model.random.streams import Streams
from desim_uav.model.rules import DECIDES
from desim_uav.model.state import Observation
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
"""The entries that the description in a file must have, with their types."""


@dataclass(frozen=True, eq=False)
class QTable:
    """The Q-tables of all drones and their description.

    ``q``: float32 (drones, states, actions). The row of a state is the mixed-radix number of its
    features' values, the first feature most significant. ``about`` holds ``features`` ([name,
    highest value]), ``actions``, and the scenario and training that the tables come from.
    """

    q: NDArray[np.float32]
    about: dict[str, Any]

    def to_bytes(self) -> bytes:
        """Return the bytes of a policy file. The same table always gives the same bytes."""
        return array_file.pack(self.about | {"format": FORMAT}, q=self.q)

    @property
    def drones(self) -> int:
        """How many drones it is for."""
        return len(self.q)

    def table(self) -> QTable:
        """Return the table itself; ``TableFile`` has the same method."""
        return self


class TableFile:
    """A file of Q-tables whose description has been read.

    Raises PolicyError, which names the file, if it is not a policy file, or if it has changed
    according to the checksums of its folder.
    """

    def __init__(self, path: Path) -> None:
        verify(path, strangers=True)
        self._stored = array_file.Stored(path, "policy file", ["q"], FORMAT)
        self.about = self._stored.about
        self.form = self._stored.forms["q"]
        problem = _misfit(self.form, self.about)
        if problem:
            raise PolicyError(f"{path}: {problem}")

    @property
    def drones(self) -> int:
        """How many drones it is for."""
        return self.form.shape[0]

    def table(self) -> QTable:
        """Read the table. Raises PolicyError if it is damaged."""
        q = self._stored.arrays()["q"]
        if not np.isfinite(q).all():
            raise PolicyError(f"{self._stored.path}: q has values that are not finite")
        return QTable(q, self.about)


def read_table(path: Path) -> QTable:
    """Read a table. Raises PolicyError, which names the file, if it is not a policy file."""
    return TableFile(path).table()


def _misfit(q: array_file.Form, about: dict[str, Any]) -> str:
    """Return why the content of a file cannot be a table, or ""."""
    for key, of_type in ABOUT.items():
        if not isinstance(about.get(key), of_type):
            return f"its description has no valid {key!r}"
    if not 0 <= about["world_seed"] < 2**63:
        return f"world_seed: {in_short(about['world_seed'], 40)}: must be from 0 to 2^63 - 1"
    features = about["features"]
    if not all(isinstance(f, list) and len(f) == 2 and isinstance(f[1], int) for f in features):
        return "each of the features must be [name, highest value]"
    states = math.prod(high + 1 for _, high in features)
    if q.dtype != np.float32 or len(q.shape) != 3:
        return (
            f"q must be float32 of shape (drones, states, actions), not {q.dtype} of shape "
            f"{q.shape}"
        )
    if q.shape[1:] != (states, len(about["actions"])):
        return (
            f"q has {q.shape[1]} states and {q.shape[2]} actions, but its description has {states} "
            f"and {len(about['actions'])}"
        )
    return ""


@register("policy", "table")
class Greedy:
    """Chooses the best allowed action by a learned table; of equally good ones, the first."""

    ceiling = True
    file_of = staticmethod(find_table)

    def __init__(self, file: str = "") -> None:
        if not file:
            raise ValueError("a table needs its file: table:policy.npz, or just policy.npz")
        self._use(file, TableFile(find_table(file)))

    @classmethod
    def of_table(cls, table: QTable, name: str) -> Greedy:
        """Act by a table that is in memory; tables and messages call the policy ``name``."""
        policy = cls.__new__(cls)
        policy._use(name, table)
        return policy

    def _use(self, name: str, stored: TableFile | QTable) -> None:
        self.name = name
        self._stored = stored
        self.about = stored.about
        self.world_seed: int = self.about["world_seed"]
        self._q: NDArray[np.float32] | None = None

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Check and read the table. Raises PolicyError if it does not fit the scenario."""
        self._fit(world)

    def _fit(self, world: World) -> None:
        """Check that the table fits the world, and read it."""
        self._world = world
        self._encode = world.scenario.observation.encode
        features = common_features(world.features_of_types)
        about = self.about
        self._require("drones", self._stored.drones, world.scenario.drone_count)
        self._require("actions", about["actions"], [a.name.lower() for a in world.actions])
        self._require("states", about["features"], described(features))
        self._sizes = table_sizes(features)
        if self._q is None:
            self._q = self._stored.table().q

    def _require(self, what: str, learned: object, here: object) -> None:
        if learned != here:
            raise PolicyError(
                f"{self.name}: the policy was learned with {what} {in_short(learned)}; "
                f"the scenario has {in_short(here)}"
            )

    def notice(self, world: World) -> str:
        """Return a warning if the table is of another world, or "". Raises as ``begin`` does."""
        self._fit(world)
        about = self.about
        if world_hash(world) == about["world_hash"]:
            return ""
        return (
            f"{self.name} was learned in another world: {in_short(about['scenario'])}, world seed "
            f"{about['world_seed']}"
        )

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """Return the forced action if there is one, else the best allowed action."""
        if observation.mode not in DECIDES:
            return list(mask).index(True)
        assert self._q is not None, "begin comes first"
        world, drone = self._world, observation.drone
        code = self._encode(observation, world.facts_of(drone))
        row = table_row(code, self._sizes, len(world.features_of(drone)))
        return int(np.where(mask, self._q[drone, row], -np.inf).argmax())


def described(features: Sequence[Feature]) -> list[list[Any]]:
    """Return features as a policy file describes them: [name, highest value]."""
    return [[feature.name, int(feature.high)] for feature in features]
