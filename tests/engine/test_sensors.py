"""Sensors, worked by hand: what their buffers keep, when updates are delivered, how old they are.

The drone has 1 MHz; users at ``FAR`` get 1 bit/s/Hz, so that a Mbit takes a second.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pytest

from desim_uav.engine.base import EpisodeLog
from desim_uav.experiment import tables
from desim_uav.model.rules import Outcome
from desim_uav.rules.words import FATES
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, to_plain
from desim_uav.world import World, build_world
from tests.audit.ages import audit_logs
from tests.engine.helpers import Ask, Flight, fly, path_of, radio, seen, strip
from tests.engine.test_offloading import AWAY
from tests.engine.test_transfers import FAR

pytestmark = pytest.mark.usefixtures("every_engine")

US = 10**6
KINDS = ("request", "generate", "drop", "deliver", "complete", "serve", "stop", "close")


def world_of(
    users: Sequence[tuple[float, float]] = (FAR,), sharing: str = "max_rate", **service: Any
) -> World:
    reading = {
        "kind": "collect",
        "updates": {"kind": "poisson", "mean_s": 60},
        "size_mbit": [1],
        **service,
    }
    scenario = {
        "map": {"size_m": [600, 700], "cells": [1, 1], "dimensions": 2},
        "drones": {"count": 1, "radio": radio(sharing=sharing), "battery": None},
        "stations": {"count": 0},
        "users": {"positions_m": users, "mobility": {"kind": "static"}},
        "services": {"reading": reading},
        "demand": {"kind": "sensing", "service": "reading"},
        "reward": {"kind": "coverage_battery"},
        "episode": {"steps": 2, "step_s": 10},
    }
    return build_world(from_mapping(scenario), 0)


def taken(at_s: float, mbit: float = 1.0) -> Ask:
    """An update that is taken at a time, and its size."""
    return (at_s, 0.0, 0.0, 0, round(mbit * 1e12), 0)


def log_of(world: World, updates: Mapping[int, Sequence[Ask]]) -> EpisodeLog:
    return fly(world, path_of(world, updates))


def of_updates(log: EpisodeLog) -> list[tuple[Any, ...]]:
    """The events as (seconds, kind, drone, user, request, update)."""
    return [(e[0] / US, e[2], *e[3:6], e[-1]) for e in seen(log, *KINDS)]


def fates(log: EpisodeLog) -> list[tuple[str, float]]:
    """The fate of each update and its time in seconds, in the order of the numbers of updates."""
    assert [one.number for one in log.updates] == list(range(len(log.updates)))
    return [(FATES[one.fate], one.ended_us / US) for one in log.updates]


def test_updates_are_sent_one_after_the_other() -> None:
    """Updates at 1 and 1.5 s are delivered at 2 and 3 s; the age is 2 s before either."""
    log = log_of(world_of(age_limit_s=10), {0: [taken(1), taken(1.5)]})
    assert of_updates(log) == [
        (1.0, "generate", -1, 0, -1, 0),
        (1.0, "request", -1, 0, 0, -1),
        (1.0, "serve", 0, 0, 0, -1),
        (1.5, "generate", -1, 0, -1, 1),
        (2.0, "stop", 0, 0, 0, -1),
        (2.0, "complete", 0, 0, 0, -1),
        (2.0, "deliver", 0, 0, -1, 0),
        (2.0, "request", -1, 0, 1, -1),
        (2.0, "serve", 0, 0, 1, -1),
        (3.0, "stop", 0, 0, 1, -1),
        (3.0, "complete", 0, 0, 1, -1),
        (3.0, "deliver", 0, 0, -1, 1),
    ]
    first, second = log.updates
    assert (first.before_us, first.after_us) == (2 * US, 1 * US)
    assert (second.before_us, second.after_us) == (2 * US, 1_500_000)
    assert (second.sent_us, second.received_us, second.drone) == (2 * US, 3 * US, 0)
    (sensor,) = log.sensors
    assert sensor.area_us2 == 2 * (2 + 1.5 + 17 * (1.5 + 18.5) / 2) * US * US
    assert (sensor.peaks_us, sensor.falls, sensor.age_us) == (4 * US, 2, 18_500_000)
    assert sensor.over_us == 8_500_000
    assert (sensor.generated, sensor.delivered, sensor.dropped, sensor.lost) == (2, 2, 0, 0)


def test_the_tables_have_the_ages_in_seconds() -> None:
    world = world_of(users=(FAR, AWAY), age_limit_s=10)
    log = log_of(world, {0: [taken(1), taken(1.5)], 1: [taken(0.5)]})
    requests = tables.requests_table([log], world)
    assert requests["t_request_s"].tolist() == [0.5, 1.0, 1.5]
    assert requests["attached_s"].tolist() == [0.0, 1.0, 1.5]
    assert requests["wait_s"].tolist() == [19.5, 0.0, 0.5]
    (episode,) = tables.episodes_table([log], world, requests).to_dict("records")
    assert episode["age_s"] == (173.5 / 20 + 10) / 2
    assert (episode["peak_age_s"], episode["worst_age_s"]) == (2.0, 10.0)
    assert (episode["updates"], episode["updates_delivered"]) == (3, 2)
    assert (episode["updates_dropped"], episode["updates_lost"]) == (0, 0)
    assert episode["age_violation_s"] == 8.5 + 10.0
    near, away = tables.sensors_table([log], world).to_dict("records")
    assert (near["age_s"], near["peak_age_s"], near["age_end_s"]) == (173.5 / 20, 2.0, 18.5)
    assert (away["age_s"], away["age_end_s"], away["violation_s"]) == (10.0, 20.0, 10.0)
    assert away["peak_age_s"] != away["peak_age_s"]
    updates = tables.updates_table([log], world)
    assert updates["fate"].tolist() == ["buffered", "delivered", "delivered"]
    assert updates["request_id"].tolist() == [0, 1, 2]
    assert updates["size_mbit"].tolist() == [1.0, 1.0, 1.0]
    assert updates["t_delivered_s"].tolist()[1:] == [2.0, 3.0]


UPDATES = [taken(1), taken(1.2), taken(1.4), taken(1.6)]
"""Four updates, the last three of which are taken while the first one is sent, until 2 s."""


@pytest.mark.parametrize(
    ("service", "expected"),
    [
        ({"buffer": 10}, "delivered 2 delivered 3 delivered 4 delivered 5"),
        (
            {"buffer": 2, "keeps": "newest"},
            "delivered 2 dropped 1.4 dropped 1.6 delivered 3",
        ),
        (
            {"buffer": 2, "keeps": "oldest"},
            "delivered 2 delivered 3 dropped 1.4 dropped 1.6",
        ),
        ({"buffer": 1, "keeps": "newest"}, "delivered 2 dropped 1.2 dropped 1.4 dropped 1.6"),
        ({"buffer": 1, "keeps": "oldest"}, "delivered 2 dropped 1.2 dropped 1.4 dropped 1.6"),
        ({"buffer": 9, "keeps": "last"}, "delivered 2 dropped 1.4 dropped 1.6 delivered 3"),
        (
            {"buffer": 9, "keeps": "last", "preempt": True},
            "dropped 1.2 dropped 1.4 dropped 1.6 delivered 2.6",
        ),
        (
            {"buffer": 1, "keeps": "last", "preempt": True},
            "dropped 1.2 dropped 1.4 dropped 1.6 delivered 2.6",
        ),
        ({"sends": "last"}, "delivered 2 delivered 5 delivered 4 delivered 3"),
        ({"sends": "last", "buffer": 3}, "delivered 2 dropped 1.6 delivered 4 delivered 3"),
        (
            {"sends": "last", "buffer": 3, "keeps": "oldest"},
            "delivered 2 delivered 4 delivered 3 dropped 1.6",
        ),
        (
            {"buffer": 3, "keeps": "newest"},
            "delivered 2 dropped 1.6 delivered 3 delivered 4",
        ),
    ],
)
def test_a_full_buffer(service: dict[str, Any], expected: str) -> None:
    words = expected.split()
    log = log_of(world_of(**service), {0: UPDATES})
    assert fates(log) == [(fate, float(t)) for fate, t in zip(words[::2], words[1::2], strict=True)]


def test_an_update_that_is_replaced_while_it_is_sent_closes_its_request() -> None:
    log = log_of(world_of(keeps="last", preempt=True), {0: [taken(1), taken(1.25)]})
    assert of_updates(log)[2:7] == [
        (1.0, "serve", 0, 0, 0, -1),
        (1.25, "generate", -1, 0, -1, 1),
        (1.25, "request", -1, 0, 1, -1),
        (1.25, "stop", 0, 0, 0, -1),
        (1.25, "drop", 0, 0, 0, 0),
    ]
    one, two = log.requests
    assert (one.outcome, one.t_end_us) == (Outcome.DROPPED, 1_250_000)
    assert one.sent_ubit == 25 * 10**10
    assert (two.outcome, two.t_end_us) == (Outcome.COMPLETED, 2_250_000)
    assert log.updates[0].sent_us == 1 * US
    assert log.updates[0].received_us == -1


def test_an_older_update_that_comes_later_does_not_lower_the_age() -> None:
    """Updates of 1, 1.2 and 1.6 s are delivered at 2, 4 and 3 s: the age falls twice."""
    log = log_of(world_of(sends="last"), {0: [taken(1), taken(1.2), taken(1.6)]})
    assert [(one.before_us, one.after_us) for one in log.updates] == [
        (2_000_000, 1_000_000), (2_400_000, 2_400_000), (2_000_000, 1_400_000),
    ]  # fmt: skip
    (sensor,) = log.sensors
    assert (sensor.falls, sensor.delivered, sensor.peaks_us) == (2, 3, 4 * US)
    audit_logs([log], world_of(sends="last"))


def test_the_last_update_takes_the_place_of_one_that_waits() -> None:
    """Sensor 1 asks at 1.2 s, behind sensor 0, and has taken two more updates when its turn comes.

    The last one, which is twice as large, is sent from 2 to 4 s, then those of 1.3 and 1.2 s.
    """
    world = world_of(users=(FAR, FAR), sends="last", buffer=3)
    log = log_of(world, {0: [taken(1)], 1: [taken(1.2), taken(1.3), taken(1.4, 2)]})
    assert fates(log) == [(("delivered"), t) for t in (2.0, 6.0, 5.0, 4.0)]
    own = [one for one in log.requests if one.user == 1]
    assert [(one.request_id, one.t_request_us) for one in own] == [
        (1, 1_200_000), (2, 1_300_000), (3, 1_200_000),
    ]  # fmt: skip
    audit_logs([log], world)


def test_the_last_update_stays_first_if_the_one_after_it_is_dropped() -> None:
    """The buffer has room for two, and keeps those of 1.2 and 1.3 s: the latter is sent at 2 s."""
    world = world_of(users=(FAR, FAR), sends="last", buffer=2, keeps="oldest")
    log = log_of(world, {0: [taken(1)], 1: [taken(1.2), taken(1.3), taken(1.4)]})
    assert fates(log) == [
        *(("delivered", 2.0), ("delivered", 4.0), ("delivered", 3.0), ("dropped", 1.4)),
    ]
    audit_logs([log], world)


def test_an_update_that_takes_the_place_of_another_one_has_its_room_first() -> None:
    """Sensor 2 holds the band until 7 s. Sensor 1 has had room for 4 Mbit since 6 s, and keeps it.

    Sensor 0, which comes first at 6.5 s, has given 0.5 Mbit back, and finds no room for 4.
    """
    world = carrying([NEAR] * 3, 7.0)
    services = to_plain(world.scenario)["services"]
    services["reading"]["keeps"] = "last"
    world = carrying([NEAR] * 3, 7.0, services=services)
    asks = {0: [held(6.2, 0.5), held(6.5, 4)], 1: [held(6, 4), held(6.5, 4)], 2: [held(5, 2)]}
    log = fly(world, path_of(world, asks))
    received_us = {(one.user, one.generated_us): one.received_us for one in log.updates}
    assert received_us[0, 6_500_000] == -1
    assert received_us[1, 6_500_000] == 11 * US
    audit_logs([log], world)


def test_the_last_update_needs_its_own_room_and_rate() -> None:
    """Sensor 1 waits with 0.4 Mbit while sensor 0 holds the band until 7 s, and then has 2 more.

    These do not fit the store, where there is room for 1.5 Mbit more, until 1 Mbit takes their
    place.
    """
    world = carrying([NEAR, NEAR], 3.5)
    services = to_plain(world.scenario)["services"]
    services["reading"]["sends"] = "last"
    world = carrying([NEAR, NEAR], 3.5, services=services)
    asks = {0: [held(5, 2)], 1: [held(6, 0.4), held(6.5, 2), held(9, 1)]}
    log = fly(world, path_of(world, asks))
    assert [one.received_us for one in log.updates] == [7 * US, -1, -1, 10 * US]
    audit_logs([log], world)


@pytest.mark.parametrize("sharing", ["equal", "max_rate"])
def test_sensors_share_a_server_with_preemption(sharing: str) -> None:
    """Each update replaces what the drone receives, of its own sensor or of the other one."""
    world = world_of(users=(FAR, FAR, AWAY), sharing=sharing, keeps="last", preempt="all")
    asks = {0: [taken(1), taken(4)], 1: [taken(1.5), taken(4.5)], 2: [taken(1.2)]}
    log = log_of(world, asks)
    assert fates(log) == [
        ("dropped", 1.5), ("buffered", 20), ("delivered", 2.5), ("dropped", 4.5),
        ("delivered", 5.5),
    ]  # fmt: skip
    assert [one.outcome for one in log.requests if one.user == 0] == [Outcome.DROPPED] * 2
    audit_logs([log], world)


@pytest.mark.parametrize(("keeps", "kept"), [("newest", [2, 3]), ("oldest", [0, 1]), ("last", [3])])
def test_who_is_out_of_reach_keeps_what_fits(keeps: str, kept: list[int]) -> None:
    log = log_of(world_of(users=(AWAY,), buffer=2, keeps=keeps), {0: UPDATES})
    assert [one.number for one in log.updates if FATES[one.fate] == "buffered"] == kept
    closed = [one.outcome for one in log.requests]
    assert closed == [Outcome.DROPPED] * (len(closed) - 1) + [Outcome.NEVER_SERVED]
    (sensor,) = log.sensors
    assert (sensor.area_us2, sensor.falls) == (400 * US * US, 0)
    assert (sensor.generated, sensor.dropped) == (4, 4 - len(kept))


def test_sensors_of_a_drone_are_served_in_the_order_of_their_updates() -> None:
    """Sensor 1 takes its second update before sensor 0 takes any, so that this comes last."""
    log = log_of(world_of(users=(FAR, FAR)), {0: [taken(1.4)], 1: [taken(1), taken(1.2)]})
    assert fates(log) == [("delivered", 2.0), ("delivered", 3.0), ("delivered", 4.0)]
    assert [one.user for one in log.updates] == [1, 1, 0]


def test_sizes_and_shares_of_updates() -> None:
    """Two sensors share the bandwidth equally: 2 Mbit of one and 0.5 of the other."""
    log = log_of(
        world_of(users=(FAR, FAR), sharing="equal"), {0: [taken(0, 2)], 1: [taken(0, 0.5)]}
    )
    assert fates(log) == [("delivered", 2.5), ("delivered", 1.0)]


# ---- at will, and at the ground


def test_updates_at_will_follow_delivery_and_a_rest() -> None:
    """Sending takes 1, 4 and 1 s. After 1 s of it, a sensor waits for 2 s more."""
    world = world_of(updates={"kind": "at_will", "wait_s": 3}, size_mbit=[1, 4])
    asks = [taken(0, 1), taken(0, 4), taken(0, 1), taken(0, 4), taken(0, 4)]
    log = fly(world, path_of(world, {0: asks}, thinking=True))
    assert [one.generated_us / US for one in log.updates] == [0, 3, 7, 10, 14]
    assert [(FATES[one.fate], one.ended_us / US) for one in log.updates] == [
        ("delivered", 1), ("delivered", 7), ("delivered", 8), ("delivered", 14), ("delivered", 18),
    ]  # fmt: skip


def test_updates_at_will_are_drawn_for_a_whole_episode() -> None:
    world = world_of(updates={"kind": "at_will"}, size_mbit=[1, 2])
    log = fly(world, draw(world, 3, 0))
    ends = [one.ended_us for one in log.updates]
    assert [one.generated_us for one in log.updates] == [0, *ends[:-1]]
    assert ends[-1] == log.duration_us


def carrying(
    users: Sequence[Sequence[float]], store_mbit: float | None = None, **changes: Any
) -> World:
    """Cells of 240 m in a row, with a station in the middle, at x = 1080, where the drone begins.

    Users to the west of x = 840 are out of its reach there.
    """
    reading = {
        "kind": "collect",
        "updates": {"kind": "poisson", "mean_s": 60},
        "size_mbit": [1],
        "delivered": "ground",
        "bandwidth_kbps": [1000],
    }
    base = {
        "starts": [(4, 0)],
        "users": users,
        "steps": 4,
        "radius_m": 200.0,
        "battery": {"autonomy_min": 10},
        "bandwidth_kbps": 1000,
        "services": {"reading": reading},
        "demand": {"kind": "sensing", "service": "reading"},
        "reward": {"kind": "age", "scale_s": 30},
        "drones": {"store_mbit": store_mbit},
    }
    return strip(**{**base, **changes})


def held(at_s: float, mbit: float = 1.0, kbps: float = 1000.0) -> Ask:
    """An update that holds a rate while it is sent."""
    return (at_s, 0.0, 0.0, 0, round(mbit * 1e12), round(kbps * 1000))


NEAR = (1080.0, 120.0)


def test_updates_are_delivered_when_the_drone_lands() -> None:
    """Those of 5 and 30 s are received at 6 and 31 s; the drone lands at the second epoch, 60 s."""
    world = carrying([NEAR])
    log = fly(world, path_of(world, {0: [held(5), held(30), held(100)]}), "hover charge")
    assert [(FATES[one.fate], one.ended_us / US) for one in log.updates] == [
        ("delivered", 60), ("delivered", 60), ("stored", 240),
    ]  # fmt: skip
    one, two, _ = log.updates
    assert (one.received_us, two.received_us) == (6 * US, 31 * US)
    assert (one.before_us, one.after_us) == (two.before_us, two.after_us) == (60 * US, 30 * US)
    (sensor,) = log.sensors
    assert (sensor.falls, sensor.peaks_us, sensor.delivered) == (1, 60 * US, 2)
    assert sensor.area_us2 == (60**2 + 210**2 - 30**2) * US * US
    at_60 = [(e[0], *e[2:6], e[6], e[-1]) for e in seen(log, "land", "deliver")]
    assert at_60 == [
        (60 * US, "land", 0, -1, -1, 0, -1),
        (60 * US, "deliver", 0, 0, -1, -1, 0),
        (60 * US, "deliver", 0, 0, -1, -1, 1),
    ]


def test_a_full_store_takes_no_more_until_it_is_emptied() -> None:
    """There is room for two updates of 1 Mbit. The third is sent after the landing, at 120 s."""
    world = carrying([NEAR], 2.5, steps=3, battery={"autonomy_min": 60, "return_below": 1.0})
    asks = {0: [held(5), held(10), held(20)]}
    log = fly(world, path_of(world, asks), "hover charge hover")
    assert [one.received_us for one in log.updates] == [6 * US, 11 * US, 121 * US]
    assert [FATES[one.fate] for one in log.updates] == ["delivered", "delivered", "stored"]


def test_room_that_is_given_back_goes_to_the_next_one() -> None:
    """An update of 0.5 Mbit is replaced by one of 0.4, which makes room for the other sensor's."""
    reading = {
        "kind": "collect",
        "updates": {"kind": "poisson", "mean_s": 60},
        "size_mbit": [1],
        "delivered": "ground",
        "keeps": "last",
        "preempt": True,
        "bandwidth_kbps": [10],
    }
    world = carrying([NEAR, NEAR], 1.0, steps=2, bandwidth_kbps=1000, services={"reading": reading})
    asks = {0: [held(0, 0.5, 10), held(10, 0.4, 10)], 1: [held(1, 0.6, 10)]}
    log = fly(world, path_of(world, asks))
    assert [(one.user, one.t_request_us, one.t_first_us) for one in log.requests] == [
        (0, 0, 0), (1, 1 * US, 10 * US), (0, 10 * US, 10 * US),
    ]  # fmt: skip
    assert [FATES[one.fate] for one in log.updates] == ["dropped", "stored", "stored"]


