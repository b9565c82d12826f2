"""Random streams, one per (seed, purpose, entity, episode), which are independent of each other.

They are NumPy's: ``Generator(SFC64(SeedSequence(seed, spawn_key=(purpose, entity, episode))))``.
The kernels here give the same numbers as that generator's ``random()``, for all entities at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.rowcode.kernels import kernel, rule
from desim_uav.rowcode.rows import Row, Table, row


class Purpose(IntEnum):
    """The purpose of a random stream. A learner and the simulator never share a stream."""

    WORLD = 0
    PLACEMENT = 1
    MOBILITY = 2
    DEMAND = 3
    POSITION_NOISE = 4
    RESPAWN = 5
    LEARNER = 6
    LINK = 7
    TASK = 8
    PLANNER = 9


class Streams:
    """The streams of one purpose in one episode, one per entity (user, drone or cluster)."""

    def __init__(self, seed: int, purpose: Purpose, episode: int = 0, first: int = 0) -> None:
        """Name the streams; ``episode`` may be negative (warm-up) and is taken modulo 2**32.

        ``first`` is added to the number of each entity.
        """
        self.seed = seed
        self.purpose = purpose
        self.episode = episode % 2**32
        self.first = first

    def beginning(self, first: int) -> Streams:
        """Return the streams whose entity 0 is the entity ``first`` of these."""
        return Streams(self.seed, self.purpose, self.episode, self.first + first)

    def generator(self, entity: int) -> np.random.Generator:
        """Return the stream of one entity, from its beginning, as a NumPy generator."""
        key = (int(self.purpose), self.first + entity, self.episode)
        sequence = np.random.SeedSequence(self.seed, spawn_key=key)
        return np.random.Generator(np.random.SFC64(sequence))

    def states(self, count: int) -> NDArray[np.uint64]:
        """Return the initial SFC64 states of the streams of entities 0 … count-1: (count, 4)."""
        states = states_of(self.seed, self.purpose, [self.episode], count, self.first)
        own: NDArray[np.uint64] = states[0]
        return own


Seeds = int | Sequence[int]
"""The seed of all episodes, or a sequence with that of each."""


def seed_of_each(seeds: Seeds, episodes: Sequence[int]) -> Sequence[int]:
    """Return the seed of each episode."""
    return [seeds] * len(episodes) if isinstance(seeds, int | np.integer) else seeds


def states_of(
    seeds: Seeds, purpose: Purpose, episodes: Sequence[int], count: int, first: int = 0
) -> NDArray[np.uint64]:
    """Return the initial states of several episodes' streams: (episodes, count, 4).

    They are those of the entities from number ``first`` on.
    """
    numbers = np.array([episode % 2**32 for episode in episodes], np.uint64)
    own = np.array(seed_of_each(seeds, episodes), np.uint64)
    states = np.empty((len(numbers), count, 4), np.uint64)
    pools = np.empty((2, 4), np.uint64)
    _seed_states(own, np.uint64(purpose), numbers, np.uint64(first), pools, states)
    return states


def uniforms_of(
    seed: Seeds, purpose: Purpose, episodes: Sequence[int], entities: int, count: int
) -> NDArray[np.float64]:
    """Return the first ``count`` uniform numbers of each stream: (episodes, entities, count)."""
    states = states_of(seed, purpose, episodes, entities)
    return uniforms(states.reshape(-1, 4), count).reshape(len(episodes), entities, count)


FAR_US = 2.0**61
"""The longest time that is drawn, in microseconds: two of them still fit in 64 bits."""

_LOW = np.uint64(0xFFFFFFFF)
_SHIFT = np.uint64(16)


@kernel
def _hashmix(
    value: np.uint64, constant: np.uint64, multiplier: np.uint64
) -> tuple[np.uint64, np.uint64]:
    """Return the hashed value and the next constant of SeedSequence's hash on 32-bit words."""
    value = (value ^ constant) & _LOW
    constant = (constant * multiplier) & _LOW
    value = (value * constant) & _LOW
    return value ^ (value >> _SHIFT), constant


@kernel
def _mix(x: np.uint64, y: np.uint64) -> np.uint64:
    left = (np.uint64(0xCA01F9DD) * x) & _LOW
    right = (np.uint64(0x4973F715) * y) & _LOW
    mixed = (left - right) & _LOW
    return mixed ^ (mixed >> _SHIFT)


@kernel
def _stir(pool: NDArray[np.uint64], word: np.uint64, source: int, constant: np.uint64) -> np.uint64:
    """Mix word number ``source`` into all others of the pool, and return the next constant."""
    for target in range(4):
        if source != target:
            hashed, constant = _hashmix(word, constant, np.uint64(0x931E8875))
            pool[target] = _mix(pool[target], hashed)
    return constant


@kernel
def _begun(pool: NDArray[np.uint64], seed: np.uint64, purpose: np.uint64) -> np.uint64:
    """Mix a seed and a purpose into a pool of four words, and return the next constant."""
    seeds = (seed & _LOW, seed >> np.uint64(32), np.uint64(0), np.uint64(0))
    constant = np.uint64(0x43B0D7E5)
    for i in range(4):
        pool[i], constant = _hashmix(seeds[i], constant, np.uint64(0x931E8875))
    for source in range(5):
        constant = _stir(pool, pool[source] if source < 4 else purpose, source, constant)
    return constant


