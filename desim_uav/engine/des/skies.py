"""The sky in the SimPy engine, whose memory grows when a kernel needs more."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from desim_uav.engine.leg_memory import memory_of_legs
from desim_uav.engine.sky import Room, complete, enlarged, scene_of, sky_of
from desim_uav.model.mobility.walks import Walks
from desim_uav.model.radio.chances import compiled_chance
from desim_uav.model.radio.levels import compiled_loss
from desim_uav.rowcode.rows import address
from desim_uav.rowcode.views import in_memory
from desim_uav.rules.rows import State
from desim_uav.sky import links
from desim_uav.sky.foresee import foresee_discs, foresee_rings
from desim_uav.sky.leg_memory import recall_leg, remember_leg
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
        constants.foresee = self._with_room(of_rings, state, self._for_changes)
        for name in ("foresee_in_air", "foresee_all"):
            setattr(
                constants, name, self._with_room(getattr(links, name), state, self._for_changes)
            )
        constants.recall_leg = self._with_room(recall_leg, state, self._for_changes)
        constants.remember_leg = remember_leg
        constants.mark = self._with_room(links.mark, state, self._for_marks)
        for row, own in zip(constants.scene.radios, self.world.links, strict=True):
            if own.in_air:
                loss = compiled_loss(own.radio.loss, float(own.radio.carrier_ghz))
                row.level, row.rates, row.loss_values = loss.level, loss.rates, loss.values
                self._kept.append(loss)  # which the constants point at
                if own.radio.sight == "drawn":
                    chance = compiled_chance(own.radio.loss)
                    row.p_los = chance.p_los
                    self._kept.append(chance)
        complete(constants.scene)

    def _with_room(
        self, kernel: Any, state: Callable[[], Any], larger: Callable[[int], Room | None]
    ) -> Callable[..., int]:
        """Return a kernel that is called again until its result asks for no ``larger`` room."""

        def call(scene: int, sky: int, *others: int) -> int:
            state().sky.leg_memory = memory_of_legs()
            result: int = kernel(scene, sky, *others)
            while (room := larger(result)) is not None:
                self._enlarge(state(), room)
                own = state().sky
                if kernel in LISTS:
                    others = (own.changes.address, room.changes, *others[2:])
                result = kernel(scene, address(own), *others)
            return result

        return call

    def _for_changes(self, count: int) -> Room | None:
        """Return room for so many changes on a leg, or None if there is enough."""
        return self._room._replace(changes=2 * count) if count > self._room.changes else None

    def _for_marks(self, lacking: int) -> Room | None:
        """Return room for what ``mark`` lacks, or None if that is nothing."""
        room = self._room
        if lacking < 0:
            return room._replace(stretches=max(2 * room.stretches, -lacking))
        return room._replace(marks=max(2 * room.marks, lacking)) if lacking > 0 else None


LISTS = (foresee_discs, foresee_rings, links.foresee_in_air, recall_leg)
"""The kernels that are given memory for the changes on one leg: its address, and its size."""