def test_a_crash_loses_what_is_stored() -> None:
    world = carrying([NEAR], battery={"autonomy_min": 1.0, "on_crash": "remove"})
    log = fly(world, path_of(world, {0: [held(5), held(100)]}), "hover hover")
    assert [(FATES[one.fate], one.ended_us / US) for one in log.updates] == [
        ("lost", 60), ("buffered", 240),
    ]  # fmt: skip
    assert [(e[0], e[2], e[3], e[4], e[-1]) for e in seen(log, "lose")] == [
        (60 * US, "lose", 0, 0, 0)
    ]
    (sensor,) = log.sensors
    assert (sensor.lost, sensor.delivered, sensor.area_us2) == (1, 0, 240**2 * US * US)


def test_an_update_that_is_turned_away_is_never_tried_again() -> None:
    """Rates above 500 kbit/s are refused: here the second of three; then the third one is sent.

    The store has room for 3.5 Mbit, of which the refused one gives 2 back.
    """
    admission = {"kind": "tests.engine.test_own_components:Smallest", "limit_bps": 500_000}
    world = carrying([NEAR], drones={"admission": admission, "store_mbit": 3.5})
    log = fly(world, path_of(world, {0: [held(5, 1, 200), held(6, 2, 800), held(7, 1, 200)]}))
    assert fates(log) == [("stored", 240), ("dropped", 10), ("stored", 240)]
    assert [(one.sent_us, one.received_us) for one in log.updates] == [
        (5 * US, 10 * US), (-1, -1), (10 * US, 15 * US),
    ]  # fmt: skip
    assert [(e[0], *e[2:6], e[-1]) for e in seen(log, "refuse", "drop")] == [
        (10 * US, "refuse", 0, 0, 1, -1),
        (10 * US, "drop", 0, 0, -1, 1),
    ]
    assert [one.outcome for one in log.requests] == [
        Outcome.COMPLETED, Outcome.NEVER_SERVED, Outcome.COMPLETED,
    ]  # fmt: skip
    (sensor,) = log.sensors
    assert (sensor.generated, sensor.dropped, sensor.delivered) == (3, 1, 0)
    audit_logs([log], world)


