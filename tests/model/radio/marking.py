"""Links with their draws for ``marks_of``, and the truth about them by own formulas."""

from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from statistics import NormalDist

import numpy as np

from desim_uav.model.radio.buildings import cells_as_prisms
from desim_uav.model.radio.chances import Odds, compiled_chance
from desim_uav.model.radio.marks import DRAWN, Mark, Marks, Sight, marks_of, memory_for
from desim_uav.model.radio.path_loss import LOS, NLOS, AlHourani
from desim_uav.model.radio.tracks import Walkers
from desim_uav.model.radio.visits import Cells
from desim_uav.rowcode.views import zeros
from tests.model.radio.looking import finer, grid, moving
from tests.model.radio.making import START_US, Leg, flight_of, flying, hovering, walks
from tests.model.sampler import Walk

KEY = (0x0123456789ABCDEF, 0xFEDCBA9876543210)
TOWNS = [(4.88, 0.43), (9.61, 0.16), (12.08, 0.11), (27.23, 0.08)]
FLAT = cells_as_prisms(np.zeros((1, 1)), (1.0, 1.0))


def still(x, y):
    """A user who does not move."""
    return Walk(np.zeros(1), np.array([(x, y)], float), np.zeros((1, 2)))


@dataclass(frozen=True)
class Street:
    """A drone on its leg over a map of cells, and users; ``town`` has Al-Hourani's a and b."""

    leg: Leg
    walks: list
    span_s: float
    kind: int = DRAWN
    town: tuple = TOWNS[1]
    shadow_db: tuple = (0.0, 0.0)
    cell_m: tuple = (200.0, 200.0)
    cells: tuple = (5, 5)
    number: int = 0
    key: tuple = KEY
    height_m: float = 1.5
    buildings: object = FLAT
    stretches: int = 200
    least: dict = field(default_factory=dict)

    @property
    def span_us(self):
        """The start and the end of the span."""
        return START_US, START_US + round(self.span_s * 1e6)

    def sight(self):
        """The same for the package."""
        legs = [walks(walk, START_US) for walk in self.walks]
        chance = kept_chance(*self.town) if self.kind == DRAWN else (0, 0)
        most = max(map(len, legs))
        return Sight(
            self.kind,
            Odds(
                np.array(self.key, np.uint64),
                np.arange(len(legs)),
                self.number,
                self.shadow_db,
                chance[0],
                chance[1],
            ),
            Cells(self.cell_m, self.cells),
            Walkers(
                np.concatenate(legs),
                np.cumsum([0, *map(len, legs)]),
                np.full(len(legs), self.height_m),
            ),
            flight_of(self.leg),
            self.buildings,
            memory_for(len(self.leg.profile), most, self.cells, self.buildings, self.stretches),
        )

    def marks(self, span_us=None, rows=None):
        """The marks of each user: lists of (seconds, branch, dB)."""
        rows = 400 * len(self.walks) if rows is None else rows
        out, at = zeros(Mark, rows), np.zeros(len(self.walks) + 1, np.int64)
        count = marks_of(self.sight(), span_us or self.span_us, Marks(out, at, 0, rows))
        if not 0 <= count <= rows:
            return count
        assert count == at[-1]
        return [out[first:after].tolist() for first, after in pairwise(at)]

    # ---- the truth

    def cell(self, t):
        """The number of the cell in which the drone is, at the times ``t``."""
        places = self.leg.trip.at(t)[:, :2] / np.array(self.cell_m)
        ix, iy = np.clip(np.floor(places).astype(int), 0, np.array(self.cells) - 1).T
        return ix * self.cells[1] + iy

    def border_m(self, t):
        """How far the drone is from the nearest border of a cell, at the times ``t``."""
        places = self.leg.trip.at(t)[:, :2] / np.array(self.cell_m)
        nearest = np.clip(np.rint(places), 1, np.maximum(np.array(self.cells) - 1, 1))
        return (np.abs(places - nearest) * np.array(self.cell_m)).min(axis=1)

    def draws(self, user, cell):
        """The least elevation in degrees, and the shadowing with and without line of sight."""
        counter = [cell, user, self.number % 2**64, 0]
        before = sum(word << 64 * k for k, word in enumerate(counter)) - 1
        key = sum(word << 64 * k for k, word in enumerate(self.key))
        words = np.random.Philox(key=key, counter=before % 2**256).random_raw(4).tolist()
        uniform, (a, b) = (words[0] >> 11) * 2.0**-53, self.town
        normals = [NormalDist().inv_cdf(((word >> 12) + 0.5) * 2.0**-52) for word in words[1:3]]
        least = a - np.log((1.0 / uniform - 1.0) / a) / b
        return least, *(s * z for s, z in zip(self.shadow_db, normals, strict=True))

    def beyond_deg(self, user, t):
        """How far the drone is above the least elevation, at the times ``t``."""
        away = self.leg.trip.at(t)
        ground = np.hypot(*(away[:, :2] - self.walks[user].at(t)).T)
        elevation = np.degrees(np.arctan2(away[:, 2] - self.height_m, ground))
        return elevation - self._drawn(user, t)[:, 0]

    def _drawn(self, user, t):
        cells, place = np.unique(self.cell(t), return_inverse=True)
        for cell in cells.tolist():
            if (user, cell) not in self.least:
                self.least[user, cell] = self.draws(user, cell)
        return np.array([self.least[user, cell] for cell in cells.tolist()])[place]

    def true_marks(self, user, t, clear=None):
        """The branch and the additional loss at the times ``t``, shape (times, 2)."""
        clear = self.beyond_deg(user, t) >= 0.0 if clear is None else clear
        drawn = self._drawn(user, t)
        return np.column_stack(
            [np.where(clear, LOS, NLOS), np.where(clear, drawn[:, 1], drawn[:, 2])]
        )

    def hold(self, user, rows, margin=None, tiny=1e-9):
        """(times at which marks are wrong, rows in doubt).

        ``margin`` (times) is positive where the user sees the drone, by default the elevation. It
        decides nothing where it is below ``tiny``.
        """
        margin = margin or (lambda t: self.beyond_deg(user, t))

        def truth(t):
            return self.true_marks(user, t, margin(t) > 0.0)

        t = grid(self.span_s)
        for _ in range(3):
            t = np.unique(np.concatenate([t, finer(t, np.abs(margin(t)))]))
            t = np.unique(np.concatenate([t, finer(t, self.border_m(t))]))
        times = np.array([at for at, _, _ in rows])
        t = t[np.abs(t[:, None] - times).min(axis=1) > 1.1e-6]
        claims = np.array([mark[1:] for mark in rows])
        own = claims[np.searchsorted(times, t, side="right") - 1]
        clear = (np.abs(margin(t)) > tiny) & (self.border_m(t) > 1e-8)
        wrong, unclear = list(t[_differ(own, truth(t)) & clear]), 0
        for k, at in enumerate(times[1:], 1):
            around = np.array([at - 1e-6, at + 1e-6])
            clear = at - times[k - 1] > 2.5e-6 and 1e-6 <= at <= self.span_s - 1e-6
            clear &= k + 1 == len(times) or times[k + 1] - at > 2.5e-6
            if not clear or np.abs(margin(around)).min() < 1e-4 * tiny:
                unclear += 1
            elif _differ(claims[k - 1 : k + 1], truth(around)).any():
                wrong.append(at)
        return wrong, unclear


