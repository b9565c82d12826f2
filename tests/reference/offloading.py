"""Offloading: the part of a task that is sent to a processor, by what is known when it is made."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tests.reference.inputs import Request
from tests.reference.processors import cycles_of

if TYPE_CHECKING:
    from tests.reference.service import Services


def offloaded_part(services: Services, user: int, request: Request) -> float:
    """Return the part of a user's task that is offloaded."""
    kind = services.inputs.offloading
    if kind in ("always", "never"):
        return float(kind == "always")
    own_us = cycles_of(request) / int(services.tasks.clocks[user])
    offloaded_us = _offloaded_us(services, user, request)
    if kind == "split":
        return own_us / (own_us + offloaded_us)
    return float(offloaded_us < own_us)


def _offloaded_us(services: Services, user: int, request: Request) -> float:
    """How long all of a task would take if it were offloaded, as far as is known now."""
    d = int(services.holder[user])
    if d < 0:
        return np.inf
    tasks, bps_of, total = services.tasks, _rates(services, user, d), 0.0
    for stage in (request, *request.then):
        if stage.cycles:
            there = services.open & ~tasks.alone & (tasks.cycles > 0)
            total += stage.cycles / services.inputs.processors[d].clock
            total += tasks.backlog_us(d, there, services.left)
        elif stage.amount:
            rate = bps_of[-1] if stage.up else bps_of[0]
            bps = stage.bandwidth_bps if services.links[d].sharing == "held" else rate
            if bps == 0:
                return np.inf
            total += stage.amount / bps
    return total


def _rates(services: Services, user: int, d: int) -> list[int]:
    """The rate that a user would get in each band if it shared it, and the backhaul, equally."""
    at_link, held, found = services.at_links(d), services.held(d), []
    at_link[user] = False
    free_bps = services.backhauls.free_bps(services, d)
    for band_hz, inside in services.bands(d):
        served = np.flatnonzero(at_link & (services.server == d) & held & inside)
        free_hz = int(band_hz) - sum(services.need_hz(d, u) for u in served)
        sharers = int((at_link & ~held & inside).sum()) + 1
        bps = free_hz // sharers * services.efficiency(d, user) // 1_000_000
        sharers = int((at_link & ~held).sum()) + 1
        found.append(int(min(bps, free_bps // sharers)))
    return found
