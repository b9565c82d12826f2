"""Sample paths as the compiled engine reads them: those of several episodes in two flat arrays."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.batch.memory import PATH_HEADER, Floats, Ints, Path
from desim_uav.model.demand import ManyRequests, Requests
from desim_uav.model.mobility import ManyRandomWalks, RandomWalks, Walks
from desim_uav.sample_path import SamplePaths


class Section(NamedTuple):
    """Numbers of all episodes, end to end: what is left to no chance stands there once.

    ``begins``: where those of each episode begin.
    """

    parts: list[NDArray[Any]]
    begins: Sequence[int]


def paths_of(paths: SamplePaths) -> tuple[Path, Ints]:
    """Sample paths in one, and where each has its header: (paths, 2), in ``i`` and in ``f``.

    Sections are counted from the header on (see ``Path``).
    """
    at_random, walkers, legs = _walking(paths.walking)
    rows, offsets = _requests(paths.requests)
    count, options = len(paths.episodes), paths.respawn.shape[2]
    noisy = paths.position_error is not None
    whole, at_i = _laid((walkers, rows, offsets, _block(paths.respawn)), count * PATH_HEADER)
    real, at_f = _laid((legs, _errors(paths)), 0)
    headers, starts = [], []
    for k, after in enumerate(_after_previous(paths.requests)):
        (walk, row, offset, respawn), (leg, error), at = at_i[k], at_f[k], k * PATH_HEADER
        begins = walk - at, row - at, offset - at, respawn - at
        headers.append((after, at_random, *begins, options, noisy, error - leg))
        starts.append((at, leg))
    header = np.array(headers, np.int64).reshape(-1)
    packed = Path(
        np.concatenate([header, *whole], dtype=np.int64), np.concatenate(real, dtype=np.float64)
    )
    return packed, np.array(starts, np.int64)


def _laid(sections: Sequence[Section], at: int) -> tuple[list[NDArray[Any]], list[tuple[int, ...]]]:
    """All parts of sections that follow one another, and where each episode's numbers begin."""
    parts, places = [], []
    for section in sections:
        places.append([at + begin for begin in section.begins])
        parts += section.parts
        at += sum([part.size for part in section.parts])
    return parts, list(zip(*places, strict=True))


def _block(numbers: NDArray[Any]) -> Section:
    """As many numbers an episode."""
    count = len(numbers)
    return Section([numbers.reshape(-1)], [k * (numbers.size // count) for k in range(count)])


def _listed(arrays: Sequence[NDArray[Any]]) -> Section:
    """An array an episode, or always the same."""
    if len(set(map(id, arrays))) == 1:
        return Section([arrays[0].reshape(-1)], [0] * len(arrays))
    parts = [array.reshape(-1) for array in arrays]
    return Section(parts, [0, *accumulate(part.size for part in parts[:-1])])


def _walking(walking: Sequence[Walks | RandomWalks]) -> tuple[bool, Section, Section]:
    """Do users walk at random? The beginnings of their streams, or the offsets of legs; legs."""
    none = _nothing(len(walking))
    if isinstance(walking, ManyRandomWalks):
        return True, _block(walking.states.view(np.int64)), none
    states = [own.states.view(np.int64) for own in walking if isinstance(own, RandomWalks)]
    if states:
        return True, _listed(states), none
    walks = [own.drawn() for own in walking]
    return False, _listed([own.offsets for own in walks]), _listed([own.legs for own in walks])


def _requests(requests: Sequence[Requests]) -> tuple[Section, Section]:
    """The rows, and their offsets."""
    if isinstance(requests, ManyRequests):
        columns = requests.rows.shape[1]
        begins = [columns * begin for begin in requests.begins]
        return Section([requests.rows.reshape(-1)], begins), _block(requests.offsets)
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
    return Section([NOTHING], [0] * count)


NOTHING: Floats = np.empty(0)
