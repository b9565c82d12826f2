"""Drones and users for the kernels of the air, and the truth about them by own formulas."""

from dataclasses import dataclass, field
from functools import cache
from itertools import chain

import numpy as np

from desim_uav.model.radio.air import class_changes_in_air, pair_changes
from desim_uav.model.radio.functions import log10, slant_range_m
from desim_uav.model.radio.levels import compiled_loss
from desim_uav.model.radio.path_loss import AlHourani, FreeSpace, LogDistance, RowPathLoss
from desim_uav.model.radio.scene import Air, memory
from tests.model.radio.looking import Loss, moving
from tests.model.radio.making import START_US, flying, hovering, walks
from tests.model.sampler import Walk

FREE_AT_1M_DB = 20.0 * np.log10(4e9 * np.pi * 2.0 / 299_792_458.0)
USER_M = 1.5


@dataclass(frozen=True)
class Radio:
    """A path loss of the package at 2 GHz, and the sampler's formula for it."""

    path_loss: object
    truth: Loss

    def level(self, apart, branch):
        """The level of 1 mW in dBm, with a branch for each place."""
        open_, mean = self.truth, self.truth.level(apart)
        los = mean + open_.fall_db * (1.0 - open_.sees(_elevation(apart)))
        return np.choose(branch, [mean, los, los - open_.fall_db])


def _elevation(apart):
    return np.degrees(np.arctan2(apart[..., 2], np.hypot(apart[..., 0], apart[..., 1])))


def town(a, b, los, nlos):
    """Al-Hourani's mean loss."""
    truth = Loss(0.0, FREE_AT_1M_DB + los, 2.0, nlos - los, a, b)
    return Radio(AlHourani(a=a, b=b, eta_los_db=los, eta_nlos_db=nlos), truth)


def plain(exponent, at_1m_db):
    """A loss over the logarithm of the distance."""
    truth = Loss(0.0, at_1m_db, exponent, 0.0, 1.0, 1.0)
    return Radio(LogDistance(exponent, at_1m_db), truth)


FREE = Radio(FreeSpace(), Loss(0.0, FREE_AT_1M_DB, 2.0, 0.0, 1.0, 1.0))
RADIOS = [
    town(4.88, 0.43, 0.1, 21.0),
    town(9.61, 0.16, 1.0, 20.0),
    town(12.08, 0.11, 1.6, 23.0),
    town(27.23, 0.08, 2.3, 34.0),
    plain(3.3, 36.0),
    FREE,
]


@dataclass(frozen=True)
class Sky:
    """Drones on their legs and users on their walks; a mark is (seconds, branch, extra dB)."""

    legs: list
    radios: list
    powers_dbm: list
    bands: list
    serves: list
    walks: list
    noise_dbm: float
    thresholds: np.ndarray
    span_s: float
    marks: dict = field(default_factory=dict)

    @property
    def span_us(self):
        """The start and the end of the span."""
        return START_US, START_US + round(self.span_s * 1e6)

    def level(self, i, user, t):
        """The level of a drone at a user, in dBm."""
        walk = self.walks[user]
        apart = self.legs[i].trip.at(t) - np.column_stack([walk.at(t), np.full(len(t), USER_M)])
        marks = np.array(self.marks.get((i, user), [(0.0, 0, 0.0)]))
        own = marks[np.maximum(np.searchsorted(marks[:, 0], t, side="right") - 1, 0)]
        return self.powers_dbm[i] + self.radios[i].level(apart, own[:, 1].astype(int)) - own[:, 2]

    def ratio_db(self, i, user, t):
        """Signal over noise and interference."""
        t = np.atleast_1d(np.asarray(t, float))
        total = np.full(len(t), 10 ** (self.noise_dbm / 10))
        for k in range(len(self.legs)):
            if k != i and self.serves[k] and self.bands[k] == self.bands[i]:
                total += 10 ** (self.level(k, user, t) / 10)
        return self.level(i, user, t) - 10 * np.log10(total)

    def gain_db(self, one, other, user, t):
        """What one level exceeds another one by."""
        t = np.atleast_1d(np.asarray(t, float))
        return self.level(one, user, t) - self.level(other, user, t)

    def air(self):
        """The same for the package."""
        count, users = len(self.legs), len(self.walks)
        losses = [kept_loss(radio.path_loss) for radio in self.radios]
        legs = [walks(walk, START_US) for walk in self.walks]
        marks = [self.marks.get((i, user), []) for i in range(count) for user in range(users)]
        places = [
            (*leg.route, power) for leg, power in zip(self.legs, self.powers_dbm, strict=True)
        ]
        return Air(
            places=np.array(places, float),
            senders=np.array(
                [
                    (
                        *(START_US - self.legs[i].before_us, i, self.serves[i], self.bands[i], i),
                        START_US,
                    )
                    for i in range(count)
                ]
            ),
            pieces=np.concatenate([leg.profile for leg in self.legs]),
            pieces_at=offsets(leg.profile for leg in self.legs),
            losses=np.array([loss[:3] for loss in losses]),
            radios=np.array([(2.0, self.noise_dbm)] * count),
            thresholds_db=np.tile(self.thresholds, count),
            thresholds_at=np.arange(count + 1) * len(self.thresholds),
            legs=np.concatenate(legs),
            legs_at=offsets(legs),
            heights_m=np.full(users, USER_M),
            marks=np.array([*chain(*marks)], float).reshape(-1, 3),
            marks_at=self._marks_at(marks) if self.marks else np.zeros(0, np.int64),
            **memory(count, 5),
        )

    def _marks_at(self, marks):
        """Where the marks of each user begin and end, drone by drone."""
        users, ends = len(self.walks), offsets(marks)
        return np.concatenate(
            [ends[i * users : (i + 1) * users + 1] for i in range(len(self.legs))]
        )