def test_a_rule_over_objects_turns_updates_away_one_after_the_other() -> None:
    """The first one takes the whole band; what does not fit at once is refused, one by one."""
    if Flight.flown_by != "des":
        pytest.skip("only the SimPy engine takes rules that work on Python objects")
    world = carrying([NEAR, NEAR], drones={"admission": {"kind": "tests.engine.helpers:Loss"}})
    asks = {0: [held(5, 10)], 1: [held(6), held(7), held(20)]}
    log = fly(world, path_of(world, asks))
    assert fates(log) == [("stored", 240), ("dropped", 6), ("dropped", 7), ("stored", 240)]
    audit_logs([log], world)


def test_the_reward_is_minus_the_mean_age() -> None:
    """The age falls from 60 to 30 s at 60 s: means of 30, 60, 120 and 180 s over steps of 60 s."""
    world = carrying([NEAR])
    log = fly(world, path_of(world, {0: [held(30)]}), "hover charge")
    assert [step.reward for step in log.steps] == [-1.0, -2.0, -4.0, -6.0]


def told(world: World, *updates: Ask, script: str = "hover charge") -> list[Any]:
    """What engines show at each epoch, if sensor 0 takes these updates."""
    flight = Flight(world)
    path = path_of(world, {0: list(updates)})
    shown = [flight.engine.reset(path)]
    commands = [flight.command(word) for word in script.split()]
    for k in range(world.scenario.episode.steps):
        command = commands[k] if k < len(commands) else flight.command("hover")
        shown.append(flight.engine.step([command] * len(world.starts)))
    return shown


