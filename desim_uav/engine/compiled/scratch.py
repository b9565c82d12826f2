"""Scratch: memory that means nothing between two calls, of which each thread has one.

Rows list the tables of it (``Row.scratch``). A state knows how long they are and where they lie in
scratch; each call of a kernel that needs them first says where the scratch of its thread is. The
word before it says where the thread's memory of legs is (``engine.leg_memory``).
"""

from __future__ import annotations

import threading

import numpy as np

from desim_uav.engine.leg_memory import memory_of_legs
from desim_uav.rowcode.compiled_rows import array_at, place_of
from desim_uav.rowcode.kernels import rule
from desim_uav.rowcode.packing import headers_of
from desim_uav.rowcode.rows import Words, place
from desim_uav.rules.rows import State
from desim_uav.sky.rows import Sky

HEADERS = headers_of(State)
"""The words of a state that say where its tables in scratch are, relative to their rows."""

NEEDS = (State.byte_of["sky"] + Sky.byte_of["scratch_words"]) // 8
"""The word of a state that says how many words of scratch it needs."""

WORDS = State.words

words_at = array_at(int)


class _OfThread(threading.local):
    """The scratch of a thread: its address, and the memory there, which only grows.

    ``most`` words are the most that a state of any thread has needed so far.
    """

    most = 0
    address = 0

    def __init__(self) -> None:
        self.blocks = [np.zeros(0, np.int64)]


_own = _OfThread()
_one_at_a_time = threading.Lock()


def need(memory: Words) -> None:
    """Let all scratch suffice for a state in memory, from the next calls of kernels on."""
    with _one_at_a_time:  # two threads may make engines at the same time
        _OfThread.most = max(_OfThread.most, int(memory[NEEDS]))


def scratch() -> int:
    """Return the address of the scratch of this thread, for the call of a kernel."""
    if len(_own.blocks[-1]) <= _OfThread.most:
        block: Words = np.zeros(1 + 2 * _OfThread.most, np.int64)
        block[0] = memory_of_legs()
        # The smaller ones stay, because states may still have their addresses.
        _own.blocks.append(block)
        _own.address = place(block) + 8
    return _own.address


@rule
def use_scratch(state: State, scratch: int) -> None:
    """Let the tables of a state be in the scratch at an address, and forget what they may hold.

    A state may have been copied or moved since its last call, which may also have been in another
    thread. ``Sky.scratch_at`` is where scratch was then, relative to the state, so that nothing has
    to be done if it is still there.
    """
    sky, words = state.sky, words_at(place_of(state), WORDS)
    moved = scratch - place_of(state) - sky.scratch_at
    if moved != 0:
        for header in HEADERS:
            words[header] += moved
        sky.scratch_at += moved
    sky.leg_memory = words_at(scratch - 8, 1)[0]
    sky.from_us = sky.to_us = state.look.walked_us = -1
