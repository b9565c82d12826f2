"""Results that come over the backhauls of two drones, worked by hand.

The drones and tasks are those of ``test_task_logs``: a link carries 1 Mbit/s over 1 MHz.
"""

from __future__ import annotations

from typing import Any

import pytest

from desim_uav.engine.base import EpisodeLog
from tests.engine.helpers import US, Ask, seen
from tests.engine.test_task_logs import (
    ANEW,
    BOTH,
    HERE,
    MIDDLE,
    NO_BITS,
    NOWHERE,
    PLAIN,
    RADIO,
    SERVICES,
    THERE,
    ends_s,
    log_of,
    mast,
    of_user,
    over_station,
    served,
    task,
    world_of,
)

pytestmark = pytest.mark.usefixtures("every_engine")

OVER = [(0.0, *HERE, 0.0, 0.0), (5.0, *NOWHERE, 0.0, 0.0), (6.0, *THERE, 0.0, 0.0)]
"""A walk from drone 0 to drone 1, below which a user is from 6 s on."""


def flown(kbps: float, asks: dict[int, list[Ask]], places: list[Any]) -> EpisodeLog:
    """An episode of two drones with backhauls, in which user 0 walks to the second one."""
    world = world_of(places, BOTH, drones={"backhaul": {"kbps": kbps}})
    return log_of(world, asks, walks={0: OVER})


@pytest.mark.parametrize("kbps", [2000, 1000])
def test_a_result_comes_over_the_backhauls(kbps: float) -> None:
    """It is sent for 1 s, computed from 1 s to 11 s, and comes down from drone 1 in 2 s."""
    log = flown(kbps, {0: [task(0.0, 1.0, 10.0, 2.0)]}, [HERE])
    spells = [(t, kind, drone) for t, kind, drone, _ in served(log) if kind in ("serve", "stop")]
    assert sorted(spells) == sorted(
        [
            *((0, "serve", 0), (1, "stop", 0), (1, "serve", 0), (11, "stop", 0)),
            *((11, "serve", 1), (13, "stop", 1)),
        ]
    )
    (one,) = log.requests
    assert (one.t_end_us, one.drones) == (13 * US, [0, 1])


def test_the_smaller_rate_is_that_of_the_way() -> None:
    """Over 500 kbit/s the input takes 2 s and the result 4 s: 2 + 10 + 4."""
    assert ends_s(flown(500, {0: [task(0.0, 1.0, 10.0, 2.0)]}, [HERE])) == {0: 16.0}


def test_a_result_counts_at_its_site_and_where_it_comes_down() -> None:
    """Over 800 kbit/s the input takes 1.25 s, so the result is ready at 11.25 s.

    User 1 sends 4 Mbit to drone 0 from 11.25 s on. Two share its backhaul then, with 400 kbit/s
    each: until 13.25 s both have got 0.8 Mbit. User 2 sends to drone 1 from then on. There the
    result is proposed 400 kbit/s and user 2 500, of which 800 fit: 355,555 and 444,444 bit/s. What
    is left of the result takes 3.375 s and a bit. Then user 1 has 800 kbit/s, and so has user 2.
    """
    asks = {
        0: [task(0.0, 1.0, 10.0, 2.0)],
        1: [task(11.25, 4.0, 1.0)],
        2: [task(13.25, 4.0, 1.0)],
    }
    log = flown(800, asks, [HERE, HERE, THERE])
    end_s = 13.25 + 1.2e6 / 355_555
    assert of_user(log, 0).t_end_us / US == pytest.approx(end_s, abs=2e-6)
    arrives_s = {event[4]: event[0] / US for event in seen(log, "stage") if event[4]}
    first_s = end_s + (4.0 - 0.4 * (end_s - 11.25)) / 0.8
    second_s = end_s + (4.0 - 0.444444 * (end_s - 13.25)) / 0.8
    assert arrives_s == pytest.approx({1: first_s, 2: second_s}, abs=1e-5)


@pytest.mark.parametrize(("service", "end_s"), [(PLAIN, 11.0), (ANEW, 12.0)])
def test_what_the_site_has_sent_counts_elsewhere_or_does_not(service: int, end_s: float) -> None:
    """The result of 6 s is ready at 4 s, and the user leaves at 5 s: 5 s or 6 s are left at 6 s."""
    log = flown(1000, {0: [task(0.0, 1.0, 3.0, 6.0, service=service)]}, [HERE])
    (one,) = log.requests
    assert (one.t_end_us, one.drones) == (end_s * US, [0, 1])


