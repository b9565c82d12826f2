"""Waiting for a pad: queues worked by hand, and stations as the M/D/c queues of the textbooks."""

from __future__ import annotations

import pytest

from desim_uav.model.rules import Mode
from tests.engine.helpers import HOP_US, US, Flight, events, fly, path_of, seen
from tests.verification.figure import Estimate, check
from tests.verification.queueing import (
    MD_C,
    ROOMY,
    charged_together,
    figures,
    md_c_wait_min,
    queueing,
)

# ---- by hand


@pytest.mark.usefixtures("every_engine")
def test_three_drones_at_one_pad_wait_for_0_d_and_2d():
    # 60 s of 600 are missing, full in 900 s: D = 90 s.
    world = queueing(drones=3, pads=1, steps=6)
    log = fly(world, path_of(world), *["hover charge"] * 3)
    assert seen(log) == events("""
         60000000  10  land     0  -  -  0
         60000000  10  charge   0  -  -  0
         60000000  10  land     1  -  -  0
         60000000  10  land     2  -  -  0
        150000000   3  charged  0  -  -  0
        150000000   3  charge   1  -  -  0
        240000000   3  charged  1  -  -  0
        240000000   3  charge   2  -  -  0
        330000000   3  charged  2  -  -  0
    """)
    assert log.queueing_us == (0 + 90 + 180) * US
    assert log.charges == 3
    modes = [[step.mode for step in log.steps if step.drone == drone] for drone in range(3)]
    assert modes[1] == [
        Mode.FLYING, Mode.QUEUED, Mode.CHARGING, Mode.CHARGED, Mode.FLYING, Mode.FLYING,
    ]  # fmt: skip
    assert modes[2][1:5] == [Mode.QUEUED] * 2 + [Mode.CHARGING] * 2
    assert [step.charge for step in log.steps if step.drone == 2] == [
        540 * US, 540 * US, 540 * US, 540 * US, 580 * US, 600 * US,
    ]  # fmt: skip


@pytest.mark.parametrize(("drones", "pads"), ROOMY)
def test_drones_with_a_pad_each_do_not_wait(drones: int, pads: int):
    log = charged_together(drones, pads)
    assert log.queueing_us == 0
    assert {event[0] for event in seen(log, "charged")} == {150 * US}
    assert log.charges == drones


@pytest.mark.usefixtures("every_engine")
def test_three_drones_at_two_pads():
    world = queueing(drones=3, pads=2, steps=5)
    log = fly(world, path_of(world), *["hover charge"] * 3)
    assert [event[:4] for event in seen(log, "charge", "charged")] == [
        (60 * US, 10, "charge", 0),
        (60 * US, 10, "charge", 1),
        (150 * US, 3, "charged", 0),
        (150 * US, 3, "charged", 1),
        (150 * US, 3, "charge", 2),
        (240 * US, 3, "charged", 2),
    ]
    assert log.queueing_us == 90 * US


@pytest.mark.usefixtures("every_engine")
def test_first_come_first_served_and_the_lowest_drone_of_those_that_come_together():
    # Drones 2 and 1 are one hop from the station, drone 0 two; drone 3 comes from the other side,
    # two hops away as well. Each charges for as long as it has flown, at 1 s a second.
    starts = [(2, 0), (3, 0), (5, 0), (6, 0)]
    world = queueing(4, pads=1, steps=4, full_charge_min=10.0, starts=starts)
    log = fly(world, path_of(world), *["goto"] * 4)
    assert [event[:4] for event in seen(log, "land", "charge", "charged")] == [
        (HOP_US, 3, "land", 1),
        (HOP_US, 3, "charge", 1),
        (HOP_US, 3, "land", 2),
        (2 * HOP_US, 3, "land", 0),
        (2 * HOP_US, 3, "charged", 1),
        (2 * HOP_US, 3, "charge", 2),
        (2 * HOP_US, 3, "land", 3),
        (3 * HOP_US, 3, "charge", 0),
        (3 * HOP_US, 3, "charged", 2),
        (5 * HOP_US, 3, "charged", 0),
        (5 * HOP_US, 3, "charge", 3),
        (7 * HOP_US, 3, "charged", 3),
    ]
    assert log.queueing_us == (0 + 1 + 1 + 3) * HOP_US


@pytest.mark.usefixtures("every_engine")
def test_a_charged_drone_frees_its_pad_though_it_stays():
    # Drone 0 is charged at 150 s and told nothing before 180 s; drone 1 charges from 150 s on.
    world = queueing(drones=2, pads=1, steps=4)
    log = fly(world, path_of(world), "hover charge", "hover charge")
    at_180 = [step.mode for step in log.steps if step.t_us == 180 * US]
    assert at_180 == [Mode.CHARGED, Mode.CHARGING]


@pytest.mark.usefixtures("every_engine")
def test_a_queue_is_carried_over():
    # Three steps an episode: 150, 240 (= 180 + 60) and 330 s (= 180 + 150).
    world = queueing(drones=3, pads=1, steps=3)
    flight = Flight(world, carry_over=True)
    first = flight.episode(path_of(world), *["hover charge"] * 3)
    second = flight.episode(path_of(world, episode=1))
    assert seen(second) == events("""
         60000000  3  charged  1  -  -  0
         60000000  3  charge   2  -  -  0
        150000000  3  charged  2  -  -  0
    """)
    charge = [a.name == "CHARGE" for a in world.actions]
    assert flight.shown[0].masks[1] == flight.shown[0].masks[2] == tuple(charge)
    assert flight.shown[0].observations[1].battery_s == 540 + 20
    assert (first.queueing_us, second.queueing_us) == ((0 + 90 + 120) * US, 60 * US)
    assert (first.charges, second.charges) == (1, 2)


# ---- the textbooks'


@pytest.mark.parametrize(("pads", "rate", "expected"), MD_C)
def test_the_theory(pads: int, rate: float, expected: float):
    assert md_c_wait_min(pads, rate) == pytest.approx(expected, abs=5e-6)


@pytest.mark.parametrize(
    ("quick", "accuracy"),
    [
        pytest.param(True, 0.05, marks=pytest.mark.thorough),
        pytest.param(False, 0.01, marks=pytest.mark.slow),
    ],
)
def test_a_station_is_an_m_d_c_queue(quick: bool, accuracy: float):
    found = list(figures(quick))
    check(found)
    assert all(f.error < accuracy * f.theory for f in found if isinstance(f, Estimate))
