"""The sky in the SimPy engine, whose memory grows when a kernel needs more."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from desim_uav.engine.sky import Room, enlarged, scene_of, sky_of
from desim_uav.model.mobility.walks import Walks
from desim_uav.model.radio.chances import compiled_chance
from desim_uav.model.radio.levels import compiled_loss
from desim_uav.rowcode.rows import address
from desim_uav.rowcode.views import in_memory
from desim_uav.rules.rows import State
from desim_uav.sky import links
from desim_uav.sky.foresee import foresee_discs, foresee_rings
from desim_uav.sky.rows import Sky
from desim_uav.sky.separation import least_m, meet
from desim_uav.world import World

CHANGES, MARKS_A_USER, STRETCHES = 256, 4, 16
"""How many changes on a leg, marks of a user, and blocked stretches of a line of sight, there is
memory for at first."""


class Skies:
    """Makes the sky of an environment and, when a kernel asks for it, larger ones."""

    def __init__(self, world: World) -> None:
        self.world, self._kept = world, []  # type: tuple[World, list[Any]]
        self._room = Room(CHANGES, MARKS_A_USER * len(world.homes), 0, STRETCHES)

    def first(self) -> Sky:
        """Return a sky for a new state."""
        return in_memory(sky_of(self.world, self._room))

    def begin(self, state: State, walks: Walks) -> None:
        """Make room for the legs of these walks."""
        most_legs = int(np.diff(walks.offsets).max(initial=0))
        if self.world.marked and most_legs > self._room.legs:
            self._enlarge(state, self._room._replace(legs=most_legs))

    def _enlarge(self, state: State, room: Room) -> None:
        state.sky, self._room = enlarged(state.sky, self.world, room), room

    def set_functions(self, constants: Any, state: Callable[[], Any]) -> None:
        """Set the scene and the functions that the rules call; ``state`` returns the state."""
        constants.scene = in_memory(scene_of(self.world))
        constants.meet, constants.least_m = meet, least_m
        constants.better_us = links.better_us
        of_rings = foresee_rings if self.world.graded else foresee_discs
        constants.foresee = self._with_changes(of_rings, state)
        constants.foresee_in_air = self._with_changes(links.foresee_in_air, state)
        constants.foresee_all = self._with_all_changes(state)
        constants.mark = self._with_marks(state)
        for row, own in zip(constants.scene.radios, self.world.links, strict=True):
            if own.in_air:
                loss = compiled_loss(own.radio.path_loss, float(own.radio.carrier_ghz))
                row.level, row.rates, row.loss_values = loss.level, loss.rates, loss.values
                self._kept.append(loss)  # which the constants point at
                if own.radio.sight == "drawn":
                    chance = compiled_chance(own.radio.path_loss)
                    row.p_los = chance.p_los
                    self._kept.append(chance)

    def _with_changes(self, kernel: Any, state: Callable[[], Any]) -> Callable[..., int]:
        """Return a kernel that writes the changes of a leg, and finds room for all of them."""

        def foresee(scene: int, sky: int, out: int, room: int, *others: int) -> int:
            room = min(room, self._room.changes)  # the table may be that of all senders
            count: int = kernel(scene, sky, out, room, *others)
            while count > room:
                self._enlarge(state(), self._room._replace(changes=2 * count))
                changes = state().sky.changes
                out, room = changes.address, self._room.changes
                count = kernel(scene, address(state().sky), out, room, *others)
            return count

        return foresee

    def _with_all_changes(self, state: Callable[[], Any]) -> Callable[..., int]:
        """Return the kernel that writes the changes of all legs, and finds room for all of them."""

        def foresee(scene: int, sky: int, *others: int) -> int:
            most: int = links.foresee_all(scene, sky, *others)
            while most > self._room.changes:
                self._enlarge(state(), self._room._replace(changes=2 * most))
                most = links.foresee_all(scene, address(state().sky), *others)
            return most

        return foresee

    def _with_marks(self, state: Callable[[], Any]) -> Callable[..., int]:
        """Return the kernel that makes marks, which finds room for all of them."""

        def mark(scene: int, sky: int, *others: int) -> int:
            lacking = links.mark(scene, sky, *others)
            while lacking != 0:
                room = self._room
                if lacking < 0:
                    room = room._replace(stretches=max(2 * room.stretches, -lacking))
                else:
                    room = room._replace(marks=max(2 * room.marks, lacking))
                self._enlarge(state(), room)
                lacking = links.mark(scene, address(state().sky), *others)
            return 0

        return mark