def test_a_result_waits_if_one_of_both_has_no_backhaul() -> None:
    shared = {"radio": RADIO, "battery": None, "processor": {"ghz": 0.001}, "count": 1}
    types = [
        shared | {"name": "joined", "start_cells": [[0, 0]], "backhaul": {"kbps": 1000}},
        shared | {"name": "apart", "start_cells": [[2, 0]]},
    ]
    log = log_of(world_of([HERE], drones=types), {0: [task(0.0, 1.0, 10.0, 2.0)]}, walks={0: OVER})
    (one,) = log.requests
    assert (one.t_end_us, one.drones) == (60 * US, [0])


def test_a_held_rate_has_to_fit_both_backhauls() -> None:
    """All rates are 400 kbit/s, of which one fits 500. The result is ready at 11 s.

    User 1 sends 1.6 Mbit to its site from 10 s to 14 s, so the result comes from 14 s to 16 s. User
    2 has 0.4 Mbit to send there from 15 s on, and waits until 16 s.
    """
    rate = (400_000,)
    asks = {
        0: [(*task(0.0, 0.4, 10.0, 0.8), *rate)],
        1: [(*task(10.0, 1.6, 1.0), *rate)],
        2: [(*task(15.0, 0.4, 1.0), *rate)],
    }
    services = {name: NO_BITS | own | {"bandwidth_kbps": [400]} for name, own in SERVICES.items()}
    drones = {"backhaul": {"kbps": 500}, "radio": RADIO | {"sharing": "held"}}
    world = world_of([HERE] * 3, BOTH, drones=drones, services=services)
    log = log_of(world, asks, walks={0: OVER})
    assert ends_s(log) == {0: 16.0, 1: 15.0, 2: 18.0}
    assert [event[0] / US for event in seen(log, "serve") if event[3] == 1] == [14.0]


# ---- a site crashes


def sent_as_its_site_falls(
    asks: dict[int, list[Ask]], uplink_mhz: float | None, sharing: str, **terms: Any
) -> EpisodeLog:
    """An episode of a drone in the middle, which falls at 93 s, and of a mast.

    User 0 is below the mast, and user 1 comes there from the drone at 92.5 s.
    """
    own_radio = {"radio": RADIO | {"uplink_mhz": uplink_mhz, "sharing": sharing}}
    joined = own_radio | {"backhaul": {"kbps": 5000}}
    services = {name: NO_BITS | own | terms for name, own in SERVICES.items()}
    world = over_station(
        *(2, 2, {}, [mast() | joined]),
        changes={"drones": joined, "services": services},
        **{"autonomy_min": 1.55, "on_crash": "remove"},
    )
    away = [(92.0, *NOWHERE, 0.0, 0.0), (92.5, *THERE, 0.0, 0.0)]
    walks = {0: [(0.0, *THERE, 0.0, 0.0)], 1: [(0.0, *MIDDLE, 0.0, 0.0), *away]}
    return log_of(world, asks, walks=walks)


@pytest.mark.parametrize(("uplink_mhz", "ends"), [(None, (95.25, 101)), (1, (94.25, 100))])
def test_others_share_what_a_result_has_had_that_is_lost(
    uplink_mhz: float | None, ends: tuple[float, float]
) -> None:
    """The result of user 1 comes over the mast from 92.5 s on, until its site falls at 93 s.

    The result of user 0 has the band there from 91 s on, half of it from 92.5 s on, and 1.25 Mbit
    of it are left at 93 s. User 1 sends 1 Mbit again then. In a band of its own this takes until
    94 s, and the result has all of the other one. If all is in one band, it takes until 95 s, and
    0.25 Mbit of the result are left. The task of user 1 is computed in 2 s, and returned in 4 s.
    """
    asks = {0: [task(88.0, 1.0, 4.0, 3.0)], 1: [task(85.0, 1.0, 4.0, 4.0)]}
    log = sent_as_its_site_falls(asks, uplink_mhz, "equal")
    assert of_user(log, 1).restarts == 1
    assert ends_s(log) == {0: ends[0], 1: ends[1]}


@pytest.mark.parametrize(("uplink_mhz", "ends"), [(None, (95, 100.5)), (1, (94, 100.5))])
def test_others_hold_what_a_result_has_held_that_is_lost(
    uplink_mhz: float | None, ends: tuple[float, float]
) -> None:
    """Each rate is 600 kbit/s of 1 MHz. The result of user 0 is ready at 92.7 s, and waits.

    The one of user 1 is lost at 93 s. User 1 sends its input again from then to 94 s, and that
    of user 0 has waited for less time. With a band for each, the result of 0.6 Mbit comes at once.
    """
    rate = (600_000,)
    asks = {
        0: [(*task(90.2, 0.6, 3.0, 0.6), *rate)],
        1: [(*task(85.0, 0.6, 3.0, 3.0), *rate)],
    }
    log = sent_as_its_site_falls(asks, uplink_mhz, "held", bandwidth_kbps=[600])
    assert of_user(log, 1).restarts == 1
    assert ends_s(log) == {0: ends[0], 1: ends[1]}
