"""Mobility and demand of one's own over rows: the same numbers in Python and machine code."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import engine_for
from desim_uav.engine.compiled import BatchSimulation
from desim_uav.engine.compiled.pack import lacking
from desim_uav.engine.des import Simulation
from desim_uav.env import UavEnv, UavVectorEnv
from desim_uav.errors import SimulationError
from desim_uav.learning.training import Training
from desim_uav.model.catalogue import catalogue
from desim_uav.model.demand import demand
from desim_uav.model.demand.day_profile import DayProfile
from desim_uav.model.mobility import mobility
from desim_uav.model.mobility.gauss_markov import GaussMarkov
from desim_uav.model.mobility.group import Group
from desim_uav.model.mobility.levy import Levy
from desim_uav.model.mobility.manhattan import Manhattan
from desim_uav.model.mobility.mobility import Area
from desim_uav.model.mobility.random_waypoint import RandomWaypoint
from desim_uav.model.mobility.walking import from_here, go_on, go_to, stay, walking_of
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.services import PAPER
from desim_uav.rowcode import components
from desim_uav.rowcode.rows import blank, held_by
from desim_uav.sample_path import draw
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests import plug_ins
from tests.selection import by_default
from tests.verification.engines import differences
from tests.verification.walked import starts_of, velocities_of

US = 1_000_000
SETTINGS = RunSettings((True,) * 3, True, keep_events=True)
WALKS = [
    plug_ins.Waypoints(),
    plug_ins.Waypoints(speed_mps=40.0, pause_s=1.5),
    plug_ins.GaussMarkov(),
    plug_ins.GaussMarkov(mean_mps=50.0, alpha=0.3),
    mobility.RandomWalk(speed_mps=30.0, leg_s=7.0),
    RandomWaypoint(),
]
MORE_WALKS = [
    RandomWaypoint((3.0, 40.0), (0.0, 0.0), start="home"),
    GaussMarkov(20.0),
    GaussMarkov(start="home"),
    Manhattan(20.0),
    Manhattan(100.0, start="home"),
    Group(radius_m=20.0),
    Group(3, 140.0, 7.5, start="home"),
    Levy(),
    Levy((1.0, 50.0), 0.7, (1.0, 60.0), 2.0, 30.0, start="home"),
]
DEMANDS = [
    plug_ins.Bursts(),
    plug_ins.Arriving(),
    demand.Static(none=0.2),
    demand.Dynamic(none=0.1),
    demand.Poisson(30.0),
]
MORE_DEMANDS = [
    DayProfile((((0.0, 20.0), (0.3, 90.0)), ((1.0, 70.0),))),
    DayProfile((((0.0, 0.0), (8.0, 90.0)), ((1.0, 70.0), (20.0, 5.0))), "linear", 7.9, 0.2),
]


def world_of(*names: str) -> World:
    """A case with one's own mobility or demand, by the keys of the scenario."""
    keys = ("users.mobility", "demand")
    own = [
        f"{key}={{kind: 'tests.plug_ins:{name}'}}"
        for key, name in zip(keys, names, strict=False)
        if name
    ]
    return build_world(load(scenario_path("case8"), own), 0)


def walked(model: Any, users: int = 20) -> Any:
    homes = np.random.default_rng(1).uniform((0.0, 0.0), (400.0, 300.0), (users, 2))
    homes[0] = (400.0, 0.0)
    streams = Streams(7, Purpose.MOBILITY, 3)
    return model.walks(homes, streams, Area(400.0, 300.0), 900 * US)


def asked(model: Any, users: int = 20) -> Any:
    services = catalogue(PAPER, dict.fromkeys(PAPER, 1.0))
    return model.requests(users, services, Streams(7, Purpose.DEMAND, 3), 1800 * US)


