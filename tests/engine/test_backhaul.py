"""Backhauls of a fixed capacity, worked by hand: which rates they admit, and how they are shared.

A drone has 1 MHz: users in class 1 get 1 bit/s/Hz, and those in class 2 get 2 bit/s/Hz. A backhaul
counts bits, and not the bandwidth that they take.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.model.sharing import RowSharing
from desim_uav.rules.backhaul import divide
from desim_uav.rules.rows import Constants, Drone, State
from desim_uav.rules.service import give_share, rate_bps
from desim_uav.rules.settle import settle
from desim_uav.rules.stages import scan_later
from desim_uav.rules.words import ADMISSION, ATTACHMENT
from desim_uav.world import World
from tests.audit.invariants import audit
from tests.engine.helpers import Ask, Flight, fly, path_of, radio
from tests.engine.test_shares import busy
from tests.engine.test_transfers import FAR, MBIT, NEAR, VIDEO, ends_us, hover
from tests.reference.shares import FLUID, whole
from tests.selection import by_default

pytestmark = pytest.mark.usefixtures("every_engine")

CLASSES = [{"snr_db": 50, "bit_s_hz": 1}, {"snr_db": 60, "bit_s_hz": 2}]


def behind(kbps: float, users: list[tuple[float, float]], sharing: Any = "equal") -> World:
    """A drone as in ``hover``, with a backhaul."""
    drones = {
        "count": 1,
        "radio": radio(classes=CLASSES, sharing=sharing),
        "battery": None,
        "backhaul": {"kind": "capacity", "kbps": kbps},
    }
    return hover(users, "" if isinstance(sharing, dict) else sharing, drones=drones)


def video(at_s: float, lasts_s: float, kbps: float) -> Ask:
    return (at_s, lasts_s, kbps, VIDEO)


@pytest.mark.parametrize(
    ("sharing", "expected_s"),
    [
        *(("equal", (24, 24)), ("proportional_fair", (24, 24))),
        *(("max_rate", (24, 16)), ("max_min", (16, 24))),
    ],
)
def test_each_sharing_keeps_its_proportions(sharing: str, expected_s: tuple[int, int]) -> None:
    """6 Mbit in class 1 and 12 Mbit in class 2, over a backhaul of 750 kbit/s.

    Without it, equal bandwidths or times give 500 and 1,000 kbit/s; now these are 250 and 500, so
    both take 24 s. Max-rate gives all to the second user first, 12 Mbit in 16 s, and then 6 Mbit to
    the other one, in 8 s. Max-min gives both 375 kbit/s, for 16 s; the second user then has 6 Mbit
    left, at 750 kbit/s.
    """
    asks = {0: [(0.0, 6 * MBIT, 0.0)], 1: [(0.0, 12 * MBIT, 0.0)]}
    world = behind(750, [FAR, NEAR], sharing)
    assert ends_us(world, asks) == [1_000_000 * end_s for end_s in expected_s]


def test_shares_are_rounded_down_to_whole_bits() -> None:
    """A third and two thirds of 1,000 kbit/s: 333,333 and 666,666 bit/s."""
    asks = {0: [(0.0, 6 * MBIT, 0.0)], 1: [(0.0, 12 * MBIT, 0.0)]}
    assert ends_us(behind(1000, [FAR, NEAR]), asks) == [18_000_019, 18_000_019]


def test_a_wide_backhaul_changes_nothing() -> None:
    """All that the band can carry is 2 Mbit/s."""
    asks = {0: [(0.0, 6 * MBIT, 0.0)], 1: [(0.0, 12 * MBIT, 0.0), video(20.0, 5.0, 900.0)]}
    wide, none = (
        fly(each, path_of(each, asks)) for each in (behind(2000, [FAR, NEAR]), hover([FAR, NEAR]))
    )
    assert wide.events == none.events


def test_rates_that_are_held_come_first() -> None:
    """6 Mbit at 800 kbit/s, of which a hold takes 500 from 2 s to 6 s: 1.6 + 1.2 + 3.2 Mbit."""
    asks = {0: [(0.0, 6 * MBIT, 0.0)], 1: [video(2.0, 4.0, 500.0)]}
    assert ends_us(behind(800, [FAR, FAR]), asks) == [10_000_000, 6_000_000]


def test_whoever_shares_waits_while_holds_have_the_whole_backhaul() -> None:
    asks = {0: [(0.0, 6 * MBIT, 0.0)], 1: [video(2.0, 4.0, 800.0)]}
    world = behind(800, [FAR, FAR])
    log = fly(world, path_of(world, asks))
    (first, _) = sorted(log.requests, key=lambda one: one.user)
    assert (first.t_end_us, first.interruptions) == (11_500_000, 1)


def test_a_rate_is_admitted_only_if_it_fits() -> None:
    """Three of 400 kbit/s and one of 200 take 700 kHz in class 2, but 1,400 of 1,000 kbit/s.

    The third waits until 10 s, but not the one behind it, which fits.
    """
    asks = {user: [video(0.0, 10.0, 400.0)] for user in range(3)} | {3: [video(0.0, 10.0, 200.0)]}
    assert ends_us(behind(1000, [NEAR] * 4), asks) == [
        10_000_000,
        10_000_000,
        20_000_000,
        10_000_000,
    ]


def test_the_last_admitted_waits_if_the_capacity_falls() -> None:
    """Of 300, 300 and 300 kbit/s within 1,000, the last one waits when 200 are lost."""
    world = behind(1000, [NEAR] * 3)
    simulation = Simulation(world, RunSettings((True,), False), audit=audit)
    simulation.reset(path_of(world, {user: [video(0.0, 50.0, 300.0)] for user in range(3)}))
    constants, state = simulation.constants, simulation.state
    drone = state.drones[0]
    assert [user.request.server for user in state.users] == [0, 0, 0]
    drone.free_bps -= 200_000
    scan_later(state, drone)
    settle(constants, simulation.own_path, state, ATTACHMENT, ADMISSION)
    assert [user.request.server for user in state.users] == [0, 0, -1]
    assert (drone.free_bps, list(drone.waiting)) == (200_000, [2])


@dataclass(frozen=True)
class LastFirst(RowSharing):
    """Gives three quarters of the bandwidth to the last request, and the rest to the first one."""

    def divide(self, world: Constants, state: State, drone: Drone, phase: int) -> None:
        """Divide the band unequally."""
        for k in range(len(drone.sharing)):
            hz = 0
            if k == len(drone.sharing) - 1:
                hz = drone.free_hz * 3 // 4
            elif k == 0:
                hz = drone.free_hz // 4
            user = state.users[drone.sharing[k]]
            give_share(world, state, user, hz, rate_bps(world, drone, user, hz), phase)


def test_ones_own_sharing_is_capped_like_any_other() -> None:
    """It proposes 250, 0 and 750 kbit/s; over 400 these are 100, 0 and 300.

    User 2 has 6 Mbit until 20 s, user 0 has had 2 Mbit of 4 then, and user 1 has 3 Mbit. They get
    100 and 300 kbit/s, so user 1 is done 10 s later. User 0 alone gets three quarters, 750 kbit/s,
    of which 400 remain: it needs 2.5 s for the last Mbit.
    """
    asks = {user: [(0.0, mbit * MBIT, 0.0)] for user, mbit in enumerate((4, 3, 6))}
    world = behind(400, [FAR] * 3, {"kind": f"{__name__}:LastFirst"})
    flight = Flight(world)
    flight.engine.reset(path_of(world, asks))
    flight.engine.step([flight.command("hover")])
    ends = {one.user: one.t_end_us for one in flight.engine.log.requests}
    assert ends == {0: 32_500_000, 1: 30_000_000, 2: 20_000_000}


def test_access_points_have_backhauls() -> None:
    """6 Mbit at 750 kbit/s over the mast, while the drone, which is far away, has none."""
    mast = {
        "at_m": [300, 300],
        "height_m": 20,
        "radio": radio(classes=CLASSES, sharing="equal"),
        "backhaul": {"kbps": 750},
    }
    drones = {
        "count": 1,
        "radio": radio(classes=[{"snr_db": 90, "bit_s_hz": 1}], sharing="equal"),
        "battery": None,
    }
    world = hover([FAR], access_points=[mast], drones=drones)
    assert ends_us(world, {0: [(0.0, 6 * MBIT, 0.0)]}) == [8_000_000]


@pytest.mark.parametrize("sharing", by_default(["equal"], FLUID, at_most=2))
def test_the_sum_of_any_shares_fits(sharing: str) -> None:
    """At random: what is proposed times what is left over the sum, but for a bit of rounding."""
    simulation = busy.__wrapped__(sharing)
    world, state = simulation.constants, simulation.state
    drone, rng = state.drones[0], np.random.default_rng(34)
    for _ in range(200):
        drone.free_hz = int(rng.integers(0, 10 ** int(rng.integers(1, 12))))
        drone.free_bps = int(rng.integers(0, 10 ** int(rng.integers(1, 12))))
        world.radios[0].backhaul_bps = 10**12
        for user in state.users:
            user.classes[0] = int(rng.integers(1, world.radios[0].classes + 1))
        divide(world, state, drone, ADMISSION)
        users = [state.users[number] for number in drone.sharing]
        efficiencies = [world.radios[0].efficiencies[user.classes[0]] for user in users]
        proposed = whole(sharing, drone.free_hz, efficiencies)
        rates = [user.request.rate if user.request.server == 0 else 0 for user in users]
        assert sum(rates) <= drone.free_bps
        part = min(Fraction(drone.free_bps, max(sum(proposed), 1)), Fraction(1))
        pairs = zip(rates, proposed, strict=True)
        assert all(abs(rate - int(own * part)) <= 1 for rate, own in pairs)
