"""Do 2026: the best number of drones at a station with few charging pads.

The study has sensors at random in 25 km², among which drones fly tours, each in a part of the
field; they charge at a station with c pads. More drones have shorter tours, but wait longer for a
pad. Its peak age of a sensor is the time of a tour, of the way to the station and back, of the
wait, and of charging. The wait is that of the closed queue M/M/c//N: N drones, exponential times
between charges, exponential times of charging. The study's own simulation has nearly fixed times,
and so has the simulator here: charging takes 8 minutes, and times between charges vary by up to
15 %. Means are over 30 fields.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from desim_uav.experiment.papers.row import FigureRow
from desim_uav.experiment.papers.simulated import STANDARD_ERRORS, flown, scenario_of
from desim_uav.model.energy.propulsion.rotary_wing import ROTORS, power_w, powers_of
from desim_uav.model.random.streams import Streams
from desim_uav.model.rules import Action
from desim_uav.model.state import Observation
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCENARIO = "do_2026.yaml"
FLEETS, FIELDS, SEEDS = range(1, 21), range(30), range(4)
BY_FORMULA = {1: 4, 2: 6, 3: 9, 4: 12}
"""The study's best numbers of drones by the closed queue, by the number of pads."""
BY_SIMULATION = {1: 4, 2: 8, 3: 12, 4: 16}
"""Those of its own simulation."""
NEAR = 4
"""The fleets that are simulated: so many drones fewer or more than the study's best number."""

SENSORS, SIDE_M, SPEED_MPS = 60, 5000.0, 12.0
BATTERY_J, KEPT, CHARGING_S = 240e3, 0.15, 480.0
PACKET_BIT, BAND_HZ, POWER_W, GAIN, NOISE_W, HEIGHT_M = 5e6, 1e6, 0.1, 1e-5, 1e-14, 100.0

LAWS = ("exponential", "nearly fixed")
"""The laws of the times between charges."""

DRAWN_MIN = 60.0
"""The longest peak age that is drawn."""

Places = NDArray[np.float64]


# ---- the study's field


@cache
def field_of(seed: int, drones: int) -> tuple[float, float]:
    """Return the longest tour with its way, and the mean time between charges, in s."""
    draws = random.Random(seed)
    sensors = [(draws.uniform(0, SIDE_M), draws.uniform(0, SIDE_M)) for _ in range(SENSORS)]
    places = np.array(sensors)
    centres = places[[draws.randrange(SENSORS) for _ in range(drones)]]
    for _ in range(25):
        apart = ((places[:, None] - centres[None]) ** 2).sum(2)
        part = apart.argmin(1)
        for k in {*part.tolist()}:
            centres[k] = places[part == k].mean(0)
    tours = [tour_of(places[part == k]) for k in sorted(set(part))]
    ways_s = [2 * way_m / SPEED_MPS for *_, way_m in tours]
    longest_s = max(loop_s + way_s for (loop_s, *_), way_s in zip(tours, ways_s, strict=True))
    between_s = np.mean([flight_s for _, flight_s, _ in tours]) + np.mean(ways_s)
    return float(longest_s), float(between_s)


def tour_of(places: Places) -> tuple[float, float, float]:
    """Return the time of a tour, that of all tours of a battery, and how far the station is."""
    powers = powers_of(ROTORS["zeng2019"])
    centre = places.mean(0)
    away_m = np.hypot(*(places - centre).T).mean()
    ratio = POWER_W * GAIN / (away_m**2 + HEIGHT_M**2) / NOISE_W
    hover_s = len(places) * PACKET_BIT / (BAND_HZ * math.log2(1 + ratio))
    flight_s = length_of(places) / SPEED_MPS
    used_j = power_w(powers, SPEED_MPS) * flight_s + power_w(powers, 0.0) * hover_s
    tours = max(1, math.floor(BATTERY_J * (1 - KEPT) / used_j))
    loop_s = flight_s + hover_s
    return loop_s, tours * loop_s, math.dist(centre, (SIDE_M / 2, SIDE_M / 2))


