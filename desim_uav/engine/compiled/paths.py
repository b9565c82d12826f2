"""Sample paths in the memory of compiled code: those of several episodes in one block."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import repeat
from operator import is_
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.demand.requests import DRAWN, ManyRequests, Requests
from desim_uav.model.mobility.walking import ManyRowWalks, RowWalks
from desim_uav.model.mobility.walks import Walks
from desim_uav.rowcode.kernels import kernel
from desim_uav.rowcode.rows import Words
from desim_uav.rowcode.rows import place as place_of
from desim_uav.rules.rows import Ask, Path
from desim_uav.sample_path import SamplePaths

T = TypeVar("T")


class TableSection(NamedTuple):
    """The entries of one table in all episodes, end to end, or once if they are always the same.

    ``begins`` and ``counts`` are the index of the first entry of each episode and their number:
    arrays (episodes,) of whole numbers, or one number for all episodes.
    """

    parts: list[NDArray[Any]]
    begins: NDArray[np.int64] | int
    counts: NDArray[np.int64] | int


NOTHING = TableSection([], 0, 0)


TABLES = (Ask.words, 1, 1, 1, 1, 1, 1, 1, 1, 1)
"""The words of an entry of each table of a Path: a row of asks has two, other entries one."""


def paths_of(paths: SamplePaths) -> tuple[Words, NDArray[np.int64]]:
    """Return sample paths in one block, and the word at which each one's row begins."""
    rows, sections = _rows_and_sections(paths)
    starts = Path.words * np.arange(len(rows))
    at, place, parts = rows.size, 2, []
    for columns, section in zip(TABLES, sections, strict=True):
        if section is NOTHING:
            rows[:, place : place + 2] = 0
        else:
            rows[:, place] = 8 * (at + section.begins - starts)
            rows[:, place + 1] = section.counts // columns
        place += 2
        for part in section.parts:
            parts.append(_as_words(part))
            at += part.size
    return np.concatenate([rows.reshape(-1), *parts], dtype=np.int64), starts


def blocks_of(paths: SamplePaths) -> tuple[list[Words], NDArray[np.int64]]:
    """Return sample paths in a block of memory each, and the addresses of these blocks.

    A block may be copied and kept on its own. All are parts of one array, which exists as long as
    one of them does.
    """
    rows, sections = _rows_and_sections(paths)
    episodes = len(rows)
    begins, sizes = np.empty((2, len(sections), episodes), np.int64)
    for number, section in enumerate(sections):
        begins[number], sizes[number] = section.begins, section.counts
    lengths = Path.words + sizes.sum(axis=0)
    ends = np.cumsum(lengths)
    starts = ends - lengths
    block, at, place = np.empty(ends[-1], np.int64), np.full(episodes, Path.words), 2
    for columns, section, begin, counts in zip(TABLES, sections, begins, sizes, strict=True):
        rows[:, place], rows[:, place + 1] = 8 * at, counts // columns
        place += 2
        if section.parts:
            _copy_parts(_joined(section), begin, counts, block, starts + at)
        at += counts
    _copy_parts(
        rows.reshape(-1),
        Path.words * np.arange(episodes),
        np.full(episodes, Path.words),
        block,
        starts,
    )
    bounds = zip(starts.tolist(), ends.tolist(), strict=True)
    return [block[start:end] for start, end in bounds], place_of(block) + 8 * starts


@kernel
def _copy_parts(
    source: Words,
    begins: NDArray[np.int64],
    counts: NDArray[np.int64],
    block: Words,
    at: NDArray[np.int64],
) -> None:
    """Copy ``counts`` (episodes,) words from ``source``, from ``begins`` on, to ``at``."""
    for k in range(len(counts)):
        for word in range(counts[k]):
            block[at[k] + word] = source[begins[k] + word]


