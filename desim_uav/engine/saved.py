"""Saved states of engines, which both kinds of engine restore exactly.

A saved state holds the rows of ``rules.rows.State`` as tuples with named fields, without the memory
in which one kind of engine works alone. That memory is derived again from rows and sample path.
"""

from __future__ import annotations

import hashlib
from collections import namedtuple
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pickle import UnpicklingError
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from desim_uav.copies import Unchanging
from desim_uav.engine.base import Carried, EpisodeLog, RunSettings
from desim_uav.errors import StateError
from desim_uav.model.state import Snapshot
from desim_uav.rowcode.rows import (
    Maybe,
    Queue,
    Row,
    Table,
    blank,
    held_by,
    is_number,
    is_row,
    number,
    origin_of,
)
from desim_uav.rowcode.views import View
from desim_uav.rules.rows import Drone, State
from desim_uav.rules.words import AIMS
from desim_uav.sample_path import SamplePath
from desim_uav.world import World

OF_ONE_ENGINE = {
    State: {
        *("keeps_events", "keeps_requests", "drones", "events", "closed", "handovers", "records"),
        *("point_records", "updates", "flown", "away_m"),
        *("look", "sky", "slot_times", "slot_keys", "winners", "before", "before_us"),
        *("fetch_at", "fetch_end"),
    },
    Drone: {"route", "route_end", "features"},
}
"""The fields that a saved state leaves out: what an engine logs, what the last step has added to
the log, what it derives from other fields, and the numbers of hops, which each engine chooses."""

NOT_TOLD = {"history", "used", "gained", "counted", "course", "store"}
"""The fields that a digest leaves out: the commands, of which it has those that were given; what a
battery used and gained as far as it is counted, which depends on what is recorded, as do stored
updates; and the courses of drones, which also hold memory, so that it has only their ends."""

PLACES = 6
"""How many of the first fields of a ``Course`` say where its leg begins and ends."""

Hops = tuple[tuple[int, int, int], ...]


class Rows(NamedTuple):
    """The rows of a state as values.

    ``state`` has the fields of State. ``routes`` holds the next hops of each drone's return, and
    ``due`` the slot, time and key of each scheduled event, ordered by time and key.
    """

    state: Any
    routes: tuple[Hops, ...]
    due: tuple[tuple[int, int, int], ...]

    def rows(self) -> Rows:
        """Return these rows."""
        return self


class Kept(Protocol):
    """The state in the form in which an engine has saved it."""

    def rows(self) -> Rows:
        """Return the state as rows."""


