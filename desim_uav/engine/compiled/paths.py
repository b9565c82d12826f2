"""Sample paths in the memory of compiled code: those of several episodes in one block."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.demand import ManyRequests, Requests
from desim_uav.model.mobility import ManyRandomWalks, RandomWalks, Walks
from desim_uav.model.rows import Words
from desim_uav.rules.rows import Path
from desim_uav.sample_path import SamplePaths


class Section(NamedTuple):
    """Numbers of all episodes, end to end: what is not random stands there once.

    ``begins`` and ``counts``: where those of each episode begin, and how many there are.
    """

    parts: list[NDArray[Any]]
    begins: Sequence[int]
    counts: Sequence[int]


def paths_of(paths: SamplePaths) -> tuple[Words, NDArray[np.int64]]:
    """Return sample paths in one block, and the word at which each one's row begins."""
    at_random, legs_at, legs, streams = _walking(paths.walking)
    asks, asks_at = _requests(paths.requests)
    episodes, drawn = len(paths.episodes), paths.respawn.shape[2]
    rows = [[after, at_random, drawn] for after in _after_previous(paths.requests)]
    at, parts = episodes * Path.words, []
    # In the order of the tables of Path, of whose rows asks have four words.
    sections = (asks, asks_at, legs, legs_at, streams, _block(paths.respawn), _errors(paths))
    for columns, section in zip((4, 1, 1, 1, 1, 1, 1), sections, strict=True):
        for k, row in enumerate(rows):
            row.append(8 * (at + section.begins[k] - k * Path.words))
            row.append(section.counts[k] // columns)
        for part in section.parts:
            parts.append(part.view(np.int64) if part.dtype == np.float64 else part)
            at += part.size
    header = np.array(rows, np.int64).reshape(-1)
    return np.concatenate([header, *parts], dtype=np.int64), Path.words * np.arange(episodes)


def _block(numbers: NDArray[Any]) -> Section:
    """As many numbers per episode."""
    count = len(numbers)
    size = numbers.size // count
    parts = [np.ascontiguousarray(numbers).reshape(-1)]
    return Section(parts, [k * size for k in range(count)], [size] * count)


def _listed(arrays: Sequence[NDArray[Any]]) -> Section:
    """An array per episode, or always the same."""
    count, first = len(arrays), arrays[0]
    if all(array is first for array in arrays):
        return Section([np.ascontiguousarray(first).reshape(-1)], [0] * count, [first.size] * count)
    flat = [np.ascontiguousarray(array).reshape(-1) for array in arrays]
    sizes = [array.size for array in flat]
    return Section(flat, [0, *accumulate(sizes[:-1])], sizes)


def _walking(walking: Sequence[Walks | RandomWalks]) -> tuple[bool, Section, Section, Section]:
    """Return whether users walk at random, the offsets of legs, the legs, and users' streams."""
    none = _nothing(len(walking))
    if isinstance(walking, ManyRandomWalks):
        return True, none, none, _block(walking.states.view(np.int64))
    states = [own.states.view(np.int64) for own in walking if isinstance(own, RandomWalks)]
    if states:
        return True, none, none, _listed(states)
    walks = [own.drawn() for own in walking]
    return (
        False,
        _listed([own.offsets for own in walks]),
        _listed([own.legs for own in walks]),
        none,
    )


def _requests(requests: Sequence[Requests]) -> tuple[Section, Section]:
    """Return the rows, and their offsets."""
    if isinstance(requests, ManyRequests):
        columns = requests.rows.shape[1]
        begins = [columns * begin for begin in requests.begins]
        counts = [columns * int(own[-1]) for own in requests.offsets]
        return Section([requests.rows.reshape(-1)], begins, counts), _block(requests.offsets)
    return _listed([own.rows for own in requests]), _listed([own.offsets for own in requests])


def _after_previous(requests: Sequence[Requests]) -> Sequence[bool]:
    if isinstance(requests, ManyRequests):
        return [requests.after_previous] * len(requests)
    return [own.after_previous for own in requests]


def _errors(paths: SamplePaths) -> Section:
    if paths.position_error is None:
        return _nothing(len(paths.episodes))
    return _block(paths.position_error)


def _nothing(count: int) -> Section:
    return Section([], [0] * count, [0] * count)
