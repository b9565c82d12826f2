"""Encodings of a drone's observation for a learner: the paper's state, or local features."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from desim_uav.errors import SimulationError
from desim_uav.model.state import Facts, Observation
from desim_uav.registry import register


class Feature(NamedTuple):
    """One number of an encoded observation, with its name and its inclusive bounds.

    ``whole`` says that it is a whole number. If all features are, a table can hold the values of
    states.
    """

    name: str
    low: float
    high: float
    whole: bool


class Encoding(Protocol):
    """Encodes a drone's observation as numbers for a learner, whose drones have a ceiling."""

    def features(self, facts: Facts) -> tuple[Feature, ...]:
        """Return the names and bounds of the numbers, in their order."""

    def encode(self, observation: Observation, facts: Facts) -> tuple[float, ...]:
        """Return the numbers of an observation, each within the bounds of its feature."""


def table_sizes(features: Sequence[Feature]) -> tuple[int, ...]:
    """Return the number of values of each feature of a table's states, which begin at 0."""
    return tuple(int(feature.high) + 1 for feature in features)


def table_row(code: Sequence[float], sizes: Sequence[int]) -> int:
    """Return the row of a state in a table, in which the first feature is the most significant.

    Raises SimulationError for a state that the table does not have.
    """
    row = 0
    for value, size in zip(code, sizes, strict=True):
        if not 0 <= value < size:
            raise SimulationError(
                f"observation: {tuple(code)} is outside the bounds of its features, which have "
                f"{tuple(sizes)} values from 0"
            )
        row = row * size + int(value)
    return row


@register("observation", "position")
@dataclass(frozen=True)
class Position:
    """The paper's state: cell x and y, in 3D the level, with a battery its full minutes left."""

    def features(self, facts: Facts) -> tuple[Feature, ...]:
        """Return two to four features, all whole numbers from 0."""
        nx, ny = facts.grid.cells
        sizes = {"cell_x": nx, "cell_y": ny}
        if facts.three_d:
            sizes["level"] = facts.grid.levels_under_ceiling
        if facts.capacity_s is not None:
            sizes["battery_min"] = 1 + int(facts.capacity_s // 60)
        return tuple(Feature(name, 0, size - 1, True) for name, size in sizes.items())

    def encode(self, observation: Observation, facts: Facts) -> tuple[float, ...]:
        """As many whole numbers as features."""
        ix, iy = observation.cell
        battery_s = observation.battery_s
        if battery_s is None:
            return (ix, iy, observation.level) if facts.three_d else (ix, iy)
        minutes = int(battery_s // 60)
        return (ix, iy, observation.level, minutes) if facts.three_d else (ix, iy, minutes)


@register("observation", "local")
@dataclass(frozen=True)
class Local:
    """The drone's surroundings as numbers from 0 to 1 (the bearing: from -1 to 1).

    These are the believed position, the attached users, the requests served and the open requests
    in the footprint, by service (all over the number of users), the free bandwidth and the time
    left. With a battery they also include its charge and n_B, and the bearing (sine and cosine
    from north) and flight time of the nearest charging station; charge and times are divided by
    the capacity.
    """

    def features(self, facts: Facts) -> tuple[Feature, ...]:
        """Return the features, all real numbers."""
        names = ["x", "y"] + ["altitude"] * facts.three_d + ["attached"]
        names += [f"served_{name}" for name in facts.services]
        names += [f"asking_{name}" for name in facts.services]
        names += ["bandwidth_left", "time_left"]
        lows = dict.fromkeys(names, 0.0)
        if facts.capacity_s is not None:
            lows |= {"battery": 0.0, "n_b": 0.0}
            lows |= {"bearing_sin": -1.0, "bearing_cos": -1.0, "flight_time": 0.0}
        return tuple(Feature(name, low, 1.0, False) for name, low in lows.items())

    def encode(self, observation: Observation, facts: Facts) -> tuple[float, ...]:
        """As many numbers as features."""
        grid, (ix, iy) = facts.grid, observation.cell
        nx, ny = grid.cells
        values = [(ix + 0.5) / nx, (iy + 0.5) / ny]
        if facts.three_d:
            values.append((observation.level + 0.5) / grid.levels_under_ceiling)
        values.append(observation.attached_users / facts.users)
        values += [count / facts.users for count in observation.served]
        values += [count / facts.users for count in observation.asking]
        values.append(1.0 - observation.bandwidth_kbps / facts.bandwidth_kbps)
        values.append(1.0 - observation.step / observation.steps)
        if facts.capacity_s is not None:
            values += _way_home(observation, facts, facts.capacity_s)
        return tuple(values)


def _way_home(observation: Observation, facts: Facts, capacity_s: float) -> list[float]:
    """Return battery, n_B, and the bearing and flight time of the nearest station."""
    assert observation.battery_s is not None and observation.return_s is not None
    values = [observation.battery_s / capacity_s, min(observation.return_s / capacity_s, 1.0)]
    if observation.station is None or observation.flight_s is None:
        return [*values, 0.0, 0.0, 1.0]
    station = facts.stations[observation.station]
    cell_x, cell_y = facts.grid.cell_m
    east = (station[0] - observation.cell[0]) * cell_x
    north = (station[1] - observation.cell[1]) * cell_y
    distance = math.sqrt(east * east + north * north)
    bearing = (east / distance, north / distance) if distance > 0.0 else (0.0, 0.0)
    return [*values, *bearing, min(observation.flight_s / capacity_s, 1.0)]
