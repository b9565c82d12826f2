"""The interface of admission rules, which decide which requests a drone serves.

The paper's rule is in ``rules.admission``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple, Protocol

from desim_uav.errors import SimulationError


class Waiting(NamedTuple):
    """A waiting request, with all that an admission rule may know about it.

    ``done`` of ``required`` are microseconds of service or millionths of a bit in stage number
    ``stage`` of ``stages``. It holds a rate of ``bandwidth_bps``, for which it needs a bandwidth of
    ``needs_hz``; they are equal at the 1 bit/s/Hz of the paper's disc.
    """

    user: int
    service: int
    t_request_us: int
    required: int
    done: int
    stage: int
    stages: int
    bandwidth_bps: int
    needs_hz: int


class Admission(Protocol):
    """An admission rule over Python objects (see ``RowAdmission`` for one over rows)."""

    def scan(
        self, waiting: Sequence[Waiting], free_hz: float
    ) -> tuple[Sequence[Waiting], Sequence[Waiting]]:
        """Return the requests that a drone serves from now on, and those that it refuses for good.

        ``waiting`` is in the order of (request time, user). ``free_hz`` is the free bandwidth in
        bit/s, inf if it is unlimited; the requests served must fit into it. A refused request is
        closed; all others continue to wait.
        """


class RowAdmission:
    """An admission rule over rows, which can be compiled, so that both engines run it.

    A subclass is a frozen dataclass whose fields are numbers, or mappings from services to numbers.
    """

    plain: ClassVar = ("scan",)
    """The methods of which a subclass overrides one if it works on Python objects, not on rows."""

    def scan_rows(self, world: Any, path: Any, state: Any, drone: Any, phase: int) -> None:
        """Serve or refuse requests of the users in ``drone.waiting``, or let them wait.

        They are in order of (request time, user), and ``state.users[u].request`` is the request of
        user u. ``rules.admission.admit`` serves one that ``rules.service.fits``: its bandwidth
        must fit ``drone.free_hz`` unless its radio's is unlimited, and its rate ``drone.free_bps``,
        what is left of the backhaul; ``turn_away`` refuses one for good. Both remove it
        from ``drone.waiting``. The others continue to wait.
        """
        raise NotImplementedError

    def scan(
        self, waiting: Sequence[Waiting], free_hz: float
    ) -> tuple[Sequence[Waiting], Sequence[Waiting]]:
        """Raise SimulationError: this rule works on rows, not on Python objects."""
        raise SimulationError(f"admission {type(self).__name__!r} works on rows (scan_rows)")
