"""Links as seen by looking: motion, levels and states that share no code with the package.

A claim is a list of rows (microsecond, state). It is held against the truth at the points of a
grid, at finer points where the truth comes near to a threshold, and a microsecond before and after
each row.
"""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from tests.model.sampler import Flight, Walk

COARSE_S = 0.05


@dataclass(frozen=True)
class Trip:
    """A drone's straight flight in 3-D from one place to another, and a hover there."""

    start: np.ndarray
    stop: np.ndarray
    flight: Flight

    def at(self, t):
        """Places at the times ``t``, shape (times, 3)."""
        if self.flight is None:
            return np.broadcast_to(self.start, (len(t), 3))
        ahead = (self.stop - self.start) / self.flight.distance
        return self.start + ahead * self.flight.flown(t)[:, None]


@dataclass(frozen=True)
class Loss:
    """Al-Hourani's mean level over any exponent; ``fall_db`` 0 is a log-distance loss."""

    power_dbm: float
    at_1m_db: float
    exponent: float
    fall_db: float
    a: float
    b: float

    def level(self, apart):
        """The level in dBm where the drone is ``apart`` (..., 3) from the user."""
        ground = np.hypot(apart[..., 0], apart[..., 1])
        slant = np.hypot(ground, apart[..., 2])
        blocked = 1.0 - self.sees(np.degrees(np.arctan2(apart[..., 2], ground)))
        loss = self.at_1m_db + 10.0 * self.exponent * np.log10(slant) + self.fall_db * blocked
        return self.power_dbm - loss

    def sees(self, elevation):
        """The probability of line of sight."""
        return 1.0 / (1.0 + self.a * np.exp(-self.b * (elevation - self.a)))


@dataclass(frozen=True)
class Scene:
    """One user and some drones, each with its loss, on one clock; drone 0 serves."""

    walk: Walk
    height_m: float
    trips: list
    losses: list
    noise_dbm: float
    span_s: float

    def apart(self, k, t):
        """From the user to drone k at the times ``t``: (times, 3)."""
        user = np.column_stack([self.walk.at(t), np.full(len(t), self.height_m)])
        return self.trips[k].at(t) - user

    def ratio_db(self, t):
        """Signal over noise and interference at the times ``t``."""
        t = np.atleast_1d(np.asarray(t, float))
        levels = [loss.level(self.apart(k, t)) for k, loss in enumerate(self.losses)]
        noise = np.zeros(len(t)) if self.noise_dbm == -np.inf else 10 ** (self.noise_dbm / 10)
        noise = noise + sum(10 ** (one / 10) for one in levels[1:])
        return levels[0] - 10 * np.log10(noise)


def moving(rng, span_s, count, speed=12.0, still=0.2):
    """A walk of up to ``count`` legs that begins some time before the span, near the origin."""
    count = rng.integers(1, count + 1)
    starts = np.sort(rng.uniform(0.0, span_s, count - 1))
    times = np.concatenate([[-rng.uniform(0.0, 60.0)], starts]).round(6)
    speeds = rng.uniform(0.1, speed, count) * (rng.random() >= still)
    headings = rng.uniform(0.0, 2 * np.pi, count)
    velocities = speeds[:, None] * np.column_stack([np.cos(headings), np.sin(headings)])
    points = np.empty((count, 2))
    points[0] = rng.uniform(-300.0, 300.0, 2) + velocities[0] * times[0]
    for k in range(1, count):
        points[k] = points[k - 1] + velocities[k - 1] * (times[k] - times[k - 1])
    return Walk(times, points, velocities)


@dataclass
class Seen:
    """What was held against the truth, and what of it was wrong."""

    legs: int = 0
    rows: int = 0
    unclear: int = 0
    wrong: list = field(default_factory=list)
    by_rows: dict = field(default_factory=dict)

    def add(self, rows, wrong, unclear, what):
        """The rows of one leg, the points at which they are wrong, and the rows in doubt."""
        self.legs += 1
        self.rows += len(rows)
        self.unclear += unclear
        self.by_rows[len(rows)] = self.by_rows.get(len(rows), 0) + 1
        if len(wrong):
            self.wrong.append((what, rows, wrong))


def grid(span_s):
    """Points all over a span, and its ends."""
    return np.linspace(0.0, span_s, max(2, int(np.ceil(span_s / COARSE_S)) + 1))


def finer(t, distance):
    """More points where the distance from a threshold is less than before and after, and least."""
    low = np.flatnonzero((distance[1:-1] < distance[:-2]) & (distance[1:-1] <= distance[2:])) + 1
    nearest = low[np.argsort(distance[low])[:30]]
    cells = [np.linspace(t[k - 1], t[k + 1], 81) for k in nearest]
    return np.unique(np.concatenate([np.empty(0), *cells]))


def claimed(rows, start_us, t):
    """The claimed states at the times ``t``; the first row is at the start of the span."""
    times = np.array([t_us for t_us, _ in rows]) - start_us
    return np.array([state for _, state in rows])[np.searchsorted(times, t * 1e6, side="right") - 1]


def hold_classes(value, thresholds, rows, span_us, blind_db):
    """(times at which claimed classes are wrong, rows in doubt).

    A class is wrong if its value is more than ``blind_db`` beyond its thresholds; a row, if the
    value does not pass the threshold within a microsecond.
    """
    start_us, end_us = span_us
    span_s = (end_us - start_us) * 1e-6
    bounds = np.concatenate([[-np.inf], thresholds, [np.inf]])
    t = grid(span_s)
    for _ in range(3):
        distance = np.abs(value(t)[:, None] - thresholds[None, :]).min(axis=1)
        t = np.unique(np.concatenate([t, finer(t, distance)]))
    near = np.array([(t_us - start_us) * 1e-6 for t_us, _ in rows])
    t = t[np.abs(t[:, None] - near[None, :]).min(axis=1) > 1e-6]
    own, true = claimed(rows, start_us, t), value(t)
    bad = (true < bounds[own] - blind_db) | (true > bounds[own + 1] + blind_db)
    wrong, unclear = list(t[bad]), 0
    for (_, before), (t_us, after) in pairwise(rows):
        at = (t_us - start_us) * 1e-6
        crossed = thresholds[min(before, after) : max(before, after)]
        low, high = value([max(at - 1e-6, 0.0), min(at + 1e-6, span_s)])
        far = np.minimum(np.abs(low - crossed), np.abs(high - crossed)).min(initial=np.inf)
        passes = ((low < crossed) & (high > crossed)) | ((low > crossed) & (high < crossed))
        if far < 1e-10 or t_us in (start_us, end_us):
            unclear += 1
        elif not passes.all() or (high > low) != (after > before):
            wrong.append(at)
    return wrong, unclear
