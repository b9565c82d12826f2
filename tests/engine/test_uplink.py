"""Uploads in a band of their own, worked by hand: what shares it, what it holds, and who knows.

Links have 1 bit/s/Hz. Downloads have a band of 1 MHz, and uploads one of 0.5 MHz; the processor has
a core of 1 MHz.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest

from desim_uav.model.sharing import RowSharing
from desim_uav.rules.rows import Constants, Drone, State
from desim_uav.rules.service import give_share, rate_bps
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine import test_offloading
from tests.engine.helpers import Flight, fly, path_of, radio, seen
from tests.engine.test_stages import SERVICES as STAGED
from tests.engine.test_stages import SHARED, UBIT, US, ask, hover
from tests.engine.test_task_logs import HERE, NO_BITS, SERVICES, ends_s, log_of, task, world_of
from tests.engine.test_transfers import FAR
from tests.selection import by_default

pytestmark = pytest.mark.usefixtures("every_engine")


def apart(users: int, sharing: Any = "equal", **drones: Any) -> World:
    """Some users below a drone with two bands."""
    rates = {"bandwidth_kbps": [400]} if sharing == "held" else {}
    services = {name: NO_BITS | rates | own for name, own in SERVICES.items()}
    told = {"radio": radio(sharing=sharing, uplink_mhz=0.5), **drones}
    return world_of([HERE] * users, drones=told, services=services)


@dataclass(frozen=True)
class OwnEqual(RowSharing):
    """Gives each request the same bandwidth of the band that it is asked about."""

    def divide(self, world: Constants, state: State, drone: Drone, phase: int) -> None:
        """Divide the band equally."""
        hz = drone.free_hz // len(drone.sharing)
        for k in range(len(drone.sharing)):
            user = state.users[drone.sharing[k]]
            give_share(world, state, user, hz, rate_bps(world, drone, user, hz), phase)


SHARINGS = ["equal", "proportional_fair", {"kind": f"{__name__}:OwnEqual"}]


@pytest.mark.parametrize("sharing", by_default(SHARINGS[:1], SHARINGS, at_most=3))
def test_uploads_share_among_themselves(sharing: Any) -> None:
    """Two inputs of 1 Mbit, from 0 and from 1 s on; results of 2 and of 1 Mbit.

    User 0 has 0.5 Mbit left at 1 s, and 0.25 Mbit/s from then on, until 3 s. User 1 has sent as
    much then, and sends the rest until 4 s. Each is computed in 0.5 s. The result of user 0 has
    the whole other band from 3.5 s on; at 4.5 s 1 Mbit is left. As much comes to user 1, at half of
    the band each, until 6.5 s.
    """
    asks = {0: [task(0.0, 1.0, 0.5, 2.0)], 1: [task(1.0, 1.0, 0.5, 1.0)]}
    assert ends_s(log_of(apart(2, sharing), asks)) == {0: 6.5, 1: 6.5}


def test_one_band_for_all_is_another_matter() -> None:
    """The upload of user 1 takes half of the band from the result of user 0, from 1.5 to 2 s.

    1 Mbit is up at 1 s, and computed at 1.5 s. The result of 0.5 Mbit comes at 0.5 Mbit/s, until
    2.5 s, because the other input is sent meanwhile. With two bands both take as long as alone.
    """
    asks = {0: [task(0.0, 1.0, 0.5, 0.5)], 1: [task(1.5, 1.0, 0.5)]}
    one = world_of([HERE] * 2, drones={"radio": radio()})
    two = world_of([HERE] * 2, drones={"radio": radio(uplink_mhz=1)})
    assert ends_s(log_of(one, asks)) == {0: 2.5, 1: 3.5}
    assert ends_s(log_of(two, asks)) == {0: 2.0, 1: 3.0}


def test_a_rate_is_held_in_its_own_band() -> None:
    """Three tasks of 0.4 Mbit up, 0.5 s and 0.8 Mbit down, at 400 kbit/s.

    One input fits at a time, from 0, 1 and 2 s on, but two results. These begin at 1.5, 2.5 and
    3.5 s, when the first one has ended.
    """
    rows = {user: [(*task(0.0, 0.4, 0.5, 0.8), 400_000)] for user in range(3)}
    log = log_of(apart(3, "held"), rows)
    assert ends_s(log) == {0: 3.5, 1: 4.5, 2: 5.5}


def test_one_backhaul_carries_both_bands() -> None:
    """750 kbit/s, and inputs of 0.25 and of 1 Mbit at 0 and 1 s; a result of 1 Mbit.

    At 1 s a result is proposed 1,000 kbit/s, and an input 500, of which half fits. The result has
    come at 3 s. The input has 0.5 Mbit left, which take until 4 s, and it is computed at 4.5 s.
    """
    world = apart(2, backhaul={"kind": "capacity", "kbps": 750})
    asks = {0: [task(0.0, 0.25, 0.5, 1.0)], 1: [task(1.0, 1.0, 0.5)]}
    assert ends_s(log_of(world, asks)) == {0: 3.0, 1: 4.5}


def test_access_points_have_their_own_bands() -> None:
    """A mast takes 3 Mbit in 1.5 s at 2 MHz and brings 6 Mbit in 6 s at 1 MHz."""
    mast = {"at_m": [300, 300], "height_m": 20, "radio": radio(uplink_mhz=2)}
    far = {"count": 1, "radio": radio(classes=[{"snr_db": 90, "bit_s_hz": 1}]), "battery": None}
    told: Any = {"services": STAGED, "demand": {"kind": "static", "mix": {"call": 1}}}
    world = hover([FAR], access_points=[mast], drones=far, **told)
    log = fly(world, path_of(world, {0: [ask(0.0, *SHARED)]}))
    assert [(one.t_end_us, one.sent_ubit) for one in log.requests] == [(7_500_000, 9 * UBIT)]
    assert [(event[0], event[3]) for event in seen(log, "stage")] == [(1_500_000, 1)]


def test_offloading_foresees_the_rate_of_uploads() -> None:
    """1 Mbit takes 2 s at 0.5 MHz, and 0.5 s on the core; the user alone would take 1 s."""
    told = test_offloading.RADIO | {"uplink_mhz": 0.5}
    world = test_offloading.world_of("split", radio=told)
    (request,) = test_offloading.log_of(world, {0: [test_offloading.ask(0.0, 1.0)]}).requests
    assert request.part == pytest.approx(1 / 3.5)


def test_the_bandwidth_in_use_is_that_of_both_bands() -> None:
    """At 60 s, an upload has 0.5 of the 1.5 MHz that there are."""
    told = test_offloading.RADIO | {"uplink_mhz": 0.5}
    world = test_offloading.world_of("always", radio=told, observation={"kind": "local"})
    flight = Flight(world)
    flight.engine.reset(path_of(world, {0: [test_offloading.ask(30.0, 40.0)]}))
    names = [one.name for one in world.scenario.observation.features(world.facts)]
    flight.engine.step([flight.command("hover")])
    left = flight.engine.features()[0][names.index("bandwidth_left")]
    assert left == pytest.approx(1 - 0.5 / 1.5)
    assert world.bandwidth_of_all_hz == 1_500_000
    assert world.facts.bandwidth_khz == 1500


def test_updates_go_up() -> None:
    """An update of 1 Mbit takes 2 s in the band of uploads, beside a download of 1 Mbit in 1 s."""
    users = [
        {"name": "meter", "positions_m": [HERE], "demand": {"kind": "sensing", "service": "read"}},
        {"name": "phone", "positions_m": [HERE]},
    ]
    read = {
        "kind": "collect",
        "updates": {"kind": "periodic", "every_s": 1000, "offset": 0},
        "size_mbit": [1],
    }
    scenario = {
        "map": {"size_m": [600, 600], "cells": [1, 1], "dimensions": 2},
        "drones": {"count": 1, "radio": radio(uplink_mhz=0.5), "battery": None},
        "stations": {"count": 0},
        "users": users,
        "services": {"read": read, "page": {"kind": "transfer", "volume_mbit": [1]}},
        "demand": {"kind": "static", "mix": {"page": 1}},
        "reward": {"kind": "coverage_battery"},
        "episode": {"steps": 1},
    }
    world = build_world(from_mapping(scenario), 0)
    log = fly(world, path_of(world, {0: [ask(0.0, 0, UBIT, 0)], 1: [ask(0.0, 1, UBIT, 0)]}))
    assert {one.user: one.t_end_us for one in log.requests} == {0: 2 * US, 1: US}
