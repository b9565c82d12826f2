"""Fetching the next environment's memory into the processor's caches while one is stepped.

The states of many environments do not fit in the caches. A processor drops a request to fetch
memory if too many of them wait, so they are made a few at a time: before a step, with each of its
events, and after it.
"""

from __future__ import annotations

from desim_uav.rowcode.compiled_registers import prefetch
from desim_uav.rowcode.kernels import rare_rule
from desim_uav.rules.rows import Path, State

CACHE_LINE = 64
"""The bytes that most processors fetch at once."""

AT_ONCE = 32 * CACHE_LINE
"""The bytes that are fetched with an event."""

PATH = 8 * Path.words
"""The bytes at the beginning of a sample path, which say where its tables are."""


@rare_rule
def begin_fetching(state: State, path: int, next_state: int, size: int) -> None:
    """Begin to fetch a sample path and the first ``size`` bytes of a state, at these addresses.

    They are fetched while ``state`` is stepped.
    """
    state.fetch_at, state.fetch_end = path, path + PATH
    fetch(state)
    state.fetch_at, state.fetch_end = next_state, next_state + size
    fetch(state)


@rare_rule
def fetch(state: State) -> None:
    """Fetch AT_ONCE more bytes, or those that are left."""
    end = min(state.fetch_at + AT_ONCE, state.fetch_end)
    for line in range(state.fetch_at, end, CACHE_LINE):
        prefetch(line)
    state.fetch_at = end


@rare_rule
def end_fetching(state: State) -> None:
    """Fetch what is left, at the end of a step."""
    for line in range(state.fetch_at, state.fetch_end, CACHE_LINE):
        prefetch(line)
    state.fetch_at = state.fetch_end = 0
