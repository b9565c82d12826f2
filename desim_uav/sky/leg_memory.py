"""A memory of the changes of class on legs that were flown before, over users who stand at home.

What changes on such a leg depends on nothing but the world, the leg, how long it is looked at, and
the classes that links have before; so does how long after the start it changes. Legs from cell to
cell are flown again and again.

The memory is a block of words, of which each thread has one. Words SIZE to DRAFT say how many words
there are, where the next leg is written, how many legs there are, and where the key of the leg ends
that was asked for and is not known (0: there is none). The slots follow: they hold the first words
of legs by a hash of their keys. Then come the legs: the key, the number of changes, and a word for
each of them. If there is no room for a leg, all are forgotten.
"""

from __future__ import annotations

import numpy as np

from desim_uav.model.radio.links import changes_at
from desim_uav.rowcode.compiled_rows import entries_at
from desim_uav.rowcode.kernels import kernel, rule
from desim_uav.rowcode.rows import Table, Words
from desim_uav.sky.memory import scene_at, sky_at
from desim_uav.sky.rows import Change, LegRow, Scene, Sky

SIZE, END, COUNT, DRAFT, HEAD = range(5)

SLOTS = 2**16
"""The number of slots, of which at most a half are used."""

LEGS_AT = HEAD + SLOTS
"""The number of the word at which the first leg begins."""

OF_LEG = 15
"""The words of a key without the classes: its hash, and what identifies the leg."""

FACTOR = 6364136223846793005
"""The multiplier of a hash (Knuth's for linear congruential generators)."""

IN_WORD, CLASS_BITS = 8, 8
"""So many classes, of so many bits each, are in a word."""

USER_BITS, CHANGE_BITS, TIME_BITS = 20, 8, 35
"""The bits of a change: its user, its class, and its time since the start, in microseconds."""

SIGNED = 2 ** (CHANGE_BITS - 1)
"""What is added to the class of a change, so that it is not below 0."""

_words_at, _floats_at = entries_at(int), entries_at(float)


def new_memory(words: int) -> Words:
    """Return a memory of so many words, more than LEGS_AT, in which there is no leg yet."""
    memory: Words = np.zeros(words, np.int64)
    memory[SIZE], memory[END] = words, LEGS_AT
    return memory


@kernel
def recall_leg(
    scene: int, sky: int, out: int, room: int, sender: int, start_us: int, until_us: int
) -> int:
    """Write the changes on a sender's leg to ``out`` if they are known, and return their number.

    They are those that ``links.foresee_in_air`` would write, of which only so many are written as
    there is ``room`` for. The number is -1 if they are not known; then ``remember_leg`` may follow,
    before this thread asks for another leg. The sky must have the sender's leg and the classes that
    its links have now. All users must stand at home, and nothing may interfere or be drawn.
    """
    at, own, span = scene_at(scene), sky_at(sky), (start_us, until_us)
    memory = _memory_of(own)
    memory[DRAFT] = 0
    if not _fits(at, own.legs[sender], until_us - start_us):
        return -1
    length = OF_LEG + (len(at.groups) + IN_WORD - 1) // IN_WORD
    if memory[END] + length >= len(memory):
        _forget(memory)
        if memory[END] + length >= len(memory):
            return -1
    _write_key(at, own, sender, span)
    known = memory[_slot(memory, length)]
    if known == 0:
        memory[DRAFT] = memory[END] + length
        return -1
    first, changes = known + length + 1, changes_at(out, room)
    count = memory[first - 1]
    for k in range(min(count, room)):
        _unpack(memory[first + k], start_us, changes[k])
    return count


@kernel
def remember_leg(sky: int, out: int, count: int, start_us: int) -> None:
    """Keep the changes on the leg that was asked for last, which are not known.

    There are ``count`` of them at ``out``, and the leg is looked at from ``start_us`` on.
    """
    memory = _memory_of(sky_at(sky))
    begin, end = memory[END], memory[DRAFT]
    memory[DRAFT] = 0
    if end == 0:
        return
    if end + 1 + count > len(memory) or 2 * memory[COUNT] >= SLOTS:
        _forget(memory)
        return
    changes = changes_at(out, count)
    memory[end] = count
    for k in range(count):
        memory[end + 1 + k] = _packed(changes[k], start_us)
    memory[_slot(memory, end - begin)] = begin
    memory[END] = end + 1 + count
    memory[COUNT] += 1


