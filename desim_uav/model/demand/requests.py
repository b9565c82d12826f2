"""Tables of the requests of episodes, as demand models draw them and as files have them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

DUE_US, SERVICE, REQUIRED_US, BANDWIDTH_BPS = range(4)
DRAWN = REQUIRED_US
"""The columns of a table of requests (see ``Requests``); the drawn values begin with DRAWN."""


class Requests(NamedTuple):
    """All users' requests in one episode: rows of DUE_US SERVICE and the values that are drawn.

    There is a value for each list of the service (``services.Service.values``), in their order, and
    0 in the columns that it does not need. Those of the built-in services are REQUIRED_US, which is
    in millionths of a bit if the service asks for a volume, and BANDWIDTH_BPS.

    The rows of user u are ``offsets[u]:offsets[u + 1]``. If ``after_previous`` is true, DUE_US
    counts from the end of the user's previous request, and for the first request from the start of
    the episode. Otherwise DUE_US is the time of an arrival, which is dropped while another request
    of that user is open. It is one truth value for all users, or an array of one for each (users,).
    """

    rows: NDArray[np.int64]
    offsets: NDArray[np.int64]
    after_previous: bool | NDArray[np.bool_]

    @property
    def follows(self) -> NDArray[np.bool_]:
        """Whether the times of each user (users,) count from the end of its previous request."""
        return np.broadcast_to(self.after_previous, len(self.offsets) - 1)


def joined_requests(parts: Sequence[Requests]) -> Requests:
    """Return the requests of groups of users in an episode, in the order of the groups."""
    if len(parts) == 1:
        return parts[0]
    return Requests(
        np.concatenate([part.rows for part in parts]),
        joined_offsets([part.offsets for part in parts]),
        np.concatenate([part.follows for part in parts]),
    )


def joined_offsets(parts: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Return the offsets (users + 1,) of tables that are put one behind the other."""
    counts = np.concatenate([np.diff(part) for part in parts])
    return np.concatenate([[0], np.cumsum(counts)])


class ManyRequests(Sequence[Requests]):
    """The requests of several episodes in two tables: DUE_US and SERVICE, and what is drawn.

    The rows of episode k are ``begins[k]:begins[k + 1]``. ``offsets`` (episodes, users + 1) count
    from the beginning of each episode's rows.
    """

    def __init__(
        self,
        asks: NDArray[np.int64],
        drawn: NDArray[np.int64],
        offsets: NDArray[np.int64],
        after_previous: bool | NDArray[np.bool_],
    ) -> None:
        self.offsets, self.after_previous = offsets, after_previous
        ends: list[int] = np.cumsum(offsets[:, -1]).tolist()
        self.begins, self.asks, self.drawn = [0, *ends[:-1]], asks[: ends[-1]], drawn[: ends[-1]]

    def __len__(self) -> int:
        return len(self.offsets)

    @property
    def follows(self) -> NDArray[np.bool_]:
        """``Requests.follows`` of each episode."""
        return np.broadcast_to(self.after_previous, self.offsets.shape[1] - 1)

    def __getitem__(self, k: Any) -> Any:
        """Return the requests of episode k of the table."""
        rows = self.rows_of(k)
        both = np.concatenate([self.asks[rows], self.drawn[rows]], axis=1)
        return Requests(both, self.offsets[k], self.after_previous)

    def rows_of(self, k: int) -> slice:
        """Return the rows of episode k."""
        return slice(self.begins[k], self.begins[k] + int(self.offsets[k, -1]))


def joined_episodes(groups: Sequence[Sequence[Requests]]) -> Sequence[Requests]:
    """Return the requests of groups of users in several episodes, in the order of the groups."""
    if len(groups) == 1:
        return groups[0]
    tables = [own for own in groups if isinstance(own, ManyRequests)]
    if len(tables) < len(groups):
        return [joined_requests(parts) for parts in zip(*groups, strict=True)]
    counts = np.array([own.offsets[:, -1] for own in tables])
    before = np.cumsum(counts, axis=0) - counts
    ends = [own.offsets[:, 1:] + first[:, None] for own, first in zip(tables, before, strict=True)]
    parts = [(own, own.rows_of(k)) for k in range(len(tables[0])) for own in tables]
    return ManyRequests(
        np.concatenate([own.asks[rows] for own, rows in parts]),
        np.concatenate([own.drawn[rows] for own, rows in parts]),
        np.concatenate([tables[0].offsets[:, :1], *ends], axis=1),
        np.concatenate([own.follows for own in tables]),
    )
