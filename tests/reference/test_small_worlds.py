"""Small worlds of the fixed-step simulator, worked by hand: one class or two, drones that hover.

Unless a test says otherwise, links have the loss of 20 log10(d / 1 m), a power of 100 dBm, and a
noise of 0 dBm, so that the ratio is 100 - 20 log10(d) dB: 50 dB at 316.2 m, 60 dB at 100 m.
Everything happens at multiples of dt, where the simulator is exact, or a bound is given.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.reference.fixed_step import simulate
from tests.reference.inputs import US, Association, Inputs, Request, Result
from tests.reference.radio import (
    CQI,
    MCS,
    TOWNS,
    AccessPoint,
    Disc,
    Radio,
    al_hourani,
    free_space,
    log_distance,
)

STILL = (0.0, 0.0)
DT_S = 0.5
LEFT, HOVER = 3, 4


def radio(*classes: tuple[float, float], bandwidth_hz: int = 1_000_000, **changes: Any) -> Radio:
    """Classes as (least ratio in dB, bit/s/Hz); the noise in the band is 0 dBm."""
    ladder = tuple((snr_db, round(bit_s_hz * 1e6)) for snr_db, bit_s_hz in classes)
    noise_dbm_per_hz = -10 * math.log10(bandwidth_hz)
    base = Radio(100.0, bandwidth_hz, 0.0, noise_dbm_per_hz, 2.0, log_distance(2.0, 0.0), ladder)
    return replace(base, **changes)


def fly(
    links: list[Disc | Radio],
    starts: list[tuple[int, int]],
    users: list[tuple[float, float, float, float]],
    requests: dict[int, list[Request]],
    steps: int = 2,
    dt_s: float = DT_S,
    command: int = HOVER,
    **changes: Any,
) -> Result:
    """Hover for some minutes over cells of 100 m, 10 m above users (x, y, vx, vy).

    Drone 0 may have another command.
    """
    inputs = Inputs(
        cell_m=(100.0, 100.0),
        height_m=np.zeros((10, 1)),
        levels_m=(10.0,),
        level_step_m=10.0,
        three_d=False,
        levels=(1,) * len(starts),
        stations=(),
        starts=starts,
        links=links,
        max_speed_mps=10.0,
        max_acceleration_mps2=2.0,
        fill_epoch=False,
        returns_fill_epoch=False,
        capacity=None,
        return_below=0.0,
        respawn_after_us=None,
        charge_us=1,
        pads=1,
        steps=steps,
        step_us=60 * US,
        legs=[np.array([[0.0, *user]]) for user in users],
        requests=[requests.get(user, []) for user in range(len(users))],
        follows=[False] * len(users),
        position_error=None,
        respawn=np.zeros((len(starts), steps + 1), int),
    )
    commands = [[command, *[HOVER] * (len(starts) - 1)]] * steps
    return simulate(replace(inputs, **changes), commands, dt_s)


def hold(seconds: float, kbps: float, at_s: float = 0.0) -> Request:
    """A hold of a rate for a time."""
    return Request(round(at_s * US), round(seconds * US), round(kbps * 1000))


def transfer(mbit: float, at_s: float = 0.0, kbps: float = 0.0) -> Request:
    """A transfer of a volume."""
    return Request(round(at_s * US), 0, round(kbps * 1000), round(mbit * 1e12))


def ends_s(result: Result) -> dict[int, float]:
    """When the request of each user was completed."""
    return {r.user: r.t_end_us / US for r in result.requests if r.completed}


# ---- levels and classes


def test_losses_have_their_known_values() -> None:
    """Anchors of Al-Hourani's mean at 2 GHz, computed with 50 digits, and of free space."""
    far, high = np.array([600.0, 600.0, 600.0]), np.array([100.0, 40.0, 100.0])
    urban = al_hourani(*TOWNS["urban"])(far, high, 2.0)
    assert urban[:2] == pytest.approx([112.397596, 113.299445], abs=1e-6)
    assert al_hourani(*TOWNS["suburban"])(far, high, 2.0)[2] == pytest.approx(102.711985, abs=1e-6)
    assert free_space(np.array(1.0), np.array(0.0), 2.0) == pytest.approx(38.468383, abs=1e-6)
    assert log_distance(3.0, 30.0)(np.array(6.0), np.array(8.0), 2.0) == pytest.approx(60.0)


