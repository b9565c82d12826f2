"""One request of a user, from asking to its end. Times in microseconds of the episode."""

from __future__ import annotations

from desim_uav.engine.des.agenda import Due
from desim_uav.model.rules import Outcome

# An enum member is looked up slowly in Python 3.11.
NEVER_SERVED, COMPLETED = Outcome.NEVER_SERVED, Outcome.COMPLETED
UNFINISHED = Outcome.UNFINISHED


class Request:
    """What a user asked for and what it got so far.

    ``serving`` is the drone that serves it now (-1: none), since ``started_us``; ``stopped_us``
    the end of the last service of more than 0 µs. ``stamp`` changes with every start and stop, so
    that a completion foreseen before then is known to be stale. ``again`` lets its user go on,
    ``think_us`` after the end (None: that was its last).
    """

    def __init__(
        self,
        request_id: int,
        user: int,
        service: int,
        t_request_us: int,
        required_us: int,
        bandwidth_bps: int,
        think_us: int,
        again: Due | None,
    ) -> None:
        self.request_id = request_id
        self.user = user
        self.service = service
        self.t_request_us = t_request_us
        self.required_us = required_us
        self.bandwidth_bps = bandwidth_bps
        self.think_us = think_us
        self.again = again
        self.served_us = 0
        self.attached_us = 0
        self.interruptions = 0
        self.t_first_us: int | None = None
        self.t_end_us = -1
        self.started_us = -1
        self.stopped_us = -1
        self.serving = -1
        self.stamp = 0
        self.outcome = NEVER_SERVED
        self.drones: list[int] = []

    def start(self, drone: int, t_us: int) -> None:
        """Service begins."""
        self.serving = drone
        self.started_us = t_us
        self.stamp += 1

    def stop(self, t_us: int) -> int:
        """Service stops; the time served now. A service of 0 µs leaves no trace."""
        drone, self.serving = self.serving, -1
        self.stamp += 1
        elapsed_us = t_us - self.started_us
        if elapsed_us > 0:
            self.served_us += elapsed_us
            if self.t_first_us is None:
                self.t_first_us = self.started_us
            else:
                self._count_interruption(self.started_us)
            if not self.drones or self.drones[-1] != drone:
                self.drones.append(drone)
            self.stopped_us = t_us
        return elapsed_us

    def count_attached(self, since_us: int, t_us: int) -> None:
        """Its user was attached from ``since_us`` until now; while it is open, that counts."""
        asked_us = self.t_request_us
        self.attached_us += t_us - (since_us if since_us > asked_us else asked_us)

    def close(self, t_us: int) -> None:
        """The request ends, served or not."""
        self.t_end_us = t_us
        if self.served_us == self.required_us:
            self.outcome = COMPLETED
        elif self.served_us > 0:
            self.outcome = UNFINISHED
            self._count_interruption(t_us)

    def _count_interruption(self, resumed_us: int) -> None:
        """An interruption is a stop after which the request goes unserved for more than 0 µs."""
        self.interruptions += resumed_us > self.stopped_us
