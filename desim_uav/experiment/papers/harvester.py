"""The policy of the drones that harvest data: which device next, by a few learned weights.

Each drone decides alone, by what all see: the map, what devices still have, and the places and
batteries of the others, but not where these are going. It takes the shortest way to the device with
the highest score that leaves it enough battery to land, hovers there until the device has no more,
and goes to the nearest station when there is no such device. Only the scores are learned.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from desim_uav.experiment.papers.harvest import LAND, Floats, Ints, Sight, Town

FEATURES = (
    "way",  # the steps to the device, in tens
    "log_way",  # the logarithm of these steps and one
    "units",  # what it still has, in tens
    "around",  # what others have, the less the further they are from it (by e in 5 steps)
    "home",  # the steps from it to the nearest station, in tens
    "battery",  # the share of the battery that the ways there and to the station take
    "own",  # 1 for the device to which the drone has been going
    "others",  # how many other drones are nearer, softly (2 steps), and can reach it too
    "pace",  # what it still has, in tens, over 1 and a fifth of the steps to it
)
"""What the score of a device adds up, each times its weight."""

WEIGHTS = Path(__file__).parent / "bayerlein_2021.json"
"""The learned weights, and how they were learned."""

EMPTY = 0.01
"""Devices with less than this have no more, in Mbit."""
NEAR, SOFT = 5.0, 2.0


def learned() -> Floats:
    """Return the weights that come with the package."""
    return in_order(json.loads(WEIGHTS.read_text(encoding="utf-8"))["weights"])


def in_order(weights: Mapping[str, float]) -> Floats:
    """Return weights in the order of ``FEATURES``."""
    return np.array([weights[name] for name in FEATURES])


class Harvester:
    """Chooses where the drones of a mission go; ``weights`` are those of ``FEATURES``."""

    def __init__(self, weights: Floats, town: Town, devices: Ints, drones: int) -> None:
        self.weights, self.town, self.devices = weights, town, devices
        self.home = town.home[devices]
        between = town.steps[np.ix_(devices, devices)]
        self.around = np.exp(-between / NEAR) - np.eye(len(devices))
        self.aims = np.full(drones, -1)

    def __call__(self, sight: Sight) -> list[int]:
        """Return the cell to which each drone goes, or LAND."""
        return [
            self._next(sight, drone) if flies else int(sight.at[drone])
            for drone, flies in enumerate(sight.flies)
        ]

    def _next(self, sight: Sight, drone: int) -> int:
        """Return where a drone goes, and note the device that it aims at."""
        ways = self.town.steps[sight.at[drone], self.devices]
        scores = self.scores(sight, drone, ways)
        needed = np.maximum(ways, 1.0) + self.home + 1.0
        scores[(sight.units < EMPTY) | (needed > sight.steps[drone])] = -np.inf
        best = int(scores.argmax())
        at = int(sight.at[drone])
        if scores[best] == -np.inf:
            self.aims[drone] = -1
            return LAND if self.town.home[at] == 0 else self._towards(sight, at, self.town.home)
        self.aims[drone] = best
        return at if ways[best] == 0 else self._towards(sight, at, self._steps_to(best))

    def _steps_to(self, device: int) -> Floats:
        steps: Floats = self.town.steps[self.devices[device]]
        return steps

    def scores(self, sight: Sight, drone: int, ways: Floats) -> Floats:
        """Return the score of each device for a drone that is so many steps away."""
        own, others = np.zeros(len(ways)), np.zeros(len(ways))
        if self.aims[drone] >= 0:
            own[self.aims[drone]] = 1.0
        for other, flies in enumerate(sight.flies):
            if flies and other != drone:
                theirs = self.town.steps[sight.at[other], self.devices]
                nearer = 1.0 / (1.0 + np.exp((theirs - ways) / SOFT))
                others += nearer * (theirs + self.home + 1.0 <= sight.steps[other])
        tens = sight.units / 10.0
        features = (
            ways / 10.0,
            np.log1p(ways),
            tens,
            self.around @ tens,
            self.home / 10.0,
            (ways + self.home) / sight.steps[drone],
            own,
            others,
            tens / (1.0 + ways / 5.0),
        )
        scores: Floats = self.weights @ np.stack(features)
        return scores

    def _towards(self, sight: Sight, at: int, steps: Floats) -> int:
        """Return the next cell of a shortest way, that with most data around it."""
        beside = self.town.beside[at]
        nearer = beside[steps[beside] < steps[at]]
        ways = self.town.steps[np.ix_(nearer, self.devices)]
        return int(nearer[((1.0 + ways) ** -2.0 @ sight.units).argmax()])
