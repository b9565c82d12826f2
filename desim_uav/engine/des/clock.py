"""SimPy's clock in whole microseconds, for the rules: what is to happen, and who waits for it."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

import simpy

Life = Generator[simpy.Event, Any, None]
"""What a SimPy process runs."""


class Due(simpy.Event):
    """An event with its own time and its own place in that instant.

    ``valid``: it has been scheduled, and has not been undone since.
    """

    valid = False

    def happen(self, delay_us: int, key: int) -> None:
        """Schedule it after a delay, at a place (see ``rules.due.key``)."""
        self.delay_us, self.key, self.valid = delay_us, key, True
        self.succeed()


class Clock(simpy.Environment):
    """A SimPy environment in which events of one instant happen in the order of their keys.

    SimPy orders them by priority, so the key is the priority. All keys are larger than SimPy's own
    priorities: a process that is interrupted or gets a resource goes on before the next event of
    the rules.

    Each slot has an event that a process waits for (``wait``). If the thing of a slot is scheduled
    anew, another event takes over those who wait.
    """

    def __init__(self, slots: int, after_event: Callable[[], None] | None = None) -> None:
        super().__init__(initial_time=0)
        self.after_event = after_event
        self._events = [Due(self) for _ in range(slots)]

    def schedule(self, event: simpy.Event, priority: Any = 1, delay: Any = 0) -> None:
        """Schedule an event; one that is due has its own priority and delay."""
        if isinstance(event, Due):
            priority, delay = event.key, event.delay_us
        super().schedule(event, priority, delay)

    def step(self) -> None:
        """Process the next event."""
        super().step()
        if self.after_event is not None:
            self.after_event()

    def due(self, slot: int, t_us: int, key: int) -> None:
        """Let the thing of a slot happen at a time, at its place in that instant."""
        event = self._events[slot]
        if event.triggered:
            before, event = event, Due(self)
            if not before.processed:
                event.callbacks, before.callbacks = before.callbacks, []
            self._events[slot] = event
        event.happen(t_us - int(self.now), key)

    def undo(self, slot: int) -> None:
        """Let the thing of a slot not happen."""
        self._events[slot].valid = False

    def clear(self) -> None:
        """Clear all slots."""
        for event in self._events:
            event.valid = False

    def nothing_before(self, key: int) -> bool:
        """Return whether it is known that nothing else happens in this instant."""
        return self.peek() > self.now

    def wait(self, slot: int) -> Life:
        """Wait until the thing of a slot happens."""
        happened = False
        while not happened:
            yield self._events[slot]
            happened = self._events[slot].valid  # of the event that took over, if one did
            self._events[slot] = Due(self)

    def run_before(self, t_us: int, key: int) -> None:
        """Let everything happen that comes before a place in an instant."""
        end = Due(self)
        end.happen(t_us - int(self.now), key)
        self.run(until=end)