def test_ladders_rise() -> None:
    """The class of 1 MHz, 30 dBm and 7 dB over thermal noise at the ends of ladders."""
    assert (len(CQI), len(MCS)) == (15, 18)
    for ladder in (CQI, MCS):
        assert list(ladder) == sorted(ladder)
        assert [e for _, e in ladder] == sorted({e for _, e in ladder})
    link = Radio(30.0, 1_000_000, 7.0, -174.0, 2.0, al_hourani(*TOWNS["urban"]), MCS)
    assert link.noise_dbm == pytest.approx(-107.0)


@pytest.mark.parametrize(("away_m", "served"), [(99.4, 2.0), (99.6, 1.0), (316.0, 1.0), (316.2, 0)])
def test_a_class_holds_within_its_distance(away_m: float, served: float) -> None:
    """60 dB in space are at 99.4987 m over the ground, and 50 dB at 316.0696 m."""
    link = radio((50, 1), (60, 2), sharing="equal")
    result = fly([link], [(0, 0)], [(50 + away_m, 50, *STILL)], {0: [transfer(1e6)]}, steps=1)
    (request,) = result.requests
    assert request.delivered_ubit == round(served * 60 * 1e12)
    assert request.served_us == (60 * US if served else 0)
    assert result.qoe3 == (100.0 if served else 0.0)


def test_users_in_a_building_are_nearer() -> None:
    """At the drone's own height 60 dB are at 100 m."""
    link = radio((60, 1), sharing="equal")
    users = [(149.9, 50, *STILL)] * 2
    up = np.array([0.0, 10.0])
    result = fly([link], [(0, 0)], users, {0: [transfer(1)], 1: [transfer(1)]}, users_height_m=up)
    assert ends_s(result) == {1: 1.0}


# ---- holds


def test_a_hold_occupies_what_its_class_needs() -> None:
    """1 Mbit/s takes 1 MHz in class 1 and half of it in class 2, where two holds fit at once."""
    link = radio((50, 1), (60, 2))
    near, far = (60.0, 50.0, *STILL), (250.0, 50.0, *STILL)
    asks = {0: [hold(10, 1000)], 1: [hold(10, 1000)]}
    assert ends_s(fly([link], [(0, 0)], [near, near], asks)) == {0: 10.0, 1: 10.0}
    assert ends_s(fly([link], [(0, 0)], [near, far], asks)) == {0: 10.0, 1: 20.0}
    assert ends_s(fly([link], [(0, 0)], [far, far], asks)) == {0: 10.0, 1: 20.0}


def test_a_hold_rounds_its_bandwidth_up() -> None:
    """3 bit/s at 2 bit/s/Hz take 2 Hz: of 3 Hz one hold takes all but 1, of 4 Hz two fit."""
    asks = {0: [hold(10, 0.003)], 1: [hold(10, 0.003)]}
    users = [(60.0, 50.0, *STILL)] * 2
    for bandwidth_hz, second_s in ((3, 20.0), (4, 10.0)):
        link = radio((50, 2), bandwidth_hz=bandwidth_hz)
        assert ends_s(fly([link], [(0, 0)], users, asks)) == {0: 10.0, 1: second_s}


def test_the_last_admitted_waits_if_a_class_falls() -> None:
    """User 0 leaves class 2 after 20.25 s, noticed at 20.5 s.

    User 1 was admitted at 1 s: it has 20.5 s left at 40 s, when it is served again.
    """
    link = radio((50, 1), (60, 2))
    walker = (70.0, 50.0, 79.49874371066 / 20.25, 0.0)
    users = [walker, (60.0, 50.0, *STILL)]
    result = fly([link], [(0, 0)], users, {0: [hold(40, 1000)], 1: [hold(40, 1000, 1.0)]})
    assert ends_s(result) == {0: 40.0, 1: 60.5}
    assert result.qoe1 == 100.0
    assert result.qoe2 == pytest.approx(19.5 / 60 / 2)


def test_who_was_admitted_last_waits_even_if_another_one_fell() -> None:
    """The one who falls goes on; of those admitted with it, the highest user waits."""
    link = radio((50, 1), (60, 2), bandwidth_hz=1_500_000)
    walker = (70.0, 50.0, 79.49874371066 / 20.25, 0.0)
    still = (60.0, 50.0, *STILL)
    asks = {0: [hold(40, 1000)], 1: [hold(40, 1000)], 2: [hold(40, 1000)]}
    result = fly([link], [(0, 0)], [walker, still, still], asks)
    assert ends_s(result) == {0: 40.0, 1: 40.0, 2: 59.5}


# ---- sharing


SHARED = {"equal": (12.0, 12.0), "proportional_fair": (12.0, 12.0), "max_rate": (12.0, 6.0)}


