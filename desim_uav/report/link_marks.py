"""The marks of a link in an episode: its lines of sight and its shadowing, as in the engines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.sky import buildings_of
from desim_uav.model.radio.buildings import Buildings
from desim_uav.model.radio.chances import Odds, compiled_chance
from desim_uav.model.radio.marks import (
    DRAWN,
    KINDS,
    Mark,
    Marks,
    Sight,
    marks_of,
    memory_for,
)
from desim_uav.model.radio.tracks import Flight, Walkers
from desim_uav.model.radio.visits import Cells
from desim_uav.model.random.philox import key_of
from desim_uav.model.random.streams import Purpose
from desim_uav.model.rules import US
from desim_uav.rowcode.views import zeros
from desim_uav.world import World

ROOM = 256
"""For so many marks, and stretches in which buildings block a line, there is room at first."""

Flown = tuple[Flight, tuple[int, int]]
"""A flight, and the time for which a transmitter is on it."""


class LinkMarks(NamedTuple):
    """The branch of the path loss, and an additional loss, of a link from some times on."""

    since_us: NDArray[np.int64]
    branches: NDArray[np.int64]
    extra_db: NDArray[np.float64]

    def at(self, times_us: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the branches and the additional losses at some times."""
        rows = np.searchsorted(self.since_us, times_us, "right") - 1
        return self.branches[rows], self.extra_db[rows]


@dataclass(frozen=True)
class MarkMaker:
    """Makes the marks of links in an episode of a world, under the seed of a run."""

    world: World
    seed: int
    episode: int

    @cached_property
    def buildings(self) -> Buildings:
        """The buildings that block lines of sight."""
        return buildings_of(self.world)

    @cached_property
    def _key(self) -> NDArray[np.uint64]:
        return key_of(self.seed, Purpose.LINK, self.episode)

    def marks(
        self, radio: Any, number: int, user: int, walk: Any, flown: Sequence[Flown]
    ) -> LinkMarks:
        """Return the marks of the link between a user and a transmitter.

        ``number`` is that of the transmitter in the draws (``chances.Odds``), ``walk`` are the legs
        of the user's walk, and ``flown`` the flights of the transmitter.
        """
        chance = compiled_chance(radio.path_loss) if KINDS[radio.sight] == DRAWN else None
        odds = Odds(
            self._key,
            self.world.stream_numbers[[user]],
            number,
            _deviations_db(radio),
            0 if chance is None else chance.p_los,
            0 if chance is None else chance.values,
        )
        walkers = Walkers(walk, np.array([0, len(walk)]), self.world.homes[[user], 2])
        parts = [self._on(KINDS[radio.sight], odds, walkers, *each) for each in flown]
        since_us, branches, extra_db = map(np.concatenate, zip(*parts, strict=True))
        return LinkMarks(since_us, branches, extra_db)

    def _on(
        self, kind: int, odds: Odds, walkers: Walkers, flight: Flight, span_us: tuple[int, int]
    ) -> LinkMarks:
        """Return the marks on one flight, with as much room as they need."""
        cells, most, room = self.world.grid.cells, len(walkers.legs), ROOM
        where = odds, Cells(self.world.grid.cell_m, cells), walkers, flight, self.buildings
        while True:
            memory = memory_for(len(flight.pieces), most, cells, self.buildings, room)
            out = Marks(zeros(Mark, room), np.zeros(2, np.int64), 0, room)
            end = int(marks_of(Sight(kind, *where, memory), span_us, out))
            if 0 <= end <= room:
                rows: Any = out.rows[:end]
                since_us = span_us[0] + np.rint(rows["begin_s"] * US).astype(np.int64)
                return LinkMarks(since_us, rows["branch"].copy(), rows["extra_db"].copy())
            room = max(2 * room, abs(end))


def _deviations_db(radio: Any) -> tuple[float, float]:
    """Return the standard deviations of the shadowing with and without line of sight."""
    if radio.shadowing is None:
        return 0.0, 0.0
    return float(radio.shadowing.los_db), float(radio.shadowing.nlos_db)