@pytest.mark.parametrize(("sensors", "drones"), [(1, 1), (2, 1), (1, 2)])
def test_a_drone_is_paid_for_the_ages_that_fall_by_its_deliveries(
    sensors: int, drones: int
) -> None:
    """The age falls by 30 s at 60 s; each drone has a fair share of 60 s per step and sensor."""
    reward = {"kind": "qoe", "w1": 0, "w3": 0, "age": 2}
    away = (120.0, 120.0)
    starts = [(4, 0), (8, 0)][:drones]
    world = carrying([NEAR, away][:sensors], reward=reward, starts=starts)
    shown = told(world, held(30))
    terms = [[each["age"] for each in one.reward_terms] for one in shown[1:]]
    unit = 2 * (30 / 60) * drones / sensors
    assert terms == [[one, 0.0][:drones] for one in (0.0, unit, 0.0, 0.0)]


def test_a_fall_that_a_fresher_update_has_made_is_not_paid_again() -> None:
    """Those of 5 and 30 s are delivered together at 60 s, which lets the age fall by 30 s."""
    reward = {"kind": "qoe", "w1": 0, "w3": 0, "age": 1}
    shown = told(carrying([NEAR], reward=reward), held(5), held(30))
    assert [one.reward_terms[0]["age"] for one in shown[1:]] == [0.0, 0.5, 0.0, 0.0]


