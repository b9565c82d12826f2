"""Ground access points, worked by hand: they serve, disturb and take users over as drones do.

Levels are 100 dBm - 20 log10(d / 1 m), and noise is 0 dBm, unless a test says otherwise: a link of
at least 50 dB holds within 316.2 m in space.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

import desim_uav
from desim_uav.engine.base import EpisodeLog, RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.errors import UsageError
from desim_uav.model.rules import Outcome
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine.helpers import Flight, before_end, events, fly, path_of, radio, seen

MBIT = 1e6
"""What ``path_of`` takes for a second of service is a bit of a transfer."""

MAST = 1
"""The number of the first access point, after that of the lone drone."""


pytestmark = pytest.mark.thorough
"""Both engines compile the kernels of links in the air, which takes long."""


def mast(x: float, y: float = 100.0, **changes: Any) -> dict[str, Any]:
    """A mast of 20 m."""
    point = {"at_m": [x, y], "height_m": 20, "radio": radio(**changes.pop("radio", {}))}
    return {**point, **changes}


def road(
    places: Sequence[tuple[float, float]], masts: Sequence[Mapping[str, Any]], **changes: Any
) -> World:
    """A road of 2,000 m along x, over whose west end (100 m, 100 m) a drone hovers at 20 m."""
    scenario = {
        "map": {"size_m": [2000, 200], "cells": [10, 1], "dimensions": 2},
        "drones": {"count": 1, "radio": radio(), "battery": None, "start_cells": [[0, 0]]},
        "stations": {"count": 0},
        "access_points": masts,
        "users": {"positions_m": places, "mobility": {"kind": "static"}},
        "services": {"upload": {"kind": "transfer", "volume_mbit": [1]}},
        "demand": {"kind": "static", "mix": {"upload": 1}},
        "episode": {"steps": 2, "step_s": 60},
        **changes,
    }
    scenario["map"]["levels"] = {"min_altitude_m": 20}  # type: ignore[index]
    return build_world(from_mapping(scenario), 0)


@pytest.mark.usefixtures("every_engine")
class TestByHand:
    """Flights of every engine."""

    def test_it_serves_without_end(self) -> None:
        """70 Mbit at 1 Mbit/s go on into the second step."""
        world = road([(1500.0, 100.0)], [mast(1500)])
        log = fly(world, path_of(world, {0: [(0.0, 70 * MBIT, 0.0)]}))
        assert [event[:7] for event in before_end(log)] == events(
            f"""
                   0 4 enter    {MAST} 0
                   0 5 request  - 0 0
                   0 7 attach   {MAST} 0
                   0 7 serve    {MAST} 0 0
            70000000 1 stop     {MAST} 0 0
            70000000 1 complete {MAST} 0 0
            """
        )
        (request,) = log.requests
        assert (request.outcome, request.drones) == (Outcome.COMPLETED, [MAST])
        assert log.attached_us == 120_000_000

    def test_users_in_its_footprint_are_counted_step_by_step(self) -> None:
        world = road([(1500.0, 100.0)] * 2, [mast(500), mast(1500)])
        log = fly(world, path_of(world, {0: [(0.0, 70 * MBIT, 0.0)], 1: [(30.0, 90 * MBIT, 0.0)]}))
        rows = [tuple(row) for row in log.point_steps]
        assert rows == [
            (0, 60_000_000, 0, 0, 0, 0),
            (0, 60_000_000, 1, 2, 2, 1_000_000),
            (1, 120_000_000, 0, 0, 0, 0),
            (1, 120_000_000, 1, 2, 1, 1_000_000),
        ]

    def test_the_drone_takes_precedence_at_the_same_instant(self) -> None:
        """Both cover the user from the start on; of two, the lower number is attached."""
        world = road([(200.0, 100.0)], [mast(250)])
        assert [event[3] for event in seen(fly(world, path_of(world)), "attach")] == [0]

    def test_the_strongest_wins(self) -> None:
        """The user is 100 m away from the drone and 50 m from the mast."""
        world = road([(200.0, 100.0)], [mast(250)], association="strongest")
        assert [event[3] for event in seen(fly(world, path_of(world)), "attach")] == [MAST]

    def test_a_walker_is_handed_over_half_way(self) -> None:
        """From 1,000 m to 1,300 m at 4 m/s, between masts at 1,000 m and 1,300 m."""
        masts = [mast(1000), mast(1300)]
        world = road([(1000.0, 100.0)], masts, association="strongest")
        log = fly(world, path_of(world, walks={0: [(0.0, 1000.0, 100.0, 4.0, 0.0)]}))
        handed = [event[:5] for event in seen(log, "handover")]
        assert len(handed) == 1
        t_us, phase, kind, drone, user = handed[0]
        assert (phase, kind, drone, user) == (7, "handover", MAST + 1, 0)
        assert t_us == pytest.approx(150 / 4 * 1e6, abs=1)

    def test_an_a3_handover_waits_for_its_trigger(self) -> None:
        """The second mast is better by 6 dB from where its distance is half that of the first."""
        a3 = {"kind": "a3", "offset_db": 5, "hysteresis_db": 1, "time_to_trigger_ms": 640}
        world = road([(1000.0, 100.0)], [mast(1000), mast(1300)], association=a3)
        log = fly(world, path_of(world, walks={0: [(0.0, 1000.0, 100.0, 4.0, 0.0)]}))
        ratio = 10 ** (6 / 10)  # of squared distances: (x² + 20²) = ratio ((300 - x)² + 20²)
        a, b, c = ratio - 1, -600 * ratio, ratio * (300**2 + 20**2) - 20**2
        x_m = (-b - math.sqrt(b * b - 4 * a * c)) / (2 * a)
        ((t_us, *_),) = seen(log, "handover")
        assert t_us == pytest.approx(x_m / 4 * 1e6 + 640_000, abs=1)

    def test_times_to_trigger_begin_anew_with_a_handover(self) -> None:
        """A walker passes masts at 0, 100 and 500 m, of which the last is better at the handover.

        It has been better than the first one for 0.7 s then, which does not count: it has to be
        better than the second one for 2.8 s.
        """
        a3 = {"kind": "a3", "offset_db": 0, "hysteresis_db": 1, "time_to_trigger_ms": 2800}
        far = {"radio": {"classes": [{"snr_db": 20, "bit_s_hz": 1}]}}
        masts = [mast(1000 + x, **far) for x in (0, 100, 500)]
        world = road([(1000.0, 100.0)], masts, association=a3)
        walk = [(0.0, 1000.0, 100.0, 100.0, 0.0), (9.0, 1900.0, 100.0, 0.0, 0.0)]
        handed = seen(fly(world, path_of(world, walks={0: walk})), "handover")
        ratio = 10 ** (1 / 10)  # of squared distances: (x² + 20²) = ratio ((100 - x)² + 20²)
        a, b, c = ratio - 1, -200 * ratio, ratio * (100**2 + 20**2) - 20**2
        better_us = (-b - math.sqrt(b * b - 4 * a * c)) / (2 * a) / 100 * 1e6
        assert [event[3] for event in handed] == [MAST + 1, MAST + 2]
        times = [better_us + 2_800_000, better_us + 5_600_000]
        assert [event[0] for event in handed] == pytest.approx(times, abs=1)

    def test_it_disturbs_the_drone(self) -> None:
        """At 30 m from the drone and 970 m from the mast, the SINR is about 28.6 dB, not 68.9."""
        classes = [{"snr_db": 28, "bit_s_hz": 0.5}, {"snr_db": 50, "bit_s_hz": 1}]
        on_air = {"interference": "co_channel", "classes": classes}
        for masts, link_class in (([], 2), ([mast(1100, radio=on_air)], 1)):
            drones = {"count": 1, "radio": radio(**on_air), "battery": None}
            world = road([(130.0, 100.0)], masts, drones={**drones, "start_cells": [[0, 0]]})
            entered = seen(fly(world, path_of(world)), "enter")
            assert [event[3:5] + event[-1:] for event in entered] == [(0, 0, link_class)]

    @pytest.mark.parametrize(("counts", "reward"), [(False, 1 / 3), (True, 2 / 3)])
    def test_it_counts_in_rewards_if_wanted(self, counts: bool, reward: float) -> None:
        """The drone has one user of three: a third of its fair share alone, 2/3 beside a mast."""
        masts = [mast(1500, counts_in_reward=counts)]
        users = [(100.0, 100.0), (1500.0, 100.0), (1500.0, 101.0)]
        world = road(users, masts, reward={"kind": "coverage"})
        flight = Flight(world)
        flight.episode(path_of(world))
        assert [one.rewards for one in flight.shown[1:]] == [(pytest.approx(reward),)] * 2

    def test_beside_drones_with_a_disc(self) -> None:
        world = road(
            [(100.0, 100.0), (1500.0, 100.0)],
            [mast(1500, radio={"sharing": "held"})],
            drones={"count": 1, "footprint_radius_m": 50, "battery": None, "start_cells": [[0, 0]]},
            services={"stream": {"bandwidth_kbps": [500], "duration_min": [1]}},
            demand={"kind": "static", "mix": {"stream": 1}},
        )
        attached = seen(fly(world, path_of(world)), "attach")
        assert [event[3:5] for event in attached] == [(0, 0), (MAST, 1)]


def played(name: str, world: World, seed: int) -> list[tuple[EpisodeLog, list[Any]]]:
    """Two episodes with random commands: the log and the rewards of each."""
    settings = RunSettings((True,) * world.scenario.drones.count, True, keep_events=True)
    engine, rng, told = make_engine(name, world, settings), np.random.default_rng(seed), []
    for episode in range(2):
        shown, rewards = engine.reset(draw(world, seed, episode)), []
        while not (shown.terminated or shown.truncated):
            shown = engine.step(rng.integers(len(world.actions), size=len(shown.masks)).tolist())
            rewards.append(shown.rewards)
        told.append((engine.log, rewards))
    return told


def test_both_engines_are_equal() -> None:
    classes = [{"snr_db": at, "bit_s_hz": rate} for at, rate in ((-3, 0.25), (3, 1), (15, 3))]
    on_air = {"interference": "co_channel", "classes": classes}
    masts = [
        mast(300, 50, radio={**on_air, "power_dbm": 85}),
        mast(1700, 150, radio=on_air, height_m=35, counts_in_reward=True),
    ]
    places = [(230.0 * k, 24.0 * k) for k in range(1, 8)]
    world = road(
        places,
        masts,
        drones={
            "count": 2,
            "radio": radio(**on_air, power_dbm=90),
            "battery": None,
        },
        users={"positions_m": places, "mobility": {"kind": "random_walk"}},
        association={"kind": "a3", "time_to_trigger_ms": 500},
        episode={"steps": 8, "step_s": 60},
    )
    one, other = (played(name, world, 3) for name in ("des", "batch"))
    assert one == other
    rows = [event for log, _ in one for event in log.events or ()]
    assert {event[3] for event in rows if event[2] == "serve"} >= {2, 3}
    assert {"class", "handover"} <= {event[2] for event in rows}


def test_their_rows_are_a_table_of_a_run() -> None:
    world = {"users": {"count": 4, "clusters": {"count": 1}}, "demand": {"kind": "dynamic"}}
    point = {"at_m": [700, 700], "height_m": 20, "radio": {"kind": "link_classes"}}
    run = desim_uav.run(
        {**world, "access_points": [point], "episode": {"steps": 3}}, policy="hover"
    )
    table = run.access_points
    assert table["step"].tolist() == [0, 1, 2]
    assert table["access_point"].tolist() == [0] * 3
    assert (table["attached_users"] <= 4).all() and table["attached_users"].sum() > 0
    with pytest.raises(UsageError, match="the scenario has no access points"):
        _ = desim_uav.run(world, policy="hover").access_points