@kernel
def _seed_states(
    seeds: NDArray[np.uint64],
    purpose: np.uint64,
    episodes: NDArray[np.uint64],
    lowest: np.uint64,
    pools: NDArray[np.uint64],
    states: NDArray[np.uint64],
) -> None:
    """Seed SFC64 for each entity as NumPy does, with a SeedSequence of four 32-bit words.

    The entities are those from number ``lowest`` on; ``pools`` is memory for two of these words.
    ``states``: (episodes, entities, 4).
    """
    start, pool, first, count = pools[0], pools[1], np.uint64(0), states.shape[1]
    for k in range(len(episodes) * count):
        episode, entity = k // count, k % count
        if entity == 0 and (episode == 0 or seeds[episode] != seeds[episode - 1]):
            first = _begun(start, seeds[episode], purpose)
        for i in range(4):
            pool[i] = start[i]
        constant = first
        for source in range(5, 7):
            word = lowest + np.uint64(entity) if source == 5 else episodes[episode]
            constant = _stir(pool, word, source, constant)
        constant, state = np.uint64(0x8B51F9DD), states[episode, entity]
        for i in range(3):
            low, constant = _hashmix(pool[2 * i % 4], constant, np.uint64(0x58F38DED))
            high, constant = _hashmix(pool[2 * i % 4 + 1], constant, np.uint64(0x58F38DED))
            state[i] = low | (high << np.uint64(32))
        state[3] = np.uint64(1)
        for _ in range(12):
            next_word(state)


StreamState = tuple[np.uint64, np.uint64, np.uint64, np.uint64]


@kernel
def advanced(state: StreamState) -> tuple[np.uint64, StreamState]:
    """Return the next 64 bits of an SFC64 state, and the state after them."""
    a, b, c, counter = state
    word: np.uint64 = a + b + counter
    a = b ^ (b >> np.uint64(11))
    b = c + (c << np.uint64(3))
    c = ((c << np.uint64(24)) | (c >> np.uint64(40))) + word
    return word, (a, b, c, counter + np.uint64(1))


@kernel
def next_word(state: NDArray[np.uint64]) -> np.uint64:
    """Advance an SFC64 state (4 words) in place and return its next 64 bits."""
    word, after = advanced((state[0], state[1], state[2], state[3]))
    state[0], state[1], state[2], state[3] = after
    return word


@kernel
def next_uniform(state: NDArray[np.uint64]) -> float:
    """Return the next uniform number in [0, 1), with 53 bits."""
    return as_uniform(next_word(state))


@kernel
def as_uniform(word: np.uint64) -> float:
    """Return 64 random bits as a number in [0, 1), of which 53 bits are used."""
    return np.float64(word >> np.uint64(11)) * (1.0 / 9007199254740992.0)


def uniforms(states: NDArray[np.uint64], count: int) -> NDArray[np.float64]:
    """Return the next ``count`` uniform numbers of each stream: (streams, count)."""
    numbers = np.empty((len(states), count))
    _write_uniforms(states, numbers)
    return numbers


@kernel
def _write_uniforms(states: NDArray[np.uint64], numbers: NDArray[np.float64]) -> None:
    """Write the next uniform numbers of each stream, as many as there is room for."""
    for stream in range(len(states)):
        own = states[stream]
        state = (own[0], own[1], own[2], own[3])  # in registers
        for k in range(numbers.shape[1]):
            word, state = advanced(state)
            numbers[stream, k] = as_uniform(word)
        own[0], own[1], own[2], own[3] = state


# ---- streams of components over rows


@row
class Stream(Row):
    """A random stream, from which a component over rows draws: the words of its SFC64 state."""

    a: int
    b: int
    c: int
    counter: int


@rule
def begin_stream(stream: Stream, words: Table[int], first: int) -> None:
    """Put a stream at the state whose four words begin at index ``first``."""
    stream.a, stream.b = words[first], words[first + 1]
    stream.c, stream.counter = words[first + 2], words[first + 3]


@rule
def uniform(stream: Any) -> float:
    """Return the next number of a stream, which is uniform in [0, 1)."""
    word, state = advanced(
        (
            np.uint64(stream.a),
            np.uint64(stream.b),
            np.uint64(stream.c),
            np.uint64(stream.counter),
        )
    )
    stream.a, stream.b, stream.c, stream.counter = state
    return as_uniform(np.uint64(word))


@rule
def apart(stream: Any) -> None:
    """Turn a stream that has just begun into another one, which is independent of it.

    One of the words of its state is changed, and then it is mixed as SFC64 is when it is seeded.
    """
    stream.a, stream.counter = np.uint64(stream.a) ^ np.uint64(0x9E3779B97F4A7C15), 1
    for _ in range(12):
        uniform(stream)


@rule
def exponential_us(stream: Stream, mean_s: float) -> int:
    """Return an exponential time in whole microseconds, which takes one number of a stream.

    Rounding hides differences of logarithms between platforms, which are in their last bit. The
    time is at most 2^61 microseconds, which is longer than any episode.
    """
    return int(min(np.rint(-math.log1p(-uniform(stream)) * mean_s * 1e6), FAR_US))


@rule
def heading(stream: Stream) -> tuple[float, float]:
    """Return a vector of length 1 in a uniform direction.

    It is drawn by rejection, because square roots and quotients are the same on every platform,
    but sines are not.
    """
    while True:
        x = 2.0 * uniform(stream) - 1.0
        y = 2.0 * uniform(stream) - 1.0
        squared = x * x + y * y
        if 1e-6 < squared <= 1.0:
            length = math.sqrt(squared)
            return x / length, y / length
