"""Footprint crossings against known times and an independent sampler."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from desim_uav.model.geometry.coverage import SEEN_ROWS, DroneLeg, Users, WalkLeg, look_around
from desim_uav.model.geometry.crossings import crossings
from desim_uav.model.geometry.relative import Change
from desim_uav.model.motion.motion import REST, BangCoastBang
from desim_uav.model.rules import US
from desim_uav.rowcode.views import records, zeros
from tests.model.sampler import Flight, Pair, Walk, look
from tests.verification.figure import Exact, Figure

R = 600.0
FILL = BangCoastBang(timing="fill_epoch").epoch_transit(240.0, 60.0)
FAST = BangCoastBang(timing="minimum_time").fastest_transit(240.0)


def find(transit, route, span_us, users, *, fresh=False, radius=R, climb=0.0, room=1000):
    """The crossings as (t_us, user, enters); ``users``: a list of legs (t0, x, y, vx, vy) each."""
    legs = records(WalkLeg, [leg for user in users for leg in user])
    offsets = np.cumsum([0, *map(len, users)])
    out = zeros(Change, room)
    walking = Users(legs, offsets, np.zeros((SEEN_ROWS, len(users))))
    look_around(walking, *span_us)
    leg = DroneLeg(transit.rows, tuple(map(float, route)), span_us, radius, fresh, climb)
    count = crossings(leg, walking, out)
    return [(int(t), int(u), bool(e)) for t, u, e in out[:count]]


def hover(span_us, users, **options):
    return find(REST, (0, 0, 0, 0), span_us, users, **options)


def fly(transit, users, span_us=None, **options):
    """A 240 m transit along +x from the origin."""
    return find(transit, (0, 0, 240, 0), span_us or (0, transit.duration_us), users, **options)


def at(x, y, vx=0.0, vy=0.0, t0=0):
    return [(t0, x, y, vx, vy)]


# ---- stated times


def figures(quick: bool = False) -> Iterator[Figure]:
    """A user that walks, a drone that flies away; and pairs at random."""
    yield from stated()
    yield from survey(60 if quick else 400).figures()


def stated() -> Iterator[Figure]:
    """Times worked by hand, and a tangent."""
    (into, _, _), (out, _, _) = hover((0, 2000 * US), [at(-1000, 300, 1.5)])
    yield Exact("a user walks past: entry, s", into / US, 320.256505, 1e-6)
    yield Exact("a user walks past: exit, s", out / US, 1013.076828, 1e-6)
    for transit, name, x, seconds in (
        (FAST, "minimum time", 3.0, 1.22474487),
        (FAST, "minimum time", 100.0, 13.0856928),
        (FAST, "minimum time", 235.0, 29.4095238),
        (FILL, "60 s", 100.0, 25.0847706),
    ):
        ((left, _, _),) = fly(transit, [at(x - R, 0)])
        yield Exact(f"a drone ({name}) leaves at x = {x:g} m, s", left / US, seconds, 1e-6)
    tangents = [fly(t, [at(x, y)]) for t in (FAST, FILL) for x in (1, 120, 238) for y in (R, -R)]
    covered = max(sum(-t if enters else t for t, _, enters in rows) for rows in tangents)
    yield Exact("a tangent: time covered, µs", covered, 0, cases=len(tangents))
    unpaired = sum([e for *_, e in rows] not in ([], [True, False]) for rows in tangents)
    yield Exact("a tangent: entries without an exit", unpaired, 0, cases=len(tangents))


# ---- at random

USERS = 3


def random_flight(rng):
    """(the package's transit, the sampler's flight, length of the leg in us)."""
    while True:
        usual = rng.random() < 0.4
        v = 8.3 if usual else rng.uniform(2.0, 15.0)
        a = 4.0 if usual else 10 ** rng.uniform(-1.2, 0.6)
        distance = 240.0 if rng.random() < 0.4 else rng.uniform(5.0, 400.0)
        if rng.random() < 0.5:
            transit = BangCoastBang(v, a, "minimum_time").fastest_transit(distance)
            flight = Flight.minimum_time(distance, v, a)
        elif a * 60.0**2 / 4.0 > 1.01 * distance:
            transit = BangCoastBang(1e3, a, "fill_epoch").epoch_transit(distance, 60.0)
            flight = Flight.filling(distance, a, 60.0)
        else:
            continue
        hovers_on = rng.choice([0, 20 * US])
        return transit, flight, transit.duration_us + int(hovers_on)


def anchor_time(rng, flight):
    """A time in the flight; a good part of them while the drone accelerates."""
    if rng.random() < 0.6:
        ramp = rng.uniform(0.0, flight.ramp_s)
        return rng.choice([ramp, flight.total_s - ramp])
    return rng.uniform(0.0, flight.total_s)


def random_walk_through(rng, drone_at, drone_velocity, anchor_s, span_s, radius):
    """A walk of 1-4 legs on the circle at the anchor, some of them as a tangent there."""
    count = rng.integers(1, 5)
    starts = np.sort(rng.uniform(0.0, span_s, count - 1))
    times = np.concatenate([[-rng.uniform(0.0, 60.0)], starts]).round(6)
    moving = rng.random() < 0.7
    speeds = rng.uniform(0.1, 12.0, count) * moving
    headings = rng.uniform(0.0, 2 * np.pi, count)
    velocities = speeds[:, None] * np.column_stack([np.cos(headings), np.sin(headings)])
    leg = max(np.searchsorted(times, anchor_s, side="right") - 1, 0)
    bearing, distance = rng.uniform(0.0, 2 * np.pi), radius
    if rng.random() < 0.3:
        relative = drone_velocity - velocities[leg]
        bearing = np.arctan2(relative[1], relative[0]) + np.pi / 2
        distance *= 1.0 + rng.choice([-1, 1]) * 10 ** rng.uniform(-8, -3)
    anchor = drone_at + distance * np.array([np.cos(bearing), np.sin(bearing)])
    points = np.empty((count, 2))
    points[leg] = anchor - velocities[leg] * (anchor_s - times[leg])
    for k in range(leg + 1, count):
        points[k] = points[k - 1] + velocities[k - 1] * (times[k] - times[k - 1])
    for k in range(leg - 1, -1, -1):
        points[k] = points[k + 1] - velocities[k] * (times[k + 1] - times[k])
    return Walk(times, points, velocities)


def is_clear(seen, span_s):
    """Does rounding leave no doubt: no pair in one microsecond, none at an end of the leg?"""
    times = np.array([t for t, _ in seen.crossings])
    apart = np.diff(times).min(initial=1.0) > 2e-6
    inner = times.min(initial=1.0) > 2e-6 and times.max(initial=0.0) < span_s - 2e-6
    return apart and inner and seen.nearest_miss_m > 1e-9


@dataclass
class Survey:
    """What was found of random pairs of a drone's leg and a user, and by whom.

    ``by_roots`` counts pairs by their crossings. Pairs that rounding leaves in doubt (two crossings
    within a microsecond, one at an end of the leg, a graze by a nanometre) are ``unclear``, and
    compared no further.
    """

    pairs: int = 0
    unclear: int = 0
    unlike: list[object] = field(default_factory=list)
    sampled: int = 0
    worst_us: float = 0.0
    accelerating: int = 0
    coasting: int = 0
    resting: int = 0
    standing: int = 0
    by_roots: np.ndarray = field(default_factory=lambda: np.zeros(10, int))

    def add(
        self,
        pair: Pair,
        flight: Flight,
        own: list[tuple[float, bool]],
        sampled: list[tuple[float, bool]],
    ) -> None:
        """The crossings of one pair as the simulator and as the sampler have them."""
        if [enters for _, enters in own] == [enters for _, enters in sampled]:
            for (t, _), (expected, _) in zip(own, sampled, strict=True):
                self.worst_us = max(self.worst_us, abs(t - expected) * 1e6)
        else:
            self.unlike.append((pair, own, sampled))
        self.sampled += len(sampled)
        for t, _ in own:
            self.accelerating += flight.accelerates(t)
            self.resting += t > flight.total_s
            self.coasting += not flight.accelerates(t) and t <= flight.total_s
        self.by_roots[len(own)] += 1
        self.standing += not pair.walk.velocities.any()

    def figures(self) -> Iterator[Figure]:
        """No miss, no extra, and the same times."""
        pairs = int(self.by_roots.sum())
        found = self.accelerating + self.coasting + self.resting
        yield Exact("random pairs: crossings found by both", found, self.sampled, cases=pairs)
        yield Exact(
            "random pairs: pairs with different crossings", len(self.unlike), 0, cases=pairs
        )
        worst = "random pairs: largest time difference, µs"
        yield Exact(worst, self.worst_us, 0.0, 1.5, cases=found)


def random_heading(rng, oblique):
    """What a metre of flight is along x, y and z: along an axis of the map, or any way."""
    if not oblique:
        return np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)][rng.integers(4)])
    heading, steep = rng.uniform(0.0, 2 * np.pi), rng.choice([0.0, rng.uniform(-1.5, 1.5)])
    return np.array(
        [np.cos(heading) * np.cos(steep), np.sin(heading) * np.cos(steep), np.sin(steep)]
    )


def survey(drones: int = 400, oblique: bool = False) -> Survey:
    """Random legs, accelerating and coasting, past users that walk and stand."""
    rng = np.random.default_rng(20_240)
    result = Survey(pairs=drones * USERS)
    for _ in range(drones):
        transit, flight, span_us = random_flight(rng)
        radius = R if rng.random() < 0.6 else rng.uniform(20.0, 600.0)
        *heading, climbs = random_heading(rng, oblique)
        heading = np.array(heading)
        origin = rng.uniform(0.0, 2400.0, 2)
        start_us = int(rng.integers(0, 1800 * US))
        pairs = []
        for _ in range(USERS):
            anchor_s = anchor_time(rng, flight)
            drone_at = origin + heading * flight.flown(anchor_s)
            velocity = heading * flight.velocity(anchor_s)
            walk = random_walk_through(rng, drone_at, velocity, anchor_s, span_us * 1e-6, radius)
            pairs.append(Pair(origin, heading, flight, span_us * 1e-6, walk, radius))
        rows = find(
            transit,
            (*origin, *(origin + heading * flight.distance)),
            (start_us, start_us + span_us),
            [
                [
                    (start_us + round(t * 1e6), *point, *velocity)
                    for t, point, velocity in zip(
                        pair.walk.times, pair.walk.points, pair.walk.velocities, strict=True
                    )
                ]
                for pair in pairs
            ],
            radius=radius,
            climb=climbs * flight.distance,
        )
        for user, pair in enumerate(pairs):
            seen = look(pair)
            if is_clear(seen, pair.span_s):
                own = [((t - start_us) * 1e-6, enters) for t, u, enters in rows if u == user]
                result.add(pair, flight, own, seen.crossings)
            else:
                result.unclear += 1
    return result
