"""Changes of classes and of levels in the SimPy engine, where they are not those of rings."""

from __future__ import annotations

from typing import Any

import numpy as np

from desim_uav.engine.air import set_memory
from desim_uav.engine.constants import transits_of
from desim_uav.model.radio.air import class_changes_in_air, pair_changes
from desim_uav.model.radio.levels import compiled_loss
from desim_uav.model.radio.scene import (
    LOSS_COLUMNS,
    PLACE_COLUMNS,
    RADIO_COLUMNS,
    SENDER_COLUMNS,
    Air,
    memory,
)
from desim_uav.model.walking import Walks
from desim_uav.rules.air import note_classes, place_drones
from desim_uav.rules.words import NEVER
from desim_uav.world import World

Rows = list[list[int]]


class InAir:
    """Computes the changes of an episode by the kernels of ``model.radio.air``."""

    def __init__(self, world: World, constants: Any, state: Any) -> None:
        self.constants, self.state = constants, state
        set_memory(state.look.air, world)
        self._losses = []  # which the constants point at
        for row, links in zip(constants.radios, world.links, strict=True):
            if links.in_air:
                loss = compiled_loss(links.radio.path_loss)
                row.level, row.rates, row.loss_values = loss.level, loss.rates, loss.values
                self._losses.append(loss)
        profiles = [transit.profile for transit in transits_of(world)]
        self._profiles = np.concatenate(profiles), np.cumsum([0, *map(len, profiles)])
        self._memory = memory(len(state.senders), max(map(len, profiles)))
        self._thresholds = np.array(constants.thresholds_db), np.array(constants.thresholds_at)
        self._heights = np.array(constants.heights_m)
        self._found = np.empty((256, 3), np.int64)

    def begin(self, walks: Walks) -> None:
        """Begin an episode with these walks."""
        self._walks = walks

    def changes(self, drone: Any, span_us: tuple[int, int]) -> Rows:
        """Return the changes of class on a drone's leg, in no order."""
        note_classes(self.state, drone)
        air, held = self._air(), self.state.look.air.held
        while True:
            count = class_changes_in_air(air, drone.index, span_us, held, False, self._found)
            if count <= len(self._found):
                rows: Rows = self._found[:count].tolist()
                return rows
            self._found = np.empty((2 * count, 3), np.int64)

    def passes_us(
        self, world: Any, path: Any, state: Any, user: Any, one: int, other: int, better: int
    ) -> int:
        """Return when one drone becomes better than another one (see ``rules.association``)."""
        span_us, passed = (state.now_us, state.known_until_us), state.look.air.passed.reshape(-1, 2)
        air = self._air()
        rows = pair_changes(air, user.index, one, other, world.margin_db, span_us, better, passed)
        return int(passed[0, 0]) if rows > 0 else NEVER

    def _air(self) -> Air:
        """Return what kernels know of drones and users."""
        place_drones(self.constants, self.state)
        own: Any = self.state.look.air
        legs, offsets = self._walks
        return Air(
            places=own.ways.reshape(-1, PLACE_COLUMNS),
            senders=own.senders.reshape(-1, SENDER_COLUMNS),
            pieces=self._profiles[0],
            pieces_at=self._profiles[1],
            losses=own.losses.reshape(-1, LOSS_COLUMNS),
            radios=own.radios.reshape(-1, RADIO_COLUMNS),
            thresholds_db=self._thresholds[0],
            thresholds_at=self._thresholds[1],
            legs=legs,
            legs_at=offsets,
            heights_m=self._heights,
            marks=np.empty((0, 3)),
            marks_at=np.empty(0, np.int64),
            **self._memory,
        )
