"""The event queue of the rules (see ``rules.due``) on SimPy's, with times in microseconds."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

import simpy

Process = Generator[simpy.Event, Any, None]
"""A generator that SimPy runs as a process."""


class Due(simpy.Event):
    """A SimPy event that is scheduled with a delay and a key (see ``rules.due.key``).

    ``valid`` says that it has been scheduled and not cancelled since.
    """

    valid = False

    def happen(self, delay_us: int, key: int) -> None:
        """Schedule the event after a delay; ``key`` is its rank in that instant."""
        self.delay_us, self.key, self.valid = delay_us, key, True
        self.t_us = int(self.env.now) + delay_us
        self.succeed()


class Clock(simpy.Environment):
    """A SimPy environment in which events of one instant happen in the order of their keys.

    SimPy orders them by priority, so the key is the priority. All keys are larger than SimPy's own
    priorities: a process that is interrupted or gets a resource continues before the next event of
    the rules.

    Each slot has an event for which a process waits (``wait``). If the slot is given a new time,
    a new event replaces it and takes over its callbacks.
    """

    def __init__(
        self, slots: int, after_event: Callable[[], None] | None = None, now_us: int = 0
    ) -> None:
        super().__init__(initial_time=now_us)
        self.after_event = after_event
        self._events = [Due(self) for _ in range(slots)]
        self._end = Due(self)

    def schedule(self, event: simpy.Event, priority: Any = 1, delay: Any = 0) -> None:
        """Schedule an event; a ``Due`` has its own priority and delay."""
        if isinstance(event, Due):
            priority, delay = event.key, event.delay_us
        super().schedule(event, priority, delay)

    def step(self) -> None:
        """Process the next event, and call ``after_event`` if there is one."""
        super().step()
        if self.after_event is not None:
            self.after_event()

    def due(self, slot: int, t_us: int, key: int) -> None:
        """Schedule the event of a slot for a time; ``key`` is its rank in that instant."""
        event = self._events[slot]
        if event.triggered:
            before, event = event, Due(self)
            if not before.processed:
                event.callbacks, before.callbacks = before.callbacks, []
            self._events[slot] = event
        event.happen(t_us - int(self.now), key)

    def undo(self, slot: int) -> None:
        """Cancel the event of a slot, if one is scheduled."""
        self._events[slot].valid = False

    def clear(self) -> None:
        """Cancel the events of all slots."""
        for event in self._events:
            event.valid = False

    def scheduled(self) -> tuple[tuple[int, int, int], ...]:
        """Return the slot, time and key of each event that is scheduled, by time and key."""
        happen = [
            (event.t_us, event.key, slot) for slot, event in enumerate(self._events) if event.valid
        ]
        return tuple([(slot, t_us, key) for t_us, key, slot in sorted(happen)])

    def nothing_before(self, key: int) -> bool:
        """Return whether no other event is scheduled for this instant, whatever its key."""
        return self.peek() > self.now

    def wait(self, slot: int) -> Process:
        """Wait until the event of a slot happens."""
        happened = False
        while not happened:
            yield self._events[slot]
            happened = self._events[slot].valid  # the event may be a new one
            self._events[slot] = Due(self)

    def run_until(self, t_us: int, key: int) -> None:
        """Let ``run_to_end`` end at a time, before the events of that instant with larger keys."""
        before, self._end = self._end, Due(self)
        if not before.processed:
            self._end.callbacks, before.callbacks = before.callbacks, []
        self._end.happen(t_us - int(self.now), key)

    def run_to_end(self) -> None:
        """Run all events before the end, which they may bring forward."""
        self.run(until=self._end)

    def run_before(self, t_us: int, key: int) -> None:
        """Run all events before time ``t_us``, and those of that instant with smaller keys."""
        end = Due(self)
        end.happen(t_us - int(self.now), key)
        self.run(until=end)
