"""Bayerlein, Theile, Caccamo, Gesbert 2021: drones gather data between buildings and land in time.

The paper trains one network for all missions of its map Manhattan32, and evaluates it on missions
that it draws anew. The map is an image, which we have not read, so ours is one like it, and what is
collected is an open question. To show how much depends on the map, others are tried too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from desim_uav.experiment.papers.harvest import (
    STEP_US,
    Floats,
    Ground,
    Mission,
    drawn,
    ground_of,
)
from desim_uav.experiment.papers.harvester import FEATURES, Harvester, learned
from desim_uav.experiment.papers.row import FigureRow
from desim_uav.experiment.papers.simulated import STANDARD_ERRORS
from desim_uav.model.rules import US

if TYPE_CHECKING:
    from matplotlib.figure import Figure

THEIRS = {"landed": 99.4, "collected": 88.0, "collected and landed": 87.5}
"""What the paper prints for Manhattan32, in percent."""
FIRST_SEED = 910_000
"""The first seed of missions; no training has these, and nothing was chosen by them."""
MISSIONS, OTHERS = 600, 150
"""The missions on the scenario's map, and on each of the others."""

ELSEWHERE = ("streets of 3 cells", "streets of 1 cell", "one landing corner")

SIDE_M, HEIGHT_M, EDGE_DB, LOS = 320.0, 10.0, -25.0, 2.27
SLOTS = STEP_US // US
STREET = 18
"""Both numbers of a cell that is in a street."""

BUDGETS = (50, 70, 90, 110, 130, 151)
"""The ends of the ranges of batteries that are drawn, in steps."""


@dataclass(frozen=True)
class Flown:
    """How missions ended: their numbers of drones, mean batteries in steps, and shares (missions,).

    ``landed`` is 1 if all drones of a mission have landed.
    """

    drones: Floats
    steps: Floats
    landed: Floats
    collected: Floats

    def percent(self, what: str) -> Floats:
        """Return a measure of each mission, in percent."""
        both = self.landed * self.collected
        shares = {"landed": self.landed, "collected": self.collected, "collected and landed": both}
        return 100.0 * shares[what]


def rows() -> Iterator[FigureRow]:
    """Yield the data of a slot, the paper's measures, and what depends on map and training."""
    how = "the formulas of the authors' code"
    yield FigureRow("data of a slot above a device, units", how, slot(), slot_flown(), 2e-6, 6)
    base = flown()
    for what, theirs in THEIRS.items():
        how = f"printed; ours on another map, {error(base.percent(what))}"
        yield FigureRow(f"{what}, %", how, theirs, float(base.percent(what).mean()), None, 1)
    both = "collected and landed"
    others = {"weights of 0": untrained()} | {name: elsewhere(name) for name in ELSEWHERE}
    for name, other in others.items():
        how = f"as above; {error(other.percent(both))}"
        ours = float(other.percent(both).mean())
        yield FigureRow(f"{both}, {name}, %", how, THEIRS[both], ours, None, 1)


def error(percent: Floats) -> str:
    """Return how sure a mean is, as text."""
    limit = STANDARD_ERRORS * percent.std(ddof=1) / math.sqrt(len(percent))
    return f"{len(percent)} missions, 4 standard errors are {limit:.1f}"


def slot() -> float:
    """Return what is sent in a slot right above a device, in units, without shadowing."""
    edge_m = SIDE_M * math.sqrt(0.5)
    return math.log2(1.0 + 10.0 ** (EDGE_DB / 10.0) * (edge_m / HEIGHT_M) ** LOS)


@cache
def slot_flown() -> float:
    """Return what is sent in a slot to a drone that hovers above a device, in a run."""
    ground = ground_of("no shadowing")
    cell = ground.town.number[[STREET], [STREET]]
    mission = Mission(cell, np.array([100.0]), cell, np.array([2]))
    outcome = ground.flown(mission, 0, lambda sight: sight.at.tolist())
    return 100.0 * outcome.collected / (2 * SLOTS)


@cache
def flown() -> Flown:
    """Return how missions end with the learned weights."""
    return missions(ground_of(), learned(), MISSIONS)


@cache
def untrained() -> Flown:
    """Return how they end with weights of 0: devices are taken in the order of their numbers."""
    return missions(ground_of(), np.zeros(len(FEATURES)), MISSIONS)


@cache
def elsewhere(name: str) -> Flown:
    """Return how missions end on another map with the learned weights."""
    return missions(ground_of(name), learned(), OTHERS)


def missions(ground: Ground, weights: Floats, count: int, first: int = FIRST_SEED) -> Flown:
    """Fly missions of the seeds from ``first`` on."""
    ended, town = [], ground.town
    for seed in range(first, first + count):
        mission = drawn(town, seed)
        policy = Harvester(weights, town, mission.devices, len(mission.starts))
        outcome = ground.flown(mission, seed, policy)
        ended.append((len(mission.starts), mission.steps.mean(), *outcome))
    return Flown(*np.array(ended, float).T)


def draw() -> Figure:
    """Draw what is collected over the mean battery, by the number of drones."""
    from desim_uav.report.figures.papers import Series, lines_figure

    base, series = flown(), []
    both = base.percent("collected and landed")
    for drones in sorted({*base.drones.tolist()}):
        middles, shares = list[float](), list[float]()
        for least, end in pairwise(BUDGETS):
            inside = (base.drones == drones) & (base.steps >= least) & (base.steps < end)
            if inside.any():
                middles.append(0.5 * (least + end - 1))
                shares.append(float(both[inside].mean()))
        name = f"{drones:.0f} drone" + ("s" if drones > 1 else "")
        series.append(Series(name, middles, shares))
    theirs = THEIRS["collected and landed"]
    series.append(Series("paper, all missions", [50.0, 150.0], [theirs, theirs]))
    return lines_figure(
        "Collected and landed", "steps that a battery lasts", "collected and landed, %", series
    )
