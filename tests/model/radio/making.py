"""The package's view of drones and users: their legs, walks and tracks."""

import numpy as np

from desim_uav.model.geometry.coverage import WalkLeg
from desim_uav.model.motion.motion import REST, BangCoastBang
from desim_uav.model.radio.tracks import Flight, TrackRow, fly, walk
from desim_uav.rowcode.views import records, zeros
from tests.model import sampler
from tests.model.radio.looking import Trip

START_US = 1_740_000_001


class Leg:
    """A drone's leg for the package and, as a ``Trip``, for the sampler."""

    def __init__(self, start, stop, transit, flight, before_s=0.0):
        self.route = (*map(float, start), *map(float, stop))
        self.profile, self.before_us = transit.rows, round(before_s * 1e6)
        flown = flight and _Later(flight, self.before_us * 1e-6)
        self.trip = Trip(np.array(start, float), np.array(stop, float), flown)


class _Later:
    """A flight of which the span sees only what comes after its first seconds."""

    def __init__(self, flight, before_s):
        self.flight, self.before_s, self.distance = flight, before_s, flight.distance

    def flown(self, t):
        return self.flight.flown(np.asarray(t) + self.before_s)


def hovering(place):
    """A drone that stays where it is."""
    return Leg(place, place, REST, None)


def flying(rng, start, stop, span_s):
    """A drone that flies in minimum time or fills a span, and may have begun before it."""
    start, stop = np.array(start, float), np.array(stop, float)
    distance = float(np.sqrt(((stop - start) ** 2).sum()))
    while True:
        v, a = rng.uniform(2.0, 20.0), 10 ** rng.uniform(-1.2, 0.6)
        before = rng.uniform(0.0, 20.0) if rng.random() < 0.3 else 0.0
        if rng.random() < 0.6:
            transit = BangCoastBang(v, a, "minimum_time").fastest_transit(distance)
            return Leg(start, stop, transit, sampler.Flight.minimum_time(distance, v, a), before)
        if a * span_s**2 / 4.0 > 1.01 * distance:
            transit = BangCoastBang(1e3, a, "fill_epoch").epoch_transit(distance, span_s)
            return Leg(start, stop, transit, sampler.Flight.filling(distance, a, span_s))


def walks(walk_, start_us=START_US):
    """A walk of the sampler as rows of the package."""
    return records(
        WalkLeg,
        [
            (start_us + round(t * 1e6), *point, *velocity)
            for t, point, velocity in zip(walk_.times, walk_.points, walk_.velocities, strict=True)
        ],
    )


def flight_of(leg, start_us=START_US):
    """A leg as a flight of the package."""
    return Flight(leg.profile, leg.route, start_us - leg.before_us)


def absolute(legs, walk_, height_m, span_us):
    """(table of tracks, rows of the drones, rows of the user)."""
    tracks, drones, row = zeros(TrackRow, 120), [], 0
    for leg in legs:
        after = fly(flight_of(leg, span_us[0]), span_us, tracks, row)
        drones.append((row, after))
        row = after
    own = walks(walk_, span_us[0])
    after = walk(own, (0, len(own)), height_m, span_us, tracks, row)
    assert after < len(tracks)
    return tracks, drones, (row, after)


def rows_of(out, count):
    """The rows a kernel has written, as numbers."""
    assert count <= len(out)
    return out[:count].tolist()
