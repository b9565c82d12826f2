"""Rewards R1, R2 and R3: against tables worked by hand, and the formulas stated once more."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from desim_uav.errors import ScenarioError
from desim_uav.model.geometry.grid import Grid
from desim_uav.model.rules import US, Mode
from desim_uav.model.state import Facts, Observation
from desim_uav.rules import rewards as rules
from desim_uav.rules.rewards import Coverage, CoverageBattery, MultiService
from desim_uav.scenario.load import loads
from tests.rows import rows_of, terms_of

SERVICES = ("throughput", "edge_computing", "data_gathering")
LANDED_OR_DOWN = (Mode.QUEUED, Mode.CHARGING, Mode.CHARGED, Mode.CRASHED)
CAPACITY_S = 1800.0
FULL, HOME_S = 1800.0, 100.0


def facts_of(drones=2, users=24, services=SERVICES, capacity_s=CAPACITY_S) -> Facts:
    grid = Grid(2400.0, 2400.0, np.zeros((10, 10)), (20.0,), 20.0, 1)
    clusters = np.empty((0, 3))
    drawn = (grid, ((5, 9),), clusters, drones, users, services, 30, 60.0, False)
    return Facts(*drawn, capacity_s, math.inf)


def seen(
    attached=0, mode=Mode.FLYING, battery_s=FULL, return_s=HOME_S, served=(0, 0, 0), limited=True
) -> Observation:
    battery = (battery_s, CAPACITY_S, return_s) if limited else (None, None, None)
    return Observation(
        *(0, 1, 30, (0, 0), 0, mode, *battery, attached, sum(served), 0.0), 0, 0.0, tuple(served)
    )


def paid(reward, drone, asked=(0, 0, 0), facts=None) -> float:
    return sum(terms_of(reward, drone, asked, facts or facts_of()).values())


def battery_weights(drone, low) -> tuple[float, float]:
    world, state, row = rows_of(drone, facts_of())
    service, cost, _ = rules.battery_weights(world, row, state.observations[drone.drone], low, True)
    return service, cost


# ---- R1


@pytest.mark.parametrize(
    ("attached", "drones", "users", "expected"),
    [
        (0, 2, 24, 0.0),
        (1, 2, 24, 1 / 12),  # 24 users, two drones: a fair share is 12
        (6, 2, 24, 0.5),
        (11, 2, 24, 11 / 12),
        (12, 2, 24, 1.0),
        (13, 2, 24, 1.0),
        (24, 2, 24, 1.0),
        (7, 2, 35, 0.4),  # a fair share of 17.5
        (17, 2, 35, 34 / 35),
        (18, 2, 35, 1.0),
        (7, 1, 14, 0.5),
        (1, 5, 3, 1.0),  # more drones than users: one is more than a share
        (0, 5, 3, 0.0),
    ],
)
def test_r1_is_the_share_of_a_fair_share_at_most_one(attached, drones, users, expected):
    facts = facts_of(drones, users)
    for limited in (True, False):
        terms = terms_of(Coverage(), seen(attached, limited=limited), (0, 0, 0), facts)
        assert terms == {"users": pytest.approx(expected, abs=1e-15)}
        assert terms["users"] <= 1.0


def test_r1_minds_no_battery():
    assert paid(Coverage(), seen(6, battery_s=1.0, return_s=math.inf)) == 0.5


# ---- R2: capacity 1800 s, so c1 = 360, c2 = 240, c3 = 160, c4 = 106 2/3 s

ABOVE, BELOW = 1e-6, -1e-6
C4 = 106.666667  # in whole microseconds, as all times
BANDS = [
    # (battery, n_B): (w_s, w_c)
    (1800.0, 100.0, 1.0, 0.0),
    (360.0 + ABOVE, 100.0, 1.0, 0.0),
    (360.0, 100.0, 0.8, 0.2),  # B = c1
    (240.0 + ABOVE, 100.0, 0.8, 0.2),
    (240.0, 100.0, 0.5, 0.5),  # B = c2
    (160.0 + ABOVE, 100.0, 0.5, 0.5),
    (160.0, 100.0, 0.2, 0.8),  # B = c3
    (C4 + ABOVE, 100.0, 0.2, 0.8),
    (C4, 100.0, 0.0, 1.0),  # B = c4
    (C4 + BELOW, 100.0, 0.0, 1.0),
    (100.0 + ABOVE, 100.0, 0.0, 1.0),
    (1e-6, 0.0, 0.0, 1.0),
    (0.0, 0.0, 0.0, 1.0),
    (0.0, 100.0, 0.0, 1.0),
    # Above c1 the way home does not count, be it too long or none.
    (1800.0, 1800.0, 1.0, 0.0),
    (361.0, 500.0, 1.0, 0.0),
    (361.0, math.inf, 1.0, 0.0),
    # At or below c1 it counts alone, once the battery just suffices for it or does not.
    (300.0, 300.0 + BELOW, 0.8, 0.2),
    (300.0, 300.0, 0.0, 1.0),  # B = n_B
    (300.0, 300.0 + ABOVE, 0.0, 1.0),
    (360.0, 360.0, 0.0, 1.0),
    (200.0, 200.0 + BELOW, 0.5, 0.5),
    (200.0, 200.0, 0.0, 1.0),
    (120.0, 120.0 + BELOW, 0.2, 0.8),
    (120.0, 120.0, 0.0, 1.0),
    (300.0, math.inf, 0.0, 1.0),
    (300.0, 0.0, 0.8, 0.2),  # on a station
]


@pytest.mark.parametrize(("battery_s", "return_s", "service", "cost"), BANDS)
def test_the_weights_of_service_and_of_the_way_home(battery_s, return_s, service, cost):
    drone = seen(6, battery_s=battery_s, return_s=return_s)
    assert battery_weights(drone, 0.2) == (service, cost)
    way_home = 1.0 if battery_s == 0 else min(1.0, return_s / battery_s)
    for sign in (-1.0, 1.0, 0.5):
        terms = terms_of(CoverageBattery(sign), drone, (0, 0, 0), facts_of())
        assert terms == {
            "users": pytest.approx(service * 0.5, abs=1e-15),
            "return": pytest.approx(sign * cost * way_home, abs=1e-15),
        }


@pytest.mark.parametrize(
    ("battery_s", "return_s", "attached", "sign", "expected"),
    [
        (1800.0, 900.0, 6, -1.0, 0.5),
        (300.0, 150.0, 6, -1.0, 0.8 * 0.5 - 0.2 * 0.5),
        (300.0, 150.0, 6, 1.0, 0.8 * 0.5 + 0.2 * 0.5),
        (200.0, 50.0, 24, -1.0, 0.5 - 0.5 * 0.25),
        (150.0, 120.0, 3, -1.0, 0.2 * 0.25 - 0.8 * 0.8),
        (150.0, 120.0, 3, 1.0, 0.2 * 0.25 + 0.8 * 0.8),
        (100.0, 50.0, 12, -1.0, -0.5),
        (100.0, 50.0, 12, 1.0, 0.5),
        (50.0, 100.0, 12, -1.0, -1.0),  # n_B / B clipped
        (0.0, 0.0, 12, -1.0, -1.0),
        (300.0, math.inf, 12, -1.0, -1.0),
        (300.0, 0.0, 12, -1.0, 0.8),
    ],
)
def test_r2_by_hand(battery_s, return_s, attached, sign, expected):
    drone = seen(attached, battery_s=battery_s, return_s=return_s)
    assert paid(CoverageBattery(sign), drone) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize(
    ("battery_s", "expected"),
    [
        *[(901, 0.5), (900, 0.3), (601, 0.3), (600, 0.0), (401, 0.0), (400, -0.3), (267, -0.3)],
        *[(266, -0.5), (1, -0.5)],
    ],
)
def test_the_first_threshold_is_a_parameter(battery_s, expected):
    # c1 = 900, c2 = 600, c3 = 400, c4 = 266 2/3 s; r_u = r_c = 1/2, so (w_s - w_c) / 2.
    drone = seen(6, battery_s=float(battery_s), return_s=0.5 * battery_s)
    assert paid(CoverageBattery(low_battery=0.5), drone) == pytest.approx(expected, abs=1e-15)
    assert paid(MultiService(low_battery=0.5, users=1.0), drone) == pytest.approx(expected)


def test_without_a_threshold_only_an_empty_battery_counts():
    never = CoverageBattery(low_battery=0.0)
    assert paid(never, seen(6, battery_s=1e-6, return_s=900.0)) == 0.5
    assert paid(never, seen(6, battery_s=0.0, return_s=900.0)) == -1.0


@pytest.mark.parametrize(
    ("low", "capacity_us", "thresholds"),
    [
        (0.2, 1_800_000_000, (360_000_000, 240_000_000, 160_000_000, 106_666_667)),
        (0.58, 3_000_000_000, (1_740_000_000, 1_160_000_000, 773_333_333, 515_555_556)),
        (0.5, 7, (4, 2, 2, 1)),  # 3.5, 2.33, 1.56 and 1.04: half goes to the even one
        (0.5, 5, (2, 2, 1, 1)),  # 2.5, 1.67, 1.11 and 0.74
        (0.0, 1_800_000_000, (0, 0, 0, 0)),
    ],
)
def test_thresholds_are_whole_microseconds(low, capacity_us, thresholds):
    drone = seen()._replace(capacity_s=capacity_us / 1e6, return_s=0.0)
    weights = ((1.0, 0.0), (0.8, 0.2), (0.5, 0.5), (0.2, 0.8), (0.0, 1.0))
    for charge in {us + by for us in thresholds for by in (-1, 0, 1)} - {-1, 0}:
        at = drone._replace(battery_s=charge / 1e6)
        band = sum(charge <= us for us in thresholds)
        assert battery_weights(at, low) == weights[band]


# ---- R3


@pytest.mark.parametrize(
    ("attached", "served", "asked", "expected"),
    [
        (12, (0, 0, 0), (0, 0, 0), 0.5),  # 0/0 is 0
        (12, (0, 0, 0), (9, 9, 9), 0.5),
        (12, (2, 1, 3), (2, 1, 3), 1.0),
        (6, (1, 0, 0), (4, 0, 0), 0.25 + 0.2 / 4),
        (6, (0, 1, 0), (0, 4, 0), 0.25 + 0.2 / 4),
        (6, (0, 0, 1), (0, 0, 4), 0.25 + 0.1 / 4),
        (24, (3, 2, 1), (5, 4, 3), 0.5 + 0.2 * 3 / 5 + 0.2 / 2 + 0.1 / 3),
    ],
)
def test_r3_on_a_full_battery(attached, served, asked, expected):
    for limited in (True, False):
        drone = seen(attached, served=served, limited=limited)
        assert paid(MultiService(), drone, asked) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_r3_term_by_term_on_a_low_battery(sign):
    drone = seen(6, battery_s=200.0, return_s=50.0, served=(1, 2, 3))
    assert terms_of(MultiService(sign), drone, (4, 4, 4), facts_of()) == pytest.approx(
        {
            "users": 0.5 * 0.5 * 0.5,
            "throughput": 0.5 * 0.2 * 0.25,
            "edge_computing": 0.5 * 0.2 * 0.5,
            "data_gathering": 0.5 * 0.1 * 0.75,
            "return": sign * 0.5 * 0.25,
            "charging": 0.0,
        },
        abs=1e-15,
    )


def test_r3_weighs_services_by_name_in_their_order():
    facts = facts_of(services=("data_gathering", "video", "throughput"))
    terms = terms_of(MultiService(), seen(served=(1, 1, 1)), (2, 2, 2), facts)
    assert list(terms) == ["users", *facts.services, "return", "charging"]
    assert list(terms.values()) == [0.0, 0.05, 0.0, 0.1, 0.0, 0.0]
    own = MultiService(users=0.0, services={"video": 2.0})
    assert paid(own, seen(24, served=(1, 1, 1)), (2, 2, 2), facts) == 1.0


# ---- modes


def rewards():
    return [Coverage(), CoverageBattery(), MultiService(), CoverageBattery(1.0), MultiService(1.0)]


@pytest.mark.parametrize("mode", LANDED_OR_DOWN)
@pytest.mark.parametrize("battery_s", [0.0, 50.0, 300.0, FULL])
def test_who_is_landed_or_down_gets_nothing(mode, battery_s):
    drone = seen(mode=mode, battery_s=battery_s)
    for reward in rewards():
        assert set(terms_of(reward, drone, (1, 2, 3), facts_of()).values()) == {0.0}


@pytest.mark.parametrize(
    ("battery_s", "service", "cost"), [row[:1] + row[2:] for row in BANDS[:10]]
)
def test_who_returns_serves_nobody_and_pays_for_the_way(battery_s, service, cost):
    drone = seen(mode=Mode.RETURNING, battery_s=battery_s)
    assert paid(Coverage(), drone, (1, 2, 3)) == 0.0
    for sign in (-1.0, 1.0):
        way = pytest.approx(sign * cost * 100.0 / battery_s, abs=1e-15)
        assert paid(CoverageBattery(sign), drone, (1, 2, 3)) == way
        assert paid(MultiService(sign), drone, (1, 2, 3)) == way


def test_the_names_of_the_terms_never_change():
    drones = [
        seen(mode=mode, battery_s=battery_s, limited=limited)
        for mode in Mode
        for battery_s in (0.0, 100.0, 200.0, FULL)
        for limited in (True, False)
    ]
    for reward in rewards():
        names = {tuple(terms_of(reward, drone, (0, 1, 2), facts_of())) for drone in drones}
        assert len(names) == 1


# ---- the formulas once more, in fractions, and compared on whatever comes

MICROSECONDS = st.integers(0, int(CAPACITY_S) * US).map(lambda us: us / US)
BATTERIES = st.one_of(
    MICROSECONDS,
    st.integers(0, 1800).map(float),
    st.integers(0, 120 * US).map(lambda us: us / US),
    st.sampled_from([row[0] for row in BANDS]),
)
RETURNS = st.one_of(
    MICROSECONDS, st.integers(0, 200 * US).map(lambda us: us / US), st.just(math.inf)
)


def stated(kind, sign, low, mode, battery, home, attached, drones, users, served, asked):
    """The reward as the model words it. ``battery`` and ``home`` are None where unlimited."""
    if mode in LANDED_OR_DOWN:
        return Fraction(0)
    flying = mode is Mode.FLYING
    fair = Fraction(users, drones)
    r_u = min(Fraction(1), attached / fair) if flying else Fraction(0)
    if kind == "R1":
        return r_u
    w_s, w_c, r_c = Fraction(1), Fraction(0), Fraction(0)
    if battery is not None:
        b = Fraction(battery)
        n = None if math.isinf(home) else Fraction(home)
        c1 = Fraction(str(low)) * Fraction(CAPACITY_S)
        c2, c3, c4 = (c1 / Fraction(3, 2) ** k for k in (1, 2, 3))
        enough = n is not None and b > n
        if b > c1:
            w_s = Fraction(1)
        elif enough and c2 < b <= c1:
            w_s = Fraction(8, 10)
        elif enough and c3 < b <= c2:
            w_s = Fraction(5, 10)
        elif enough and c4 < b <= c3:
            w_s = Fraction(2, 10)
        else:
            w_s = Fraction(0)
        w_c = 1 - w_s
        r_c = Fraction(1) if b == 0 or n is None else min(Fraction(1), n / b)
    if kind == "R2":
        return w_s * r_u + Fraction(sign) * w_c * r_c
    w_u, w_tr, w_ec, w_dg = Fraction(5, 10), Fraction(2, 10), Fraction(2, 10), Fraction(1, 10)
    s_tr, s_ec, s_dg = (
        Fraction(x, of) if flying and of else Fraction(0)
        for x, of in zip(served, asked, strict=True)
    )
    r_cs = Fraction(0)
    service = w_u * r_u + w_tr * s_tr + w_ec * s_ec + w_dg * s_dg
    return w_s * service + Fraction(sign) * w_c * (r_c + r_cs)


def thresholds(low):
    return [low * CAPACITY_S / 1.5**k for k in range(4)]


@pytest.mark.thorough
@settings(max_examples=600, deadline=None, derandomize=True)
@given(
    kind=st.sampled_from(["R1", "R2", "R3"]),
    sign=st.sampled_from([-1.0, 1.0]),
    low=st.sampled_from([0.2, 0.2, 0.0, 0.5, 1.0]),
    mode=st.sampled_from([*[Mode.FLYING] * 6, *[Mode.RETURNING] * 3, *LANDED_OR_DOWN]),
    battery=st.none() | BATTERIES,
    home=RETURNS,
    drones=st.integers(1, 9),
    users=st.integers(1, 60),
    data=st.data(),
)
def test_the_formulas_stated_once_more(kind, sign, low, mode, battery, home, drones, users, data):
    flying = mode is Mode.FLYING
    attached = data.draw(st.integers(0, users)) if flying else 0
    asked = data.draw(st.tuples(*[st.integers(0, 20)] * 3))
    served = tuple(data.draw(st.integers(0, of)) if flying else 0 for of in asked)
    if battery is not None:
        # Where rounding decides the band, the tables above do; c2 to c4 are seldom round numbers.
        near = [c for c in thresholds(low) if c != battery and abs(c - battery) < 1e-6]
        assume(not near and battery not in thresholds(low)[3:])
    reward = {"R1": Coverage(), "R2": CoverageBattery(sign, low), "R3": MultiService(sign, low)}
    drone = seen(attached, mode, battery, home, served, limited=battery is not None)
    got = paid(reward[kind], drone, asked, facts_of(drones, users))
    known = (attached, drones, users, served, asked)
    assert got == pytest.approx(
        float(stated(kind, sign, low, mode, battery, home, *known)), abs=1e-12
    )
    assert -1.0 <= got <= 1.0


@pytest.mark.thorough
@settings(max_examples=300, deadline=None, derandomize=True)
@given(battery=BATTERIES, home=RETURNS, low=st.floats(0.0, 1.0))
@example(battery=0.0, home=0.0, low=0.2)
@example(battery=360.0, home=math.inf, low=0.2)
def test_the_weights_sum_to_one_and_service_falls_with_the_battery(battery, home, low):
    service, cost = battery_weights(seen(battery_s=battery, return_s=home), low)
    assert service + cost == 1.0
    assert service in {1.0, 0.8, 0.5, 0.2, 0.0}
    less = battery_weights(seen(battery_s=0.9 * battery, return_s=home), low)
    assert less[0] <= service


# ---- rewards of a user's own


class Nothing:
    """No reward: it has no terms."""


def test_what_has_no_terms_is_no_reward():
    with pytest.raises(ScenarioError, match="cannot be used as reward: it has no method 'terms'"):
        loads(f'reward: {{kind: "{__name__}:Nothing"}}')
