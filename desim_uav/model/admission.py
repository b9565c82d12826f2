"""Which of a drone's attached users with open requests are served: admission control."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from desim_uav.registry import register


class Waiting(Protocol):
    """A request that waits: all an admission rule may look at."""

    user: int
    service: int
    t_request_us: int
    required_us: int
    served_us: int
    bandwidth_bps: int


W = TypeVar("W", bound=Waiting)


class Admission(Protocol):
    """An admission rule."""

    def scan(self, waiting: Sequence[W], free_bps: float) -> tuple[Sequence[W], Sequence[W]]:
        """(served now, refused for good) of the requests that wait at one drone.

        ``waiting`` stands in order of (request time, user); ``free_bps`` is inf where bandwidth is
        unlimited. The bandwidth of those served must fit ``free_bps``. A refused request closes.
        """


@register("admission", "first_come")
@dataclass(frozen=True)
class FirstCome:
    """Serve each that fits, in order of request time: no head-of-line blocking (the paper)."""

    def scan(self, waiting: Sequence[W], free_bps: float) -> tuple[Sequence[W], Sequence[W]]:
        """Everything that fits the free bandwidth in turn; nothing is refused."""
        served = []
        for request in waiting:
            if request.bandwidth_bps <= free_bps:
                free_bps -= request.bandwidth_bps
                served.append(request)
        return served, ()
