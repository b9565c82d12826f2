"""The largest values of the sums of whole numbers that compiled code keeps in 64 bits.

Python's whole numbers are not limited in size, so only the SimPy engine runs worlds in which a sum
might not fit. Sums that fit in every world are not listed here, but in
``docs/explanation/exactness.md``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from desim_uav.model.services import MOST_BPS, Collecting
from desim_uav.rules.service import MILLION
from desim_uav.world import World

LARGEST = 2**62
"""The largest sum: half of what 64 bits hold, because two of them are added and subtracted."""


MOST_NUMBERED = 2**15 - 1
"""The most things that rows number with 16 bits (``rowcode.rows.Int16``)."""


def too_many(world: World) -> list[str]:
    """Return of what there are too many to be numbered with 16 bits, if so.

    Scenarios have fewer drones, access points, stations and services in any case.
    """
    counts = [("services", "stages", sum(map(len, world.services.stages)))]
    keys = [".".join(map(str, key)) for key in world.scenario.fleet_keys]
    keys += [f"access_points.{k}" for k in range(len(world.scenario.access_points))]
    for key, links in zip(keys, world.links, strict=True):
        counts.append((f"{key}.radio", "classes", len(links.efficiencies)))
    return [
        f"{key}: {count:,} {what} are too many; at most {MOST_NUMBERED:,}"
        for key, what, count in counts
        if count > MOST_NUMBERED
    ]


class Sum(NamedTuple):
    """A sum over an episode: the keys that determine it, what it is, and its largest value."""

    keys: str
    what: str
    most: int


def too_large(world: World) -> list[str]:
    """Return why sums of an episode of this world may not fit in 64 bits, if so."""
    return [f"{one.keys}: {one.what}" for one in sums_of(world) if one.most > LARGEST]


def sums_of(world: World) -> Iterator[Sum]:
    """Yield the sums of an episode whose largest value depends on the scenario.

    Those of requests are sums over users; sensors have more than one update at a time.
    """
    scenario, horizon_us, users = world.scenario, world.horizon_us, len(world.homes)
    drones = scenario.drone_count
    together = "together is too long"
    yield Sum("users.count, episode", f"the time of all users {together}", users * horizon_us)
    yield Sum("drones.count, episode", f"the time of all drones {together}", drones * horizon_us)
    if scenario.separation_m is not None:
        pairs = drones * (drones - 1) // 2
        what = f"the time of all pairs of drones {together}"
        yield Sum("drones.count, separation_m, episode", what, pairs * horizon_us)
    keys = [".".join(map(str, key)) for key in scenario.fleet_keys]
    for key, own, fleet in zip(keys, world.types, scenario.fleet, strict=True):
        # A drone takes off at a decision epoch, with at most the capacity, and uses no more.
        used = own.capacity * (world.most_epochs + 1)
        yield Sum(f"{key}.battery, episode", "what a drone may use is too much", used)
        if own.in_joules and fleet.processor is not None:
            # Less than a watt, in picojoules; whole watts are at most MOST_W, a million.
            what = "what its processor may draw is too much"
            yield Sum(f"{key}.processor, episode", what, MILLION * horizon_us)
    for name, count, keeps in _buffers(world):
        # An update counts from when it was taken, so several of a sensor count at a time.
        what = f"the time of all updates {together}"
        most = 2 * count * (keeps.buffer + 1) * horizon_us
        yield Sum(f"services.{name}.buffer, users.count, episode", what, most)
    keys += [f"access_points.{k}" for k in range(len(scenario.access_points))]
    for key, links in zip(keys, world.links, strict=True):
        efficiencies = [int(each) for each in links.efficiencies if each > 0]
        if math.isinf(links.bandwidth_hz):
            needed_hz = MOST_BPS * MILLION // min(efficiencies, default=MILLION)
            yield Sum(f"{key}.radio", "the bandwidth in use is too large", users * needed_hz)
        else:
            widest_hz = int(max(links.bandwidth_hz, links.uplink_hz or 0))
            rate = widest_hz * max(efficiencies, default=0)
            yield Sum(f"{key}.radio", "the rate of its bandwidth is too large", rate)


def _buffers(world: World) -> Iterator[tuple[str, int, Collecting]]:
    """Yield the services whose updates sensors send, and how many sensors each of them has."""
    for number, keeps in enumerate(world.services.collecting):
        count = sum(service == number for service in world.senses)
        if keeps is not None and count > 0:
            yield world.services.names[number], count, keeps
