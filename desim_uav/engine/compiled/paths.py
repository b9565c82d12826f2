"""Sample paths in the memory of compiled code: those of several episodes in one block."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.asking import ManyRequests, Requests
from desim_uav.model.rows import Words
from desim_uav.model.walking import ManyRowWalks, RowWalks, Walks
from desim_uav.rules.rows import Path
from desim_uav.sample_path import SamplePaths


class Section(NamedTuple):
    """The entries of one table in all episodes, end to end, or once if they are always the same.

    ``begins`` and ``counts`` are the index of the first entry of each episode and their number:
    arrays (episodes,) of whole numbers, or one number for all episodes.
    """

    parts: list[NDArray[Any]]
    begins: Any
    counts: Any


NOTHING = Section([], 0, 0)


def paths_of(paths: SamplePaths) -> tuple[Words, NDArray[np.int64]]:
    """Return sample paths in one block, and the word at which each one's row begins."""
    stepwise, legs_at, legs, streams = _walking(paths.walking)
    asks, asks_at = _requests(paths.requests)
    episodes, drawn = len(paths.episodes), paths.respawn.shape[2]
    rows = np.empty((episodes, Path.words), np.int64)
    rows[:, 0], rows[:, 1], rows[:, 2] = _after_previous(paths.requests), stepwise, drawn
    starts = Path.words * np.arange(episodes)
    at, place, parts = rows.size, 3, []
    # The order is that of the tables of Path. A row of asks has four words, other entries one.
    respawns, keys = _block(paths.respawn), _keys(paths.link_keys)
    sections = (asks, asks_at, legs, legs_at, streams, respawns, _errors(paths), keys)
    for columns, section in zip((4, 1, 1, 1, 1, 1, 1, 1), sections, strict=True):
        if section is NOTHING:
            rows[:, place : place + 2] = 0
        else:
            rows[:, place] = 8 * (at + section.begins - starts)
            rows[:, place + 1] = section.counts // columns
        place += 2
        for part in section.parts:
            parts.append(part.view(np.int64) if part.dtype == np.float64 else part)
            at += part.size
    return np.concatenate([rows.reshape(-1), *parts], dtype=np.int64), starts


def _block(numbers: NDArray[Any]) -> Section:
    """Return a section of an array whose first dimension is the episode."""
    count = len(numbers)
    size = numbers.size // count
    parts = [np.ascontiguousarray(numbers).reshape(-1)]
    return Section(parts, size * np.arange(count), size)


def _listed(arrays: Sequence[NDArray[Any]]) -> Section:
    """Return a section of one array per episode; an array that is always the same stands once."""
    first = arrays[0]
    if all(array is first for array in arrays):
        return Section([np.ascontiguousarray(first).reshape(-1)], 0, first.size)
    flat = [np.ascontiguousarray(array).reshape(-1) for array in arrays]
    sizes = np.array([array.size for array in flat])
    return Section(flat, np.cumsum(sizes) - sizes, sizes)


def _walking(walking: Sequence[Walks | RowWalks]) -> tuple[bool, Section, Section, Section]:
    """Return whether users walk step by step, the offsets of legs, the legs, and users' streams."""
    if isinstance(walking, ManyRowWalks):
        return True, NOTHING, NOTHING, _block(walking.states.view(np.int64))
    states = [own.states.view(np.int64) for own in walking if isinstance(own, RowWalks)]
    if states:
        return True, NOTHING, NOTHING, _listed(states)
    walks = [own.drawn() for own in walking]
    return (
        False,
        _listed([own.offsets for own in walks]),
        _listed([own.legs for own in walks]),
        NOTHING,
    )


def _requests(requests: Sequence[Requests]) -> tuple[Section, Section]:
    """Return the sections of the requests' rows and of their offsets."""
    if isinstance(requests, ManyRequests):
        columns = requests.rows.shape[1]
        begins = columns * np.array(requests.begins)
        counts = columns * requests.offsets[:, -1]
        return Section([requests.rows.reshape(-1)], begins, counts), _block(requests.offsets)
    return _listed([own.rows for own in requests]), _listed([own.offsets for own in requests])


def _after_previous(requests: Sequence[Requests]) -> Sequence[bool]:
    """Return ``Requests.after_previous`` of each episode."""
    if isinstance(requests, ManyRequests):
        return [requests.after_previous] * len(requests)
    return [own.after_previous for own in requests]


def _keys(keys: NDArray[np.uint64]) -> Section:
    """Return the section of the keys of links' draws, which is empty without any."""
    return _block(keys.view(np.int64)) if keys.any() else NOTHING


def _errors(paths: SamplePaths) -> Section:
    """Return the section of the position errors, which is empty without noise."""
    if paths.position_error is None:
        return NOTHING
    return _block(paths.position_error)
