"""What is to happen: a binary heap of slots, ordered by (time, key).

Whatever can happen has a slot of its own, so nothing in the heap is ever stale: what no longer
comes is taken out.
"""

from __future__ import annotations

from desim_uav.engine.batch.kernels import inner
from desim_uav.engine.batch.memory import (
    AT_HEAP,
    AT_PLACE_OF,
    AT_SLOT_KEY,
    AT_SLOT_TIME,
    HEAPED,
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
    s.i[HEAPED] = 0
    for slot in range(s.i[SLOTS]):
        s.i[s.i[AT_SLOT_TIME] + slot] = NEVER
        s.i[s.i[AT_PLACE_OF] + slot] = -1


@inner
def _before(s: State, one: int, other: int) -> bool:
    t_one, t_other = s.i[s.i[AT_SLOT_TIME] + one], s.i[s.i[AT_SLOT_TIME] + other]
    if t_one != t_other:
        return bool(t_one < t_other)
    return bool(s.i[s.i[AT_SLOT_KEY] + one] < s.i[s.i[AT_SLOT_KEY] + other])


@inner
def _up(s: State, child: int) -> None:
    heap, place_of = s.i[AT_HEAP], s.i[AT_PLACE_OF]
    slot = s.i[heap + child]
    while child > 0:
        parent = (child - 1) // 2
        above = s.i[heap + parent]
        if not _before(s, slot, above):
            break
        s.i[heap + child] = above
        s.i[place_of + above] = child
        child = parent
    s.i[heap + child] = slot
    s.i[place_of + slot] = child


@inner
def _down(s: State, parent: int) -> None:
    heap, place_of = s.i[AT_HEAP], s.i[AT_PLACE_OF]
    count = s.i[HEAPED]
    slot = s.i[heap + parent]
    while True:
        child = 2 * parent + 1
        if child >= count:
            break
        if child + 1 < count and _before(s, s.i[heap + child + 1], s.i[heap + child]):
            child += 1
        below = s.i[heap + child]
        if not _before(s, below, slot):
            break
        s.i[heap + parent] = below
        s.i[place_of + below] = parent
        parent = child
    s.i[heap + parent] = slot
    s.i[place_of + slot] = parent


@inner
def is_next(s: State, t_us: int, at: int) -> bool:
    """Does nothing happen before this place in this instant, nor just there?"""
    if s.i[HEAPED] == 0:
        return True
    first = s.i[s.i[AT_HEAP]]
    t_first = s.i[s.i[AT_SLOT_TIME] + first]
    return bool(t_first > t_us or (t_first == t_us and s.i[s.i[AT_SLOT_KEY] + first] > at))


@inner
def due(s: State, slot: int, t_us: int, at: int) -> None:
    """Let the thing of a slot happen at a time, in a place of that instant."""
    s.i[s.i[AT_SLOT_TIME] + slot] = t_us
    s.i[s.i[AT_SLOT_KEY] + slot] = at
    place = s.i[s.i[AT_PLACE_OF] + slot]
    if place < 0:
        place = s.i[HEAPED]
        s.i[HEAPED] = place + 1
        s.i[s.i[AT_HEAP] + place] = slot
        s.i[s.i[AT_PLACE_OF] + slot] = place
        _up(s, place)
    else:
        _up(s, place)
        _down(s, s.i[s.i[AT_PLACE_OF] + slot])


@inner
def undo(s: State, slot: int) -> None:
    """The thing of a slot will not happen."""
    place = s.i[s.i[AT_PLACE_OF] + slot]
    if place < 0:
        return
    last = s.i[HEAPED] - 1
    s.i[HEAPED] = last
    s.i[s.i[AT_PLACE_OF] + slot] = -1
    s.i[s.i[AT_SLOT_TIME] + slot] = NEVER
    if place < last:
        moved = s.i[s.i[AT_HEAP] + last]
        s.i[s.i[AT_HEAP] + place] = moved
        s.i[s.i[AT_PLACE_OF] + moved] = place
        _up(s, place)
        _down(s, s.i[s.i[AT_PLACE_OF] + moved])