@rule
def _memory_of(sky: Sky) -> Table[int]:
    """Return the memory of this thread."""
    memory: Table[int] = _words_at(sky.leg_memory, _words_at(sky.leg_memory, 1)[SIZE])
    return memory


@rule
def _fits(scene: Scene, leg: LegRow, lasts_us: int) -> bool:
    """Return whether all classes and changes on a leg fit in the bits for them."""
    users, classes = len(scene.groups), scene.radios[leg.radio].classes
    return bool(users <= 2**USER_BITS and classes < SIGNED and lasts_us < 2**TIME_BITS)


@rule
def _forget(memory: Table[int]) -> None:
    """Forget all legs."""
    memory[END], memory[COUNT] = LEGS_AT, 0
    for slot in range(HEAD, LEGS_AT):
        memory[slot] = 0


@rule
def _write_key(scene: Scene, sky: Sky, sender: int, span_us: tuple[int, int]) -> None:
    """Write the key of a leg behind all legs in memory; its first word is the hash.

    Places are compared as they lie in memory, so that no two different ones are alike.
    """
    memory, leg = _memory_of(sky), sky.legs[sender]
    floats, at = _floats_at(sky.leg_memory, len(memory)), memory[END]
    memory[at + 1], memory[at + 2], memory[at + 3] = scene.number, leg.radio, leg.transit
    memory[at + 4], memory[at + 5], memory[at + 6] = leg.level, leg.to_level, leg.serving
    memory[at + 7], memory[at + 8] = leg.since_us - span_us[0], span_us[1] - span_us[0]
    floats[at + 9], floats[at + 10], floats[at + 11] = leg.x0_m, leg.y0_m, leg.z0_m
    floats[at + 12], floats[at + 13], floats[at + 14] = leg.x1_m, leg.y1_m, leg.z1_m
    users, word = len(scene.groups), at + OF_LEG
    for user in range(0, users, IN_WORD):
        classes, first = 0, sender * users + user
        for k in range(min(IN_WORD, users - user)):
            classes |= sky.held[first + k] << (CLASS_BITS * k)
        memory[word] = classes
        word += 1
    mixed = 0
    for k in range(at + 1, word):
        mixed = (mixed ^ memory[k]) * FACTOR
        mixed ^= mixed >> 32
    memory[at] = mixed


@rule
def _slot(memory: Table[int], length: int) -> int:
    """Return the slot of the leg whose key was written last, or an empty one where it belongs."""
    begin = memory[END]
    slot = memory[begin] & (SLOTS - 1)
    while memory[HEAD + slot] != 0 and not _is_at(memory, memory[HEAD + slot], begin, length):
        slot = (slot + 1) & (SLOTS - 1)
    return HEAD + slot


@rule
def _is_at(memory: Table[int], leg: int, begin: int, length: int) -> bool:
    """Return whether the key of a leg is that at ``begin``."""
    k = 0
    while k < length and memory[leg + k] == memory[begin + k]:
        k += 1
    return k == length


@rule
def _packed(change: Change, start_us: int) -> int:
    """Return a change as a word."""
    of_user = (change.user << CHANGE_BITS) | (change.change + SIGNED)
    return int(((change.t_us - start_us) << (USER_BITS + CHANGE_BITS)) | of_user)


@rule
def _unpack(word: int, start_us: int, out: Change) -> None:
    """Write a change, which is in a word."""
    out.t_us = start_us + (word >> (USER_BITS + CHANGE_BITS))
    out.user = (word >> CHANGE_BITS) & (2**USER_BITS - 1)
    out.change = (word & (2**CHANGE_BITS - 1)) - SIGNED
