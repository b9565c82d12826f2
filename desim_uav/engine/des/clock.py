"""The event queue of the rules (see ``rules.due``) on SimPy's, with times in microseconds."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

import simpy

Process = Generator[simpy.Event, Any, None]
"""A generator that SimPy runs as a process."""

_schedule: Callable[..., None] = simpy.Environment.schedule


class Due(simpy.Event):
    """A SimPy event that is scheduled for a time and with a key (see ``rules.due.key``).

    When it has been processed it can be used ``again``. ``valid`` says that it has been scheduled
    and not cancelled since, and ``queued`` that it has been scheduled and not used again since.
    """

    t_us: int
    key: int
    valid = queued = again = False

    def has_happened(self) -> bool:
        """Return whether the event, which has been processed, was valid; let it be used again."""
        happened, self.callbacks = self.valid, []
        self.valid, self.queued, self.again = False, False, True
        return happened


class Clock(simpy.Environment):
    """A SimPy environment in which events of one instant happen in the order of their keys.

    SimPy orders them by priority, so the key is the priority. All keys are larger than SimPy's own
    priorities: a process that is interrupted or gets a resource continues before the next event of
    the rules.

    Each slot has one of the ``events``, for which a process waits again and again. If the slot is
    given a new time before the event is processed, a new event replaces it and takes over its
    callbacks.
    """

    def __init__(self, slots: int, now_us: int = 0) -> None:
        super().__init__(initial_time=now_us)
        self.events = [Due(self) for _ in range(slots)]
        self._end = Due(self)

    def schedule(self, event: simpy.Event, priority: Any = 1, delay: Any = 0) -> None:
        """Schedule an event; a ``Due`` has its own time and priority."""
        if event.__class__ is Due:
            priority, delay = event.key, event.t_us - self.now
        _schedule(self, event, priority, delay)

    def happen(self, event: Due, t_us: int, key: int) -> None:
        """Schedule an event that is not in the queue; ``key`` is its rank in that instant."""
        event.t_us, event.key, event.valid, event.queued = t_us, key, True, True
        if event.again:  # SimPy lets an event succeed only once
            _schedule(self, event, key, t_us - self.now)
        else:
            event.succeed()

    def due(self, slot: int, t_us: int, key: int) -> None:
        """Schedule the event of a slot for a time; ``key`` is its rank in that instant."""
        event = self.events[slot]
        if event.queued:
            event = self.events[slot] = self._in_place_of(event)
        self.happen(event, t_us, key)

    def _in_place_of(self, before: Due) -> Due:
        """Return a new event, for which those wait from now on who have waited for another one."""
        event = Due(self)
        if not before.processed:
            event.callbacks, before.callbacks = before.callbacks, []
        return event

    def undo(self, slot: int) -> None:
        """Cancel the event of a slot, if one is scheduled."""
        self.events[slot].valid = False

    def clear(self) -> None:
        """Cancel the events of all slots."""
        for event in self.events:
            event.valid = False

    def scheduled(self) -> tuple[tuple[int, int, int], ...]:
        """Return the slot, time and key of each event that is scheduled, by time and key."""
        happen = [
            (event.t_us, event.key, slot) for slot, event in enumerate(self.events) if event.valid
        ]
        return tuple([(slot, t_us, key) for t_us, key, slot in sorted(happen)])

    def nothing_before(self, key: int) -> bool:
        """Return whether no other event is scheduled for this instant, whatever its key."""
        return self.peek() > self.now

    def run_until(self, t_us: int, key: int) -> None:
        """Let ``run_to_end`` end at a time, before the events of that instant with larger keys."""
        self._end = self._in_place_of(self._end)
        self.happen(self._end, t_us, key)

    def run_to_end(self) -> None:
        """Run all events before the end, which they may bring forward."""
        self.run(until=self._end)

    def run_before(self, t_us: int, key: int) -> None:
        """Run all events before time ``t_us``, and those of that instant with smaller keys."""
        end = Due(self)
        self.happen(end, t_us, key)
        self.run(until=end)


class AuditedClock(Clock):
    """A clock that calls a function after each event."""

    def __init__(self, slots: int, after_event: Callable[[], None], now_us: int = 0) -> None:
        super().__init__(slots, now_us)
        self.after_event = after_event

    def step(self) -> None:
        """Process the next event, and call ``after_event``."""
        super().step()
        self.after_event()
