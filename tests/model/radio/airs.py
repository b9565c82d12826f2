"""Drones and users for the kernels of the air, and the truth about them by own formulas."""

from dataclasses import dataclass, field
from functools import cache
from itertools import chain

import numpy as np

from desim_uav.engine.sky import complete
from desim_uav.model.radio.curves import blank_curve
from desim_uav.model.radio.functions import log10, slant_range_m
from desim_uav.model.radio.levels import compiled_loss
from desim_uav.model.radio.links import LOOKS, Link, Look
from desim_uav.model.radio.marks import Mark
from desim_uav.model.radio.path_loss import AlHourani, FreeSpace, LogDistance, RowPathLoss
from desim_uav.model.radio.slopes import DB
from desim_uav.model.radio.tracks import TrackRow
from desim_uav.model.rules import NEVER
from desim_uav.rowcode.rows import Table, address, blank, place
from desim_uav.rowcode.views import in_memory, records, zeros
from desim_uav.sky import links
from desim_uav.sky import rows as sky_rows
from desim_uav.sky.links import MOST_PASSED
from desim_uav.sky.rows import Change, LegRow, Propagation, Scene, TransitRow
from tests.model.radio.looking import Loss, moving
from tests.model.radio.making import START_US, flying, hovering, walks
from tests.model.sampler import Walk

FREE_AT_1M_DB = 20.0 * np.log10(4e9 * np.pi * 2.0 / 299_792_458.0)
USER_M, CARRIER_GHZ = 1.5, 2.0


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

    def air(self, room=0, reach_m=0.0):
        """The same for the package, with so much room for changes of each drone.

        With a reach, there are curves for the heights at which drones begin.
        """
        return Air(self, room, reach_m)


@cache
def kept_curve(path_loss, height_m, reach_m):
    """The curve of a path loss at a height, which is drawn once."""
    scene, radio = blank(Scene), blank(Propagation)
    radio.level, radio.rates, radio.loss_values = kept_loss(path_loss)[:3]
    radio.carrier_ghz, curve = CARRIER_GHZ, blank_curve(height_m, reach_m)
    scene.radios, radio.curves = Table([radio]), Table([curve])
    scene = in_memory(scene)
    complete(scene)
    drawn = scene.radios[0].curves[0]
    curve.error_db = drawn.error_db
    curve.cells[:], curve.slopes[:] = drawn.cells.array, drawn.slopes.array
    return curve


class Air:
    """The rows of a sky in memory, and the calls of its kernels."""

    def __init__(self, sky, room, reach_m):
        count, users = len(sky.legs), len(sky.walks)
        scene, own = blank(Scene), blank(sky_rows.Sky)
        scene.transits = Table(blank(TransitRow) for _ in sky.legs)
        scene.radios = Table(blank(Propagation) for _ in sky.legs)
        scene.groups, scene.heights_m = np.zeros(users, int), np.full(users, USER_M)
        own.legs = Table(blank(LegRow) for _ in sky.legs)
        own.air.links = Table(blank(Link) for _ in sky.legs)
        for i, leg in enumerate(sky.legs):
            scene.transits[i].pieces = leg.profile
            radio, loss = scene.radios[i], kept_loss(sky.radios[i].path_loss)
            radio.level, radio.rates, radio.loss_values = loss[:3]
            radio.carrier_ghz, radio.power_dbm, radio.noise_dbm = (
                CARRIER_GHZ,
                sky.powers_dbm[i],
                sky.noise_dbm,
            )
            radio.lowest, radio.classes = i * len(sky.thresholds), len(sky.thresholds)
            radio.ratios = Table(np.exp(np.array(sky.thresholds) / DB).tolist())
            if reach_m > 0.0:
                radio.curves = Table(
                    [kept_curve(sky.radios[i].path_loss, leg.route[2] - USER_M, reach_m)]
                )
            row = own.legs[i]
            row.x0_m, row.y0_m, row.z0_m, row.x1_m, row.y1_m, row.z1_m = leg.route
            row.since_us, row.transit, row.radio = START_US - leg.before_us, i, i
            row.serving, row.band, row.marked_us = int(sky.serves[i]), int(sky.bands[i]), START_US
            own.air.links[i].looks = zeros(Look, LOOKS)
        own.air.looked_s = np.zeros(LOOKS)
        own.air.thresholds_db = np.array([*np.tile(sky.thresholds, count), 0.0])
        own.air.tracks, own.passed = zeros(TrackRow, 6 * count), zeros(Change, MOST_PASSED)
        own.held, own.changes = np.zeros(count * users, int), zeros(Change, room * count)
        if sky.marks:
            marks = [sky.marks.get((i, user), []) for i in range(count) for user in range(users)]
            own.air.marks = records(Mark, [*chain(*marks)])
            own.air.marks_at = self._marks_at(offsets(marks), users)
        self.scene, self.sky, self.users = in_memory(scene), in_memory(own), users
        legs = [walks(walk, START_US) for walk in sky.walks]
        self.walks, self.begins = np.concatenate(legs), offsets(legs)

    @staticmethod
    def _marks_at(ends, users):
        """Where the marks of each user begin and end, drone by drone."""
        firsts = range(0, len(ends) - 1, users)
        return np.concatenate([ends[first : first + users + 1] for first in firsts])

    @property
    def walked(self):
        """Where the walks are."""
        return place(self.walks), len(self.walks), place(self.begins)

    def classes(self, sender, span_us, held, out):
        """Write the changes of a drone's links, user by user, and return their number."""
        self.sky.held[sender * self.users : (sender + 1) * self.users] = held
        rows = zeros(Change, len(out))
        own = address(self.scene), address(self.sky), place(rows), len(rows)
        count = links.foresee_in_air(*own, *self.walked, sender, *span_us)
        found = rows[: min(count, len(rows))][::-1]
        order = np.argsort(found["user"], kind="stable")
        out[: len(found)] = np.array(found[order].tolist()).reshape(-1, 3)
        return count

    def pair(self, user, one, other, threshold_db, span_us, held):
        """The times at which one level passes another one, and the state from then on."""
        own = address(self.scene), address(self.sky), *self.walked
        first_us = links.better_us(*own, user, one, other, *span_us, held, threshold_db)
        rows = self.sky.passed.array[: self.sky.air.links[0].rows].tolist()
        assert first_us == (rows[0][0] if rows else NEVER)
        return [(t_us, abs(change)) for t_us, _, change in rows]


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


def class_rows(sky, i):
    """The rows (time, class) of each user, the first one at the start of the span."""
    users, out = len(sky.walks), np.zeros((2000, 3), np.int64)
    count = sky.air().classes(i, sky.span_us, 0, out)
    assert 0 <= count <= len(out)
    rows = [[(START_US, 0)] for _ in range(users)]
    for t_us, user, change in out[:count].tolist():
        own = rows[user]
        assert (change > own[-1][1]) if change > 0 else (-change < own[-1][1])
        if t_us == START_US:
            own.pop()
        own.append((t_us, abs(change)))
    assert out[:count, 1].tolist() == sorted(out[:count, 1])
    return rows


def pair_rows(sky, user, one, other, threshold_db, held=-1):
    """The rows (time, state) of a pair of drones."""
    return sky.air().pair(user, one, other, threshold_db, sky.span_us, held)


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