@pytest.mark.parametrize("sharing", SHARED)
def test_transfers_share_the_band(sharing: str) -> None:
    """6 Mbit at 1 bit/s/Hz and 12 Mbit at 2 bit/s/Hz over 1 MHz."""
    link = radio((50, 1), (60, 2), sharing=sharing)
    users = [(250.0, 50.0, *STILL), (60.0, 50.0, *STILL)]
    result = fly([link], [(0, 0)], users, {0: [transfer(6)], 1: [transfer(12)]})
    assert ends_s(result) == dict(enumerate(SHARED[sharing]))
    waited_s = 6.0 if sharing == "max_rate" else 0.0
    assert result.qoe2 == pytest.approx(waited_s / 60 / 2)


def test_max_min_gives_both_the_same_rate() -> None:
    """2/3 Mbit/s each: 4 Mbit take a little more than 6 s; then the other has 2 MHz alone."""
    link = radio((50, 1), (60, 2), sharing="max_min")
    users = [(250.0, 50.0, *STILL), (60.0, 50.0, *STILL)]
    result = fly([link], [(0, 0)], users, {0: [transfer(4)], 1: [transfer(8)]}, dt_s=0.125)
    assert ends_s(result) == pytest.approx({0: 6.0, 1: 8.0}, abs=0.25)


def test_holds_come_before_transfers() -> None:
    """A hold takes half of the band from 2 s to 6 s: 6 Mbit take 8 s instead of 6 s."""
    link = radio((50, 1), sharing="equal")
    users = [(60.0, 50.0, *STILL)] * 2
    result = fly([link], [(0, 0)], users, {0: [transfer(6)], 1: [hold(4, 500, 2.0)]})
    assert ends_s(result) == {0: 8.0, 1: 6.0}


def test_a_transfer_without_a_rate_is_not_served() -> None:
    """A hold has the whole band until 10 s."""
    link = radio((50, 1), sharing="proportional_fair")
    users = [(60.0, 50.0, *STILL)] * 2
    result = fly([link], [(0, 0)], users, {0: [transfer(6)], 1: [hold(10, 1000)]})
    assert ends_s(result) == {0: 16.0, 1: 10.0}
    (late,) = [r for r in result.requests if r.user == 0]
    assert late.served_us == 6 * US


def test_a_held_transfer_has_its_own_rate() -> None:
    """6 Mbit at 0.4 Mbit/s; two of three fit into 1 MHz, also in the paper's disc."""
    for link in (radio((50, 1)), Disc(100.0, 1_000_000.0)):
        asks = {user: [transfer(6, kbps=400.0)] for user in range(3)}
        result = fly([link], [(0, 0)], [(60.0, 50.0, *STILL)] * 3, asks)
        assert ends_s(result) == {0: 15.0, 1: 15.0, 2: 30.0}


# ---- association


def line(direction: float = 1.0) -> tuple[float, float, float, float]:
    """Walk 600 m between the drones over x = 50 and x = 650, at 5 m/s."""
    return (50.0 if direction > 0 else 650.0, 50.0, 5.0 * direction, 0.0)


TWO = [(0, 0), (6, 0)]
EVERYWHERE = radio((30, 1), sharing="equal")


def holders(rule: Association, **changes: Any) -> list[tuple[int, ...]]:
    """Whose the walker is at the ends of steps of 60 s, 300 m apart, under drones 0 and 1."""
    result = fly([EVERYWHERE] * 2, TWO, [line()], {}, association=rule, **changes)
    return [
        records[0].attached + tuple(2 + u for u in records[1].attached)
        for records in result.records
    ]


def test_the_strongest_is_the_nearest_for_equal_powers() -> None:
    """Equal levels are in the middle, which the walker reaches after 60 s: a tie for drone 0."""
    assert holders(Association("strongest")) == [(0,), (2,)]
    assert holders(Association("entered_first")) == [(0,), (0,)]


def test_of_drones_that_part_from_one_place_the_closer_one_is_the_strongest_at_once() -> None:
    """Drone 0 flies away from the user; drone 1 has a band of 1 kHz only."""
    links = [EVERYWHERE, replace(EVERYWHERE, bandwidth_hz=1_000, noise_dbm_per_hz=-30.0)]
    users, asks = [(380.0, 50.0, *STILL)], {0: [transfer(1e6)]}
    changes = {"association": Association("strongest"), "steps": 1}
    (one,) = fly(links, [(3, 0)] * 2, users, asks, command=LEFT, **changes).requests
    assert one.delivered_ubit == 60 * 1000 * US
    (one,) = fly(links, [(3, 0)] * 2, users, asks, **changes).requests
    assert one.delivered_ubit == 60 * 1_000_000 * US


