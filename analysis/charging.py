"""The best number of drones at a station with few charging pads: a closed queue and the simulator.

python analysis/charging.py [FILE.png]

A study of 2026 (P. H. Do: Congestion-aware joint charging-station placement, capacity, and
swarm-UAV trajectory design for age-optimal data collection) has sensors at random in 25 km², among
which drones fly tours, each in a part of the field; they charge at a station with c pads. More
drones have shorter tours, but wait longer for a pad. Its peak age of a sensor is the time of a
tour, of the way to the station and back, of the wait, and of charging. The wait is that of the
closed queue M/M/c//N: N drones, exponential times between charges, exponential times of charging.

The tables have the mean wait and the number of drones for which the peak age is least: of this
formula; of the simulator (analysis/charging.yaml) if the times between charges are exponential, and
charging takes its 8 minutes; and of the simulator if both are what they are in the study's own
simulation, namely nearly fixed: times between charges vary by up to 15 %. Means are over 30 fields.
The picture has the peak ages of all fleets.
"""

import math
import random
import sys
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
from script import row

import desim_uav as du
from desim_uav.disk import write_whole
from desim_uav.model.energy.propulsion.rotary_wing import ROTORS, power_w, powers_of
from desim_uav.model.rules import Action

SCENARIO = Path(__file__).with_suffix(".yaml")
PADS, FLEETS, FIELDS = (1, 2, 3, 4, 5, 6), range(1, 21), range(30)
PRINTED = {1: 4, 2: 6, 3: 9, 4: 12, 6: 17}
"""The study's best numbers of drones, by the number of pads."""

SENSORS, SIDE_M, SPEED_MPS = 60, 5000.0, 12.0
BATTERY_J, KEPT, CHARGING_S = 240e3, 0.15, 480.0
PACKET_BIT, BAND_HZ, POWER_W, GAIN, NOISE_W, HEIGHT_M = 5e6, 1e6, 0.1, 1e-5, 1e-14, 100.0
LAWS = ("exponential", "nearly fixed")


# ---- the study's field


@cache
def field_of(seed, drones):
    """Return the longest tour with its way, and the mean time between charges, in s."""
    draws = random.Random(seed)
    sensors = [(draws.uniform(0, SIDE_M), draws.uniform(0, SIDE_M)) for _ in range(SENSORS)]
    places = np.array(sensors)
    centres = places[[draws.randrange(SENSORS) for _ in range(drones)]]
    for _ in range(25):
        apart = ((places[:, None] - centres[None]) ** 2).sum(2)
        part = apart.argmin(1)
        for k in set(part):
            centres[k] = places[part == k].mean(0)
    tours = [tour_of(places[part == k]) for k in sorted(set(part))]
    ways_s = [2 * way_m / SPEED_MPS for *_, way_m in tours]
    longest_s = max(loop_s + way_s for (loop_s, *_), way_s in zip(tours, ways_s, strict=True))
    between_s = np.mean([flight_s for _, flight_s, _ in tours]) + np.mean(ways_s)
    return longest_s, float(between_s)


def tour_of(places):
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


def length_of(places):
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


def closed_queue_s(drones, pads, between_s):
    """Return the mean wait in M/M/c//N."""
    shares = [1.0]
    for there in range(drones):
        rate = (drones - there) / between_s * CHARGING_S / min(there + 1, pads)
        shares.append(shares[-1] * rate)
    law = np.array(shares) / sum(shares)
    there = np.arange(drones + 1)
    return float(law @ np.maximum(there - pads, 0) / (law @ (drones - there)) * between_s)


def one_pad_s(drones, between_s):
    """Return the mean wait in M/D/1//N, of which Takács has the law."""
    rate, product, total = 1 / between_s, 1.0, 0.0
    for n in range(drones):
        total += math.comb(drones - 1, n) * product
        product *= math.exp((n + 1) * rate * CHARGING_S) - 1
    idle = 1 / (1 + drones * rate * CHARGING_S * total)
    return drones * CHARGING_S / (1 - idle) - between_s - CHARGING_S


