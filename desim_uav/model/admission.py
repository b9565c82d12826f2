"""Admission control: which open requests of its attached users a drone serves.

The paper's rule is in ``rules.admission``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Protocol, TypeVar

from desim_uav.errors import SimulationError


class Waiting(Protocol):
    """A waiting request, with everything that an admission rule may know about it."""

    user: int
    service: int
    t_request_us: int
    required_us: int
    served_us: int
    bandwidth_bps: int


W = TypeVar("W", bound=Waiting)


class Admission(Protocol):
    """An admission rule, which decides which waiting requests a drone serves."""

    def scan(self, waiting: Sequence[W], free_bps: float) -> tuple[Sequence[W], Sequence[W]]:
        """Return the requests to serve now and those to refuse for good, at one drone.

        ``waiting`` is in the order of (request time, user). ``free_bps`` is the free bandwidth in
        bit/s, inf if it is unlimited; the requests served must fit into it. A refused request is
        closed; all others go on waiting.
        """


class RowAdmission:
    """An admission rule over rows, which is compiled: both engines run it.

    A subclass is a frozen dataclass whose fields are numbers, or mappings from services to numbers.
    """

    plain: ClassVar = ("scan",)
    """A subclass that overrides one of these works on Python's objects instead of rows."""

    def scan_rows(self, world: Any, path: Any, state: Any, drone: Any, phase: int) -> None:
        """Decide on the requests of the users in ``drone.waiting``.

        They are in order of (request time, user), and ``state.users[u].request`` is the request of
        user u. ``rules.admission.admit`` serves one, whose bandwidth must fit ``drone.free_bps``
        unless ``world.bandwidth_bps`` is -1; ``turn_away`` closes one for good. Both
        take it out of ``drone.waiting``. The others go on waiting.
        """
        raise NotImplementedError

    def scan(self, waiting: Sequence[W], free_bps: float) -> tuple[Sequence[W], Sequence[W]]:
        """Refuse: this rule works on rows."""
        raise SimulationError(f"admission {type(self).__name__!r} works on rows (scan_rows)")