@pytest.mark.parametrize(
    ("exponent", "margin_db", "at_m"),
    [(3.76, 3.0, 272.9002), (2.0, 3.0, 292.7493), (2.0, 2.0, 278.6558)],
)
@pytest.mark.parametrize("trigger_s", [0.0, 0.64])
def test_a3_leaves_on_a_circle_of_apollonius(
    exponent: float, margin_db: float, at_m: float, trigger_s: float
) -> None:
    """On a line of 500 m between drones at no height; drone 1 has a band of 1 kHz only."""
    link = radio((30, 1), sharing="equal", loss_db=log_distance(exponent, -100.0))
    rule = Association("a3", margin_db, round(trigger_s * US))
    dt_s = 0.04
    changes = {"levels_m": (1e-3,), "association": rule, "dt_s": dt_s}
    users, asks = [(50.0, 50.0, 5.0, 0.0)], {0: [transfer(1e6)]}
    links = [link, replace(link, bandwidth_hz=1_000, noise_dbm_per_hz=-30.0)]
    result = fly(links, [(0, 0), (5, 0)], users, asks, steps=1, **changes)
    assert result.handovers == 1
    (request,) = result.requests
    left_s = at_m / 5 + trigger_s
    delivered_mbit = left_s + (60 - left_s) * 1e-3
    assert request.delivered_ubit / 1e12 == pytest.approx(delivered_mbit, abs=2 * dt_s)
    assert request.delivered_ubit / 1e12 >= delivered_mbit - 1e-3


def test_the_timer_of_a3_starts_anew_after_a_break() -> None:
    """A walker that turns back before the time to trigger stays; one that goes on leaves."""
    turns = np.array([[0.0, 50.0, 50.0, 5.0, 0.0], [70.0, 400.0, 50.0, -5.0, 0.0]])
    goes = np.array([[0.0, 50.0, 50.0, 5.0, 0.0], [118.0, 640.0, 50.0, 0.0, 0.0]])
    rule = Association("a3", 1.0, 30 * US)
    result = fly(
        [EVERYWHERE] * 2, TWO, [line()] * 2, {}, association=rule, legs=[turns, goes], steps=2
    )
    assert result.records[-1][0].attached == (0,)
    assert result.records[-1][1].attached == (1,)
    assert result.handovers == 1


def test_a_transfer_keeps_its_bits_across_handovers() -> None:
    """40 Mbit at 1 Mbit/s, of which drone 0 carries 30 and drone 1 the rest."""
    walker = (200.0, 50.0, 5.0, 0.0)
    result = fly(
        [EVERYWHERE] * 2, TWO, [walker], {0: [transfer(40)]}, association=Association("strongest")
    )
    assert ends_s(result) == {0: 40.0}
    assert result.handovers == 1


# ---- interference and access points


@pytest.mark.parametrize(
    ("reuse", "threshold_db", "covered"),
    [(0, 49.0, True), (1, 4.43, True), (1, 4.44, False), (2, 49.0, True), (2, 51.0, False)],
)
def test_drones_of_the_same_band_interfere(reuse: int, threshold_db: float, covered: bool) -> None:
    """At 300.17 m from drone 0, whose level is 50.4528 dBm, and 500.10 m from drone 1.

    Without noise the ratio is 20 log10(500.10 / 300.17) = 4.434 dB; the noise of 0 dBm takes less
    than 0.001 dB of it.
    """
    links = [radio((threshold_db, 1), reuse=reuse), radio((90, 1), reuse=reuse)]
    result = fly(links, [(0, 0), (8, 0)], [(350.0, 50.0, *STILL)], {}, steps=1)
    assert result.qoe3 == (100.0 if covered else 0.0)


def test_an_access_point_serves_and_interferes() -> None:
    """It takes the user, at 50 m, from the drone at 200 m; the drone's ratio falls to -12 dB."""
    at_50_m = AccessPoint((300.0, 50.0, 10.0), radio((10, 1), reuse=1, bandwidth_hz=2_000_000))
    link = radio((40, 1), reuse=1, sharing="equal")
    user = [(250.0, 50.0, *STILL)]
    asks = {0: [hold(10, 2000)]}
    alone = fly([link], [(0, 0)], user, asks)
    both = fly([link], [(0, 0)], user, asks, access_points=[at_50_m])
    assert (ends_s(alone), ends_s(both)) == ({}, {0: 10.0})
    assert alone.records[-1][0].attached == (0,)
    assert both.records[-1][0].attached == ()
    assert both.qoe3 == 100.0
