"""The draws of links, of those that are imagined too: of which only what can be seen now is known.

The draws of a link while the transmitter is in a cell are three words of random bits: one for the
line of sight, one for the shadowing with it, and one for that without it. They are a function of a
key and of the numbers of cell, user and transmitter (``model.random.philox``).

A planner imagines how an episode goes on. It must not know these words, but it sees whether each
link has line of sight now, and the shadowing that the link has now. So an imagined episode has a
second key, by which words are drawn anew given what is seen (``imagined_links``).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.random.philox import Words, philox
from desim_uav.model.random.streams import as_uniform
from desim_uav.rowcode.kernels import kernel, part

KEY_WORDS = 2
"""The words of a key. If the episode is imagined, a second key and what is seen follow."""

SEEN_AT = 2 * KEY_WORDS
"""Where the numbers of the transmitters' cells begin, and after these the chances."""

UNSEEN = -1
"""In place of a cell: the transmitter is silent, so nothing is seen of its links."""

LinkDraw = tuple[float, np.uint64, np.uint64]


def imagined_links(
    key: NDArray[np.uint64],
    new: NDArray[np.uint64],
    cells: NDArray[np.int64],
    chances: NDArray[np.float64],
) -> NDArray[np.uint64]:
    """Return the key of the links of an episode that is imagined from now on.

    ``key`` is the true one and ``new`` a second one (2,). ``cells`` (transmitters,) has the cell in
    which each transmitter is, or UNSEEN, and ``chances`` (transmitters, users) how probable it was
    that a link has line of sight as things stand: the probability by draws, or 1 or 0 where
    buildings decide. Access point k is the transmitter -1 - k, counted from the end.

    While a transmitter is in its present cell, a link that has line of sight has a uniform number
    below its chance, and another one has a number above it; both are drawn anew within these
    bounds. The shadowing of its present state stays, and that of the other state is drawn anew, as
    everything is for other cells.
    """
    state = [np.ascontiguousarray(each).reshape(-1).view(np.uint64) for each in (cells, chances)]
    return np.concatenate([key[:KEY_WORDS], new[:KEY_WORDS], *state])


@kernel
def draws_of_link(
    key: NDArray[np.uint64], numbers: NDArray[np.int64], transmitter: int, user: int, cell: int
) -> LinkDraw:
    """Return a link's uniform number, and its random bits with and without line of sight.

    ``key`` (2,) is that of the episode, or longer if the episode is imagined (``imagined_links``).
    ``numbers`` (users,) are those that users have in the draws.
    """
    counter = (np.uint64(cell), np.uint64(numbers[user]), np.uint64(transmitter), np.uint64(0))
    true = philox(key, counter)
    if len(key) > KEY_WORDS:
        return _drawn_anew(key, len(numbers), transmitter, user, cell, true, counter)
    return as_uniform(true[0]), true[1], true[2]


@part
def _drawn_anew(
    key: NDArray[np.uint64],
    users: int,
    transmitter: int,
    user: int,
    cell: int,
    true: Words,
    counter: Words,
) -> LinkDraw:
    """Return the draws of a link in an imagined episode."""
    new = philox(key[KEY_WORDS:SEEN_AT], counter)
    uniform, state = as_uniform(new[0]), key[SEEN_AT:]
    transmitters = len(state) // (1 + users)
    row = transmitter if transmitter >= 0 else transmitters + transmitter
    if np.int64(state[row]) != cell:
        return uniform, new[1], new[2]
    chance = state[transmitters:].view(np.float64)[row * users + user]
    if as_uniform(true[0]) < chance:
        return chance * uniform, true[1], new[2]
    return chance + (1.0 - chance) * uniform, new[1], true[2]