@dataclass
class Patrols:
    """Lets each drone charge after a random time in the air; ``between_s`` is its mean."""

    between_s: float
    law: str
    seed: int = 0
    ceiling: bool = True
    left: dict[int, int] = field(default_factory=dict)

    def begin(self, world, streams, carried=False):
        """Note the actions, and let drones start at any time of a patrol."""
        self._hover, self._charge = map(world.actions.index, (Action.HOVER, Action.CHARGE))
        self._step_s, self._draws = world.scenario.episode.step_s, random.Random(self.seed)
        for drone in range(world.scenario.drone_count):
            self.left[drone] = int(self._steps() * self._draws.random())

    def _steps(self):
        """Draw a number of steps, whose mean is exact."""
        if self.law == "exponential":
            lasts_s = self._draws.expovariate(1 / self.between_s)
        else:
            lasts_s = self.between_s * self._draws.uniform(0.85, 1.15)
        return math.floor(lasts_s / self._step_s + self._draws.random())

    def act(self, observation, mask):
        """Hover or charge."""
        drone = observation.drone
        if sum(mask) == 1:
            return mask.index(True)
        if self.left[drone] > 0 or not mask[self._charge]:
            self.left[drone] -= 1
            return self._hover
        self.left[drone] = self._steps()
        return self._charge


def simulated_s(drones, pads, between_s, law, seed=0):
    """Return the mean wait for a pad in a run."""
    asked = {"drones.count": drones, "stations.pads": pads, "drones.start_cells": [[0, 0]] * drones}
    policy = Patrols(between_s, law, seed)
    flown = du.run(SCENARIO, asked, policy=policy, engine="batch", progress=False).episodes
    return float(flown["queueing_s"].sum() / flown["charges"].sum())


# ---- the tables

WAYS = ("M/M/c//N", "exponential flights, fixed charging", "nearly fixed flights and charging")


def main(picture=None):
    """Print both tables, and draw the picture."""
    waits_s = {(pads, drones): waits(pads, drones) for pads in PADS for drones in FLEETS}
    peaks_min = {key: (own + tours_s(key[1]) + CHARGING_S) / 60 for key, own in waits_s.items()}
    best = {
        pads: [
            min(FLEETS, key=lambda drones, way=way: peaks_min[pads, drones][way])
            for way in (0, 1, 2)
        ]
        for pads in PADS
    }
    print("Best number of drones, and its peak age in minutes:\n")
    print(row(["pads", "the study", *WAYS, "no wait by rota up to"]))
    print(row(["---:"] * 6))
    for pads, own in best.items():
        cells = [f"{n} ({peaks_min[pads, n][way]:.2f})" for way, n in enumerate(own)]
        rota = max(n for n in FLEETS if n <= pads * (1 + between_s(n) / CHARGING_S))
        print(row([pads, PRINTED.get(pads, "-"), *cells, rota]))
    print("\nMean wait for a pad with the best number by the formula, in s:\n")
    print(row(["pads", "drones", *WAYS]))
    print(row(["---:"] * 5))
    for pads, (drones, *_) in best.items():
        print(row([pads, drones, *(f"{wait_s:.0f}" for wait_s in waits_s[pads, drones])]))
    if picture:
        write_whole(Path(picture), drawn(peaks_min, Path(picture).suffix))


def waits(pads, drones):
    """Return the mean wait of each way to find it, in s."""
    formula_s = np.mean([closed_queue_s(drones, pads, field_of(f, drones)[1]) for f in FIELDS])
    if drones <= pads:
        return np.zeros(3)
    flown_s = [simulated_s(drones, pads, between_s(drones), law) for law in LAWS]
    return np.array([formula_s, *flown_s])


def tours_s(drones):
    """Return the mean over the fields of the longest tour with its way."""
    return float(np.mean([field_of(seed, drones)[0] for seed in FIELDS]))


def between_s(drones):
    """Return the mean time between charges over the fields."""
    return float(np.mean([field_of(seed, drones)[1] for seed in FIELDS]))


def drawn(peaks_min, suffix):
    """Return the picture as the content of a file."""
    from matplotlib.figure import Figure

    from desim_uav.report.figures.style import styled, to_bytes

    @styled
    def draw():
        figure = Figure(figsize=(9, 5), layout="constrained")
        for axes, pads in zip(
            figure.subplots(2, 3, sharex=True, sharey=True).flat, PADS, strict=True
        ):
            for way, name in enumerate(WAYS):
                axes.plot(FLEETS, [peaks_min[pads, n][way] for n in FLEETS], label=name)
            axes.set(title=f"{pads} pads", ylim=(15, 60))
        figure.supxlabel("drones")
        figure.supylabel("peak age, min")
        axes.legend()
        return to_bytes(figure, suffix)

    return draw()


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:2]))
