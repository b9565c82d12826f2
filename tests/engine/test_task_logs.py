"""Tasks at processors, worked by hand: where they stand, when they are computed, what is lost.

A link within 140 m carries 1 Mbit/s over 1 MHz, and a core does 1e6 cycles in a second: a task that
is sent for a second, computed for four and returned for two has an input of 1 Mbit with 4 cycles
per bit and a result of 2 Mbit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pytest

from desim_uav.engine.base import ClosedRequest, EpisodeLog
from desim_uav.model.rules import Outcome
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine.helpers import US, Ask, events, fly, merged, path_of, radio, seen

pytestmark = pytest.mark.usefixtures("every_engine")

PLAIN, LOOSE, URGENT, STRICT, ANEW = range(5)
SERVICES = {
    "plain": {},
    "loose": {"deadline_s": 100},
    "urgent": {"deadline_s": 5},
    "strict": {"deadline_s": 5, "on_deadline": "drop"},
    "anew": {"handover": "restart"},
}
"""Services by their numbers; all amounts are told for each task."""

RADIO = radio(classes=[{"snr_db": 57, "bit_s_hz": 1}, {"snr_db": 90, "bit_s_hz": 2}])
NO_BITS = {"kind": "compute", "input_mbit": [1], "cycles_per_bit": [1], "output_mbit": [0, 1]}
HERE, THERE, NOWHERE = (120.0, 120.0), (600.0, 120.0), (360.0, 1e4)
"""Below drone 0, below drone 1 if there is one, and outside of all footprints."""
BOTH = ((0, 0), (2, 0))
"""The cells of drones 0 and 1."""


def world_of(
    places: Sequence[tuple[float, float]] = (HERE,),
    starts: Sequence[tuple[int, int]] = ((0, 0),),
    processor: Mapping[str, Any] | None = None,
    battery: Mapping[str, Any] | None = None,
    **changes: Any,
) -> World:
    """Drones over three cells of 240 m, with a core of 1 MHz each."""
    base = {
        "map": {"size_m": [720, 240], "cells": [3, 1], "dimensions": 2},
        "drones": {
            "count": len(starts),
            "start_cells": starts,
            "radio": RADIO,
            "battery": battery,
            "processor": {"ghz": 0.001, **(processor or {})},
        },
        "stations": {"count": 0},
        "users": {"positions_m": places, "mobility": {"kind": "static"}},
        "services": {name: NO_BITS | own for name, own in SERVICES.items()},
        "demand": {"kind": "static", "mix": {"plain": 1}},
        "episode": {"steps": 1, "step_s": 60},
    }
    return build_world(from_mapping(merged(base, changes)), 0)


def task(
    at_s: float, sent_s: float, computed_s: float, back_s: float = 0.0, service: int = PLAIN
) -> Ask:
    """A task that takes so long at each place if nothing else is there."""
    bits = round(sent_s * 1e6)
    return (at_s, 0.0, 0.0, service, bits, round(computed_s * 1e9 / bits), round(back_s * 1e6))


def log_of(world: World, asks: Mapping[int, Sequence[Ask]], *told: str, **path: Any) -> EpisodeLog:
    return fly(world, path_of(world, asks, **path), *told)


def served(log: EpisodeLog) -> list[tuple[Any, ...]]:
    """Time in s, kind, drone and user of what happens to requests."""
    kinds = ("serve", "stop", "stage", "complete", "late", "close")
    return [(event[0] / US, *event[2:5]) for event in seen(log, *kinds)]


def of_user(log: EpisodeLog, user: int) -> ClosedRequest:
    (request,) = (one for one in log.requests if one.user == user)
    return request


def test_a_task_goes_up_is_computed_and_comes_down() -> None:
    log = log_of(world_of(), {0: [task(0.0, 1.0, 4.0, 2.0)]})
    kinds = ("request", "serve", "stop", "stage", "complete")
    assert [(*event[:6], event[-1]) for event in seen(log, *kinds)] == events(
        """
              0 5 request  - 0 0
              0 7 serve    0 0 0
        1000000 1 stop     0 0 0
        1000000 1 stage    0 0 0 1
        1000000 7 serve    0 0 0
        5000000 1 stop     0 0 0
        5000000 1 stage    0 0 0 2
        5000000 7 serve    0 0 0
        7000000 1 stop     0 0 0
        7000000 1 complete 0 0 0
        """
    )
    (one,) = log.requests
    assert (one.sending_us, one.computing_us, one.served_us) == (3 * US, 4 * US, 7 * US)
    assert (one.asked_ubit, one.sent_ubit) == (3 * 10**12, 3 * 10**12)
    assert one.asked_cycles == 4 * 10**9, "in thousandths"
    assert (one.restarts, one.interruptions) == (0, 0)


def test_two_cores_compute_those_who_came_first() -> None:
    """Three tasks of 4 s arrive at 1, 2 and 3 s; the third waits for the first."""
    asks = {user: [task(user, 1.0, 4.0)] for user in range(3)}
    log = log_of(world_of([HERE] * 3, processor={"cores": 2}), asks)
    assert served(log)[5:] == [
        *((2, "stop", 0, 1), (2, "stage", 0, 1), (2, "serve", 0, 1), (2, "serve", 0, 2)),
        *((3, "stop", 0, 2), (3, "stage", 0, 2)),
        *((5, "stop", 0, 0), (5, "complete", 0, 0), (5, "serve", 0, 2)),
        *((6, "stop", 0, 1), (6, "complete", 0, 1)),
        *((9, "stop", 0, 2), (9, "complete", 0, 2)),
    ]


def ends_s(log: EpisodeLog) -> dict[int, float]:
    return {one.user: one.t_end_us / US for one in log.requests}


def test_the_place_in_the_line_is_that_of_the_arrival() -> None:
    """User 1 asked later, but had less to send: 2 Mbit and 0.5 Mbit, from 0 and from 0.5 s on.

    They share the band until user 1 is done at 1.5 s; then 1 Mbit is left, which takes until 2.5 s.
    """
    asks = {0: [task(0.0, 2.0, 1.0)], 1: [task(0.5, 0.5, 10.0)]}
    log = log_of(world_of([HERE] * 2), asks)
    assert ends_s(log) == {0: 12.5, 1: 11.5}


def test_tasks_of_an_instant_are_in_the_order_of_users() -> None:
    """Both are sent until 2 s."""
    asks = {0: [task(0.0, 1.0, 1.0)], 1: [task(0.0, 1.0, 1.0)]}
    assert ends_s(log_of(world_of([HERE] * 2), asks)) == {0: 3.0, 1: 4.0}


def test_shares_are_whole_thousandths_of_a_cycle() -> None:
    """Three tasks of 2 s, whose inputs are one bit each.

    The first one arrives after 1 µs, and has 1,000 thousandths of a cycle per µs until the other
    two arrive at 1.000002 s. Each then has 333 of them: what is left of the first one, 999,999,000,
    takes 3,003,000 µs. The others have as much behind them, and 500 for the other 1,000,001,000.
    """
    asks = {user: [task(min(user, 1), 1e-6, 2.0)] for user in range(3)}
    world = world_of([HERE] * 3, processor={"sharing": "processor_sharing"})
    log = log_of(world, asks)
    ends = [of_user(log, user).t_end_us for user in range(3)]
    assert ends == [4_003_002, 6_003_004, 6_003_004]
    assert of_user(log, 1).computing_us == 6_003_004 - 1_000_002


def test_sharing_gives_nobody_more_than_a_core() -> None:
    """Two tasks and four cores."""
    processor = {"sharing": "processor_sharing", "cores": 4}
    asks = {0: [task(0.0, 1.0, 3.0)], 1: [task(1.0, 1.0, 3.0)]}
    assert ends_s(log_of(world_of([HERE] * 2, processor=processor), asks)) == {0: 4.0, 1: 5.0}


def test_an_earlier_deadline_interrupts() -> None:
    """A task of 10 s begins at 1 s; one that must be done by 8 s takes its core from 4 to 6 s."""
    asks = {0: [task(0.0, 1.0, 10.0, service=LOOSE)], 1: [task(3.0, 1.0, 2.0, service=URGENT)]}
    log = log_of(world_of([HERE] * 2, processor={"sharing": "earliest_deadline"}), asks)
    of_first = [(t, kind) for t, kind, _, user in served(log) if user == 0 and kind != "stage"]
    assert sorted(of_first) == sorted(
        [
            *((0, "serve"), (1, "stop"), (1, "serve"), (4, "stop"), (6, "serve")),
            *((13, "stop"), (13, "complete")),
        ]
    )
    assert ends_s(log) == {0: 13.0, 1: 6.0}
    assert (of_user(log, 0).interruptions, of_user(log, 0).deadline_us) == (1, 100 * US)
    assert of_user(log, 1).deadline_us == 8 * US


def test_a_later_deadline_waits() -> None:
    """Of those without a deadline, whoever came first is first."""
    asks = {
        0: [task(0.0, 1.0, 3.0, service=URGENT)],
        1: [task(1.0, 1.0, 1.0)],
        2: [task(2.0, 1.0, 1.0)],
        3: [task(3.0, 0.5, 1.0, service=LOOSE)],
    }
    log = log_of(world_of([HERE] * 4, processor={"sharing": "earliest_deadline"}), asks)
    assert ends_s(log) == {0: 4.0, 3: 5.0, 1: 6.0, 2: 7.0}


@pytest.mark.parametrize(
    ("computed_s", "kind"),
    [(4.999998, "complete"), (4.999999, "complete"), (5.0, "late")],
)
def test_whoever_is_done_at_the_deadline_is_not_late(computed_s: float, kind: str) -> None:
    """A bit is sent in a microsecond, and all is due at 5 s."""
    log = log_of(world_of(), {0: [task(0.0, 1e-6, computed_s, service=STRICT)]})
    ((t_us, phase, _, drone, user, request, *_),) = seen(log, "complete", "late", "close")
    assert (phase, drone, user, request) == (1, 0, 0, 0)
    assert t_us == min(round(computed_s * US) + 1, 5 * US)
    assert seen(log, kind)
    (one,) = log.requests
    assert (one.outcome is Outcome.COMPLETED) == (kind == "complete")


def test_a_late_task_goes_on_if_late_ones_only_count() -> None:
    log = log_of(world_of(), {0: [task(0.0, 1.0, 7.0, service=URGENT)]})
    (one,) = log.requests
    assert (one.outcome, one.t_end_us, one.deadline_us) == (Outcome.COMPLETED, 8 * US, 5 * US)


def test_a_core_is_free_when_its_task_is_dropped() -> None:
    """The first task is dropped at 5 s, the second one takes the core then; the third never had it.

    It arrives at 3 s, and is due at 7 s, when the second one is still computed.
    """
    asks = {
        0: [task(0.0, 1.0, 10.0, service=STRICT)],
        1: [task(1.0, 1.0, 4.0)],
        2: [task(2.0, 1.0, 1.0, service=STRICT)],
        3: [task(3.0, 1.0, 1.0)],
    }
    log = log_of(world_of([HERE] * 4), asks)
    assert ends_s(log) == {0: 5.0, 1: 9.0, 2: 7.0, 3: 10.0}
    late = [(event[0] / US, event[4]) for event in seen(log, "late")]
    assert late == [(5.0, 0), (7.0, 2)]
    assert (of_user(log, 0).computing_us, of_user(log, 0).done) == (4 * US, 4 * 10**9)
    assert of_user(log, 2).computing_us == 0
    ((at_us, phase),) = {e[:2] for e in seen(log, "serve") if e[4] == 1 and e[0] > 2 * US}
    assert (at_us, phase) == (5 * US, 7), "in the same instant"


def test_a_task_is_dropped_while_it_is_sent_or_out_of_reach() -> None:
    """User 0 has 9 Mbit to send; user 1 is away from 1 s on. The band is free again at 5 s."""
    away = [(0.0, *HERE, 0.0, 0.0), (1.0, *NOWHERE, 0.0, 0.0)]
    asks = {
        0: [task(0.0, 9.0, 1.0, service=STRICT)],
        1: [task(0.0, 9.0, 1.0, service=STRICT)],
        2: [task(4.0, 1.0, 1.0)],
    }
    log = log_of(world_of([HERE] * 3), asks, walks={1: away})
    assert ends_s(log) == {0: 5.0, 1: 5.0, 2: 6.5}
    assert of_user(log, 1).sending_us == US
    assert [event[3] for event in seen(log, "late")] == [-1, 0]


# ---- handover


def test_a_result_waits_for_the_link_to_its_site() -> None:
    """The user is below the other drone from 6 to 29 s; its task is done at 11 s."""
    away = [(5.0, *NOWHERE, 0.0, 0.0), (6.0, *THERE, 0.0, 0.0), (29.0, *NOWHERE, 0.0, 0.0)]
    walk = [(0.0, *HERE, 0.0, 0.0), *away, (30.0, *HERE, 0.0, 0.0)]
    log = log_of(world_of([HERE], BOTH), {0: [task(0.0, 1.0, 10.0, 2.0)]}, walks={0: walk})
    spells = [(t, kind, drone) for t, kind, drone, _ in served(log) if kind in ("serve", "stop")]
    assert sorted(spells) == sorted(
        [
            *((0, "serve", 0), (1, "stop", 0), (1, "serve", 0), (11, "stop", 0)),
            *((30, "serve", 0), (32, "stop", 0)),
        ]
    )
    assert [event[:4] for event in seen(log, "attach", "detach")][:4] == [
        *((0, 7, "attach", 0), (5 * US, 2, "detach", 0), (6 * US, 7, "attach", 1)),
        (29 * US, 2, "detach", 1),
    ]
    (one,) = log.requests
    assert (one.t_end_us, one.drones, one.computing_us) == (32 * US, [0], 10 * US)


def test_a_task_without_a_result_is_done_without_its_user() -> None:
    walk = [(0.0, *HERE, 0.0, 0.0), (5.0, *NOWHERE, 0.0, 0.0)]
    log = log_of(world_of(), {0: [task(0.0, 1.0, 10.0)]}, walks={0: walk})
    ((t_us, phase, _, drone, user, *_),) = seen(log, "complete")
    assert (t_us, phase, drone, user) == (11 * US, 1, -1, 0)


@pytest.mark.parametrize(("service", "sent_s", "end_s"), [(PLAIN, 4.0, 7.0), (ANEW, 5.0, 8.0)])
def test_what_was_sent_counts_elsewhere_or_does_not(
    service: int, sent_s: float, end_s: float
) -> None:
    """Of 4 Mbit one is sent to drone 0; the user is below drone 1 from 2 s on, which computes."""
    walk = [(0.0, *HERE, 0.0, 0.0), (1.0, *NOWHERE, 0.0, 0.0), (2.0, *THERE, 0.0, 0.0)]
    asks = {0: [task(0.0, 4.0, 2.0, service=service)]}
    log = log_of(world_of([HERE], BOTH), asks, walks={0: walk})
    (one,) = log.requests
    assert (one.t_end_us, one.sending_us) == (end_s * US, sent_s * US)
    assert (one.drones, one.sent_ubit) == ([0, 1], 4 * 10**12)
    ((at_us, _, _, drone, *_),) = seen(log, "stage")
    assert (at_us, drone) == ((sent_s + 1) * US, 1), "computed once, where the last bit came"


@pytest.mark.parametrize(("service", "end_s"), [(PLAIN, 15.0), (ANEW, 15.0)])
def test_a_gap_loses_nothing(service: int, end_s: float) -> None:
    """A user who is away from 1 to 10 s, and back with its drone, has 3 of 4 Mbit left."""
    walk = [(0.0, *HERE, 0.0, 0.0), (1.0, *NOWHERE, 0.0, 0.0), (10.0, *HERE, 0.0, 0.0)]
    asks = {0: [task(0.0, 4.0, 2.0, service=service)]}
    log = log_of(world_of(), asks, walks={0: walk})
    assert ends_s(log) == {0: end_s}


# ---- drones that do not serve

MIDDLE = (360.0, 120.0)
"""Below a drone over the station."""


def mast() -> dict[str, Any]:
    """A mast with two cores of 2 MHz, beyond the drone's reach."""
    processor = {"cores": 2, "ghz": 0.002}
    return {"at_m": list(THERE), "height_m": 20, "radio": RADIO, "processor": processor}


