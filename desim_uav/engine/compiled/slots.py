"""The event queue of compiled code: slots, which are ordered by (time, key) in two tournaments.

Each thing that can happen has a slot (see ``rules.due``), whose time is NEVER if it is not
scheduled. The winners of matches 2n and 2n + 1 of a tournament meet in its match n, and match 1
decides it; numbers from the count of its slots on denote the slots themselves. If a slot changes,
its matches are played again; their number is about the binary logarithm of the number of slots.

The slots of the senders' crossings have a tournament of their own, because most changes are theirs
and they are few. The other tournament is at the beginning of ``State.winners``, where match 0 is
the final between the winners of the two.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.rowcode.compiled_registers import either, precedes
from desim_uav.rowcode.kernels import rule, stands_in_for
from desim_uav.rules import due as seam
from desim_uav.rules.due import crossing_slot
from desim_uav.rules.rows import State
from desim_uav.rules.words import NEVER


def tournaments(slots: int, crossings: int, senders: int) -> NDArray[np.int64]:
    """Return ``State.winners`` for so many slots, those of crossings from ``crossings`` on."""
    numbers, end = list(range(slots)), crossings + senders
    winners: list[int] = []
    for entrants in (numbers[:crossings] + numbers[end:], numbers[crossings:end]):
        matches = [0] * len(entrants) + entrants
        for match in range(2 * len(entrants) - 2, 1, -2):
            matches[match // 2] = matches[match]
        winners += matches
    winners[0] = winners[1]
    return np.array(winners, np.int64)


@stands_in_for(seam.nothing_due)
def _nothing_due(state: State) -> None:
    # All are equal then, so that those who have won before are winners still.
    for slot in range(len(state.slot_times)):
        state.slot_times[slot] = NEVER
        state.slot_keys[slot] = 0


@rule
def _entry(state: State, slot: int) -> tuple[int, int, int]:
    """Return where a slot's tournament begins, its number there, and where its rival is found.

    The rival is the winner of the other tournament.
    """
    senders, number = len(state.senders), slot - crossing_slot(state, 0)
    others = len(state.slot_times) - senders
    if 0 <= number < senders:
        return 2 * others, senders + number, 1
    return 0, others + (slot if number < 0 else slot - senders), 2 * others + 1


@rule
def _meet(state: State, slot: int) -> None:
    """Play the matches of a slot that has changed, and the final."""
    winners, changed = state.winners, slot
    begins, node, rival = _entry(state, slot)
    t_us, key = state.slot_times[slot], state.slot_keys[slot]
    while node > 1:
        slot, t_us, key = _winner(state, slot, t_us, key, winners[begins + (node ^ 1)])
        node >>= 1
        if slot != changed and winners[begins + node] == slot:
            return
        winners[begins + node] = slot
    slot, t_us, key = _winner(state, slot, t_us, key, winners[rival])
    winners[0] = slot


@rule
def _winner(state: State, slot: int, t_us: int, key: int, other: int) -> tuple[int, int, int]:
    """Return the slot that is earlier, of one with this time and key and another one; the same.

    A match has no jump, because winners are unpredictable and mispredicted jumps take longer.
    """
    t_other, other_key = state.slot_times[other], state.slot_keys[other]
    loses = precedes(t_other, other_key, t_us, key)
    t_us, key = either(loses, t_other, t_us), either(loses, other_key, key)
    return either(loses, other, slot), t_us, key


@stands_in_for(seam.due)
def _due(state: State, slot: int, t_us: int, key: int) -> None:
    state.slot_times[slot] = t_us
    state.slot_keys[slot] = key
    _meet(state, slot)


@stands_in_for(seam.undo)
def _undo(state: State, slot: int) -> None:
    if state.slot_times[slot] != NEVER:
        state.slot_times[slot] = NEVER
        _meet(state, slot)


@stands_in_for(seam.run_until)
def _run_until(state: State, t_us: int, key: int) -> None:
    pass  # the loop reads ``next_us``


@stands_in_for(seam.nothing_before)
def _nothing_before(state: State, key: int) -> Any:
    return not is_before(state, next_slot(state), state.now_us, key + 1)


@rule
def next_slot(state: State) -> int:
    """Return the slot of the next event; its time is NEVER if nothing is scheduled."""
    return state.winners[0]


@rule
def is_before(state: State, slot: int, t_us: int, key: int) -> bool:
    """Return whether the event of a slot is before ``t_us``, or then with a smaller key."""
    slot_us = state.slot_times[slot]
    return slot_us < t_us or (slot_us == t_us and state.slot_keys[slot] < key)
