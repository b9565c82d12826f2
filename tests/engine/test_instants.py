"""All changes of one instant happen before any drone admits requests, whoever has which number."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import EpisodeLog, RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.rules import association, settle
from desim_uav.rules.words import ON_ATTACH
from desim_uav.sample_path import SamplePath
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.audit.invariants import audit
from tests.engine.helpers import US, before_end, events, fly, path_of, seen

A3 = {"kind": "a3", "hysteresis_db": 0, "time_to_trigger_ms": 2000}
LOSSES = {
    "free_space": {"kind": "free_space"},
    "al_hourani": {"kind": "al_hourani", "environment": "urban"},
}


def road(
    starts: Sequence[int],
    places: Sequence[tuple[float, float]],
    radio: Mapping[str, Any] | None = None,
    **changes: Any,
) -> World:
    """Cells of 100 m along x, with drones over some of them that are received everywhere."""
    classes = {
        "kind": "link_classes",
        "bandwidth_mhz": 5,
        "power_dbm": 30,
        "path_loss": {"kind": "free_space"},
        "classes": [{"snr_db": 0, "bit_s_hz": 1}],
        **(radio or {}),
    }
    scenario = {
        "map": {"size_m": [800, 100], "cells": [8, 1], "dimensions": 2, "obstacles": None},
        "drones": {
            "count": len(starts),
            "start_cells": [[x, 0] for x in starts],
            "battery": None,
            "radio": classes,
        },
        "stations": {"count": 0},
        "users": {"positions_m": places, "mobility": {"kind": "static"}},
        "services": {"call": {"duration_min": [1], "bandwidth_kbps": [3000]}},
        "demand": {"kind": "static", "mix": {"call": 1}},
        "association": "strongest",
        "reward": {"kind": "coverage"},
        "episode": {"steps": 8},
        **changes,
    }
    return build_world(from_mapping(scenario), 0)


# ---- handovers of one instant


@pytest.mark.usefixtures("every_engine")
@pytest.mark.parametrize(("association", "after_s"), [("strongest", 0), (A3, 2)])
def test_users_who_change_drones_together_are_admitted_by_the_time_of_request(
    association: Any, after_s: int
) -> None:
    """Both walk from drone 0 to drone 1, which serve one of them; user 1 has asked first."""
    world = road([0, 5], [(50, 50)] * 2, association=association)
    walk, ask = [(0, 50, 50, 1, 0)], (500, 3000)
    path = path_of(world, {1: [(0, *ask)], 0: [(10, *ask)]}, walks={0: walk, 1: walk})
    log = fly(world, path)
    at = (250 + after_s) * US
    assert [event[:7] for event in seen(log) if event[0] == at] == events(f"""
        {at}  7  detach    0  0
        {at}  7  stop      0  1  0
        {at}  7  detach    0  1
        {at}  7  attach    1  0
        {at}  7  handover  1  0
        {at}  7  attach    1  1
        {at}  7  handover  1  1
        {at}  7  serve     1  1  0
    """)
    served = {request.user: request.served_us for request in log.requests}
    assert served == {0: 0, 1: 480 * US}


@pytest.mark.usefixtures("every_engine")
def test_bandwidth_that_falls_free_in_an_instant_is_there_for_who_comes_in_it() -> None:
    """User 2 goes from drone 1 to 2 when user 1 comes from 0 to 1, where user 0 has waited."""
    world = road([0, 2, 4], [(50, 50)] * 3, episode={"steps": 4})
    walks = {0: [(0, 250, 50, 0, 0)], 1: [(0, 50, 50, 1, 0)], 2: [(0, 250, 50, 1, 0)]}
    asks = {1: [(0, 500, 3000)], 2: [(0, 500, 3000)], 0: [(10, 500, 3000)]}
    log = fly(world, path_of(world, asks, walks=walks))
    served = {request.user: (request.served_us, request.drones) for request in log.requests}
    assert served == {0: (0, []), 1: (240 * US, [0, 1]), 2: (240 * US, [1, 2])}


@pytest.mark.usefixtures("every_engine")
def test_classes_that_change_in_one_instant_are_added_up_before_anybody_waits() -> None:
    """One user comes into the better class just when another one leaves it: the sum stays.

    A drone of 2 MHz serves two rates of 750 kbit/s at 1 bit/s/Hz and at 0.75 bit/s/Hz, and 250
    kbit/s.
    """
    ladder = [{"snr_db": 0, "bit_s_hz": 0.75}, {"snr_db": 30, "bit_s_hz": 1}]
    world = road(
        [4],
        [(50, 50)] * 3,
        {"bandwidth_mhz": 2, "power_dbm": 0, "classes": ladder},
        episode={"steps": 2},
    )
    edge_m = float(world.links[0].rings_m.min())
    walks = {
        0: [(0, 450 + edge_m - 30, 50, 1, 0)],
        1: [(0, 450 - edge_m - 30, 50, 1, 0)],
        2: [(0, 450, 50, 0, 0)],
    }
    asks = {2: [(10, 500, 250)], 1: [(0, 500, 750)], 0: [(5, 500, 750)]}
    log = fly(world, path_of(world, asks, walks=walks))
    changes = [event[0] for event in seen(log, "class")]
    assert changes == [30 * US, 30 * US]
    assert not [event for event in seen(log, "stop") if event[0] < log.duration_us]


def many(seed: int) -> tuple[World, dict[int, Any], dict[int, Any]]:
    """Drones that interfere or not, and users of whom several walk together."""
    rng = np.random.default_rng(seed)
    ladder = [{"snr_db": -3, "bit_s_hz": 0.4}, {"snr_db": 6, "bit_s_hz": 1.1}]
    radio = {
        "interference": ("none", "co_channel")[seed % 2],
        "classes": ladder,
        "bandwidth_mhz": 3,
        "sharing": ("held", "equal")[seed // 2 % 2],
    }
    held = {} if seed // 2 % 2 else {"bandwidth_kbps": [1]}
    services = {"call": {"duration_min": [1], "bandwidth_kbps": [1]}}
    world = road(
        [0, 3, 6],
        [(50, 50)] * 12,
        radio,
        association=("strongest", A3)[seed // 4 % 2],
        services=services | {"upload": {"kind": "transfer", "volume_mbit": [9], **held}},
    )
    walks = [(0, float(rng.integers(0, 800)), 50, speed, 0) for speed in (0, 0.4, -0.5, 0.25)]
    asked_s = rng.permutation(12) * 3.7
    asks = {user: [(asked_s[user], 400, float(rng.integers(500, 1500)))] for user in range(12)}
    return world, asks, {user: [walks[user % 4]] for user in range(12)}


@pytest.mark.usefixtures("every_engine")
@pytest.mark.parametrize("seed", range(6))
def test_numbers_of_users_decide_nothing(seed: int) -> None:
    """With other numbers, each user has the same requests, services and handovers."""
    world, asks, walks = many(seed)
    told = ("right left right left", "hover right", "left left left")
    number = np.random.default_rng(seed).permutation(12).tolist()
    one = fly(world, path_of(world, asks, walks=walks), *told)
    asks = {number[user]: own for user, own in asks.items()}
    walks = {number[user]: own for user, own in walks.items()}
    other = fly(world, path_of(world, asks, walks=walks), *told)
    assert one.links == other.links
    assert one.links is not None
    assert one.links.handovers > 0
    assert told_of(one, number) == told_of(other, range(12))


def told_of(log: EpisodeLog, number: Sequence[int]) -> list[Any]:
    """What a log says of requests and events, less the numbers of requests."""
    requests = [
        (number[r.user], r.t_request_us, r.t_first_us, r.t_end_us, r.served_us, r.done, r.drones)
        for r in log.requests
    ]
    happened = [
        (t_us, phase, kind, drone, number[user] if user >= 0 else -1, link_class)
        for t_us, phase, kind, drone, user, _, _, link_class in log.events or ()
    ]
    return [sorted(requests), sorted(happened)]


# ---- levels that are equal but for rounding


def apart(association: Any, loss: str) -> World:
    """Four drones over one cell, and users in a grid; buildings let drones climb."""
    places = [(48.7 + 101.3 * x, 31.1 + 97.9 * y) for x in range(9) for y in range(9)]
    scenario = {
        "map": {
            "size_m": [960, 960],
            "cells": [4, 4],
            "dimensions": 3,
            "levels": {"min_altitude_m": 60, "step_m": 20},
            "obstacles": {"coverage": [0.1, 0.1], "height_m": [90, 90]},
        },
        "drones": {
            "count": 4,
            "start_cells": [[1, 1]] * 4,
            "battery": None,
            "radio": {"kind": "link_classes", "power_dbm": 40, "path_loss": LOSSES[loss]},
        },
        "stations": {"count": 0},
        "association": association,
        "users": {"positions_m": places, "mobility": {"kind": "static"}},
        "episode": {"steps": 1},
    }
    return build_world(from_mapping(scenario), 0)


@pytest.mark.usefixtures("every_engine")
@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("association", ["strongest", {**A3, "time_to_trigger_ms": 3}])
@pytest.mark.thorough
def test_users_take_the_drone_that_becomes_the_strongest_when_drones_part(
    association: Any, loss: str
) -> None:
    """Levels are equal at the start, and differ by 1e-16 dB after a microsecond."""
    world = apart(association, loss)
    log = fly(world, path_of(world), "hover", "up", "right", "forward")
    flown_m, path_loss = 0.5 * 4 * 0.01**2, world.links[0].radio.path_loss
    levels_db = [
        [
            -path_loss.mean_db(
                math.hypot(360 + flown_m * dx - x, 360 + flown_m * dy - y), 60 + flown_m * dz, 2.0
            )
            for dx, dy, dz in ((0, 0, 0), (0, 0, 1), (1, 0, 0), (0, 1, 0))
        ]
        for x, y, _ in world.homes.tolist()
    ]
    best = np.argmax(levels_db, axis=1).tolist()
    assert len(set(best)) > 2
    early = [event for event in seen(log, "handover") if event[0] < 10_000]
    at_us = 0 if association == "strongest" else 3000
    assert sorted((t_us, drone, user) for t_us, _, _, drone, user, *_ in early) == sorted(
        (at_us, drone, user) for user, drone in enumerate(best) if drone > 0
    )


@pytest.mark.usefixtures("every_engine")
@pytest.mark.parametrize("association", ["strongest", A3])
def test_nobody_changes_drones_between_equal_levels(association: Any) -> None:
    """Two drones over one place, and one as far away on the other side of the users."""
    size = {"size_m": [800 / 3, 100], "cells": [8, 1], "dimensions": 2}
    world = road([1, 6, 6], [(400 / 3, y) for y in (3.1, 47.7, 81.9)], map=size)
    walks = {user: [(0, 400 / 3, 3.1 + user, 0, 0.1)] for user in range(3)}
    log = fly(world, path_of(world, walks=walks))
    assert log.links is not None
    assert log.links.handovers == 0
    assert Counter(event[3] for event in seen(log, "attach")) == {0: 3}


def meeting(starts: Sequence[int], user_m: float, association: Any) -> World:
    """Two drones that need 20 s to the next cell, and a user beside cell 3."""
    drones = {
        "count": 2,
        "start_cells": [[x, 0] for x in starts],
        "battery": None,
        "radio": {"kind": "link_classes", "power_dbm": 30, "path_loss": LOSSES["free_space"]},
        "motion": {
            "kind": "bang_coast_bang",
            "timing": "minimum_time",
            "max_speed_mps": 20,
            "max_acceleration_mps2": 1,
        },
    }
    return road(starts, [(user_m, 50)], drones=drones, association=association)


@pytest.mark.usefixtures("every_engine")
def test_a_user_changes_drones_where_their_levels_become_equal_and_stay_so() -> None:
    """Both drones come to cell 3, of which drone 1 is closer to the user until then."""
    world = meeting([2, 4], 380, "strongest")
    log = fly(world, path_of(world), "right", "left")
    attached = [(event[0], event[3]) for event in seen(log, "attach")]
    assert attached == [(0, 1), (20 * US, 0)]


@pytest.mark.usefixtures("every_engine")
@pytest.mark.parametrize(("trigger_s", "times_us"), [(9, []), (7, [19 * US])])
def test_a_time_to_trigger_ends_where_levels_become_equal(
    trigger_s: int, times_us: list[int]
) -> None:
    """Drone 1 is closer for 8 s, from 32 m before it is at the place of drone 0 until then."""
    world = meeting([3, 4], 366, {**A3, "time_to_trigger_ms": 1000 * trigger_s})
    log = fly(world, path_of(world), "hover", "left")
    assert [event[0] for event in seen(log, "handover")] == times_us


# ---- outages


@pytest.mark.usefixtures("every_engine")
def test_an_outage_is_logged_when_it_begins_and_when_it_ends() -> None:
    """The user walks through the footprint, which it enters at 70 s."""
    world = road([4], [(50, 50)], {"power_dbm": -24})
    radius_m = float(world.links[0].rings_m.max())
    assert 30 < radius_m < 200
    walk, left_us = [(0, 450 - radius_m - 70, 50, 1, 0)], round((70 + 2 * radius_m) * US)
    log = fly(world, path_of(world, {0: [(10, 5000, 3000)]}, walks={0: walk}))
    assert [event[:6] for event in seen(log, "outage", "outage_end")] == [
        (10 * US, 5, "outage", -1, 0, 0),
        (70 * US, 4, "outage_end", -1, 0, 0),
        (left_us, 2, "outage", -1, 0, 0),
        (480 * US, 8, "outage_end", -1, 0, 0),
    ]
    assert log.links is not None
    assert log.links[2:] == (2, 60 * US + 480 * US - left_us)


@pytest.mark.usefixtures("every_engine")
def test_no_link_for_0_s_is_no_outage() -> None:
    """A user passes the point at which two footprints meet."""
    power = {"power_dbm": -24}
    radius_m = float(road([1], [(50, 50)], power).links[0].rings_m.max())
    size = {"size_m": [8 * radius_m, 100], "cells": [8, 1], "dimensions": 2}
    world = road([1, 3], [(50, 50)], power, map=size, episode={"steps": 4})
    walk = [(0, 1.5 * radius_m, 50, radius_m / 50, 0)]
    log = fly(world, path_of(world, {0: [(0, 5000, 3000)]}, walks={0: walk}))
    assert [event[:5] for event in before_end(log, "exit", "enter", "outage", "outage_end")] == [
        (0, 4, "enter", 0, 0),
        (50 * US, 2, "exit", 0, 0),
        (50 * US, 4, "enter", 1, 0),
        (150 * US, 2, "outage", -1, 0),
        (150 * US, 2, "exit", 1, 0),
        (240 * US, 8, "outage_end", -1, 0),
    ]
    assert log.links == (1, 0, 1, 90 * US)


# ---- what the audit notices


def flown(world: World, path: SamplePath, watch: Any = audit) -> Simulation:
    """An episode of hovering drones, which is audited by ``watch``."""
    count = world.scenario.drone_count
    engine = Simulation(world, RunSettings((True,) * count, False, keep_events=True), audit=watch)
    shown = engine.reset(path)
    while not (shown.terminated or shown.truncated):
        shown = engine.step([4] * count)
    return engine


def handed_over() -> tuple[World, SamplePath]:
    """Two users who walk from drone 0 to drone 1."""
    world, walk, ask = road([0, 5], [(50, 50)] * 2), [(0, 50, 50, 1, 0)], (500, 3000)
    asks = {1: [(0, *ask)], 0: [(10, *ask)]}
    return world, path_of(world, asks, walks={0: walk, 1: walk})


def test_the_audit_notices_who_is_admitted_before_all_have_come(monkeypatch: Any) -> None:
    world, path = handed_over()
    flown(world, path)
    monkeypatch.setattr(settle, "nothing_before", lambda state, place: True)
    with pytest.raises(AssertionError, match="user 1 waits behind those who asked later"):
        flown(world, path)


def test_the_audit_notices_who_is_handed_back_without_a_reason(monkeypatch: Any) -> None:
    world, path = handed_over()
    right = association.passes_us

    def wrong(*given: Any) -> int:
        now_us = given[2].now_us
        return int(now_us + 1) if now_us == 250 * US else int(right(*given))

    monkeypatch.setattr(association, "passes_us", wrong)
    with pytest.raises(AssertionError, match="is handed back after 1 µs"):
        flown(world, path)


def test_the_audit_notices_two_attachments_in_a_phase() -> None:
    world, path = handed_over()

    def watch(engine: Simulation) -> None:
        events = engine.state.events
        events += [event for event in events if event.kind == ON_ATTACH][-1:]
        audit(engine)

    with pytest.raises(AssertionError, match="is attached twice in phase 7"):
        flown(world, path, watch)
