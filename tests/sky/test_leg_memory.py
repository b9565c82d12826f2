"""The memory of legs: what it gives back is what was put in, for the same leg alone."""

from __future__ import annotations

import numpy as np
import pytest

from desim_uav.rowcode.rows import Table, address, blank, place
from desim_uav.rowcode.views import in_memory, zeros
from desim_uav.sky.leg_memory import (
    COUNT,
    DRAFT,
    END,
    LEGS_AT,
    SLOTS,
    new_memory,
    recall_leg,
    remember_leg,
)
from desim_uav.sky.rows import Change, LegRow, Propagation, Scene, Sky

USERS, ROOM = 9, 4
"""One user more than a word has classes, and the room for changes of the kernels' tests."""


class Asked:
    """A sky of two senders with one radio, whose legs are asked for."""

    def __init__(self, words: int = LEGS_AT + 200) -> None:
        scene, sky = blank(Scene), blank(Sky)
        scene.number, scene.groups = 7, Table([0] * USERS)
        scene.radios = Table(blank(Propagation) for _ in range(2))
        for radio in scene.radios:
            radio.classes = 15
        sky.legs, sky.held = Table(blank(LegRow) for _ in range(2)), Table([3] * 2 * USERS)
        self.scene, self.sky = in_memory(scene), in_memory(sky)
        self.memory = new_memory(words)
        self.sky.leg_memory = place(self.memory)
        self.rows = zeros(Change, ROOM)

    def recall(
        self, sender: int = 0, start_us: int = 0, until_us: int = 60, room: int = ROOM
    ) -> int:
        """Ask for a leg."""
        places = address(self.scene), address(self.sky), place(self.rows), room
        return recall_leg(*places, sender, start_us, until_us)

    def remember(self, changes: list[tuple[int, int, int]], start_us: int = 0) -> None:
        """Keep the changes on the leg that was asked for."""
        self.rows[: len(changes)] = changes
        remember_leg(address(self.sky), place(self.rows), len(changes), start_us)


CHANGES = [(50, 8, -14), (50, 0, 15), (7, 2**20 - 1, 0), (0, 3, 1)]


def test_a_leg_is_recalled_at_any_time_for_any_drone() -> None:
    asked = Asked()
    assert asked.recall() == -1
    asked.remember(CHANGES)
    asked.rows[:] = 0
    now_us = 10**15
    asked.sky.legs[1].since_us = now_us
    assert asked.recall(1, now_us, now_us + 60) == len(CHANGES)
    assert asked.rows.tolist() == [(now_us + t, user, change) for t, user, change in CHANGES]


def test_only_as_many_changes_are_written_as_there_is_room_for() -> None:
    asked = Asked()
    asked.recall()
    asked.remember(CHANGES)
    asked.rows[:] = 0
    assert asked.recall(room=1) == len(CHANGES)
    assert asked.rows.tolist() == [CHANGES[0], *[(0, 0, 0)] * 3]


FIELDS = (
    *("x0_m", "y0_m", "z0_m", "x1_m", "y1_m", "z1_m", "since_us", "transit", "level", "to_level"),
    *("radio", "serving"),
)


@pytest.mark.parametrize("name", FIELDS)
def test_a_leg_that_differs_is_another_one(name: str) -> None:
    asked = Asked()
    asked.recall()
    asked.remember(CHANGES)
    leg = asked.sky.legs[0]
    setattr(leg, name, 1)
    assert asked.recall() == -1
    setattr(leg, name, 0)
    assert asked.recall() == len(CHANGES)


@pytest.mark.parametrize("user", range(USERS))
def test_classes_that_differ_make_another_leg(user: int) -> None:
    asked = Asked()
    asked.recall()
    asked.remember(CHANGES)
    asked.sky.held[user] = 4
    assert asked.recall() == -1
    assert asked.recall(1) == len(CHANGES)


def test_a_leg_of_another_world_or_of_another_length_is_another_one() -> None:
    asked = Asked()
    asked.recall()
    asked.remember(CHANGES)
    assert asked.recall(until_us=61) == -1
    asked.scene.number += 1
    assert asked.recall() == -1


def test_many_legs_share_slots() -> None:
    asked = Asked(2**17)
    legs = range(2000)
    for _ in range(2):
        known = []
        for number in legs:
            asked.sky.legs[0].x0_m = 0.1 * number
            known.append(asked.recall())
            if known[-1] < 0:
                asked.remember([(number % 60, number % 9, 2)])
            else:
                assert asked.rows[0].tolist() == (number % 60, number % 9, 2)
    assert known == [1] * len(legs) and asked.memory[COUNT] == len(legs)
    slots = np.flatnonzero(asked.memory[LEGS_AT - SLOTS : LEGS_AT])
    hashes = asked.memory[asked.memory[LEGS_AT - SLOTS + slots]] & (SLOTS - 1)
    assert (hashes != slots).any()  # some are not in the first slot that they asked for


def test_a_memory_without_room_forgets_all_and_begins_anew() -> None:
    asked = Asked(LEGS_AT + 100)
    leg = asked.sky.legs[0]
    known = []
    for number in [*range(6), 5, 0]:
        leg.x0_m = float(number)
        known.append(asked.recall())
        if known[-1] < 0:
            asked.remember(CHANGES)
        assert asked.memory[END] <= len(asked.memory)
    assert known == [-1] * 6 + [4, -1]
    asked.memory[COUNT] = SLOTS // 2
    leg.x0_m = 9.0
    assert asked.recall() == -1
    asked.remember(CHANGES)
    assert asked.memory[COUNT] == 0 and not asked.memory[LEGS_AT - SLOTS : LEGS_AT].any()


def test_what_does_not_fit_is_neither_recalled_nor_kept() -> None:
    for words, classes, until_us in ((LEGS_AT + 10, 15, 60), (2**17, 128, 60), (2**17, 15, 2**35)):
        asked = Asked(words)
        asked.scene.radios[0].classes = classes
        for _ in range(2):
            assert asked.recall(until_us=until_us) == -1
            assert asked.memory[DRAFT] == 0
            asked.remember(CHANGES)
    asked = Asked(LEGS_AT + 20)
    asked.recall()
    asked.remember(CHANGES)
    assert asked.memory[COUNT] == 0