@dataclass(frozen=True, eq=False)
class SavedState(Unchanging):
    """The state of an engine at a decision epoch, which does not change.

    ``before`` are the states in which the drones began the episode, ``served_by`` the drones that
    have served open requests, and ``named_terms`` the terms of rewards that do not work on rows.
    ``latest`` is the snapshot, or None if none has been made. In a pickle ``kept`` is rows, which
    every version of the package with the same rows and every kind of engine restores.
    """

    world: World
    settings: RunSettings
    path: SamplePath
    before: Carried | None
    kept: Kept
    log: EpisodeLog
    served_by: tuple[tuple[int, tuple[int, ...]], ...]
    named_terms: tuple[tuple[tuple[str, float], ...], ...] = ()
    latest: Snapshot | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields, with the state as rows."""
        return {**super().__getstate__(), "kept": self.rows}

    @cached_property
    def rows(self) -> Rows:
        """The state as rows."""
        return self.kept.rows()

    @property
    def commands(self) -> list[list[int]]:
        """The commands of all steps so far, one per drone; -1 is none of the actions."""
        state, drones = self.rows.state, self.world.scenario.drone_count
        history = state.history[: state.step * drones]
        return [list(history[k : k + drones]) for k in range(0, len(history), drones)]

    @property
    def numbers(self) -> NDArray[np.float64] | None:
        """The numbers of all commands so far in free flight, else None (``Commands.kept``)."""
        return self.world.commands.kept(self._aims(self.rows.state))

    def _aims(self, state: Any) -> tuple[float, ...]:
        """Return the part of ``State.aims`` that the commands so far have written."""
        aims: tuple[float, ...] = state.aims[: AIMS * state.step * self.world.scenario.drone_count]
        return aims

    def digest(self) -> str:
        """Return the SHA-256 of what a state says of its episode.

        It is the same for both kinds of engine, whatever they have run before this episode.
        """
        state, *others = self.rows
        content = [self.commands, _content_of(state._replace(aims=self._aims(state))), *others]
        if self.world.free:
            content.append([one.course[:PLACES] for one in state.senders if one.off_grid])
        return hashlib.sha256(repr(tuple(content)).encode()).hexdigest()

    def check(self, world: World, settings: RunSettings) -> None:
        """Raise StateError if an engine of this world and these settings cannot go on."""
        if world is not self.world and not _same(world, self.world):
            raise StateError("restore: the state is of another world")
        if settings.carry_over != self.settings.carry_over:
            raise StateError("restore: carry_over is not that of the state")
        if any(now and not then for now, then in zip(*_ceilings(settings, self), strict=True)):
            raise StateError("restore: a drone of the state may be above the ceiling")
        for name in ("keep_events", "keep_steps"):
            if getattr(settings, name) and not getattr(self.settings, name):
                raise StateError(f"restore: the log of the state is without {name[5:]}")


def _ceilings(settings: RunSettings, saved: SavedState) -> Any:
    return settings.ceilings, saved.settings.ceilings


def _same(world: World, other: World) -> bool:
    """Return whether two worlds are drawn from the same scenario and the same seed."""
    return world.seed == other.seed and world.scenario == other.scenario


def copied(log: EpisodeLog, settings: RunSettings) -> EpisodeLog:
    """Return a log to which others can be added, with what these settings keep of it."""
    return replace(
        log,
        events=None if log.events is None or not settings.keep_events else log.events[:],
        legs=log.legs[:] if settings.keep_events else [],
        steps=log.steps[:] if settings.keep_steps else [],
        point_steps=log.point_steps[:] if settings.keep_steps else [],
        requests=log.requests[:],
        updates=log.updates[:],
        crashed=log.crashed[:],
    )


# ---- rows as values


@cache
def fields_of(cls: Any) -> tuple[tuple[str, Any], ...]:
    """Return the names and types of the fields that a saved state has of a class of rows."""
    left_out = OF_ONE_ENGINE.get(cls, ())
    return tuple((name, kind) for name, kind in cls.kinds.items() if name not in left_out)


@cache
def _values(cls: Any) -> Any:
    names = [name for name, _ in fields_of(cls)]
    base: Any = namedtuple(cls.__name__, names)  # type: ignore[misc]
    reduce = {"__reduce__": lambda one: (_unpickled, (cls, one._fields, tuple(one)))}
    return type(cls.__name__, (base,), {"__slots__": (), **reduce})


def _unpickled(cls: Any, names: tuple[str, ...], values: tuple[Any, ...]) -> Any:
    """Return the values of a row from a pickle. Raises UnpicklingError if its fields are others."""
    if names != _values(cls)._fields:
        raise UnpicklingError(
            f"the saved state in this pickle has other fields of {cls.__name__} than this version "
            "of desim-uav; use the version that wrote it"
        )
    return _values(cls)._make(values)


def read(one: Row | View, cls: Any) -> Any:
    """Return the fields of a row, or of a view of one, as values."""
    return _values(cls)._make([_read(getattr(one, name), kind) for name, kind in fields_of(cls)])


def _read(value: Any, kind: Any) -> Any:
    if is_number(kind):
        return number(kind, value)
    if is_row(kind):
        return read(value, kind)
    of = held_by(kind)
    if origin_of(kind) is Maybe:
        return None if value is None else read(value, of)
    if is_row(of):
        return tuple([read(each, of) for each in value])
    if isinstance(value, np.ndarray):
        return tuple(value.tolist())
    return tuple([number(of, one) for one in value])


def _content_of(values: object) -> Any:
    """Return values without the fields that may be left from an earlier episode."""
    if not isinstance(values, tuple):
        return values
    names = getattr(values, "_fields", None)
    if names is None:
        return [_content_of(each) for each in values]
    if getattr(values, "number", 0) < 0:  # a user has no request
        return None
    fields = zip(names, values, strict=True)
    return [_content_of(value) for name, value in fields if name not in NOT_TOLD]


def write(one: Row | View, cls: Any, values: Sequence[Any]) -> None:
    """Write values into the fields of a row, or of a view of one."""
    for (name, kind), value in zip(fields_of(cls), values, strict=True):
        if is_number(kind):
            setattr(one, name, value)
        elif is_row(kind):
            write(getattr(one, name), kind, value)
        elif origin_of(kind) is Maybe:
            if value is not None:
                write(getattr(one, name), held_by(kind), value)
        else:
            _write_entries(one, name, kind, value)


def _row_of(cls: Any, values: Sequence[Any]) -> Any:
    """Return a new row with these values, which rules may change."""
    one = blank(cls)
    write(one, cls, values)
    return one


def _write_entries(one: Any, name: str, kind: Any, values: Sequence[Any]) -> None:
    """Write the entries of a table or a queue."""
    entries, of = getattr(one, name), held_by(kind)
    if origin_of(kind) is Table and is_row(of):
        for each, value in zip(entries, values, strict=True):
            write(each, of, value)
    elif isinstance(entries, Queue) and is_row(of):
        entries[:] = [_row_of(of, value) for value in values]
    elif origin_of(kind) is Table or isinstance(entries, Queue):
        entries[:] = values
    else:
        setattr(one, name, values)
