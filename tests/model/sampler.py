"""Crossings found by looking: an independent sampler of |drone(t) - user(t)| - R.

It shares no code with the package: its own closed forms of the flight and the walk, a coarse grid,
and 0.1 ms on both sides of every change of sign and of every near miss.
"""

from dataclasses import dataclass

import numpy as np

COARSE_S = 0.05
FINE_S = 1e-4
FINEST_S = 1e-7


@dataclass(frozen=True)
class Flight:
    """Rest to rest along one axis: ``ramp_s`` up, a cruise at ``speed``, ``ramp_s`` down."""

    distance: float
    speed: float
    ramp_s: float
    total_s: float

    @classmethod
    def minimum_time(cls, distance, v, a):
        if distance < v * v / a:
            ramp = np.sqrt(distance / a)
            return cls(distance, a * ramp, ramp, 2 * ramp)
        return cls(distance, v, v / a, distance / v + v / a)

    @classmethod
    def filling(cls, distance, a, total_s):
        speed = 0.5 * (a * total_s - np.sqrt((a * total_s) ** 2 - 4 * a * distance))
        return cls(distance, speed, speed / a, total_s)

    def flown(self, t):
        """Metres flown at the times ``t``."""
        t = np.clip(t, 0.0, self.total_s)
        a = self.speed / self.ramp_s
        left = self.total_s - t
        cruising = self.speed * (t - 0.5 * self.ramp_s)
        return np.where(
            t < self.ramp_s,
            0.5 * a * t**2,
            np.where(left < self.ramp_s, self.distance - 0.5 * a * left**2, cruising),
        )

    def velocity(self, t):
        """The speed at one time."""
        a = self.speed / self.ramp_s
        if not 0.0 < t < self.total_s:
            return 0.0
        return min(a * t, self.speed, a * (self.total_s - t))

    def accelerates(self, t):
        """Does the speed change at the time ``t``?"""
        return t < self.ramp_s or self.total_s - self.ramp_s < t < self.total_s


@dataclass(frozen=True)
class Walk:
    """Straight legs: ``times[k]`` is when leg k begins, at ``points[k]``, at ``velocities[k]``."""

    times: np.ndarray
    points: np.ndarray
    velocities: np.ndarray

    def at(self, t):
        """Positions at the times ``t``, shape (times, 2)."""
        leg = np.maximum(np.searchsorted(self.times, t, side="right") - 1, 0)
        return self.points[leg] + self.velocities[leg] * (t - self.times[leg])[:, None]


@dataclass(frozen=True)
class Pair:
    """A drone's leg and one user, on one clock that starts with the leg."""

    origin: np.ndarray
    heading: np.ndarray
    flight: Flight
    span_s: float
    walk: Walk
    radius: float

    def gap(self, t):
        """How far outside the footprint the user is (inside: below 0) at the times ``t``."""
        t = np.atleast_1d(np.asarray(t, float))
        drone = self.origin + self.heading * self.flight.flown(t)[:, None]
        return np.hypot(*(drone - self.walk.at(t)).T) - self.radius


@dataclass(frozen=True)
class Seen:
    """(time, enters) of each crossing; ``nearest_miss_m``: of a turning point that crosses not."""

    crossings: list
    nearest_miss_m: float


def look(pair):
    """All crossings of a pair in order of time."""
    times = _grid(0.0, pair.span_s, COARSE_S)
    gaps = pair.gap(times)
    # Cells to look at closely: those that change sign, those around a near miss, and the next.
    worth = _changes(gaps)
    for point in _near_misses(gaps):
        worth[max(point - 1, 0) : point + 1] = True
    worth[:-1] |= worth[1:].copy()
    worth[1:] |= worth[:-1].copy()
    edges = np.flatnonzero(np.diff(worth, prepend=False, append=False))
    found, misses = [], [np.inf]
    for first, last in edges.reshape(-1, 2):
        crossed, missed = _closely(pair, times[first], times[last])
        found += crossed
        misses += missed
    return Seen(found, min(misses))


def _grid(start, stop, step):
    return np.linspace(start, stop, max(2, int(np.ceil((stop - start) / step)) + 1))


def _changes(gaps):
    return (gaps[1:] > 0.0) != (gaps[:-1] > 0.0)


def _near_misses(gaps):
    """The points nearer to the circle than their neighbours (both ends may be such points)."""
    size = np.concatenate([[np.inf], np.abs(gaps), [np.inf]])
    return np.flatnonzero((size[1:-1] < size[:-2]) & (size[1:-1] <= size[2:]))


def _closely(pair, start, stop):
    """(crossings, near misses in metres) on the fine grid, and on the finest where it turns."""
    times = _grid(start, stop, FINE_S)
    gaps = pair.gap(times)
    changes = _changes(gaps)
    found = [_bisected(pair, times[k], times[k + 1]) for k in np.flatnonzero(changes)]
    misses = []
    for k in _near_misses(gaps):
        low, high = max(k - 1, 0), min(k + 1, len(times) - 1)
        if changes[low:high].any():
            continue
        finest = _grid(times[low], times[high], FINEST_S)
        closest = pair.gap(finest)
        turns = np.flatnonzero(_changes(closest))
        found += [_bisected(pair, finest[j], finest[j + 1]) for j in turns]
        misses.append(np.inf if len(turns) else np.abs(closest).min())
    return sorted(found), misses


def _bisected(pair, low, high):
    outside = pair.gap(low)[0] > 0.0
    for _ in range(34):
        middle = 0.5 * (low + high)
        if (pair.gap(middle)[0] > 0.0) == outside:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high), bool(outside)
