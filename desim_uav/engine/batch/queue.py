"""What is to happen: slots, ordered by (time, key) in a tournament.

Whatever can happen has a slot of its own, so nothing is ever stale: what no longer comes is set to
NEVER. The slots play knock-out: match 1 is the final, the winners of matches 2n and 2n + 1 meet in
match n, and the numbers from SLOTS on stand for the slots themselves. A slot that changes plays its
matches again, as many as the logarithm of their number.
"""

from __future__ import annotations

from desim_uav.engine.batch.kernels import inner
from desim_uav.engine.batch.memory import (
    AT_SLOT_KEY,
    AT_SLOT_TIME,
    AT_WINNERS,
    NEVER,
    SLOTS,
    State,
)

COMPLETION, EXIT, ARRIVAL, ENTRY, REQUEST, DEPLETION = range(1, 7)
ATTACHMENT, RECORD, RESPAWN, COMMAND, COVERAGE, ADMISSION = range(7, 13)
"""The phases of one instant (see ``Phase``)."""


@inner
def key(phase: int, drone: int, user: int) -> int:
    """The place within an instant: by phase, drone, user (-1: none, first)."""
    return phase * (1 << 48) + (drone + 1) * (1 << 24) + user + 1


@inner
def clear_all(s: State) -> None:
    """Nothing is to happen."""
    slots = s.i[SLOTS]
    for slot in range(slots):
        s.i[s.i[AT_SLOT_TIME] + slot] = NEVER
        s.i[s.i[AT_SLOT_KEY] + slot] = 0
        s.i[s.i[AT_WINNERS] + slots + slot] = slot
    for match in range(2 * slots - 2, 1, -2):
        s.i[s.i[AT_WINNERS] + match // 2] = s.i[s.i[AT_WINNERS] + match]


@inner
def _meet(s: State, slot: int) -> None:
    """Play the matches of a slot that has changed.

    Without branches: who wins can't be foreseen, and a processor that guesses wrongly loses more.
    """
    winners, times, keys = s.i[AT_WINNERS], s.i[AT_SLOT_TIME], s.i[AT_SLOT_KEY]
    t_us, at = s.i[times + slot], s.i[keys + slot]
    changed, node = slot, s.i[SLOTS] + slot
    while node > 1:
        other = s.i[winners + (node ^ 1)]
        t_other, at_other = s.i[times + other], s.i[keys + other]
        lost = -int((t_other < t_us) | ((t_other == t_us) & (at_other < at)))  # all bits, or none
        t_us ^= (t_us ^ t_other) & lost
        at ^= (at ^ at_other) & lost
        slot ^= (slot ^ other) & lost
        node >>= 1
        if slot != changed and s.i[winners + node] == slot:
            return
        s.i[winners + node] = slot


@inner
def next_slot(s: State) -> int:
    """The slot of what happens next; its time is NEVER where nothing does."""
    return int(s.i[s.i[AT_WINNERS] + 1])


@inner
def is_before(s: State, slot: int, t_us: int, at: int) -> bool:
    """Does the thing of a slot come before a place in an instant?"""
    t_slot = s.i[s.i[AT_SLOT_TIME] + slot]
    return bool(t_slot < t_us or (t_slot == t_us and s.i[s.i[AT_SLOT_KEY] + slot] < at))


@inner
def due(s: State, slot: int, t_us: int, at: int) -> None:
    """Let the thing of a slot happen at a time, in a place of that instant."""
    s.i[s.i[AT_SLOT_TIME] + slot] = t_us
    s.i[s.i[AT_SLOT_KEY] + slot] = at
    _meet(s, slot)


@inner
def undo(s: State, slot: int) -> None:
    """The thing of a slot will not happen."""
    if s.i[s.i[AT_SLOT_TIME] + slot] != NEVER:
        s.i[s.i[AT_SLOT_TIME] + slot] = NEVER
        _meet(s, slot)
