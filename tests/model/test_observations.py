"""Encodings: the numbers a learner is given, worked by hand and held to their bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import pytest
from annotated_types import Ge
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError, SimulationError
from desim_uav.model.geometry.grid import Grid
from desim_uav.model.observations import Encoding, Feature, RowObservation, table_row
from desim_uav.model.rules import Mode
from desim_uav.model.state import Facts, Observation
from desim_uav.rules.observations import Local, Position
from desim_uav.sample_path import draw
from desim_uav.scenario.load import dump, from_mapping, load, loads
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests.engine.helpers import Flight, path_of, scenarios, some_command, strip
from tests.rows import features_of
from tests.selection import by_default

SERVICES = ("throughput", "edge_computing", "data_gathering")


def facts_of(
    three_d: bool = True,
    capacity_s: float | None = 1800.0,
    bandwidth_khz: float = 5000.0,
    services: tuple[str, ...] = SERVICES,
) -> Facts:
    """4 x 8 cells of 150 x 200 m, stations on (2, 3) and (0, 0), ten users, levels 20, 40, 60 m."""
    grid = Grid(600.0, 1600.0, np.zeros((4, 8)), (20.0, 40.0, 60.0), 20.0, 2)
    stations, clusters = ((2, 3), (0, 0)), np.empty((0, 3))
    known = (grid, stations, clusters, 3, 10, services, 30, 60.0)
    return Facts(*known, three_d, capacity_s, bandwidth_khz)


def seen(**changes: Any) -> Observation:
    """At (0, 1), level 1, six steps into the episode, with 750 s of battery."""
    return Observation(
        drone=1,
        step=6,
        steps=30,
        cell=(0, 1),
        level=1,
        mode=Mode.FLYING,
        battery_s=750.0,
        capacity_s=1800.0,
        return_s=180.0,
        attached_users=4,
        served_requests=3,
        bandwidth_khz=1250.0,
        station=0,
        flight_s=360.0,
        served=(2, 0, 1),
        asking=(3, 1, 2),
    )._replace(**changes)


UNLIMITED = {"battery_s": None, "capacity_s": None, "return_s": None}
UNLIMITED |= {"station": None, "flight_s": None}


def named(encoding: Encoding, observation: Observation, facts: Facts) -> dict[str, float]:
    """The numbers by name; as many as there are features, within their bounds."""
    features = encoding.features(facts)
    read = features_of if isinstance(encoding, RowObservation) else type(encoding).encode
    values = read(encoding, observation, facts)
    assert len(values) == len(features) == len({feature.name for feature in features})
    for value, feature in zip(values, features, strict=True):
        assert feature.low <= value <= feature.high, feature.name
        assert not feature.whole or value == int(value), feature.name
    return {feature.name: value for feature, value in zip(features, values, strict=True)}


# ---- position: the paper's state


@pytest.mark.parametrize(
    ("three_d", "limited", "expected"),
    [
        (False, False, {"cell_x": (0, 4), "cell_y": (1, 8)}),
        (True, False, {"cell_x": (0, 4), "cell_y": (1, 8), "level": (1, 2)}),
        (False, True, {"cell_x": (0, 4), "cell_y": (1, 8), "battery_min": (12, 31)}),
        (
            *(True, True),
            {"cell_x": (0, 4), "cell_y": (1, 8), "level": (1, 2), "battery_min": (12, 31)},
        ),
    ],
)
def test_position_is_cell_level_and_minutes(three_d, limited, expected):
    facts = facts_of(three_d, 1800.0 if limited else None)
    drone = seen() if limited else seen(**UNLIMITED)
    values = {name: value for name, (value, _) in expected.items()}
    assert named(Position(), drone, facts) == values
    assert Position().features(facts) == tuple(
        Feature(name, 0, size - 1, True) for name, (_, size) in expected.items()
    )


@pytest.mark.parametrize(
    ("charge", "minutes"),
    [
        (0, 0),
        (1, 0),
        (59_999_999, 0),
        (60_000_000, 1),
        (60_000_001, 1),
        (119_999_999, 1),
        (120_000_000, 2),
        (1_739_999_999, 28),
        (1_740_000_000, 29),
        (1_799_999_999, 29),
        (1_800_000_000, 30),
    ],
)
def test_the_battery_in_whole_minutes_rounded_down(charge, minutes):
    drone = seen(battery_s=charge / 1_000_000)
    assert named(Position(), drone, facts_of())["battery_min"] == minutes


@given(minutes=st.integers(0, 10**5))
def test_an_exact_minute_is_that_minute_and_a_microsecond_less_is_not(minutes):
    facts = facts_of(capacity_s=60.0 * 10**5)
    exact = seen(battery_s=minutes * 60_000_000 / 1_000_000)
    assert named(Position(), exact, facts)["battery_min"] == minutes
    if minutes > 0:
        less = seen(battery_s=(minutes * 60_000_000 - 1) / 1_000_000)
        assert named(Position(), less, facts)["battery_min"] == minutes - 1


@pytest.mark.parametrize(("capacity_s", "most"), [(30.0, 0), (60.0, 1), (90.0, 1), (130.0, 2)])
def test_a_battery_of_no_whole_minutes(capacity_s, most):
    facts = facts_of(capacity_s=capacity_s)
    assert Position().features(facts)[-1] == Feature("battery_min", 0, most, True)
    full = seen(battery_s=capacity_s, capacity_s=capacity_s)
    assert named(Position(), full, facts)["battery_min"] == most


def test_position_counts_the_states_of_the_paper():
    sizes = {}
    for case in ("case1", "case4", "case8"):
        world = build_world(load(scenario_path(case)), 0)
        features = world.scenario.observation.features(world.facts)
        sizes[case] = [int(feature.high) + 1 for feature in features]
    assert sizes["case1"] == [10, 10]
    assert sizes["case4"] == [10, 10, 31]
    levels = world.grid.levels_under_ceiling
    assert levels in (1, 2, 3)
    assert sizes["case8"] == [10, 10, levels, 31]


# ---- local: what the drone sees around it


def test_local_by_hand():
    # Station 0 lies two cells of 150 m east and two of 200 m north: 500 m away.
    assert named(Local(), seen(), facts_of()) == {
        "x": 0.5 / 4,
        "y": 1.5 / 8,
        "altitude": 1.5 / 2,
        "attached": 0.4,
        "served_throughput": 0.2,
        "served_edge_computing": 0.0,
        "served_data_gathering": 0.1,
        "asking_throughput": 0.3,
        "asking_edge_computing": 0.1,
        "asking_data_gathering": 0.2,
        "bandwidth_left": 0.75,
        "time_left": 0.8,
        "battery": 750 / 1800,
        "n_b": 0.1,
        "bearing_sin": 0.6,
        "bearing_cos": 0.8,
        "flight_time": 0.2,
    }


def test_local_says_what_there_is():
    everything = list(named(Local(), seen(), facts_of()))
    home = ["battery", "n_b", "bearing_sin", "bearing_cos", "flight_time"]
    flat = named(Local(), seen(), facts_of(three_d=False))
    assert list(flat) == [name for name in everything if name != "altitude"]
    endless = named(Local(), seen(**UNLIMITED), facts_of(capacity_s=None))
    assert list(endless) == [name for name in everything if name not in home]
    one = facts_of(services=("video",))
    assert {"served_video", "asking_video"} <= set(
        named(Local(), seen(served=(1,), asking=(1,)), one)
    )


@pytest.mark.parametrize(
    ("cell", "station", "bearing"),
    [
        ((2, 0), 0, (0.0, 1.0)),
        ((2, 7), 0, (0.0, -1.0)),
        ((0, 3), 0, (1.0, 0.0)),
        ((3, 3), 0, (-1.0, 0.0)),
        ((2, 3), 0, (0.0, 0.0)),  # there
        ((3, 6), 1, (-450 / math.hypot(450, 1200), -1200 / math.hypot(450, 1200))),
    ],
)
def test_the_bearing_is_from_north_to_the_nearest_station(cell, station, bearing):
    values = named(Local(), seen(cell=cell, station=station), facts_of())
    assert (values["bearing_sin"], values["bearing_cos"]) == pytest.approx(bearing)


def test_what_cannot_be_had_is_at_its_bound():
    free = named(Local(), seen(), facts_of(bandwidth_khz=math.inf))
    assert free["bandwidth_left"] == 1.0
    lost = named(Local(), seen(return_s=math.inf, station=None, flight_s=None), facts_of())
    home = ("n_b", "bearing_sin", "bearing_cos", "flight_time")
    assert [lost[name] for name in home] == [1.0, 0.0, 0.0, 1.0]
    far = named(Local(), seen(return_s=1801.0, flight_s=9999.0), facts_of())
    assert (far["n_b"], far["flight_time"]) == (1.0, 1.0)
    start = named(Local(), seen(step=0, battery_s=1800.0, bandwidth_khz=0.0), facts_of())
    assert [start[name] for name in ("time_left", "battery", "bandwidth_left")] == [1.0] * 3
    end = named(Local(), seen(step=30, battery_s=0.0, bandwidth_khz=5000.0), facts_of())
    assert [end[name] for name in ("time_left", "battery", "bandwidth_left")] == [0.0] * 3


def test_what_a_drone_sees_of_a_small_world():
    # 300 s of battery and a station on cell 4, two hops of 30.990663 s east of where it is at 60 s.
    # It holds two users with 400 kbit/s for them, of whom one is served; of a third the drone on
    # its left is in charge, but it asks in both footprints. A fourth asks far away.
    users = [(600, 120), (600, 100), (400, 120), (2000, 120)]
    world = strip(
        [(1, 0), (2, 0)],
        users,
        radius_m=230,
        bandwidth_kbps=400,
        steps=4,
        battery={"autonomy_min": 5, "return_below": 1.0},
        stations={"full_charge_min": 60},
    )
    flight = Flight(world)
    asks = {user: [(0, 1000, 300)] for user in range(4)}
    flight.episode(path_of(world, asks))
    drone = flight.shown[1].observations[1]
    values = named(Local(), drone, world.facts)
    assert values == pytest.approx(
        {
            "x": 2.5 / 9,
            "y": 0.5,
            "attached": 2 / 4,
            "served_throughput": 1 / 4,
            "served_edge_computing": 0.0,
            "served_data_gathering": 0.0,
            "asking_throughput": 3 / 4,
            "asking_edge_computing": 0.0,
            "asking_data_gathering": 0.0,
            "bandwidth_left": 0.25,
            "time_left": 0.75,
            "battery": 0.8,
            "n_b": 2 * 30.990663 / 300,
            "bearing_sin": 1.0,
            "bearing_cos": 0.0,
            "flight_time": 2 * 30.990663 / 300,
        },
        abs=1e-12,
    )
    assert named(Position(), drone, world.facts) == {"cell_x": 2, "cell_y": 0, "battery_min": 4}


# ---- within bounds, whatever happens


def check_bounds(world: World, seed: int, episodes: int, encodings: list[Encoding]) -> set[Mode]:
    """Random commands: every observation of every decision epoch is encoded within its bounds."""
    settings_ = RunSettings((True,) * len(world.starts), carry_over=True)
    engine, rng, modes = Simulation(world, settings_), np.random.default_rng(seed), set()
    for episode in range(episodes):
        shown = engine.reset(draw(world, seed, episode))
        while True:
            for drone in shown.observations:
                modes.add(drone.mode)
                for encoding in encodings:
                    assert all(map(math.isfinite, named(encoding, drone, world.facts).values()))
                if isinstance(own := world.scenario.observation, RowObservation):
                    assert drone.features == features_of(own, drone, world.facts)
            if shown.terminated or shown.truncated:
                break
            shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
    return modes


@pytest.mark.parametrize("case", by_default([], [f"case{k}" for k in range(9, 0, -1)], at_most=1))
def test_everything_is_within_its_bounds_in_every_case(case: str):
    modes = set()
    for seed in range(3):
        world = build_world(load(scenario_path(case)), seed)
        modes |= check_bounds(world, seed, 3, [Position(), Local()])
    if world.scenario.limited_battery:
        assert {Mode.FLYING, Mode.CRASHED} < modes


@pytest.mark.thorough
@settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
@given(scenario=scenarios(), seed=st.integers(0, 10**6))
def test_everything_is_within_its_bounds_in_random_scenarios(scenario: dict[str, Any], seed: int):
    try:
        world = build_world(from_mapping(scenario), seed)
    except ScenarioError:
        assume(False)
    check_bounds(world, seed, 2, [Position(), Local()])


@pytest.mark.thorough
def test_a_position_stands_for_no_other():
    """What a table is indexed with: different cells, levels or minutes are different numbers."""
    facts, drones = facts_of(), []
    for ix in range(4):
        for iy in range(8):
            for level in range(2):
                drones += [seen(cell=(ix, iy), level=level, battery_s=60.0 * m) for m in range(31)]
    encoded = {features_of(Position(), drone, facts) for drone in drones}
    sizes = [int(feature.high) + 1 for feature in Position().features(facts)]
    assert len(encoded) == len(drones) == math.prod(sizes)


# ---- an encoding of a user's own


@dataclass(frozen=True)
class Coarse:
    """The cell in blocks, and whether the battery is low."""

    block: Annotated[int, Ge(1)] = 2

    def features(self, facts: Facts) -> tuple[Feature, ...]:
        nx, ny = facts.grid.cells
        sizes = {"block_x": -(-nx // self.block), "block_y": -(-ny // self.block), "low": 2}
        return tuple(Feature(name, 0, size - 1, True) for name, size in sizes.items())

    def encode(self, observation: Observation, facts: Facts) -> tuple[float, ...]:
        ix, iy = observation.cell
        low = observation.battery_s is not None and observation.battery_s <= 360.0
        return ix // self.block, iy // self.block, float(low)


def test_an_encoding_of_ones_own_is_named_in_the_scenario():
    scenario = loads(f'observation: {{kind: "{__name__}:Coarse", block: 3}}')
    assert scenario.observation == Coarse(3)
    assert loads(dump(scenario)) == scenario
    world = build_world(scenario, 0)
    assert [feature.high for feature in scenario.observation.features(world.facts)] == [3, 3, 1]
    check_bounds(world, 0, 1, [scenario.observation])
    drone = seen(cell=(8, 9), battery_s=360.0)
    assert named(scenario.observation, drone, world.facts) == {"block_x": 2, "block_y": 3, "low": 1}
    with pytest.raises(ScenarioError, match=r"observation\.block: 0: must be at least 1"):
        loads(f'observation: {{kind: "{__name__}:Coarse", block: 0}}')


class Half:
    """No encoding: it names features and does not give them."""

    def features(self, facts: Facts) -> tuple[Feature, ...]:
        return ()


def test_what_does_not_encode_is_no_encoding():
    with pytest.raises(
        ScenarioError, match="cannot be used as observation: it has no method 'encode'"
    ):
        loads(f'observation: {{kind: "{__name__}:Half"}}')


def test_rows_of_a_table_count_as_numbers_do():
    assert [table_row((x, y), (2, 3)) for x in range(2) for y in range(3)] == [*range(6)]


@pytest.mark.parametrize("code", [(2, 0), (0, -1)])
def test_a_state_that_a_table_does_not_have(code: tuple[int, int]):
    with pytest.raises(
        SimulationError, match=r"outside the bounds of its features, which have \(2, 3\) values"
    ):
        table_row(code, (2, 3))