def over_station(
    users: int,
    steps: int,
    processor: Mapping[str, Any],
    access_points: Sequence[Mapping[str, Any]] = (),
    *,
    changes: Mapping[str, Any] = {},
    **battery: Any,
) -> World:
    """A drone over the station in the middle cell, with a battery for 10 minutes."""
    return world_of(
        [MIDDLE] * users,
        [(1, 0)],
        processor,
        battery={"kind": "endurance", "autonomy_min": 10, "return_below": 1.0, **battery},
        stations={"count": 1, "radius_m": 0},
        episode={"steps": steps, "step_s": 60},
        access_points=access_points,
        **changes,
    )


@pytest.mark.parametrize(("on_ground", "computed_s"), [(False, 136.0), (True, 76.0)])
def test_a_processor_stands_still_while_its_drone_charges(
    on_ground: bool, computed_s: float
) -> None:
    """The drone lands at 60 s and flies again from 120 s on; 4 s of 20 have been computed.

    The result of a second comes down once the drone serves users again.
    """
    world = over_station(1, 3, {"on_ground": on_ground})
    log = log_of(world, {0: [task(55.0, 1.0, 20.0, 1.0)]}, "hover goto hover")
    assert [event[0] / US for event in seen(log, "land", "depart")][:1] == [60.0]
    ends = [event[0] / US for event in seen(log, "stage")]
    assert ends == [56.0, computed_s]
    (one,) = log.requests
    assert one.computing_us == 20 * US
    assert one.t_end_us == (max(computed_s, 120.0) + 1.0) * US
    stops = [event[:2] for event in seen(log, "stop")]
    assert ((60 * US, 11) in stops) == (not on_ground)


