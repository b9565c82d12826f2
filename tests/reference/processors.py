"""Tasks at each tick: where they are computed, which part of them by whom, and how fast."""

from __future__ import annotations

import numpy as np

from tests.reference.inputs import NEVER, Inputs, Processor, Request


class Tasks:
    """What belongs to the open request of each user if processors have a part in it.

    ``cycles``: those of its present stage, 0 if this is at a link. ``site``: the transmitter that
    has received it since ``arrived_us``, or -1. A user computes ``own`` of its cycles itself, of
    which ``own_left`` are left, and offloads a ``part``; ``alone``: nothing else is left to do.
    ``target``: the transmitter to whose processor it moves, or -1.
    ``last``: who has served it last. ``computing_us``: for how long processors of transmitters have
    computed it, and ``own_us`` that of the user.
    """

    def __init__(self, inputs: Inputs) -> None:
        self.inputs = inputs
        users = len(inputs.legs)
        self.clocks = np.array(inputs.clocks or [0] * users, np.int64)
        self.cycles = np.zeros(users, np.int64)
        self.site = np.full(users, -1)
        self.target = np.full(users, -1)
        self.arrived_us = np.zeros(users, np.int64)
        self.deadline_us = np.full(users, NEVER)
        self.part = np.ones(users)
        self.own = np.zeros(users, np.int64)
        self.own_left = np.zeros(users, np.int64)
        self.alone = np.zeros(users, bool)
        self.last = np.full(users, -1)
        self.computing_us = np.zeros(users, np.int64)
        self.own_us = np.zeros(users, np.int64)

    def forget(self, user: int) -> None:
        """Begin a new request."""
        self.site[user] = self.last[user] = self.target[user] = -1
        self.part[user] = 1.0
        self.own[user] = self.own_left[user] = 0
        self.alone[user] = False
        self.computing_us[user] = self.own_us[user] = 0

    def elapse(self, dt_us: int, server: np.ndarray, running: np.ndarray) -> None:
        """Compute for a tick; the processors of the users ``running`` compute."""
        self.own_left -= np.where(running, self.clocks * dt_us, 0)
        served = server >= 0
        self.last[served] = server[served]
        computing = served & (self.cycles > 0) & (self.target < 0)
        self.computing_us += computing * dt_us
        self.own_us += running * dt_us

    def own_share(self, user: int) -> float:
        """Which share of its own part a user has computed."""
        return 1.0 - max(int(self.own_left[user]), 0) / int(self.own[user])

    def begin_own(self, user: int, request: Request, part: float) -> None:
        """Let a user compute what it does not offload."""
        self.part[user] = part
        cycles = cycles_of(request)
        self.own[user] = self.own_left[user] = cycles - int(cycles * part)

    def line(self, d: int, there: np.ndarray) -> list[int]:
        """The tasks at a processor, in the order in which it computes them."""
        by_deadline = self.inputs.processors[d].sharing == "earliest_deadline"

        def place(user: int) -> tuple[int, int, int]:
            return int(self.deadline_us[user]) * by_deadline, int(self.arrived_us[user]), user

        return sorted(
            np.flatnonzero(there & (self.site == d) & (self.target < 0)).tolist(), key=place
        )

    def backlog_us(self, d: int, there: np.ndarray, left: np.ndarray) -> float:
        """How long a processor needs for the tasks at it."""
        processor = self.inputs.processors[d]
        waits = sum(max(int(left[user]), 0) for user in self.line(d, there))
        return waits / processor.clock / processor.cores


def cycles_of(request: Request) -> int:
    """The cycles of all stages of a request."""
    return request.cycles + sum(stage.cycles for stage in request.then)


def paces(processor: Processor, count: int) -> list[int]:
    """The cycles, in thousandths per microsecond, that each of the tasks in a line gets."""
    if processor.sharing == "processor_sharing":
        return [min(processor.clock, processor.clock * processor.cores // max(count, 1))] * count
    served = min(count, processor.cores)
    return [processor.clock] * served + [0] * (count - served)
