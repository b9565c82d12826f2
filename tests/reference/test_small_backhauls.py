"""Small worlds of the fixed-step simulator with backhauls, and with stores, worked by hand.

Links carry 1 Mbit/s in a disc of 316 m, and drones hover 900 m from each other. Everything happens
at multiples of dt, where the simulator is exact.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.reference.inputs import US, Processor, Request, Result, Sensing
from tests.reference.test_small_services import GHZ, ends, task
from tests.reference.test_small_worlds import STILL, fly, hold, radio

HERE, THERE, MIDDLE, NOWHERE = (50.0, 50.0), (950.0, 50.0), (500.0, 50.0), (500.0, 5000.0)
STARTS = [(0, 0), (9, 0)]
OVER = [(0.0, HERE), (5.0, NOWHERE), (6.0, THERE)]
"""A walk from drone 0 to drone 1, below which a user is from 6 s on."""
BUSY = [task(1, 30, 0)]
"""A task of 30 s, which arrives at 1 s."""


def walked(*stays: tuple[float, tuple[float, float]]) -> np.ndarray:
    """A walk as the times at which a user is at the next place."""
    return np.array([[t_s, *place, *STILL] for t_s, place in stays])


def flown(
    asks: dict[int, list[Request]],
    walk: list[Any],
    places: list[tuple[float, float]],
    kbps: float,
    starts: list[tuple[int, int]] = STARTS,
    sharing: str = "equal",
    dt_s: float = 0.5,
) -> Result:
    """Drones with a core of 1 GHz each; the first user walks, and the others stand still."""
    links = [radio((50.0, 1.0), sharing=sharing, backhaul_bps=kbps * 1000)] * len(starts)
    legs = [walked(*walk), *(walked((0.0, place)) for place in places)]
    changes = {"legs": legs, "processors": [Processor(1, GHZ)] * len(starts)}
    return fly(links, starts, [(*HERE, *STILL)] * len(legs), asks, 1, dt_s, **changes)


def test_a_task_follows_its_user() -> None:
    """It moves from 6 s to 7 s, is computed from then to 11 s, and its result takes 2 s."""
    asks = {0: [task(1, 4, 1, result=2, migrates=True)], 1: BUSY}
    result = flown(asks, OVER, [HERE], 1000)
    assert dict(ends(result)) == {0: 13.0, 1: 31.0}
    one = result.requests[0]
    assert (one.computing_us, one.served_us, one.share) == (4 * US, 8 * US, 1.0)


def test_a_task_that_has_begun_stays() -> None:
    """It is computed from 2 s to 12 s, and its result comes over the backhauls."""
    asks = {0: [task(1, 10, 1, result=2, migrates=True)]}
    assert dict(ends(flown(asks, OVER, [], 1000))) == {0: 14.0}


@pytest.mark.parametrize(
    ("place", "both"),
    [
        (MIDDLE, {0: 11.5, 1: 31.0, 2: 32.0}),
        (HERE, {0: 36.0, 1: 31.0, 2: 32.0}),
        (NOWHERE, {0: 11.0, 1: 31.0, 2: 32.0}),
    ],
)
def test_a_task_turns_to_the_drone_of_its_user(
    place: tuple[float, float], both: dict[int, float]
) -> None:
    """It turns at 6.5 s, from its beginning; or it is behind the task of user 2; or it goes on."""
    asks = {0: [task(1, 4, 1, migrates=True)], 1: BUSY, 2: [task(1, 1, 3)]}
    walk = [*OVER, (6.25, NOWHERE), (6.5, place)]
    assert dict(ends(flown(asks, walk, [HERE, HERE], 1000, [*STARTS, (4, 0)]))) == both


def test_a_task_shares_the_backhaul_of_its_site() -> None:
    """User 0 sends for 1.25 s. It moves with 400 kbit/s until 8 s, and with 800 until 8.25 s."""
    asks = {0: [task(1, 4, 2, migrates=True)], 1: BUSY, 2: [task(0.8, 1, 6)]}
    result = flown(asks, OVER, [HERE, HERE], 800, dt_s=0.25)
    assert dict(ends(result)) == {0: 12.25, 1: 31.25, 2: 32.25}


@pytest.mark.parametrize(("kbps", "end_s"), [(2000, 13.0), (1000, 13.0), (500, 16.0)])
def test_a_result_comes_over_the_backhauls(kbps: float, end_s: float) -> None:
    """It is sent, computed for 10 s, and comes down from drone 1, at one rate all the way."""
    asks = {0: [task(1, 10, 0, result=2)]}
    assert dict(ends(flown(asks, OVER, [], kbps))) == {0: end_s}


def test_a_held_rate_has_to_fit_both_backhauls() -> None:
    """One of 400 kbit/s fits 500. The result is ready at 11 s, and comes from 14 s to 16 s."""

    def held(mbit: float, seconds: float, at_s: float, result: float = 0.0) -> Request:
        one = task(mbit, seconds, at_s, result)
        stages = (Request(0, 0, 400_000, 0, cycles=one.then[0].cycles),)
        if result:
            stages += (Request(0, 0, 400_000, one.then[1].volume_ubit),)
        return Request(one.due_us, 0, 400_000, one.volume_ubit, stages)

    asks = {0: [held(0.4, 10, 0, 0.8)], 1: [held(1.6, 1, 10)], 2: [held(0.4, 1, 15)]}
    result = flown(asks, OVER, [HERE, HERE], 500, sharing="held")
    assert dict(ends(result)) == {0: 16.0, 1: 15.0, 2: 18.0}


# ---- stores


def carried(
    updates: dict[int, list[tuple[float, float]]],
    rule: Sensing,
    kbps: float | None = None,
    others: dict[int, list[Request]] | None = None,
    **changes: Any,
) -> Result:
    """Sensors below a drone, whose updates (at s, Mbit) hold 400 kbit/s of 1 Mbit/s."""
    backhaul = {} if kbps is None else {"backhaul_bps": 1000 * kbps}
    links = [radio((0.0, 1.0), sharing="held", **backhaul)]
    asks = {
        user: [Request(round(t * US), 0, 400_000, round(mbit * 1e12)) for t, mbit in own]
        for user, own in updates.items()
    }
    asks |= others or {}
    rules = [rule if user in updates else None for user in range(len(asks))]
    users = [(*HERE, *STILL)] * len(asks)
    return fly(links, [(0, 0)], users, asks, steps=1, sensors=rules, **changes)


def delivered_s(result: Result) -> list[tuple[int, float]]:
    """The users of updates, and when these were delivered."""
    return [(user, t_us / US) for user, _, t_us in result.delivered]


GROUND = Sensing(3, "newest", at_ground=True)


def test_stored_updates_have_what_links_leave() -> None:
    """Until 10 s the second one is received: 0.25 Mbit of the first one go on from 7.5 s on."""
    result = carried({0: [(5, 1), (6, 1)]}, GROUND, 500)
    assert delivered_s(result) == [(0, 11.5), (0, 13.5)]
    assert result.ages_us[0] == pytest.approx((11.5**2 + 8.5**2 - 6.5**2 + 54**2 - 7.5**2) / 120e-6)


def test_stored_updates_come_in_the_order_in_which_they_were_received() -> None:
    """The older one is larger. It is received at 8 s, and the other one at 3 s."""
    result = carried({0: [(1, 2.8)], 1: [(2, 0.4)]}, GROUND, 800)
    assert delivered_s(result) == [(1, 4.0), (0, 11.5)]


def test_room_is_free_as_soon_as_an_update_is_delivered() -> None:
    """The store has room for one, so the second one is sent from 9.5 s to 12 s."""
    result = carried({0: [(5, 1), (6, 1)]}, GROUND, 500, store_ubit=1.5e12)
    assert delivered_s(result) == [(0, 9.5), (0, 14.0)]


def test_an_update_that_takes_the_place_of_another_one_has_its_room_first() -> None:
    """User 1 has had room since 1 s, and sends from 10 s on, when the band is free.

    The updates of 2 s come by user. That of user 0 is turned away, and has room at no time.
    """
    rule = Sensing(3, "last", at_ground=True)
    updates = {0: [(1.5, 0.5), (2.0, 4.0)], 1: [(1.0, 4.0), (2.0, 4.0)]}
    result = carried(updates, rule, others={2: [hold(10, 1000)]}, store_ubit=5e12)
    done = [(one.user, one.t_end_us / US) for one in result.requests if one.completed]
    assert done == [(2, 10.0), (1, 20.0)]