def _differ(one, other):
    return (one[:, 0] != other[:, 0]) | (np.abs(one[:, 1] - other[:, 1]) > 1e-8)


@cache
def kept_chance(a, b):
    """The compiled probability of line of sight of a town."""
    return compiled_chance(AlHourani(a=a, b=b, eta_los_db=1.0, eta_nlos_db=20.0))


def random_street(rng, users=2, kind=DRAWN, oblique=False):
    """A drone on an oblique, level or vertical leg over cells, or at rest, and walking users.

    If ``oblique``, it does not fly along an axis and is not at rest.
    """
    span_s = round(rng.uniform(5.0, 70.0), 6)
    cells = tuple(rng.integers(1, 13, 2).tolist())
    cell_m = tuple(rng.uniform(15.0, 100.0, 2).tolist())
    size = np.array(cell_m) * cells
    start = np.array([*rng.uniform(-0.1, 1.1, 2) * size, rng.uniform(25.0, 200.0)])
    stop = start + rng.uniform(-1.0, 1.0, 3) * (500.0, 500.0, 100.0)
    stop[2] = max(stop[2], 20.0)
    choice = rng.choice([0.3, 0.7]) if oblique else rng.random()
    if choice < 0.4:
        stop[2] = start[2]
        if choice < 0.2:
            along = rng.integers(2)
            stop[along] = start[along]
    elif choice < 0.5:
        stop[:2] = start[:2]
    leg = hovering(start) if choice > 0.9 else flying(rng, start, stop, span_s)
    around = [moving(rng, span_s, 4) for _ in range(users)]
    middle = start[:2]
    shifted = [Walk(one.times, one.points + middle, one.velocities) for one in around]
    return Street(
        leg,
        shifted,
        span_s,
        kind,
        TOWNS[rng.integers(len(TOWNS))],
        tuple(rng.uniform(0.5, 8.0, 2).tolist()) if rng.random() < 0.6 else (0.0, 0.0),
        cell_m,
        cells,
        int(rng.integers(-3, 50)),
        tuple(rng.integers(0, 2**63, 2).tolist()),
    )
