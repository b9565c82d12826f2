"""The package's view of a scene: its tracks, its links, and its kernels for one path loss."""

import numpy as np

from desim_uav.model.kernels import kernel, rule
from desim_uav.model.motion import REST, BangCoastBang
from desim_uav.model.radio.sinr import Links, advance
from desim_uav.model.radio.slopes import DEGREES, logistic_slope
from desim_uav.model.radio.tracks import TRACK_COLUMNS, Flight, fly, relative, walk
from desim_uav.model.radio.vertical import climb
from tests.model import sampler
from tests.model.radio.looking import Trip

START_US = 1_740_000_001
POWER, AT_1M, EXPONENT, FALL, A, B = range(6)


@rule
def level(own, k, distance_m, height_m):
    slant = np.sqrt(distance_m * distance_m + height_m * height_m)
    elevation = np.arctan2(height_m, distance_m) * DEGREES
    sees = 1.0 / (1.0 + own[k, A] * np.exp(-own[k, B] * (elevation - own[k, A])))
    loss = own[k, AT_1M] + 10.0 * own[k, EXPONENT] * np.log10(slant) + own[k, FALL] * (1.0 - sees)
    return own[k, POWER] - loss


@rule
def slope(own, k, distance_m, height_m, within_m):
    return logistic_slope(
        own[k, EXPONENT], own[k, FALL], own[k, A], own[k, B], distance_m, height_m, within_m
    )


sinr_changes = kernel(advance(level, slope))
climb_changes = kernel(climb(level))


class Leg:
    """A drone's leg for the package and, as a ``Trip``, for the sampler."""

    def __init__(self, start, stop, transit, flight, before_s=0.0):
        self.route = (*map(float, start), *map(float, stop))
        self.profile, self.before_us = transit.profile, round(before_s * 1e6)
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
    return np.array(
        [
            (start_us + round(t * 1e6), *point, *velocity)
            for t, point, velocity in zip(walk_.times, walk_.points, walk_.velocities, strict=True)
        ]
    )


def absolute(legs, walk_, height_m, span_us):
    """(table of tracks, rows of the drones, rows of the user)."""
    tracks, drones, row = np.zeros((120, TRACK_COLUMNS)), [], 0
    for leg in legs:
        flight = Flight(leg.profile, leg.route, span_us[0] - leg.before_us)
        after = fly(flight, span_us, tracks, row)
        drones.append((row, after))
        row = after
    own = walks(walk_, span_us[0])
    after = walk(own, (0, len(own)), height_m, span_us, tracks, row)
    assert after < len(tracks)
    return tracks, drones, (row, after)


def links_of(legs, walk_, height_m, losses, noise_dbm, span_us):
    """The links of a user."""
    tracks, drones, user = absolute(legs, walk_, height_m, span_us)
    out, offsets = np.zeros((200, TRACK_COLUMNS)), [0]
    for drone in drones:
        offsets.append(relative(tracks, drone, user, out, offsets[-1]))
    assert offsets[-1] < len(out)
    own = np.array(
        [(one.power_dbm, one.at_1m_db, one.exponent, one.fall_db, one.a, one.b) for one in losses]
    )
    return Links(own, out, np.array(offsets), noise_dbm)


def rows_of(out, count):
    """The rows a kernel has written, as numbers."""
    assert count <= len(out)
    return [(int(t), int(state)) for t, state in out[:count]]