def test_a_task_can_be_late_while_its_processor_stands_still() -> None:
    """It is due at 62 s; the next one has the core when the drone flies again."""
    asks = {0: [task(57.0, 1.0, 20.0, service=STRICT)], 1: [task(58.0, 1.0, 3.0)]}
    log = log_of(over_station(2, 3, {}), asks, "hover goto hover")
    assert ends_s(log) == {0: 62.0, 1: 123.0}


def test_a_crash_loses_tasks() -> None:
    """The drone falls at 93 s. Another one comes at 180 s, and everything begins anew.

    User 0 has been computed for 7 s of 20; user 1 waits in the line behind; user 2 has sent 3 of 10
    Mbit, which are not lost. Each then has a third of the band, 333,333 bit/s: 1 Mbit of the first
    two is there at 183.000004 s, when 6 of the third are left. User 0 is computed for 20 s, user 1
    for 2 s and user 2 for 1 s.
    """
    world = over_station(3, 4, {}, autonomy_min=1.55, respawn_after_min=1.45)
    asks = {
        0: [task(85.0, 1.0, 20.0)],
        1: [task(89.0, 1.0, 2.0)],
        2: [task(90.0, 10.0, 1.0)],
    }
    log = log_of(world, asks, respawn=[[0]])
    anew = [event for event in seen(log, "stage") if event[0] == 93 * US]
    assert [(phase, drone, user, stage) for _, phase, _, drone, user, *_, stage in anew] == [
        *((6, 0, 0, 0), (6, 0, 1, 0))
    ]
    assert [of_user(log, user).restarts for user in range(3)] == [1, 1, 0]
    assert ends_s(log) == {0: 203.000004, 1: 205.000004, 2: 206.000004}
    assert of_user(log, 0).computing_us == 27 * US
    assert of_user(log, 0).sending_us == 4_000_004
    assert of_user(log, 0).sent_ubit == 10**12, "what was lost does not count"