def length_of(places: Places) -> float:
    """Return the length of a closed tour: the nearest place next, then improved by 2-opt."""
    apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    left, way = list(range(1, len(places))), [0]
    while left:
        way.append(left.pop(int(np.argmin(apart[way[-1], left]))))
    for _ in range(6):
        before = list(way)
        for i in range(len(way) - 1):
            for k in range(i + 2, len(way)):
                a, b, c, d = way[i], way[i + 1], way[k], way[(k + 1) % len(way)]
                if b != d and apart[a, c] + apart[b, d] < apart[a, b] + apart[c, d] - 1e-12:
                    way[i + 1 : k + 1] = way[i + 1 : k + 1][::-1]
        if way == before:
            break
    return float(sum(apart[a, b] for a, b in zip(way, way[1:] + way[:1], strict=True)))


# ---- waits


def closed_queue_s(drones: int, pads: int, between_s: float) -> float:
    """Return the mean wait in M/M/c//N."""
    shares = [1.0]
    for there in range(drones):
        rate = (drones - there) / between_s * CHARGING_S / min(there + 1, pads)
        shares.append(shares[-1] * rate)
    law = np.array(shares) / sum(shares)
    number = np.arange(drones + 1)
    return float(law @ np.maximum(number - pads, 0) / (law @ (drones - number)) * between_s)


