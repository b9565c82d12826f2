"""Changes of classes and of levels in the SimPy engine, where they are not those of rings."""

from __future__ import annotations

from typing import Any

import numpy as np

from desim_uav.engine.air import Room, buildings_of, set_memory, set_room
from desim_uav.engine.constants import transits_of
from desim_uav.model.geometry.relative import TIME_US, USER
from desim_uav.model.mobility.walking import Walks
from desim_uav.model.radio.air import (
    FOUND,
    FOUND_AT,
    FOUND_COLUMNS,
    FOUND_ROOM,
    class_changes_in_air,
    class_changes_of_all,
    pair_changes,
)
from desim_uav.model.radio.levels import compiled_loss
from desim_uav.model.radio.marks import (
    CHANGE_COLUMNS,
    DRAWN,
    MARK_COLUMNS,
    VISIT_COLUMNS,
    Memory,
    Sight,
    compiled_chance,
    marks_of,
)
from desim_uav.model.radio.nested import CHANGE
from desim_uav.model.radio.scene import (
    LOSS_COLUMNS,
    PLACE_COLUMNS,
    RADIO_COLUMNS,
    SENDER_COLUMNS,
    Air,
    memory,
)
from desim_uav.model.radio.sight import Buffers
from desim_uav.model.radio.tracks import TRACK_COLUMNS, Flight
from desim_uav.rowcode.rows import named
from desim_uav.rules import rows
from desim_uav.rules.air import (
    lacks_marks,
    needs_marks,
    note_classes,
    number_in_draws,
    number_of_profile,
    place_drones,
    span_of_marks,
)
from desim_uav.rules.association import known_until_us
from desim_uav.rules.transits import heights_of, way_of
from desim_uav.rules.words import NEVER
from desim_uav.world import World

Change: Any = named(rows.Change)
"""The change of a link's class: a tuple, which takes less time than a row."""

Rows = list[list[int]]
Span = tuple[int, int]

MARKS_A_USER, STRETCHES = 4, 16
"""How many marks of a user, and blocked stretches of a line of sight, there is memory for first."""


def last_first(found: Rows) -> list[Any]:
    """Return rows as changes, the last one first: by time, rises after falls, then by user."""
    found.sort(key=lambda row: (row[TIME_US], row[CHANGE] > 0, row[USER]), reverse=True)
    return [Change(*row) for row in found]


