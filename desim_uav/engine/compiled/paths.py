"""Sample paths in the memory of compiled code: those of several episodes in one block."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import repeat
from operator import is_
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.demand.requests import DRAWN, DUE_US, SERVICE, ManyRequests, Requests
from desim_uav.model.mobility.walking import ManyRowWalks, RowWalks
from desim_uav.model.mobility.walks import Walks
from desim_uav.rowcode.kernels import kernel
from desim_uav.rowcode.rows import Fitted, Table, Words, held_by, origin_of, size_of
from desim_uav.rowcode.rows import place as place_of
from desim_uav.rules.rows import Path
from desim_uav.sample_path import SamplePaths

T = TypeVar("T")


class TableSection(NamedTuple):
    """The numbers of one table in all episodes, end to end, or once if they are always the same.

    ``begins`` and ``counts`` are the index of the first number of each episode and how many there
    are: arrays (episodes,) of whole numbers, or one number for all episodes.
    """

    parts: list[NDArray[Any]]
    begins: NDArray[np.int64] | int
    counts: NDArray[np.int64] | int


NOTHING = TableSection([], 0, 0)

TABLES = [name for name, kind in Path.kinds.items() if origin_of(kind) is Table]
HEADERS = [Path.byte_of[name] // 4 for name in TABLES]
"""The numbers of 32 bits of a Path with which its tables begin (``rowcode.rows.NEAR_WORDS``)."""
WIDTHS = [size_of(held_by(Path.kinds[name])) // 8 for name in TABLES]
"""How many numbers an entry of these tables has."""
FITTED = [held_by(Path.kinds[name]) is Fitted for name in TABLES]
"""Whether the numbers of these tables may have 32 bits."""


def paths_of(paths: SamplePaths) -> tuple[Words, NDArray[np.int64]]:
    """Return sample paths in one block, and the word at which each one's row begins.

    All numbers have 64 bits there, and what is always the same stands there once.
    """
    rows, sections = _rows_and_sections(paths)
    starts, halves = Path.words * np.arange(len(rows)), rows.view(np.int32)
    at, parts = rows.size, []
    for header, width, section in zip(HEADERS, WIDTHS, sections, strict=True):
        if section is not NOTHING:
            halves[:, header] = at + section.begins - starts
            halves[:, header + 1] = section.counts // width
        for part in section.parts:
            parts.append(_as_words(part))
            at += part.size
    return np.concatenate([rows.reshape(-1), *parts], dtype=np.int64), starts


def blocks_of(paths: SamplePaths) -> tuple[list[Words], NDArray[np.int64]]:
    """Return sample paths in a block of memory each, and the addresses of these blocks.

    A block may be copied and kept on its own. All are parts of one array, which exists as long as
    one of them does. Numbers have 32 bits if those of all episodes fit.
    """
    rows, sections = _rows_and_sections(paths)
    episodes, halves = len(rows), rows.view(np.int32)
    begins, counts, sizes = np.empty((3, len(sections), episodes), np.int64)
    narrow = []
    for k, (section, fitted) in enumerate(zip(sections, FITTED, strict=True)):
        begins[k], counts[k] = section.begins, section.counts
        narrow.append(fitted and all(map(_fits, section.parts)))
        sizes[k] = (counts[k] + 1) // 2 if narrow[k] else counts[k]
    lengths = Path.words + sizes.sum(axis=0)
    ends = np.cumsum(lengths)
    starts = ends - lengths
    block, at = np.zeros(ends[-1], np.int64), np.full(episodes, Path.words)
    of_32_bits = block.view(np.int32)
    for k, (header, section) in enumerate(zip(HEADERS, sections, strict=True)):
        rows_of = counts[k] // WIDTHS[k]
        halves[:, header], halves[:, header + 1] = at, -1 - rows_of if narrow[k] else rows_of
        if section.parts:
            target, first = (of_32_bits, 2 * (starts + at)) if narrow[k] else (block, starts + at)
            _copy_parts(_joined(section), begins[k], counts[k], target, first)
        at += sizes[k]
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
    block: NDArray[Any],
    at: NDArray[np.int64],
) -> None:
    """Copy ``counts`` (episodes,) numbers from ``source``, from ``begins`` on, to ``at``."""
    for k in range(len(counts)):
        for number in range(counts[k]):
            block[at[k] + number] = source[begins[k] + number]


def _fits(numbers: Words) -> bool:
    """Return whether whole numbers fit in 32 bits."""
    return not len(numbers) or bool(numbers.min() >= -LARGEST and numbers.max() <= LARGEST)


LARGEST = 2**31 - 1


def _joined(section: TableSection) -> Words:
    """Return the entries of a section as words, end to end."""
    words = [_as_words(part) for part in section.parts]
    return np.ascontiguousarray(words[0]) if len(words) == 1 else np.concatenate(words)


def _as_words(part: NDArray[Any]) -> Words:
    return part.view(np.int64) if part.dtype == np.float64 else part.astype(np.int64, copy=False)


def _rows_and_sections(paths: SamplePaths) -> tuple[Words, tuple[TableSection, ...]]:
    """Return rows of Path whose tables are still to be set, and the sections of ``TABLES``."""
    stepwise, legs, legs_at, streams = _walking(paths.walking)
    rows = np.zeros((len(paths.episodes), Path.words), np.int64)
    rows[:, 0], rows[:, 1] = stepwise, paths.respawn.shape[2]
    respawns, keys, follows = _block(paths.respawn), _keys(paths.link_keys), _follows(paths)
    walks = legs, legs_at, streams
    return rows, (*_requests(paths.requests), *walks, respawns, _errors(paths), keys, follows)


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
    """Return whether users walk step by step, the legs, their offsets, and users' streams."""
    if isinstance(walking, ManyRowWalks):
        return True, NOTHING, NOTHING, _block(walking.states.view(np.int64))
    walking = _once(walking)
    states = [own.states.view(np.int64) for own in walking if isinstance(own, RowWalks)]
    if states:
        return True, NOTHING, NOTHING, _listed(states)
    walks = [own.drawn() for own in walking]
    return (
        False,
        _listed([own.legs.view(float) for own in walks]),
        _listed([own.offsets for own in walks]),
        NOTHING,
    )


def _requests(requests: Sequence[Requests]) -> tuple[TableSection, ...]:
    """Return the sections of requests: times, services, values that they draw, and offsets."""
    if isinstance(requests, ManyRequests):
        begins, counts = np.array(requests.begins), requests.offsets[:, -1]
        draws = requests.drawn.shape[1]
        return (
            *(
                TableSection([requests.asks[:, column]], begins, counts)
                for column in (DUE_US, SERVICE)
            ),
            TableSection([requests.drawn.reshape(-1)], draws * begins, draws * counts),
            _block(requests.offsets),
        )
    requests = _once(requests)
    columns = (DUE_US, SERVICE, slice(DRAWN, None))
    return (
        *(_listed([own.rows[:, column] for own in requests]) for column in columns),
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