def test_a_crash_loses_a_result_that_waits() -> None:
    """The user leaves at 88 s, the task of user 0 is done at 90 s, and the drone falls at 93 s.

    When the user is back at 190 s, its task is sent, computed and returned anew.
    """
    world = over_station(1, 4, {}, autonomy_min=1.55, respawn_after_min=1.45)
    walk = [(0.0, *MIDDLE, 0.0, 0.0), (88.0, *NOWHERE, 0.0, 0.0), (190.0, *MIDDLE, 0.0, 0.0)]
    log = log_of(world, {0: [task(85.0, 1.0, 4.0, 2.0)]}, walks={0: walk}, respawn=[[0]])
    stages = [(event[0] / US, event[-1]) for event in seen(log, "stage")]
    assert stages == [(86.0, 1), (90.0, 2), (93.0, 0), (191.0, 1), (195.0, 2)]
    (one,) = log.requests
    assert (one.t_end_us, one.restarts) == (197 * US, 1)
    assert (one.computing_us, one.sending_us) == (8 * US, 4 * US)


def test_a_crash_sends_a_task_to_where_its_user_is_now() -> None:
    """The user is near a mast from 90 s on, and sends its task again from 93 s on."""
    world = over_station(1, 4, {}, autonomy_min=1.55, on_crash="remove", access_points=[mast()])
    walk = [(0.0, *MIDDLE, 0.0, 0.0), (88.0, *NOWHERE, 0.0, 0.0), (90.0, *THERE, 0.0, 0.0)]
    log = log_of(world, {0: [task(85.0, 1.0, 20.0)]}, walks={0: walk})
    (one,) = log.requests
    assert (one.restarts, one.t_end_us, one.drones) == (1, 104 * US, [0, 1])
    assert (one.sending_us, one.computing_us) == (2 * US, (7 + 10) * US)


