"""Transfers of a volume, worked by hand: who is served, at which rate, and when it is done.

Links have the loss of 20 log10(d / 1 m), a power of 100 dBm and a noise of 0 dBm. At an altitude of
20 m a link of at least 50 dB holds within 315.6 m, and one of at least 60 dB within 98.0 m.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import pytest

from desim_uav.model.rules import Outcome
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine.helpers import Ask, events, fly, path_of, radio, seen

pytestmark = pytest.mark.usefixtures("every_engine")

MBIT = 1e6
"""What ``path_of`` takes for a second of service is a bit of a transfer."""


def hover(
    users: list[tuple[float, float]], sharing: str = "equal", steps: int = 1, **changes: Any
) -> World:
    """Hover over the middle of a cell with 1 MHz: 1 bit/s/Hz from 50 dB on, 2 from 60 dB on."""
    classes = [{"snr_db": 50, "bit_s_hz": 1}, {"snr_db": 60, "bit_s_hz": 2}]
    rates = {"bandwidth_kbps": [400]} if sharing == "held" else {}
    scenario = {
        "map": {"size_m": [600, 600], "cells": [1, 1], "dimensions": 2},
        "drones": {"count": 1, "radio": radio(classes=classes, sharing=sharing), "battery": None},
        "stations": {"count": 0},
        "users": {"positions_m": users, "mobility": {"kind": "static"}},
        "services": {
            "upload": {"kind": "transfer", "volume_mbit": [1], **rates},
            "video": {"kind": "uniform_choice", "duration_min": [1], "bandwidth_kbps": [1]},
        },
        "demand": {"kind": "static", "mix": {"upload": 1}},
        "episode": {"steps": steps, "step_s": 60},
        **changes,
    }
    return build_world(from_mapping(scenario), 0)


FAR, NEAR = (300.0, 500.0), (300.0, 390.0)
"""200 m and 90 m from the drone: classes 1 and 2."""
VIDEO = 1
"""The number of the service that holds a rate."""


def ends_us(world: World, asks: Mapping[int, Sequence[Ask]], **path: Any) -> list[int]:
    """When the requests of users 0, 1, … are completed."""
    log = fly(world, path_of(world, asks, **path))
    assert {r.outcome for r in log.requests} == {Outcome.COMPLETED}
    return [r.t_end_us for r in sorted(log.requests, key=lambda r: r.user)]


@pytest.mark.parametrize(
    ("sharing", "expected_us"),
    [
        ("equal", [12_000_000, 12_000_000]),
        ("proportional_fair", [12_000_000, 12_000_000]),
        ("max_rate", [12_000_000, 6_000_000]),
        ("max_min", [9_000_010, 12_000_010]),
    ],
)
def test_two_transfers_share_a_band(sharing: str, expected_us: list[int]) -> None:
    """6 Mbit at 1 bit/s/Hz and 12 Mbit at 2 bit/s/Hz.

    Max-min gives both 666,666 bit/s, so 6 Mbit take 9.000009000009 s. The other user then has
    12,000,000 - 6,000,000.66666 bits left, at 2 Mbit/s.
    """
    asks = {0: [(0.0, 6 * MBIT, 0.0)], 1: [(0.0, 12 * MBIT, 0.0)]}
    assert ends_us(hover([FAR, NEAR], sharing), asks) == expected_us


def test_a_transfer_goes_on_where_it_was() -> None:
    """A hold takes half of the band from 2 s to 6 s: 6 Mbit take 8 s instead of 6 s."""
    asks = {0: [(0.0, 6 * MBIT, 0.0)], 1: [(2.0, 4.0, 500.0, VIDEO)]}
    assert ends_us(hover([FAR, FAR]), asks) == [8_000_000, 6_000_000]


def test_a_transfer_waits_while_holds_have_the_whole_band() -> None:
    asks = {0: [(0.0, 6 * MBIT, 0.0)], 1: [(2.0, 4.0, 1000.0, VIDEO)]}
    world = hover([FAR, FAR])
    log = fly(world, path_of(world, asks))
    assert [(r.user, r.t_end_us, r.interruptions) for r in log.requests] == [
        *((0, 10_000_000, 1), (1, 6_000_000, 0))
    ]
    assert [event[:7] for event in seen(log, "serve", "stop", "complete")] == events(
        """
              0 7 serve    0 0 0
        2000000 7 stop     0 0 0
        2000000 7 serve    0 1 1
        6000000 1 stop     0 1 1
        6000000 1 complete 0 1 1
        6000000 7 serve    0 0 0
        10000000 1 stop    0 0 0
        10000000 1 complete 0 0 0
        """
    )


def test_held_transfers_wait_for_their_rates() -> None:
    """Two of three rates of 400 kbit/s fit into 1 MHz."""
    asks = {user: [(0.0, 6 * MBIT, 400.0)] for user in range(3)}
    assert ends_us(hover([FAR] * 3, "held"), asks) == [15_000_000, 15_000_000, 30_000_000]


def test_the_last_admitted_waits_if_a_class_falls() -> None:
    """Of 1 Mbit/s two fit in class 2, and one in class 1.

    User 0 leaves class 2 at 20 s, so user 1, who was admitted at 1 s, waits until 40 s.
    """
    edge_m = math.sqrt(100.0**2 - 20.0**2)
    walk = [(0.0, 300.0, 300.0, edge_m / 20.0, 0.0)]
    asks = {0: [(0.0, 40.0, 1000.0, VIDEO)], 1: [(1.0, 40.0, 1000.0, VIDEO)]}
    world = hover([(300.0, 300.0), NEAR], steps=2)
    first_us, second_us = ends_us(world, asks, walks={0: walk})
    assert first_us == 40_000_000
    assert second_us == pytest.approx(61_000_000, abs=2)