@dataclass
class Patrols:
    """Lets each drone charge after a random time in the air; ``between_s`` is its mean."""

    between_s: float
    law: str
    seed: int = 0
    ceiling: bool = True
    left: dict[int, int] = field(default_factory=dict)

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Note the actions, and let drones start at any time of a patrol."""
        self._hover, self._charge = map(world.actions.index, (Action.HOVER, Action.CHARGE))
        self._step_s, self._draws = world.scenario.episode.step_s, random.Random(self.seed)
        for drone in range(world.scenario.drone_count):
            self.left[drone] = int(self._steps() * self._draws.random())

    def _steps(self) -> int:
        """Draw a number of steps, whose mean is exact."""
        if self.law == "exponential":
            lasts_s = self._draws.expovariate(1 / self.between_s)
        else:
            lasts_s = self.between_s * self._draws.uniform(0.85, 1.15)
        return math.floor(lasts_s / self._step_s + self._draws.random())

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """Hover or charge."""
        drone = observation.drone
        if sum(mask) == 1:
            return mask.index(True)
        if self.left[drone] > 0 or not mask[self._charge]:
            self.left[drone] -= 1
            return self._hover
        self.left[drone] = self._steps()
        return self._charge


def pads_of(count: int) -> str:
    """Return a number of pads in words."""
    return f"{count} pad" + ("s" if count > 1 else "")


def wait_s(scenario: Scenario, drones: int, law: str, seed: int) -> float:
    """Return the mean wait for a pad in a run of 40 hours."""
    policy = Patrols(between_charges_s(drones), law, seed)
    episodes = flown(scenario, policy, seed).episodes
    return float(episodes["queueing_s"].sum() / episodes["charges"].sum())


@cache
def waits_s(drones: int, pads: int, law: str = "nearly fixed") -> NDArray[np.float64]:
    """Return the mean wait for a pad in a run of 40 hours on each seed."""
    if drones <= pads:
        return np.zeros(len(SEEDS))
    scenario = scenario_of(
        SCENARIO,
        {
            "drones.count": drones,
            "stations.pads": pads,
            "drones.start_cells": [[0, 0]] * drones,
        },
    )
    return np.array([wait_s(scenario, drones, law, seed) for seed in SEEDS])


# ---- rows and figures


def rows() -> Iterator[FigureRow]:
    """Yield the best numbers of drones, by the closed queue and in runs, and what waits differ."""
    for pads, printed in BY_FORMULA.items():
        ours = best_by_formula(pads)
        what = f"{pads_of(pads)}, closed queue: best number of drones"
        yield FigureRow(what, "printed by the study's code", printed, ours, 0.5, 0)
    for pads, printed in BY_SIMULATION.items():
        best, alike = best_in_runs(pads)
        what = f"{pads_of(pads)}, simulated: best number of drones"
        how = f"printed by the study's code; here {alike[0]} to {alike[-1]} are not told apart"
        reach = max(best - alike[0], alike[-1] - best) + 0.5
        yield FigureRow(what, how, printed, best, reach, 0)
    for pads, drones in BY_FORMULA.items():
        formula_s = formula_wait_s(drones, pads)
        for law in LAWS:
            what = f"{pads_of(pads)}, {drones} drones, {law} flights: mean wait, s"
            flown_s = float(waits_s(drones, pads, law).mean())
            how = "closed queue, whose charging times are exponential"
            yield FigureRow(what, how, formula_s, flown_s, None, 0)


def best_by_formula(pads: int) -> int:
    """Return the number of drones with the least peak age by the closed queue."""
    return min(FLEETS, key=lambda drones: formula_min(drones, pads))


def simulated_fleets(pads: int) -> range:
    """Return the numbers of drones that are simulated with so many pads."""
    middle = BY_SIMULATION[pads]
    return range(max(pads, middle - NEAR), min(middle + NEAR, FLEETS[-1]) + 1)


def best_in_runs(pads: int) -> tuple[int, list[int]]:
    """Return the number of drones with the least peak age, and those not told apart from it.

    These differ from it by at most 4 standard errors of the paired difference.
    """
    peaks = {drones: peaks_min(drones, pads) for drones in simulated_fleets(pads)}
    best = min(peaks, key=lambda drones: float(peaks[drones].mean()))

    def is_alike(drones: int) -> bool:
        more = peaks[drones] - peaks[best]
        error = more.std(ddof=1) / math.sqrt(len(more))
        return bool(more.mean() <= STANDARD_ERRORS * error)

    return best, [drones for drones in peaks if is_alike(drones)]


def peaks_min(drones: int, pads: int) -> NDArray[np.float64]:
    """Return the peak age with simulated waits on each seed, in minutes."""
    return (waits_s(drones, pads) + tours_s(drones) + CHARGING_S) / 60.0


def formula_min(drones: int, pads: int) -> float:
    """Return the peak age by the closed queue, in minutes."""
    return (formula_wait_s(drones, pads) + tours_s(drones) + CHARGING_S) / 60.0


def formula_wait_s(drones: int, pads: int) -> float:
    """Return the mean wait of the closed queue over the fields."""
    waits = [closed_queue_s(drones, pads, field_of(seed, drones)[1]) for seed in FIELDS]
    return float(np.mean(waits))


@cache
def tours_s(drones: int) -> float:
    """Return the mean over the fields of the longest tour with its way."""
    return float(np.mean([field_of(seed, drones)[0] for seed in FIELDS]))


def between_charges_s(drones: int) -> float:
    """Return the mean time between charges over the fields."""
    return float(np.mean([field_of(seed, drones)[1] for seed in FIELDS]))


def draw() -> Figure:
    """Draw the peak age over the number of drones: the closed queue as lines, runs as points."""
    from desim_uav.report.figures.papers import Series, lines_figure

    series = []
    for pads in BY_FORMULA:
        fleets = [n for n in FLEETS if n >= pads and formula_min(n, pads) <= DRAWN_MIN]
        queue = [formula_min(drones, pads) for drones in fleets]
        runs = tuple((n, float(peaks_min(n, pads).mean())) for n in simulated_fleets(pads))
        series.append(Series(f"{pads_of(pads)}, closed queue", fleets, queue, points=runs))
    return lines_figure("Peak age", "drones", "peak age, min", series, "ours, runs")
