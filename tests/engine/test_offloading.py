"""Offloading, worked by hand: what a drone and its user compute, when it is done, what it takes.

The drone has 1 MHz; users at ``FAR`` get 1 bit/s/Hz, and those at ``NEAR`` 2. Inputs have
1000 cycles per bit, users have 1 GHz, and drones two cores of 2 GHz.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import EpisodeLog
from desim_uav.errors import SimulationError
from desim_uav.experiment import tables
from desim_uav.model.offloading import RowOffloading
from desim_uav.model.rules import Outcome
from desim_uav.rules.rows import Constants, State, User
from desim_uav.scenario.cost import expected_requests
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine.helpers import Ask, Flight, events, fly, path_of, radio, seen
from tests.engine.test_transfers import FAR, NEAR

pytestmark = pytest.mark.usefixtures("every_engine")

US = 10**6
AWAY = (300.0, 690.0)
"""340 m from the drone, which is out of reach."""


RADIO = radio(classes=[{"snr_db": 50, "bit_s_hz": 1}, {"snr_db": 60, "bit_s_hz": 2}])


def world_of(
    offloading: Any,
    users: Sequence[tuple[float, float]] = (FAR,),
    radio: Mapping[str, Any] = RADIO,
    processor: Mapping[str, Any] = {"cores": 2, "ghz": 2},
    own_ghz: float = 1.0,
    reward: Mapping[str, Any] = {"kind": "coverage_battery"},
    observation: Mapping[str, Any] = {"kind": "position"},
    **service: Any,
) -> World:
    task = {"kind": "compute", "input_mbit": [1], "cycles_per_bit": [1000], **service}
    scenario = {
        "map": {"size_m": [600, 700], "cells": [1, 1], "dimensions": 2},
        "drones": {"count": 1, "radio": radio, "battery": None, "processor": processor},
        "stations": {"count": 0},
        "users": {
            "positions_m": users,
            "mobility": {"kind": "static"},
            "processor": {"ghz": own_ghz, "kappa": 1e-27, "transmit_w": 0.1},
        },
        "services": {"task": task},
        "offloading": offloading,
        "demand": {"kind": "static", "mix": {"task": 1}},
        "reward": reward,
        "observation": observation,
        "episode": {"steps": 4, "step_s": 60},
    }
    return build_world(from_mapping(scenario), 0)


def ask(at_s: float, mbit: float, output_mbit: float = 0.0, cycles: float = 1000.0) -> Ask:
    return (at_s, 0.0, 0.0, 0, round(mbit * 1e6), round(cycles * 1000), round(output_mbit * 1e6), 0)


def log_of(world: World, asks: Mapping[int, Sequence[Ask]], **path: Any) -> EpisodeLog:
    return fly(world, path_of(world, asks, **path))


def of_tasks(log: EpisodeLog) -> list[tuple[Any, ...]]:
    kinds = ("request", "serve", "stop", "stage", "complete", "compute", "computed", "late")
    return [(*event[:6], event[-1]) for event in seen(log, *kinds)]


def test_a_user_computes_alone() -> None:
    """6 Gcycles take 6 s at 1 GHz and 6 J at 1e-27 J/Hz^2."""
    world = world_of("never")
    log = log_of(world, {0: [ask(1.0, 6.0)]})
    assert of_tasks(log) == events(
        """
        1000000 5 request  - 0 0
        1000000 5 compute  - 0 0
        7000000 1 computed - 0 0
        7000000 1 complete 0 0 0
        """
    )
    (request,) = log.requests
    assert (request.outcome, request.served_us, request.own_us) == (
        *(Outcome.COMPLETED, 6 * US, 6 * US),
    )
    row = tables.requests_table([log], world).iloc[0]
    assert (row["user_j"], row["offloaded"], row["gigacycles"]) == (6.0, 0.0, 6.0)
    assert (row["qoe1"], row["qoe2_iterations"], row["requested_mbit"]) == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("place", "part", "end_us"), [(FAR, 0.4, 3_600_000), (AWAY, 0.0, 6_000_000)]
)
def test_users_are_attached_before_the_first_tasks(
    place: tuple[float, float], part: float, end_us: int
) -> None:
    """What is asked for at the start is split as at any other time, if a drone covers the user."""
    (request,) = log_of(world_of("split", (place,)), {0: [ask(0.0, 6.0)]}).requests
    assert (request.t_end_us, request.part) == (end_us, part)


def test_a_task_is_split_where_both_are_done_at_once() -> None:
    """Alone it takes 6 s, offloaded 6 s to send and 3 s to compute: the part is 6/15.

    Both parts take 3.6 s. Sending 2.4 Mbit takes 2.4 s with 0.1 W, and 3.6 Gcycles take 3.6 J.
    """
    world = world_of("split")
    log = log_of(world, {0: [ask(1.0, 6.0)]})
    (request,) = log.requests
    assert (request.t_end_us, request.part) == (4_600_000, 0.4)
    assert (request.own_us, request.sending_us, request.computing_us) == (
        *(3_600_000, 2_400_000, 1_200_000),
    )
    assert request.served_us == 3_600_000, "no time counts twice"
    row = tables.requests_table([log], world).iloc[0]
    assert row["user_j"] == pytest.approx(3.6 + 0.24, rel=1e-12)
    assert (row["waiting_s"], row["qoe1"], row["delivered_mbit"]) == (0.0, 1.0, 2.4)


@pytest.mark.parametrize(
    ("offloading", "delay_s", "part"),
    [("never", 174.7627, 0.0), ("always", 97.9016, 1.0), ("split", 62.7495, 0.640945)],
)
def test_the_overhead_point_of_the_literature(offloading: str, delay_s: float, part: float) -> None:
    """100 Mibit at 9.967226 Mbit/s, 1000 cycles a bit, 0.6 and 1.2 GHz (Wang et al., 2021)."""
    radio = {**RADIO, "classes": [{"snr_db": 50, "bit_s_hz": 9.967226}]}
    world = world_of(offloading, radio=radio, processor={"ghz": 1.2}, own_ghz=0.6)
    (request,) = log_of(world, {0: [ask(0.0, 104.8576)]}).requests
    assert request.outcome == Outcome.COMPLETED
    assert request.t_end_us / US == pytest.approx(delay_s, abs=5e-5)
    assert request.part == pytest.approx(part, abs=5e-7)


def test_the_shortest_way_knows_what_waits() -> None:
    """User 1 has 4 Mbit: 4 s alone, or 4 s to send and 1 s after what is at the processor.

    User 0 is near, at 2 Mbit/s: 2 Mbit would take 2 s alone, and 1 s and 1 s offloaded, which is no
    sooner. With 3 Gcycles for its 2 Mbit, it takes 3 s alone and 2.5 s offloaded.
    """
    world = world_of("shortest", [NEAR, FAR])
    log = log_of(world, {0: [ask(0.0, 2.0), ask(20.0, 2.0, cycles=1500.0)], 1: [ask(40.0, 4.0)]})
    parts = [(r.user, r.part, r.t_end_us - r.t_request_us) for r in log.requests]
    assert parts == [(0, 0.0, 2_000_000), (0, 1.0, 2_500_000), (1, 0.0, 4_000_000)]


def test_a_backlog_counts() -> None:
    """Two tasks of 20 Gcycles are at the two cores: the next one would wait.

    Alone it takes 6 s. At an empty processor it would take 2 s to send and 1.5 s to compute; with
    about 36 Gcycles that are left at 4 GHz, 9 s more.
    """
    world = world_of("shortest", [NEAR, NEAR, NEAR])
    busy = {0: [ask(0.0, 2.0, cycles=10_000.0)], 1: [ask(0.0, 2.0, cycles=10_000.0)]}
    alone = log_of(world, {2: [ask(4.0, 2.0, cycles=3000.0)]}).requests
    beside = log_of(world, busy | {2: [ask(4.0, 2.0, cycles=3000.0)]}).requests
    assert [r.part for r in alone] == [1.0]
    assert {r.user: r.part for r in beside} == {0: 1.0, 1: 1.0, 2: 0.0}


def test_users_out_of_reach_compute_alone() -> None:
    for offloading in ("shortest", "split"):
        (request,) = log_of(world_of(offloading, [AWAY]), {0: [ask(1.0, 6.0)]}).requests
        assert (request.part, request.t_end_us) == (0.0, 7 * US)
    (request,) = log_of(world_of("always", [AWAY]), {0: [ask(1.0, 6.0)]}).requests
    assert request.outcome == Outcome.NEVER_SERVED


def test_a_task_that_is_dropped_frees_what_it_held() -> None:
    """Both send 3 Mbit at half a Mbit/s each; the first is late at 3 s, and the other goes on.

    At 3 s, 1.5 Mbit of the other are left, which take 1.5 s; 3 Gcycles then take 1.5 s.
    """
    world = world_of("always", [FAR, FAR], deadline_s=3, on_deadline="drop")
    log = log_of(world, {0: [ask(0.0, 3.0)], 1: [ask(0.5, 3.0)]})
    ends = {r.user: (r.outcome, r.t_end_us) for r in log.requests}
    assert ends[0] == (Outcome.LATE, 3 * US)
    row = tables.requests_table([log], world).set_index("user")
    assert row.loc[0, "late"] and row.loc[0, "deadline_s"] == 3.0


def test_who_leaves_stays_if_its_computation_has_begun() -> None:
    """Task 0 takes 2 s to send and 3 s at 2 GHz; it is late at 4 s, but has begun."""
    for late, outcome, end_s in (
        ("count", Outcome.COMPLETED, 5),
        ("leave", Outcome.COMPLETED, 5),
        ("drop", Outcome.LATE, 4),
    ):
        world = world_of("always", [FAR], deadline_s=4, on_deadline=late)
        log = log_of(world, {0: [ask(0.0, 2.0, cycles=3000.0)]})
        (request,) = log.requests
        assert (request.outcome, request.t_end_us) == (outcome, end_s * US), late
        assert tables.requests_table([log], world)["late"].tolist() == [True]


@dataclass(frozen=True)
class ByService(RowOffloading):
    """Offloads the same part of all tasks."""

    part: float = 0.25

    def share(self, world: Constants, state: State, user: User) -> float:
        """Return the part."""
        return self.part


def test_offloading_of_ones_own() -> None:
    """A quarter of 8 Mbit takes 2 s to send and 1 s to compute, and the rest 6 s."""
    own = {"kind": "tests.engine.test_offloading:ByService", "part": 0.25}
    (request,) = log_of(world_of(own), {0: [ask(0.0, 8.0)]}).requests
    assert (request.part, request.t_end_us, request.own_us) == (0.25, 6 * US, 6 * US)
    assert (request.sending_us, request.computing_us) == (2 * US, US)


@pytest.mark.parametrize("part", [-0.1, 1.5, float("nan")])
def test_a_share_is_from_0_to_1(part: float) -> None:
    own = {"kind": "tests.engine.test_offloading:ByService", "part": 0.5}
    world = world_of(own)
    object.__setattr__(world.scenario.offloading, "part", part)
    with pytest.raises(SimulationError, match="'ByService' gave a share that is not from 0 to 1"):
        log_of(world, {0: [ask(0.0, 8.0)]})


def test_measures_agree_with_the_table() -> None:
    world = world_of("split", [FAR, NEAR, AWAY])
    asks = {u: [ask(float(t), 3.0 + u) for t in range(0, 110, 20)] for u in range(3)}
    log = log_of(world, asks)
    frame = tables.requests_table([log], world)
    assert np.allclose(frame["waiting_s"] / 60, frame["qoe2_iterations"])
    assert (frame["own_s"] <= frame["served_s"] + 1e-9).all()


def in_time(world: World, asks: Mapping[int, Sequence[Ask]], *told: str) -> list[float]:
    """The terms of the reward for deadlines of each step, which a drone gets."""
    flight = Flight(world)
    shown, terms = flight.engine.reset(path_of(world, asks)), []
    while not (shown.terminated or shown.truncated):
        shown = flight.engine.step([flight.command("hover")])
        terms.append(flight.engine.terms()[0]["deadline"])
    return terms


def test_tasks_that_are_done_in_time_are_paid_for() -> None:
    """Alone 3 Mbit take 3 s, and 6 Mbit 6 s, which is late; a task done at 60 s is of step 0.

    The user makes one request a minute: of 4 steps with 4 requests, 1 is the fair share.
    """
    reward = {"kind": "qoe", "w1": 0, "w3": 0, "deadline": 2}
    world = world_of("never", reward=reward, deadline_s=3)
    asks = {0: [ask(1.0, 3.0), ask(10.0, 6.0), ask(57.0, 3.0), ask(70.0, 3.0)]}
    terms = in_time(world, asks)
    unit = 2 / (expected_requests(world.scenario) / 4)
    assert terms == pytest.approx([2 * unit, unit, 0.0, 0.0])


def test_a_drone_observes_the_backlog_of_its_processor() -> None:
    """At 60 s, 2 Mbit have been sent at 58 s; 40 Gcycles take 20 s on one of the two cores.

    18 s of them are left, or 9 s of both cores.
    """
    world = world_of("always", [NEAR], observation={"kind": "local", "backlog_s": 18})
    flight = Flight(world)
    flight.engine.reset(path_of(world, {0: [ask(57.0, 2.0, cycles=20_000.0)]}))
    names = [one.name for one in world.scenario.observation.features(world.facts)]
    assert names[-1] == "backlog"
    assert flight.engine.features()[0][-1] == 0.0
    flight.engine.step([flight.command("hover")])
    assert flight.engine.features()[0][-1] == pytest.approx(0.5)


def test_a_radar_shows_backlogs() -> None:
    """As above, in the cell of the drone, which is the only one of the map."""
    keys = ("users", "requests", "demand", "blocked", "stations", "drones")
    raster = {
        "kind": "radar",
        "cells_x": 1,
        "cells_y": 3,
        "scales": 1,
        **dict.fromkeys(keys, False),
    }
    world = world_of("always", [NEAR], observation={**raster, "backlog_s": 18})
    flight = Flight(world)
    flight.engine.reset(path_of(world, {0: [ask(57.0, 2.0, cycles=20_000.0)]}))
    flight.engine.step([flight.command("hover")])
    assert list(flight.engine.features()[0][-3:]) == pytest.approx([0.0, 0.5, 0.0])