def test_a_crash_on_the_way_home_sends_tasks_anew_at_once() -> None:
    """The drone flies home from 60 s on, when its processor has computed for 9 s of 20.

    Its user stands near a mast from 57 s on. The drone falls at 66 s, and nothing else happens in
    this instant: the task is sent to the mast for 1 s, and computed there for 10 s.
    """
    world = world_of(
        starts=[(0, 0)],
        battery={"kind": "endurance", "autonomy_min": 1.1, "on_crash": "remove"},
        stations={"count": 1, "radius_m": 0},
        episode={"steps": 2, "step_s": 60},
        access_points=[mast()],
    )
    walk = [(0.0, *HERE, 0.0, 0.0), (55.0, *NOWHERE, 0.0, 0.0), (57.0, *THERE, 0.0, 0.0)]
    log = log_of(world, {0: [task(50.0, 1.0, 20.0)]}, "hover goto", walks={0: walk})
    assert [event[0] / US for event in seen(log, "crash", "complete")] == [66.0, 77.0]
    (one,) = log.requests
    assert (one.restarts, one.drones, one.computing_us) == (1, [0, 1], (9 + 10) * US)


def test_a_crash_does_not_lose_a_part_that_is_done() -> None:
    """Half of the task is sent until 80.5 s and computed until 81.5 s; the user needs 100 s.

    The drone falls at 93 s, and the user goes on.
    """
    changes = {
        "users": {"processor": {"ghz": 1e-5}},
        "offloading": {"kind": "tests.engine.test_offloading:ByService", "part": 0.5},
    }
    world = over_station(1, 4, {}, autonomy_min=1.55, on_crash="remove", changes=changes)
    (one,) = log_of(world, {0: [task(80.0, 1.0, 2.0)]}).requests
    assert (one.outcome, one.restarts, one.t_end_us) == (Outcome.COMPLETED, 0, 180 * US)
    assert (one.sending_us, one.computing_us, one.own_us) == (US // 2, US, 100 * US)


# ---- access points


def test_an_access_point_computes_too() -> None:
    """A mast of two cores stands where the drone does not reach; each has its own line.

    Three users share its band, at 333,333 bit/s each.
    """
    asks = {user: [task(0.0, 1.0, 4.0)] for user in range(4)}
    world = world_of([HERE, THERE, THERE, THERE], access_points=[mast()])
    log = log_of(world, asks)
    assert ends_s(log) == {0: 5.0, 1: 5.000004, 2: 5.000004, 3: 7.000004}
    assert {one.user: one.drones for one in log.requests} == {0: [0], 1: [1], 2: [1], 3: [1]}
