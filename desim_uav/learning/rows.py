"""The rows of learning: Q-tables, lessons, learners, and an episode in which drones learn."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from desim_uav.rowcode.bounds import BETWEEN, require_inside
from desim_uav.rowcode.compiled_rows import entries_at
from desim_uav.rowcode.kernels import rule, stands_in_for
from desim_uav.rowcode.rows import BoundedTable, Row, Table, row

QPlace = tuple[int, int, int]
"""A table, a state and an action."""

BETWEEN.add(__name__)


@row
class QValues(Row):
    """The values of a drone's actions in its Q-tables: ``q[table, state, action]``.

    They are stored in single precision; computations are in double precision. ``sum`` is the sum of
    all of them. ``entries`` is a memoryview of all of them, or in compiled code their address.
    """

    bounds = "tables", "states", "actions"
    """The fields that say how many places there are."""

    entries: int
    tables: int
    states: int
    actions: int
    sum: float

    def __getitem__(self, place: QPlace) -> float:
        """Return a value.

        A place that does not exist raises OutsideError for an algorithm of one's own; else
        compiled code returns NaN for it.
        """
        entries: Any = self.entries
        value: float = entries[place]
        return value

    @rule
    def __setitem__(self, place: QPlace, value: float) -> None:
        """Change a value.

        A place that does not exist raises OutsideError for an algorithm of one's own; else
        compiled code changes nothing.
        """
        _, state, action = place
        before = value_of(self, state, action)
        put(self, place, value)
        self.sum += value_of(self, state, action) - before


class BoundedValues(QValues):
    """Values that check each place."""

    __slots__ = ()

    def __getitem__(self, place: QPlace) -> float:
        """Return a value. Raises OutsideError if there is no such place."""
        self._require(place)
        return QValues.__getitem__(self, place)

    def __setitem__(self, place: QPlace, value: float) -> None:
        """Change a value. Raises OutsideError if there is no such place."""
        self._require(place)
        QValues.__setitem__(self, place, value)

    def _require(self, place: QPlace) -> None:
        for at, bound in zip(place, self.bounds, strict=True):
            require_inside(at, getattr(self, bound), f"the {bound}")


def bounded_update(update: Callable[[Any, Any], None]) -> Callable[[Any, Any], None]:
    """Return the update of an algorithm that checks each index in its lesson."""

    def bounded(q: Any, lesson: Any) -> None:
        lesson.allowed = BoundedTable(lesson.allowed)
        update(q, lesson)

    return bounded


@rule
def value_of(q: QValues, state: int, action: int) -> float:
    """Return the value of an action in a state, which is the sum over the tables."""
    value = q[0, state, action]
    for table in range(1, q.tables):
        value += q[table, state, action]
    return value


def put(q: QValues, place: QPlace, value: float) -> None:
    """Write a value into a table."""
    entries: Any = q.entries
    entries[place] = value


singles_at = entries_at(np.float32)


@stands_in_for(QValues.__getitem__)
def _getitem(q: Any, place: Any) -> float:
    k = _entry(q, place)
    return float(_entries(q)[k]) if k >= 0 else math.nan


@stands_in_for(put)
def _put(q: Any, place: Any, value: Any) -> None:
    k = _entry(q, place)
    if k >= 0:
        _entries(q)[k] = value


@rule
def _entries(q: QValues) -> Any:
    """Return all values as a table, in compiled code."""
    return singles_at(q.entries, q.tables * q.states * q.actions)


@rule
def _entry(q: QValues, place: QPlace) -> int:
    """Return the number of the entry at a place, or a number below 0 if there is no such place."""
    table, state, action = place
    inside = _is_below(table, q.tables) & _is_below(state, q.states) & _is_below(action, q.actions)
    return (table * q.states + state) * q.actions + action if inside else -1


@rule
def _is_below(number: int, end: int) -> bool:
    """Return whether a number is from 0 to ``end`` - 1, by one comparison without signs."""
    return np.uint64(number) < np.uint64(end)  # type: ignore[return-value]


@row
class Lesson(Row):
    """The experience from which a drone learns: its last decision, and the outcome so far.

    In ``state`` (-1: no decision is open) the drone took ``action``; the sum of its discounted
    rewards since then is ``gained``. It is followed by ``next_state``, whose value is multiplied by
    ``discount``. There, the actions ``allowed`` can be taken, and ``next_action`` is taken.
    ``epsilon`` and ``alpha`` are those of the episode. ``coin`` is a random number, uniform in
    [0, 1).
    """

    state: int
    action: int
    gained: float
    discount: float
    next_state: int
    next_action: int
    allowed: Table[int]
    epsilon: float
    alpha: float
    coin: float


@row
class Learner(Row):
    """A drone that learns independently, with its Q-tables ``q`` and its open decision.

    ``update`` is its algorithm, in compiled code an address. At a decision epoch the drone
    ``decides``, or it has no choice; if it is ``lost``, it has crashed and will not be replaced.
    ``explore`` and ``which`` are random numbers, uniform in [0, 1): whether it explores, and which
    action it then takes. ``command`` is the index of the action that it is commanded, ``reward``
    its reward of the last step, ``share`` how much of a whole step that has lasted, and ``rewards``
    the sum of its rewards in the episode so far.
    """

    q: QValues
    lesson: Lesson
    gamma: float
    update: int
    decides: int
    lost: int
    explore: float
    which: float
    command: int
    reward: float
    share: float
    rewards: float


@row
class EpisodeRow(Row):
    """An episode in which drones learn, at a decision epoch.

    ``sizes`` holds the number of values of each feature of a state (see ``table_row``). ``lost``
    says that a drone has observed a state that its tables do not have, which ends the episode.
    """

    terminated: int
    truncated: int
    lost: int
    sizes: Table[int]
    learners: Table[Learner]