class InAir:
    """Computes the changes of an episode by the kernels of ``model.radio.air``."""

    def __init__(self, world: World, constants: Any, state: Any) -> None:
        self.world, self.constants, self.state = world, constants, state
        set_memory(state.look.air, world)
        self._kept: list[Any] = []  # which the constants point at
        for row, links in zip(constants.radios, world.links, strict=True):
            if links.in_air:
                radio = links.radio
                loss = compiled_loss(radio.path_loss, float(radio.carrier_ghz))
                row.level, row.rates, row.loss_values = loss.level, loss.rates, loss.values
                self._kept.append(loss)
            if row.sight == DRAWN:
                chance = compiled_chance(links.radio.path_loss)
                row.p_los = chance.p_los
                self._kept.append(chance)
        profiles = [transit.profile for transit in transits_of(world)]
        self._profiles = np.concatenate(profiles), np.cumsum([0, *map(len, profiles)])
        own = state.look.air
        if len(own.pieces):
            self._profiles = own.pieces.reshape(-1, 4), own.pieces_at
        self._memory = memory(len(state.senders), max(map(len, profiles)))
        self._thresholds = np.array(constants.thresholds_db), np.array(constants.thresholds_at)
        self._heights = np.array(constants.heights_m)
        self._found = np.empty((len(state.senders), 256, 3), np.int64)
        self._buildings = buildings_of(world)
        self._room = Room(MARKS_A_USER * len(self._heights), 0, STRETCHES)

    def begin(self, walks: Walks, link_key: Any) -> None:
        """Begin an episode with these walks, and this key of the draws of links."""
        self._walks, self._key = walks, link_key
        most_legs = int(np.diff(walks.offsets).max(initial=0))
        self._room = self._room._replace(legs=most_legs)
        set_room(self.state.look.air, self.world, self._room)

    def changes(self, drone: Any, span_us: Span) -> Rows:
        """Return the changes of class on a drone's leg, in no order."""
        self._mark_all(drone, span_us)
        note_classes(self.state, drone)
        air, held = self._air(), self._held()[drone.index]
        while True:
            found = self._found[drone.index]
            count = class_changes_in_air(air, drone.index, span_us, held, False, found)
            if count <= len(found):
                rows: Rows = found[:count].tolist()
                return rows
            self._find_more(count)

    def changes_of_all(self, drones: list[Any], span_us: Span) -> list[Rows]:
        """Return the changes of class on the legs of drones that interfere, each in no order."""
        for drone in drones:
            self._mark_all(drone, span_us)
            note_classes(self.state, drone)
        air, held = self._air(), self._held()
        table = self.state.look.air.found.reshape(-1, FOUND_COLUMNS)
        while True:
            table[:] = 0
            for drone in drones:
                found = self._found[drone.index]
                table[drone.index, FOUND_AT], table[drone.index, FOUND_ROOM] = (
                    found.ctypes.data,
                    len(found),
                )
            class_changes_of_all(air, span_us, held, table)
            most = int(table[:, FOUND].max())
            if most <= self._found.shape[1]:
                counts = table[:, FOUND].tolist()
                return [self._found[d.index, : counts[d.index]].tolist() for d in drones]
            self._find_more(most)

    def _held(self) -> Any:
        """Return the table of the classes of all links before a span."""
        return self.state.look.air.held.reshape(-1, len(self._heights))

    def _find_more(self, count: int) -> None:
        """Make room for at least so many changes of each drone."""
        self._found = np.empty((len(self._found), 2 * count, 3), np.int64)

    def _mark_all(self, drone: Any, span_us: Span) -> None:
        """Make all marks on which the classes of links to a drone depend in a span."""
        if self.world.marked:
            for other in self.state.senders:
                if lacks_marks(self.constants, self.state, drone, other, span_us[1]):
                    self._mark(other, span_us[1])

    def passes_us(
        self,
        world: Any,
        path: Any,
        state: Any,
        user: Any,
        one: int,
        other: int,
        better: int,
        margin_db: float,
    ) -> int:
        """Return when one drone becomes better than another one (see ``rules.association``)."""
        span_us = (state.now_us, known_until_us(state, one, other))
        for drone in (state.senders[one], state.senders[other]):
            if needs_marks(world, state, drone, span_us[1]):
                self._mark(drone, span_us[1])
        air, passed = self._air(), state.look.air.passed.reshape(-1, 2)
        rows = pair_changes(air, user.index, one, other, margin_db, span_us, better, passed)
        return int(passed[0, 0]) if rows > 0 else NEVER

    def _mark(self, drone: Any, until_us: int) -> None:
        """Make the marks of all links to a drone until a time."""
        tables, users = self.state.look.air, len(self._heights)
        span_us = span_of_marks(self.state, drone, until_us)
        while True:
            first = drone.index * tables.mark_rows
            out = tables.marks.reshape(-1, MARK_COLUMNS)[: first + tables.mark_rows]
            own = drone.index * (users + 1)
            out_at = tables.marks_at[own : own + users + 1]
            out_at[0] = first
            number = number_in_draws(drone)
            end = marks_of(self._sight(drone), number, span_us, out, out_at)
            if 0 <= end <= len(out):
                drone.marked_us, drone.marked_until_us = span_us
                return
            self._make_room(end - first, -end)

    def _make_room(self, rows: int, stretches: int) -> None:
        """Make room for at least so many marks of a drone, and so many stretches."""
        tables, had, room = self.state.look.air, self._room, self._room
        marks, marks_at = tables.marks.reshape(-1, had.marks, MARK_COLUMNS), tables.marks_at
        if stretches > 0:
            room = room._replace(stretches=max(2 * had.stretches, stretches))
        else:
            room = room._replace(marks=max(2 * had.marks, rows))
        self._room = room
        set_room(tables, self.world, room)
        tables.marks.reshape(-1, room.marks, MARK_COLUMNS)[:, : had.marks] = marks
        moved = np.arange(len(marks)) * (room.marks - had.marks)
        tables.marks_at[:] = marks_at + np.repeat(moved, len(marks_at) // len(marks))

    def _sight(self, drone: Any) -> Sight:
        """Return what decides on the marks of links to a drone."""
        world, tables = self.constants, self.state.look.air
        radio, (legs, offsets) = world.radios[drone.radio], self._walks
        (x0, y0, x1, y1), (z0, z1) = way_of(world, drone), heights_of(world, drone)
        pieces, begins = self._profiles
        number = number_of_profile(self.state, drone)
        profile = pieces[begins[number] : begins[number + 1]]
        return Sight(
            radio.sight,
            self._key,
            (radio.los_shadow_db, radio.nlos_shadow_db),
            self.world.grid.cell_m,
            self.world.grid.cells,
            legs,
            offsets,
            self._heights,
            Flight(profile, (x0, y0, z0, x1, y1, z1), drone.since_us),
            radio.p_los,
            radio.loss_values,
            self._buildings,
            Memory(
                tables.flown.reshape(-1, TRACK_COLUMNS),
                tables.borders_s,
                tables.visits.reshape(-1, VISIT_COLUMNS),
                tables.seen.reshape(-1, CHANGE_COLUMNS),
                Buffers(tables.times, tables.stretches.reshape(-1, 2), tables.visited),
            ),
        )

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
            marks=np.asarray(own.marks, float).reshape(-1, MARK_COLUMNS),
            marks_at=np.asarray(own.marks_at, np.int64),
            **self._memory,
        )
