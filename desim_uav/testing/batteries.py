"""A check of an energy model: that ``lasts`` is the inverse of ``drains``, in the right units."""

from __future__ import annotations

from collections.abc import Iterator

from desim_uav.engine.constants import transits_of
from desim_uav.model.energy.battery import Energy, capacity_of
from desim_uav.model.motion.motion import Transit
from desim_uav.model.rules import MINUTE_US
from desim_uav.testing.exact import require
from desim_uav.world import World

SHARES = (0.01, 0.2, 0.5, 0.9, 1.0)
UNITS = 1000.0
"""A full battery that lasts longer or shorter than it says, by this factor, has another unit."""


def require_inverse_drains(world: World) -> None:
    """Require of each battery of a world that it drains as its interface says."""
    for drones in world.scenario.fleet:
        if drones.battery is not None:
            name = type(drones.battery).__name__
            for flight in transits_of(world):
                for problem in _problems(drones.battery, flight):
                    require(False, f"battery {name!r}, {_named(flight)}: {problem}")


def _named(flight: Transit) -> str:
    return f"a flight of {flight.distance_m:g} m" if flight.distance_m else "a hover"


def _problems(energy: Energy, flight: Transit) -> Iterator[str]:
    """Yield what is wrong with what a flight takes."""
    full, longest = capacity_of(energy), round(energy.autonomy_min * MINUTE_US)
    times = [round(share * (flight.duration_us or longest)) for share in SHARES]
    before = 0
    for elapsed_us in (0, *times):
        drained = energy.drain_of(flight, elapsed_us)
        if int(drained) != drained or drained < before:
            yield f"after {elapsed_us} µs it has taken {drained}; before that, {before}"
            return
        before = drained
        if drained:
            yield from _misjudged(energy, flight, drained)
    if not flight.distance_m:
        lasts_us = energy.lasts_us(flight, full)
        if not longest / UNITS < lasts_us < longest * UNITS:
            yield f"a full battery lasts {lasts_us} µs; autonomy_min says {longest} µs"


def _misjudged(energy: Energy, flight: Transit, charge: int) -> Iterator[str]:
    """Yield the problem if ``lasts_us`` is not the least time after which a charge is used."""
    lasts_us = energy.lasts_us(flight, charge)
    until, just = (energy.drain_of(flight, at) for at in (lasts_us, lasts_us - 1))
    if not just < charge <= until:
        yield (
            f"a charge of {charge} lasts {lasts_us} µs, but {until} is taken by then, and {just} "
            "a microsecond before"
        )
