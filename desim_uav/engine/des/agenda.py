"""SimPy's event queue under the model's own order: time, phase, drone, user; never insertion."""

from __future__ import annotations

from collections.abc import Callable
from heapq import heappush
from typing import Any

import simpy

_PHASE, _DRONE = 1 << 48, 1 << 24


class Agenda(simpy.Environment):
    """A SimPy environment whose clock counts whole microseconds.

    SimPy orders events of one instant by priority: ours is the key (phase, drone, user), which is
    above SimPy's own priorities, so a resource hands on its place before the next event of ours.
    """

    _now: int
    _queue: list[Any]

    @property
    def now(self) -> int:
        """The time, in microseconds since the simulation was built."""
        return self._now

    def at(self, t_us: int, phase: int, drone: int = -1, user: int = -1) -> Due:
        """An event for a process to wait for."""
        due = Due([], None)
        self.add(due, t_us, phase, drone, user)
        return due

    def call(
        self,
        callback: Callable[[Due], None],
        args: Any,
        t_us: int,
        phase: int,
        drone: int = -1,
        user: int = -1,
    ) -> None:
        """Call ``callback`` at an instant with an event that carries ``args``."""
        key = phase * _PHASE + (drone + 1) * _DRONE + user + 1
        heappush(self._queue, (t_us, key, next(self._eid), Due([callback], args)))

    def add(self, event: simpy.Event, t_us: int, phase: int, drone: int, user: int) -> None:
        """Let a triggered event happen (SimPy's schedule, without its detour over a delay)."""
        key = phase * _PHASE + (drone + 1) * _DRONE + user + 1
        heappush(self._queue, (t_us, key, next(self._eid), event))

    def is_next(self, phase: int) -> bool:
        """Would an event of this instant and phase, without drone and user, be the next one?"""
        queue = self._queue
        return not queue or queue[0][0] > self._now or queue[0][1] > phase * _PHASE


class Due(simpy.Event):
    """An event that is bound to happen at its time."""

    _ok = True
    _value = None

    def __init__(self, callbacks: list[Callable[[Any], None]], args: Any) -> None:
        self.callbacks = callbacks
        self.args = args


class Signal(simpy.Event):
    """An event a process waits for until somebody gives it a value."""

    env: Agenda

    def give(self, value: Any, phase: int, drone: int) -> None:
        """Wake the process in this instant, in its place in the order."""
        self._ok = True
        self._value = value
        self.env.add(self, self.env.now, phase, drone, -1)