@pytest.fixture
def in_python(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Let components of a class be run by Python, as those that cannot be compiled."""
    monkeypatch.setattr(components, "_ONLY_PYTHON", set(components._ONLY_PYTHON))
    return lambda model: components._ONLY_PYTHON.add(type(model))


@pytest.mark.parametrize("model", by_default(WALKS, WALKS + MORE_WALKS), ids=str)
def test_walks_in_python_are_those_in_machine_code(model: Any, in_python: Any):
    compiled = walked(model)
    in_python(model)
    by_python = walked(model)
    assert np.array_equal(by_python.offsets, compiled.offsets)
    assert by_python.legs.tobytes() == compiled.legs.tobytes()
    assert len(compiled.legs) > 100
    assert mobility.leaves_the_map(compiled, Area(400.0, 300.0), 900 * US) == ""


@pytest.mark.thorough
@pytest.mark.parametrize("model", DEMANDS + MORE_DEMANDS, ids=str)
def test_requests_in_python_are_those_in_machine_code(model: Any, in_python: Any):
    compiled = asked(model)
    in_python(model)
    by_python = asked(model)
    assert np.array_equal(by_python.offsets, compiled.offsets)
    assert np.array_equal(by_python.rows, compiled.rows)
    assert len(compiled.rows) >= 10


def test_way_points_are_walked_to_straight_and_paused_at():
    model = plug_ins.Waypoints(speed_mps=5.0, pause_s=20.0)
    walks = walked(model)
    for first, end in pairwise(walks.offsets):
        own = walks.legs[first:end]
        speeds = np.hypot(own["vx_mps"], own["vy_mps"])
        assert speeds[0::2] == pytest.approx(5.0, rel=1e-4)
        assert (speeds[1::2] == 0.0).all()
        lasts_us = np.diff(own["begin_us"])
        assert (lasts_us[1::2] == 20 * US).all()
        arrived = starts_of(own[:-1]) + velocities_of(own[:-1]) * lasts_us[:, None] / US
        assert arrived == pytest.approx(starts_of(own[1:]), abs=1e-6)


def walker(x_m: float, y_m: float, vx_mps: float = 0.0, vy_mps: float = 0.0) -> Any:
    made: Any = blank(held_by(walking_of(plug_ins.Waypoints).kinds["walkers"]))
    made.x_m, made.y_m, made.vx_mps, made.vy_mps, made.t_us = x_m, y_m, vx_mps, vy_mps, 10 * US
    return made


def told(one: Any) -> tuple[float, ...]:
    return one.x_m, one.y_m, one.vx_mps, one.vy_mps, one.t_us / US


@pytest.mark.parametrize(
    "model", by_default(MORE_WALKS[:1], [m for m in MORE_WALKS if m.start == "home"]), ids=str
)
def test_users_walk_on_from_where_they_are(model: Any):
    """A model goes on from given places, which a stationary start would ignore."""
    homes = np.random.default_rng(1).uniform((0.0, 0.0), (400.0, 300.0), (20, 2))
    homes[0] = (400.0, 0.0)
    stationary = replace(model, start="stationary")
    for one in (model, stationary.from_here()):
        walks = walked(one)
        assert np.array_equal(starts_of(walks.legs[walks.offsets[:-1]]), homes)
    anywhere = walked(stationary)
    assert (starts_of(anywhere.legs[anywhere.offsets[:-1]]) != homes).any(axis=1).all()
    assert from_here(stationary) == replace(model, start="home")
    assert from_here(mobility.Static()) == mobility.Static()


@pytest.mark.parametrize("model", by_default(WALKS[-1:], [WALKS[-1], *MORE_WALKS]), ids=str)
def test_one_more_user_changes_no_walk_of_the_others(model: Any):
    few, many = walked(model, 10), walked(model, 11)
    assert few.legs.tobytes() == many.legs[: len(few.legs)].tobytes()
    assert len(many.legs) > len(few.legs)


def test_what_models_do_with_walkers():
    area = Area(100.0, 50.0)
    one = walker(30.0, 10.0)
    go_to(one, 60.0, 50.0, 5.0)
    assert told(one) == (60.0, 50.0, 3.0, 4.0, 20.0)
    stay(one, 25 * US)
    assert told(one) == (60.0, 50.0, 0.0, 0.0, 25.0)
    one = walker(30.0, 10.0, 2.0, 1.0)
    go_on(one, area, 20 * US)
    assert told(one) == (50.0, 20.0, 2.0, 1.0, 20.0)
    go_on(one, area, 60 * US)  # to the edge in the east, and then reflected
    assert told(one) == (100.0, 45.0, 2.0, 1.0, 45.0)
    go_on(one, area, 60 * US)
    assert told(one) == (90.0, 50.0, -2.0, 1.0, 50.0)
    go_on(one, area, 60 * US)
    assert told(one) == (70.0, 40.0, -2.0, -1.0, 60.0)


@pytest.mark.parametrize("names", [("Waypoints", ""), ("", "Bursts"), ("GaussMarkov", "Arriving")])
def test_both_engines_have_the_same_events(names: tuple[str, ...]):
    world = world_of(*names)
    one, other = Simulation(world, SETTINGS), BatchSimulation(world, SETTINGS)
    for episode in range(3):
        assert differences(one, other, 0, episode) == []
    paper = build_world(load(scenario_path("case8")), 0)
    assert differences(Simulation(paper, SETTINGS), other, 0, 0) != []


def test_training_is_the_same_in_both_engines():
    world = world_of("Waypoints", "Bursts")
    one, other = Training(world, 0, "des"), Training(world, 0, "batch")
    assert other.fuses
    assert [row for _ in range(4) for row in one.play()] == other.play(4)
    assert np.array_equal(one.q, other.q)


@pytest.mark.thorough
def test_training_with_copies_of_the_built_in_ones_is_the_same():
    own = Training(world_of("WalkAgain", "DynamicAgain"), 3, "batch")
    paper = load(
        scenario_path("case8"), ["demand.mix={throughput: 1, edge_computing: 1, data_gathering: 1}"]
    )
    built_in = Training(build_world(paper, 0), 3, "batch")
    for _ in range(2):
        assert own.play(8) == built_in.play(8)


def test_all_environments_have_them():
    own = {
        "users": {"mobility": {"kind": "tests.plug_ins:Waypoints", "speed_mps": 9.0}},
        "demand": {"kind": "tests.plug_ins:Bursts"},
    }
    one, vector = UavEnv("case8", own), UavVectorEnv("case8", 2, own)
    assert np.array_equal(one.reset(seed=5)[0], vector.reset(seed=5)[0][0])
    for _ in range(20):
        seen, reward, *_ = one.step([0, 1, 2])
        many, rewards, *_ = vector.step(np.array([[0, 1, 2]] * 2))
        assert np.array_equal(seen, many[0])
        assert reward == rewards[0]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("wordy", "plain"),
    [(("WordyWalk", ""), ("WalkAgain", "")), (("", "WordyDemand"), ("", "DynamicAgain"))],
)
def test_what_cannot_be_compiled_says_so_and_runs(
    wordy: tuple[str, ...],
    plain: tuple[str, ...],
    in_python: Any,
    capsys: pytest.CaptureFixture[str],
):
    world, compiled = world_of(*wordy), BatchSimulation(world_of(*plain), SETTINGS)
    one = Simulation(world, SETTINGS)
    assert differences(one, compiled, 0, 0) == []
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    key, name = ("users.mobility", wordy[0]) if wordy[0] else ("demand", wordy[1])
    assert said[0].startswith(
        f"desim-uav: {key}: 'tests.plug_ins:{name}' is not compiled, and drawn more slowly: "
    )
    assert lacking(world) == []
    assert engine_for(world, lambda _: pytest.fail("no engine is ruled out")) == "batch"
    again = Simulation(world, SETTINGS), BatchSimulation(world, SETTINGS)
    assert differences(*again, 0, 1) == []
    assert capsys.readouterr().err == ""


FAULTY = [
    ("Straying", r"user \d+ is off the map of 2400 x 2400 m at \d+ s: \(\d+\.?\d*, \d+\.?\d*\) m"),
    ("Stuck", "the leg of user 0 that begins at 90 s takes no time"),
    ("Crooked", "the velocity of user 0 does not lead to where it is at 60 s"),
    ("Nowhere", r"user 0 is off the map of .* at 60 s: \(nan, .*\) m"),
]


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "problem"), FAULTY)
def test_a_walk_that_leads_nowhere_is_refused(name: str, problem: str):
    world, match = world_of(name), f"users.mobility: 'tests.plug_ins:{name}': {problem}"
    with pytest.raises(SimulationError, match=match):
        Simulation(world, SETTINGS).reset(draw(world, 0, 0))
    engine = BatchSimulation(world, SETTINGS)

    def play() -> None:
        shown = engine.reset(draw(world, 0, 0))
        while not shown.truncated:
            shown = engine.step([4, 4, 4])

    with pytest.raises(SimulationError, match=match):
        play()
    with pytest.raises(SimulationError, match=match):
        Training(world, 0, "batch").play(3)


@pytest.mark.parametrize(
    ("model", "problem"),
    [
        (plug_ins.Endless(), "no time passes between the requests of user 0"),
        (plug_ins.Unknown(), "user 0 drew what is no request: wait 5 µs, service 3, 1 µs, 0 bit/s"),
        (plug_ins.Unknown(service=-2), "user 0 drew what is no request"),
        (plug_ins.Unknown(service=0, required_us=0), "user 0 drew what is no request"),
        (plug_ins.Backwards(), "user 0 drew what is no request: wait -1 µs"),
    ],
)
def test_draws_that_are_no_requests_are_refused(model: Any, problem: str, in_python: Any):
    match = f"demand: 'tests.plug_ins:{type(model).__name__}': {problem}"
    with pytest.raises(SimulationError, match=match):
        asked(model)
    in_python(model)
    with pytest.raises(SimulationError, match=match):
        asked(model)


def test_there_is_room_for_more_legs_and_requests_than_expected():
    many = walked(plug_ins.GaussMarkov(every_s=0.25))
    assert len(many.legs) > 20 * 900 / 0.25
    often = asked(plug_ins.Arriving(every_s=2.0))
    assert len(often.rows) == 20 * 899
