"""The event queue of compiled code: slots, which are ordered by (time, key) in a tournament.

Each thing that can happen has a slot (see ``rules.due``), whose time is NEVER if it is not
scheduled. Match 1 of the tournament is the final, the winners of matches 2n and 2n + 1 meet in
match n, and numbers from the count of slots on denote the slots themselves. If a slot changes, its
matches are played again; their number is about the binary logarithm of the number of slots.
"""

from __future__ import annotations

from typing import Any

from desim_uav.model.compiled_registers import either
from desim_uav.model.kernels import rule, stands_in_for
from desim_uav.rules import due as seam
from desim_uav.rules.rows import State
from desim_uav.rules.words import NEVER


@stands_in_for(seam.nothing_due)
def _nothing_due(state: Any) -> Any:
    def clear(state: Any) -> None:
        times, keys, winners = state.slot_times, state.slot_keys, state.winners
        slots = len(times)
        for slot in range(slots):
            times[slot] = NEVER
            keys[slot] = 0
            winners[slots + slot] = slot
        for match in range(2 * slots - 2, 1, -2):
            winners[match // 2] = winners[match]

    return clear


@rule
def _meet(state: State, slot: int) -> None:
    """Play the matches of a slot that has changed.

    A match has no jump, because winners are unpredictable and mispredicted jumps take longer.
    """
    winners, times, keys = state.winners, state.slot_times, state.slot_keys
    t_us, key = times[slot], keys[slot]
    changed, node = slot, len(times) + slot
    while node > 1:
        other = winners[node ^ 1]
        t_other, other_key = times[other], keys[other]
        lost = (t_other < t_us) | ((t_other == t_us) & (other_key < key))
        t_us, key = either(lost, t_other, t_us), either(lost, other_key, key)
        slot = either(lost, other, slot)
        node >>= 1
        if slot != changed and winners[node] == slot:
            return
        winners[node] = slot


@stands_in_for(seam.due)
def _due(state: Any, slot: Any, t_us: Any, key: Any) -> Any:
    def due(state: Any, slot: Any, t_us: Any, key: Any) -> None:
        state.slot_times[slot] = t_us
        state.slot_keys[slot] = key
        _meet(state, slot)

    return due


@stands_in_for(seam.undo)
def _undo(state: Any, slot: Any) -> Any:
    def undo(state: Any, slot: Any) -> None:
        if state.slot_times[slot] != NEVER:
            state.slot_times[slot] = NEVER
            _meet(state, slot)

    return undo


@stands_in_for(seam.nothing_before)
def _nothing_before(state: Any, key: Any) -> Any:
    def nothing_before(state: Any, key: Any) -> Any:
        return not is_before(state, next_slot(state), state.now_us, key + 1)

    return nothing_before


@rule
def next_slot(state: State) -> int:
    """Return the slot of the next event; its time is NEVER if nothing is scheduled."""
    return state.winners[1]


@rule
def is_before(state: State, slot: int, t_us: int, key: int) -> bool:
    """Return whether the event of a slot is before ``t_us``, or then with a smaller key."""
    slot_us = state.slot_times[slot]
    return slot_us < t_us or (slot_us == t_us and state.slot_keys[slot] < key)
