"""Tasks that follow their users from one processor to another, worked by hand.

The drones and tasks are those of ``test_task_logs``: a link carries 1 Mbit/s over 1 MHz, and user 0
keeps the core of drone 0 busy. User 1 sends 1 Mbit to drone 0 from 1 s to 2 s, where its task waits
behind that of user 0. At 6 s it is below drone 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from desim_uav.engine.base import EpisodeLog
from desim_uav.model.rules import Outcome
from desim_uav.scenario.doubts import doubts
from desim_uav.scenario.load import from_mapping
from tests.engine.helpers import US, Ask, events, seen
from tests.engine.test_relayed_results import OVER
from tests.engine.test_task_logs import (
    BOTH,
    HERE,
    MIDDLE,
    NO_BITS,
    NOWHERE,
    RADIO,
    SERVICES,
    STRICT,
    THERE,
    ends_s,
    log_of,
    mast,
    of_user,
    over_station,
    task,
    world_of,
)

pytestmark = pytest.mark.usefixtures("every_engine")

BUSY = [task(0.0, 1.0, 30.0)]
"""A task of 30 s, which arrives at 1 s."""
MIGRATING = {name: NO_BITS | own | {"handover": "migrate"} for name, own in SERVICES.items()}


def flown(
    asks: Sequence[Ask],
    walk: Sequence[Any] = OVER,
    others: dict[int, list[Ask]] | None = None,
    places: Sequence[Any] = (HERE, HERE),
    starts: Sequence[tuple[int, int]] = BOTH,
    told: Sequence[str] = (),
    **drones: Any,
) -> EpisodeLog:
    """An episode in which user 1 walks, whose tasks migrate; user 0 has a long one from 1 s on."""
    drones = {"backhaul": {"kbps": 1000}} | drones
    world = world_of(places, starts, drones=drones, services=MIGRATING)
    return log_of(world, {0: BUSY, 1: asks} | (others or {}), *told, walks={1: walk})


def of_task(log: EpisodeLog, user: int = 1) -> list[tuple[float, str, int]]:
    """Time in s, kind and drone of what happens to the task of a user."""
    kinds = ("serve", "stop", "stage", "move", "complete", "late", "close")
    return [(e[0] / US, e[2], e[3]) for e in seen(log, *kinds) if e[4] == user]


def test_a_task_follows_its_user() -> None:
    """It moves from 6 s to 7 s, is computed from then to 11 s, and its result takes 2 s."""
    log = flown([task(1.0, 1.0, 4.0, 2.0)])
    kinds = ("request", "serve", "stop", "stage", "move", "complete")
    assert [(*e[:6], e[-1]) for e in seen(log, *kinds) if e[4] == 1] == events(
        """
         1000000 5 request  - 1 1
         1000000 7 serve    0 1 1
         2000000 1 stop     0 1 1
         2000000 1 stage    0 1 1 1
         6000000 7 move     1 1 1
         6000000 7 serve    1 1 1
         7000000 1 stop     1 1 1
         7000000 1 stage    1 1 1 1
         7000000 7 serve    1 1 1
        11000000 1 stop     1 1 1
        11000000 1 stage    1 1 1 2
        11000000 7 serve    1 1 1
        13000000 1 stop     1 1 1
        13000000 1 complete 1 1 1
        """
    )
    one = of_user(log, 1)
    assert (one.t_end_us, one.drones) == (13 * US, [0, 1])
    assert (one.sending_us, one.uplink_us, one.computing_us) == (4 * US, 1 * US, 4 * US)
    assert (one.sent_ubit, one.asked_ubit, one.restarts) == (3 * 10**12, 3 * 10**12, 0)
    assert ends_s(log)[0] == 31.0


def test_a_task_that_has_begun_stays() -> None:
    """With two cores it is computed at once, until 12 s. Its result comes over the backhauls."""
    log = flown([task(1.0, 1.0, 10.0, 2.0)], processor={"ghz": 0.001, "cores": 2})
    assert of_task(log)[2:] == [
        *((2, "stage", 0), (2, "serve", 0), (12, "stop", 0), (12, "stage", 0)),
        *((12, "serve", 1), (14, "stop", 1), (14, "complete", 1)),
    ]


@pytest.mark.parametrize(("at_s", "ends"), [(5.9, {1: 13.9, 2: 9.9}), (6.1, {1: 10.9, 2: 13.9})])
def test_it_stands_in_line_by_its_arrival(at_s: float, ends: dict[int, float]) -> None:
    """User 2 sends to drone 1 for a second, in which its task and the one that moves have 1 Mbit/s.

    That one has 2 Mbit/s otherwise. So it arrives at 6.95 s, after the other one, or at 6.9 s.
    """
    others = {2: [task(at_s, 1.0, 3.0)]}
    log = flown(
        [task(1.0, 1.0, 4.0)], others=others, places=[HERE, HERE, THERE], backhaul={"kbps": 2000}
    )
    assert ends_s(log) == {0: 31.0} | ends


def test_it_shares_the_backhaul_of_its_site() -> None:
    """Over 800 kbit/s user 1 sends from 2 s to 3.25 s, and user 2 has 0.8 Mbit to send from 6 s on.

    Both have 400 kbit/s until 8 s. Then the last 0.2 Mbit move until 8.25 s.
    """
    others = {2: [task(6.0, 0.8, 1.0)]}
    log = flown([task(2.0, 1.0, 4.0)], others=others, places=[HERE] * 3, backhaul={"kbps": 800})
    assert [(t, drone) for t, kind, drone in of_task(log, 2) if kind == "stage"] == [(8.0, 0)]
    assert of_task(log)[3:] == [
        *((6, "move", 1), (6, "serve", 1), (8.25, "stop", 1), (8.25, "stage", 1)),
        *((8.25, "serve", 1), (12.25, "stop", 1), (12.25, "complete", 1)),
    ]


# ---- another handover meanwhile

THERE_SOON = [*OVER, (6.3, *NOWHERE, 0.0, 0.0)]
"""A walk on which a user is below drone 1 until 6.3 s."""


def test_it_turns_to_the_drone_that_its_user_is_attached_to_now() -> None:
    """Until 6.5 s it moves to drone 1, and from then on, from its beginning, to drone 2."""
    walk = [*THERE_SOON, (6.5, *MIDDLE, 0.0, 0.0)]
    log = flown([task(1.0, 1.0, 4.0)], walk, starts=(*BOTH, (1, 0)))
    assert of_task(log)[3:] == [
        *((6, "move", 1), (6, "serve", 1), (6.5, "stop", 1), (6.5, "move", 2), (6.5, "serve", 2)),
        *((7.5, "stop", 2), (7.5, "stage", 2), (7.5, "serve", 2), (11.5, "stop", 2)),
        (11.5, "complete", 2),
    ]
    assert of_user(log, 1).sending_us == 2_500_000


def test_it_is_at_its_site_again_if_its_user_comes_back() -> None:
    """It arrives there at 6.5 s, behind the task of user 2, which is computed from 31 s to 32 s."""
    walk = [*THERE_SOON, (6.5, *HERE, 0.0, 0.0)]
    others = {2: [task(3.0, 1.0, 1.0)]}
    log = flown([task(1.0, 1.0, 4.0)], walk, others=others, places=[HERE] * 3)
    assert ends_s(log) == {0: 31.0, 1: 36.0, 2: 32.0}
    assert of_task(log)[3:7] == [
        *((6, "move", 1), (6, "serve", 1), (6.5, "stage", 0), (6.5, "stop", 1)),
    ]


@pytest.mark.parametrize("place", [NOWHERE, MIDDLE])
def test_it_goes_on_if_its_user_is_where_it_cannot_follow(place: tuple[float, float]) -> None:
    """Drone 2, in the middle, has no backhaul."""
    shared = {"radio": RADIO, "battery": None, "processor": {"ghz": 0.001}}
    joined = {"name": "joined", "count": 2, "start_cells": BOTH, "backhaul": {"kbps": 1000}}
    apart = {"name": "apart", "count": 1, "start_cells": [[1, 0]]}
    world = world_of([HERE] * 2, drones=[shared | joined, shared | apart], services=MIGRATING)
    walk = [*THERE_SOON, (6.5, *place, 0.0, 0.0)]
    log = log_of(world, {0: BUSY, 1: [task(1.0, 1.0, 4.0)]}, walks={1: walk})
    assert ends_s(log) == {0: 31.0, 1: 11.0}
    assert [drone for _, kind, drone in of_task(log) if kind == "move"] == [1]


# ---- crashes, deadlines and the end

MAST = mast() | {"processor": {"ghz": 0.001}, "backhaul": {"kbps": 1000}}


def near_a_crash(places: Sequence[Any], goes: tuple[float, float]) -> EpisodeLog:
    """An episode of a drone in the middle, which falls at 93 s, and of a mast.

    User 0 keeps a core busy from 61 s on, for 50 s. The task of user 1 waits behind it from 86 s
    on, and moves from 92.5 s on.
    """
    changes = {"services": MIGRATING, "drones": {"backhaul": {"kbps": 1000}}}
    falls = {"autonomy_min": 1.55, "on_crash": "remove"}
    world = over_station(2, 4, {}, [MAST], changes=changes, **falls)
    asks = {0: [task(60.0, 1.0, 50.0)], 1: [task(85.0, 1.0, 4.0)]}
    away = [(92.0, *NOWHERE, 0.0, 0.0), (92.5, *goes, 0.0, 0.0)]
    walks = {u: [(0.0, *place, 0.0, 0.0)] for u, place in enumerate(places)}
    return log_of(world, asks, walks={**walks, 1: [*walks[1], *away]})


def test_it_is_lost_if_its_site_crashes() -> None:
    """It is sent to the mast from 93 s to 94 s, and computed there."""
    log = near_a_crash([MIDDLE, MIDDLE], THERE)
    one = of_user(log, 1)
    assert (one.restarts, one.t_end_us, one.sending_us) == (1, 98 * US, 2_500_000)
    assert [(t, drone) for t, kind, drone in of_task(log) if kind == "stage"] == [
        *((86, 0), (93, 0), (94, 1)),
    ]


def test_it_is_at_its_site_again_if_the_other_drone_crashes() -> None:
    """The core of the mast is free at 111 s."""
    log = near_a_crash([THERE, THERE], MIDDLE)
    one = of_user(log, 1)
    assert (one.restarts, one.t_end_us, one.sending_us) == (0, 115 * US, 1_500_000)
    assert of_task(log)[3:7] == [
        *((92.5, "move", 0), (92.5, "serve", 0), (93, "stop", 0), (93, "stage", 1)),
    ]


def test_it_is_dropped_while_it_moves() -> None:
    """Its deadline is at 6.5 s; that of the next one is kept, as nothing else moves then."""
    log = flown(
        [task(1.5, 1.0, 4.0, service=STRICT)],
        others={2: [task(7.0, 1.0, 1.0)]},
        places=[HERE, HERE, THERE],
    )
    one = of_user(log, 1)
    assert (one.outcome, one.t_end_us, one.sending_us) == (Outcome.LATE, 6_500_000, 1_500_000)
    assert (one.stage, one.done, one.required) == (1, 0, 4 * 10**9)
    assert of_user(log, 2).t_end_us == 9 * US


def test_nothing_of_its_stage_is_done_while_it_moves() -> None:
    """At the end, at 60 s, one of three stages is done, and half of the way."""
    walk = [(0.0, *HERE, 0.0, 0.0), (59.0, *NOWHERE, 0.0, 0.0), (59.5, *THERE, 0.0, 0.0)]
    log = flown([task(50.0, 1.0, 4.0, 1.0)], walk, others={0: [task(0.0, 1.0, 100.0)]})
    one = of_user(log, 1)
    assert (one.stage, one.done, one.required) == (1, 0, 4 * 10**9)
    assert (one.sending_us, one.served_us, one.sent_ubit) == (1_500_000, 1_500_000, 10**12)


# ---- the scenario


@pytest.mark.parametrize(("backhauls", "told"), [([], 1), ([0], 1), ([0, 1], 0)])
def test_that_it_cannot_migrate_is_told(backhauls: list[int], told: int) -> None:
    types: list[dict[str, Any]] = [
        {"name": name, "count": 1, "radio": RADIO, "processor": {"ghz": 1}} for name in "ab"
    ]
    for number in backhauls:
        types[number]["backhaul"] = {"kbps": 1000}
    made = {
        "drones": types,
        "services": {"vision": MIGRATING["plain"]},
        "demand": {"kind": "dynamic", "mix": {"vision": 1}},
        "reward": {"kind": "coverage_battery"},
    }
    found = [one for one in doubts(from_mapping(made)) if "migrate" in one]
    assert len(found) == told
    assert all(one.startswith("services.vision: its tasks never migrate") for one in found)
    assert all(one.endswith(f"the scenario has {len(backhauls)}") for one in found)
