"""The search for fair shares: branch and bound over sets of users, as bits.

``sets`` (footprints, words) has a bit for each user.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.rowcode.kernels import maker


def as_bits(rows: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """Return an array (footprints, users) as (footprints, words), with a bit for each user."""
    count, users = rows.shape
    bytes_ = np.zeros((count, 8 * max(1, -(-users // 64))), np.uint8)
    packed = np.packbits(rows, axis=1, bitorder="little")
    bytes_[:, : packed.shape[1]] = packed
    return bytes_.view(np.uint64)


def undominated(sets: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Return the sets contained in no other; all must differ and the largest be first."""
    indices: list[int] = []
    for k, one in enumerate(sets):
        if not (sets[indices] & one == one).all(axis=1).any():
            indices.append(k)
    return np.array(indices)


@maker
def _bits(word: np.uint64) -> int:
    """Return the number of ones."""
    m1, m2 = np.uint64(0x5555555555555555), np.uint64(0x3333333333333333)
    m4, ones = np.uint64(0x0F0F0F0F0F0F0F0F), np.uint64(0x0101010101010101)
    word = word - ((word >> np.uint64(1)) & m1)
    word = (word & m2) + ((word >> np.uint64(2)) & m2)
    word = (word + (word >> np.uint64(4))) & m4
    return int((word * ones) >> np.uint64(56))


@maker
def _size(one: NDArray[np.uint64]) -> int:
    """Return the number of users in a set."""
    total = 0
    for word in one:
        total += _bits(word)
    return total


@maker
def _gain(union: NDArray[np.uint64], one: NDArray[np.uint64]) -> int:
    """Return how many users a set adds to a union."""
    total = 0
    for k in range(len(one)):
        total += _bits(one[k] & ~union[k])
    return total


@maker
def _unite(one: NDArray[np.uint64], other: NDArray[np.uint64], union: NDArray[np.uint64]) -> int:
    """Write the union of two sets into ``union``, and return its number of users."""
    total = 0
    for k in range(len(one)):
        union[k] = one[k] | other[k]
        total += _bits(union[k])
    return total


@maker
def _shared(counted: NDArray[np.int64], drones: int, most: int) -> int:
    """Return the most users that can be attached to ``drones`` drones with at most ``most`` each.

    ``counted`` has the number of users in the union of each subset of the drones. Each user is
    attached to one of the drones that cover it; the result is the minimum cut of this flow.
    """
    users = np.int64(2**62)
    for subset in range(1 << drones):
        outside = drones - _bits(np.uint64(subset))
        users = min(users, outside * most + counted[subset])
    return int(users)


@maker
def best_shares(
    sets: NDArray[np.uint64],
    drones: int,
    users: int,
    sign: int,
    start: NDArray[np.int64],
    key: int,
    budget: int,
) -> tuple[NDArray[np.int64], int, bool]:
    """Find the sets with the largest key; several drones may have the same set.

    ``sets`` are ordered by size, the largest first. The key is
    score (users + 1) + sign · users covered. The score is ``users`` times the largest sum over
    drones of min(1, U_c / (users / drones)) that an attachment of users to covering drones gives.
    With q, r = divmod(users, drones), it is (drones - r) F(q) + r F(q + 1), where F(m) is the
    largest number of users attached if each drone takes at most m; one attachment is the best for
    all m. Returns the sets, the key, and whether they are proven to be the best. The search begins
    from known sets and their key.
    """
    count, words = sets.shape
    quota, rest = users // drones, users % drones
    unions = np.zeros((1 << drones, words), np.uint64)
    counted = np.zeros(1 << drones, np.int64)
    size = np.empty(count, np.int64)
    for k in range(count):
        size[k] = _size(sets[k])
    first = np.zeros(drones + 1, np.int64)
    largest_gain = np.zeros(drones + 1, np.int64)
    largest_gain[0] = size[0] if count else 0
    at = np.full(drones, -1, np.int64)
    best = start.copy()
    looked_at = 0
    depth = 0
    while depth >= 0:
        at[depth] = first[depth] if at[depth] < 0 else at[depth] + 1
        k = at[depth]
        left = drones - depth
        subsets = 1 << depth
        reach = key
        if k < count:
            low = _shared(counted[:subsets], depth, quota) + left * min(quota, size[k])
            high = _shared(counted[:subsets], depth, quota + 1) + left * min(quota + 1, size[k])
            most = counted[subsets - 1] + left * min(largest_gain[depth], size[k])
            low, high = min(low, most), min(high, most)
            covers = most if sign > 0 else counted[subsets - 1]
            reach = ((drones - rest) * low + rest * high) * (users + 1) + sign * covers
        if looked_at > budget:
            return best, key, False
        if reach <= key:
            at[depth] = -1
            depth -= 1
            continue
        looked_at += 1
        for subset in range(subsets):
            counted[subsets + subset] = _unite(unions[subset], sets[k], unions[subsets + subset])
        if depth + 1 == drones:
            low = _shared(counted, drones, quota)
            high = _shared(counted, drones, quota + 1)
            score = (drones - rest) * low + rest * high
            reached = score * (users + 1) + sign * counted[-1]
            if reached > key:
                key = reached
                best[:] = at
        else:
            depth += 1
            first[depth] = k
            at[depth] = -1
            largest_gain[depth] = 0
            for later in range(k, count):
                added = _gain(unions[2 * subsets - 1], sets[later])
                largest_gain[depth] = max(largest_gain[depth], added)
            looked_at += count - k
    return best, key, True
