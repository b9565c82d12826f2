"""A drone as its users know it: a footprint, a bandwidth, and a queue of requests."""

from __future__ import annotations

from bisect import insort
from operator import attrgetter

from desim_uav.engine.des.agenda import key
from desim_uav.engine.des.request import Request
from desim_uav.model.rules import Phase

_IN_ORDER = attrgetter("t_request_us", "user")


class Radio:
    """The radio of the drone with the same ``index``.

    It is ``on`` while the drone serves. ``sweep`` changes with every leg and when it is switched
    off, so that crossings foreseen for an earlier leg are known to be stale. ``waiting`` holds the
    open requests of attached users that are not served, in order of (request time, user).
    ``served`` and ``asking`` count, by service, the requests it serves and the open requests of
    all users it covers. The keys are those of user 0 on the agenda.
    """

    def __init__(self, index: int, bandwidth_bps: float, services: int) -> None:
        self.index = index
        self.entry_key = key(Phase.ENTRY, index, 0)
        self.exit_key = key(Phase.EXIT, index, 0)
        self.completion_key = key(Phase.COMPLETION, index, 0)
        self.on = False
        self.sweep = 0
        self.free_bps = bandwidth_bps
        self.used_bps = 0
        self.attached_users = 0
        self.served = [0] * services
        self.asking = [0] * services
        self.waiting: list[Request] = []

    def queue_up(self, request: Request) -> None:
        """A request waits, in its place."""
        if self.waiting:
            insort(self.waiting, request, key=_IN_ORDER)
        else:
            self.waiting.append(request)