@cache
def kept_loss(path_loss):
    """A compiled path loss, which stays in memory."""
    return compiled_loss(path_loss)


def offsets(parts):
    """Where each part begins in a table of them all, and its end."""
    return np.cumsum([0, *map(len, parts)])


def random_sky(rng, drones, users, oblique=False):
    """Drones on oblique, level and vertical legs or at rest around users who walk.

    If ``oblique``, no drone is at rest or flies straight up.
    """
    span_s = round(rng.uniform(5.0, 70.0), 6)
    legs = []
    for _ in range(drones):
        start = np.array([*rng.uniform(-600.0, 600.0, 2), rng.uniform(25.0, 200.0)])
        stop = start + rng.uniform(-1.0, 1.0, 3) * (250.0, 250.0, 100.0)
        stop[2] = max(stop[2], 20.0)
        kind = rng.choice([0.1, 0.5]) if oblique else rng.random()
        if kind < 0.2:
            stop[2] = start[2]
        elif kind < 0.4:
            stop[:2] = start[:2]
        legs.append(hovering(start) if kind > 0.85 else flying(rng, start, stop, span_s))
    radio = RADIOS[rng.integers(len(RADIOS))]
    same = rng.random() < 0.7
    radios = [radio if same else RADIOS[rng.integers(len(RADIOS))] for _ in range(drones)]
    return Sky(
        legs,
        radios,
        list(rng.uniform(10.0, 33.0, drones)),
        list(rng.integers(0, 2, drones)) if rng.random() < 0.3 else [0] * drones,
        list((rng.random(drones) < 0.9).astype(int)),
        [moving(rng, span_s, 4) for _ in range(users)],
        rng.uniform(-110.0, -90.0),
        np.zeros(0),
        span_s,
        random_marks(rng, drones, users, span_s) if rng.random() < 0.4 else {},
    )


def random_marks(rng, drones, users, span_s):
    """Marks for most links, some of which change often."""
    marks = {}
    for i in range(drones):
        for user in range(users):
            if rng.random() < 0.8:
                times = np.sort(rng.uniform(0.0, span_s, rng.integers(0, 5))).round(6)
                marks[i, user] = [
                    (t, int(rng.integers(0, 3)), rng.normal() * 4.0) for t in (0.0, *times)
                ]
    return marks


def class_rows(sky, i, air=None, held=None, out=None):
    """The rows (time, class) of each user, the first one at the start of the span."""
    air = sky.air() if air is None else air
    users = len(sky.walks)
    out = np.zeros((2000, 3), np.int64) if out is None else out
    before = np.zeros(users, np.int64) if held is None else held
    count = class_changes_in_air(air, i, sky.span_us, before, held is None, out)
    assert 0 <= count <= len(out)
    rows = [[(START_US, int(before[user]))] for user in range(users)]
    for t_us, user, change in out[:count].tolist():
        own = rows[user]
        assert (change > own[-1][1]) if change > 0 else (-change < own[-1][1])
        if t_us == START_US:
            own.pop()
        own.append((t_us, abs(change)))
    assert out[:count, 1].tolist() == sorted(out[:count, 1])
    return rows


def pair_rows(sky, user, one, other, threshold_db, air=None, held=-1):
    """The rows (time, state) of a pair of drones."""
    out = np.zeros((100, 2), np.int64)
    air = sky.air() if air is None else air
    count = pair_changes(air, user, one, other, threshold_db, sky.span_us, held, out)
    assert 0 <= count <= len(out)
    return [(t_us, state) for t_us, state in out[:count].tolist()]


def sky_of(legs, walks, radio=FREE, thresholds=(0.0,), noise_dbm=-90.0, span_s=60.0, **options):
    """A sky of drones that all serve in one band."""
    count = len(legs)
    same = {"powers_dbm": [30.0] * count, "bands": [0] * count, "serves": [1] * count, **options}
    return Sky(
        legs,
        [radio] * count,
        walks=walks,
        noise_dbm=noise_dbm,
        thresholds=np.array(thresholds, float),
        span_s=span_s,
        **same,
    )


def stroll(x, y, vx=0.0, vy=0.0):
    return Walk(np.zeros(1), np.array([(x, y)], float), np.array([(vx, vy)], float))


@dataclass(frozen=True)
class TwoSlopes(RowPathLoss):
    """A loss that rises with the distance, and faster beyond a kink."""

    kink_m: float

    def los_db(self, distance_m, height_m, carrier_ghz):
        slant_m = slant_range_m(distance_m, height_m)
        return 40.0 + 20.0 * log10(slant_m) + max(15.0 * log10(slant_m / self.kink_m), 0.0)

    def slope(self, distance_m, height_m, within_m):
        nearest = slant_range_m(distance_m, height_m) - within_m
        return (15.3 / nearest, 15.3 / nearest) if nearest > 0.0 else (np.inf, np.inf)
