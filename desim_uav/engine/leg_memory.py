"""The memory of legs that were flown before (see ``sky.leg_memory``), of which each thread has one.

It belongs to no world and to no environment: a kernel that uses it is told first where it is. It is
therefore neither copied nor saved, and two threads never write to the same one.
"""

from __future__ import annotations

import threading

from desim_uav.rowcode.rows import place
from desim_uav.sky.leg_memory import COUNT, new_memory

WORDS = 2**23
"""How long the memory of a thread is: 64 MiB, of which the system gives what is written to."""


class _OfThread(threading.local):
    """The memory of a thread, and its address."""

    def __init__(self) -> None:
        self.memory = new_memory(WORDS)
        self.address = place(self.memory)


_own = _OfThread()


def memory_of_legs() -> int:
    """Return the address of the memory of this thread, for the call of a kernel."""
    return _own.address


def known_legs() -> int:
    """Return how many legs there are in the memory of this thread."""
    return int(_own.memory[COUNT])