@pytest.mark.parametrize(
    ("observation", "expected"),
    [
        ({"kind": "local", "load_mbit": 4}, [0.0, 0.75, 0.0]),
        ({"kind": "local", "load_mbit": 2}, [0.0, 1.0, 0.0]),
        ({"kind": "position", "load_mbit": 4, "load_levels": 2}, [0, 2, 0]),
        ({"kind": "position", "load_mbit": 4, "load_levels": 8}, [0, 6, 0]),
        ({"kind": "position", "load_mbit": 1}, [0, 3, 0]),
    ],
)
def test_a_drone_observes_its_load(observation: dict[str, Any], expected: list[float]) -> None:
    """At 60 s it has 2 Mbit and is receiving one more; then it lands, and delivers."""
    world = carrying([NEAR], observation=observation)
    shown = told(world, held(5), held(30), held(59.5))
    names = [one.name for one in world.scenario.observation.features(world.facts)]
    assert names[-1] == "load"
    assert [one.observations[0].features[-1] for one in shown[:3]] == expected


def test_a_radar_shows_ages_and_loads() -> None:
    """At 60 s the sensors are 60 s old, one is below drone 0, which carries 2 Mbit of it.

    At 120 s, it has delivered the update of 30 s. Drone 1 is one cell to the west of drone 0.
    """
    raster = {"kind": "radar", "cells_x": 5, "cells_y": 1, "scales": 1, "full": 2}
    none = dict.fromkeys(("users", "requests", "demand", "blocked", "stations", "drones"), False)
    observation = {**raster, **none, "age_s": 15, "load_mbit": 4}
    world = carrying([NEAR, (600.0, 120.0)], starts=[(4, 0), (3, 0)], observation=observation)
    shown = told(world, held(5), held(30), script="hover charge")
    names = [one.name for one in world.scenario.observation.features(world.facts)][-10:]
    assert names[0] == "age0_-2_+0" and names[5] == "load0_-2_+0"
    rows = [[one.observations[d].features[-10:] for d in (0, 1)] for one in shown[:3]]
    age, load = [2.0, 0.0, 2.0], [0.0, 0.0, 0.5]
    assert [list(each) for each in rows[1]] == [
        [*age, 0.0, 0.0, *load, 0.0, 0.0],
        [0.0, *age, 0.0, 0.0, *load, 0.0],
    ]
    assert not any(rows[0][0])
    assert list(rows[2][0]) == [4.0, 0.0, 3.0, 0.0, 0.0, *[0.0] * 5]
