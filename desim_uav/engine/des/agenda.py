"""SimPy's event queue under the model's own order: time, phase, drone, user; never insertion."""

from __future__ import annotations

from collections.abc import Callable, Generator
from heapq import heappop, heappush
from typing import Any

import simpy

Life = Generator[simpy.Event, Any, None]
"""What a SimPy process runs."""

_PHASE, _DRONE = 1 << 48, 1 << 24


def key(phase: int, drone: int = -1, user: int = -1) -> int:
    """The place within an instant: by phase, drone, user (-1: none, first); users are adjacent."""
    return phase * _PHASE + (drone + 1) * _DRONE + user + 1


class Agenda(simpy.Environment):
    """A SimPy environment whose clock counts whole microseconds.

    SimPy orders events of one instant by priority: ours is the key (phase, drone, user), which is
    above SimPy's own priorities, so a resource hands on its place before the next event of ours.
    Crossings, completions and records have nobody who waits for them: the queue holds calls,
    (time, key, number, function, argument), of which that of ``happen`` is what wakes processes.
    ``paused`` ends a run.
    """

    _now: int
    _queue: list[Any]

    def __init__(self) -> None:
        super().__init__()
        self.paused = False
        self._lives: list[tuple[simpy.Process, Life]] = []

    @property
    def now(self) -> int:
        """The time, in microseconds since the simulation was built."""
        return self._now

    # ---- what is to come

    def process(self, life: Life, begins: Due | None = None) -> simpy.Process:
        """Start a process: before anything else happens, or when ``begins`` does."""
        process = simpy.Process(self, life) if begins is None else Later(self, life, begins)
        self._lives.append((process, life))
        return process

    def at(self, t_us: int, key: int) -> Due:
        """An event for a process to wait for."""
        due = Due()
        heappush(self._queue, (t_us, key, next(self._eid), happen, due))
        return due

    def call(self, function: Callable[[Any], None], argument: Any, t_us: int, key: int) -> None:
        """Call ``function`` with its one argument at an instant, in its place there."""
        heappush(self._queue, (t_us, key, next(self._eid), function, argument))

    def add(self, event: simpy.Event, t_us: int, key: int) -> None:
        """Let a triggered event happen."""
        heappush(self._queue, (t_us, key, next(self._eid), happen, event))

    def schedule(
        self, event: simpy.Event, priority: int = simpy.events.NORMAL, delay: float = 0
    ) -> None:
        """What SimPy itself lets happen, such as the handing on of a pad: always at once."""
        self.add(event, self._now + int(delay), priority)

    def is_next(self, key: int) -> bool:
        """Would an event of this instant, in this place, be the next one?"""
        queue = self._queue
        return not queue or queue[0][0] > self._now or queue[0][1] >= key

    def run_before(self, key: int) -> None:
        """Let all happen that comes before this place in this instant."""
        queue = self._queue
        while queue and queue[0][0] == self._now and queue[0][1] < key:
            self.step()

    # ---- letting it happen

    def step(self) -> None:
        """Let the next thing happen. Raises SimPy's EmptySchedule where nothing is to come."""
        if not self._queue:
            raise simpy.core.EmptySchedule
        self._now, _, _, function, argument = heappop(self._queue)
        function(argument)

    def run_on(self) -> None:
        """Step after step until somebody sets ``paused``; the loop of ``step``, written out."""
        queue = self._queue
        self.paused = False
        while not self.paused:
            self._now, _, _, function, argument = heappop(queue)
            function(argument)

    def abandon(self) -> None:
        """End all lives and forget what is to come.

        A process that waits for an event and the event that will wake it hold each other: left to
        themselves, hundreds of them an episode wait for Python's collector of cyclic garbage.
        """
        for process, life in self._lives:
            awaited = process.target
            if awaited is not None and awaited.callbacks is not None:
                awaited.callbacks.clear()
            life.close()
        self._lives.clear()
        self._queue.clear()


def happen(event: simpy.Event) -> None:
    """Wake who waits for an event, as SimPy's own step does; raise what nobody heeds."""
    callbacks, event.callbacks = event.callbacks, None  # type: ignore[assignment]
    for callback in callbacks:
        callback(event)
    if not event._ok and not event.defused:
        raise event._value


class Later(simpy.Process):
    """A process that begins with an event, where SimPy's own begins with one it makes for that."""

    def __init__(self, agenda: Agenda, life: Life, begins: Due) -> None:
        self.env = agenda
        self.callbacks = []
        self._generator = life
        self._target = begins
        begins.callbacks.append(self._resume)


class Due(simpy.Event):
    """An event that is bound to happen at its time."""

    _ok = True
    _value = None

    def __init__(self) -> None:
        self.callbacks: list[Callable[[Any], None]] = []


class Signal(simpy.Event):
    """An event a process waits for until somebody gives it a value."""

    env: Agenda

    def give(self, value: Any, key: int) -> None:
        """Wake the process in this instant, in its place in the order."""
        self._ok = True
        self._value = value
        self.env.add(self, self.env._now, key)

    def give_now(self, value: Any) -> None:
        """Wake the process before anything else happens, as SimPy's step would."""
        self._ok = True
        self._value = value
        happen(self)