def _joined(section: TableSection) -> Words:
    """Return the entries of a section as words, end to end."""
    words = [_as_words(part) for part in section.parts]
    return words[0] if len(words) == 1 else np.concatenate(words)


def _as_words(part: NDArray[Any]) -> Words:
    return part.view(np.int64) if part.dtype == np.float64 else part.astype(np.int64, copy=False)


def _rows_and_sections(paths: SamplePaths) -> tuple[NDArray[np.int64], tuple[TableSection, ...]]:
    """Return rows of Path whose tables are still to be set, and their sections in order."""
    stepwise, legs_at, legs, streams = _walking(paths.walking)
    asks, drawn, asks_at = _requests(paths.requests)
    rows = np.empty((len(paths.episodes), Path.words), np.int64)
    rows[:, 0], rows[:, 1] = stepwise, paths.respawn.shape[2]
    respawns, keys, follows = _block(paths.respawn), _keys(paths.link_keys), _follows(paths)
    errors = _errors(paths)
    return rows, (asks, drawn, asks_at, legs, legs_at, streams, respawns, errors, keys, follows)


def _block(numbers: NDArray[Any]) -> TableSection:
    """Return a section of an array whose first dimension is the episode."""
    count = len(numbers)
    size = numbers.size // count
    parts = [np.ascontiguousarray(numbers).reshape(-1)]
    return TableSection(parts, size * np.arange(count), size)


def _once(parts: Sequence[T]) -> Sequence[T]:
    """Return what has been drawn for each episode, or one of them if it is the same object."""
    return parts[:1] if all(map(is_, parts, repeat(parts[0]))) else parts


def _listed(arrays: Sequence[NDArray[Any]]) -> TableSection:
    """Return a section of one array per episode; an array that is always the same stands once."""
    arrays = _once(arrays)
    if len(arrays) == 1:
        return TableSection([np.ascontiguousarray(arrays[0]).reshape(-1)], 0, arrays[0].size)
    flat = [np.ascontiguousarray(array).reshape(-1) for array in arrays]
    sizes = np.array([array.size for array in flat])
    return TableSection(flat, np.cumsum(sizes) - sizes, sizes)


def _walking(
    walking: Sequence[Walks | RowWalks],
) -> tuple[bool, TableSection, TableSection, TableSection]:
    """Return whether users walk step by step, the offsets of legs, the legs, and users' streams."""
    if isinstance(walking, ManyRowWalks):
        return True, NOTHING, NOTHING, _block(walking.states.view(np.int64))
    walking = _once(walking)
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


def _requests(requests: Sequence[Requests]) -> tuple[TableSection, TableSection, TableSection]:
    """Return the sections of the requests, of the values that they draw, and of their offsets."""
    if isinstance(requests, ManyRequests):
        begins, counts = np.array(requests.begins), requests.offsets[:, -1]
        asks, drawn = (
            TableSection([part.reshape(-1)], part.shape[1] * begins, part.shape[1] * counts)
            for part in (requests.asks, requests.drawn)
        )
        return asks, drawn, _block(requests.offsets)
    requests = _once(requests)
    return (
        _listed([own.rows[:, :DRAWN] for own in requests]),
        _listed([own.rows[:, DRAWN:] for own in requests]),
        _listed([own.offsets for own in requests]),
    )


def _follows(paths: SamplePaths) -> TableSection:
    """Return the section of ``Requests.follows``."""
    requests = paths.requests
    if isinstance(requests, ManyRequests):
        return _listed([requests.follows])
    return _listed([own.follows for own in _once(requests)])


def _keys(keys: NDArray[np.uint64]) -> TableSection:
    """Return the section of the keys of links' draws, which is empty without any."""
    return _block(keys.view(np.int64)) if keys.any() else NOTHING


def _errors(paths: SamplePaths) -> TableSection:
    """Return the section of the position errors, which is empty without noise."""
    if paths.position_error is None:
        return NOTHING
    return _block(paths.position_error)
