"""The observations team and radar: by hand, from positions alone, and in both engines."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import RunSettings, UserState
from desim_uav.engine.des import Simulation
from desim_uav.env import UavVectorEnv
from desim_uav.errors import ScenarioError
from desim_uav.model.observations import information_of
from desim_uav.model.rules import Mode
from desim_uav.rules.observations import Local, Position
from desim_uav.rules.radar import Radar
from desim_uav.rules.team import Team
from desim_uav.sample_path import draw
from desim_uav.scenario.cost import check_cost
from desim_uav.scenario.load import from_mapping, load, loads
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests.engine import random_radio
from tests.engine.helpers import Flight, column, path_of, some_command, strip
from tests.selection import by_default
from tests.verification.engines import differences, engines


def shown_to(flight: Flight, epoch: int, drone: int) -> dict[str, float]:
    """The features of a drone that are not 0, without those of local, by name."""
    facts, observation = flight.world.facts, flight.world.scenario.observation
    names = [feature.name for feature in observation.features(facts)]
    values = flight.shown[epoch].observations[drone].features
    assert len(names) == len(values) == len(set(names))
    own = len(Local().features(facts))
    pairs = zip(names[own:], values[own:], strict=True)
    return {name: value for name, value in pairs if value}


# ---- radar by hand


def square(users: Any, starts: Any = ((1, 1), (2, 2)), **changes: Any) -> World:
    """Three by three cells of 240 m."""
    raster = {"kind": "radar", "cells_x": 3, "cells_y": 3, "scales": 1, "full": 2.0}
    return strip(starts, users, cells=(3, 3), **{"observation": raster, **changes})


USERS = [(360, 360), (390, 390), (600, 600), (100, 100)]
ASKS = {0: [(0, 120, 100)], 3: [(0, 100, 100)]}


@pytest.mark.usefixtures("every_engine")
def test_what_a_radar_counts():
    # Drone 0 holds users 0 and 1 in the middle, drone 1 user 2 in the corner; user 3 waits. At 60 s
    # half of the request of user 0 is done.
    flight = Flight(square(USERS))
    flight.episode(path_of(flight.world, ASKS))
    assert shown_to(flight, 1, 0) == {
        "free0_-1_-1": 0.5,
        "own0_+0_+0": 1.0,
        "others0_+1_+1": 0.5,
        "waiting0_-1_-1": 0.5,
        "served0_+0_+0": 0.5,
        "demand0_-1_-1": 0.5,
        "demand0_+0_+0": 0.25,
        "serving0_+1_+1": 1.0,
    }
    off_map = ["-1_+1", "+0_+1", "+1_-1", "+1_+0", "+1_+1"]
    assert shown_to(flight, 1, 1) == {
        "own0_+0_+0": 0.5,
        "others0_-1_-1": 1.0,
        "served0_-1_-1": 0.5,
        "demand0_-1_-1": 0.25,
        **{f"blocked0_{cell}": 1.0 for cell in off_map},
        "serving0_-1_-1": 1.0,
    }


@pytest.mark.usefixtures("every_engine")
def test_the_last_observation_of_an_episode_is_from_before_all_users_are_let_go():
    flight = Flight(square(USERS, steps=1))
    flight.episode(path_of(flight.world, ASKS))
    assert flight.shown[1].truncated
    assert shown_to(flight, 1, 0)["own0_+0_+0"] == 1.0
    assert shown_to(flight, 1, 0)["demand0_+0_+0"] == 0.25


@pytest.mark.usefixtures("every_engine")
def test_a_coarser_raster_has_cells_three_times_as_wide():
    raster = {"kind": "radar", "cells_x": 1, "cells_y": 1, "full": 1.0, "scales": 3}
    flight = Flight(square(USERS, observation=raster | {"requests": False, "demand": False}))
    flight.episode(path_of(flight.world))
    near = {"own0_+0_+0": 1.0}
    wide = {"own1_+0_+0": 1.0, "others1_+0_+0": 2.0, "blocked1_+0_+0": 5 / 9, "serving1_+0_+0": 1.0}
    widest = {"free2_+0_+0": 1.0, "own2_+0_+0": 1.0, "others2_+0_+0": 2.0}
    widest |= {"blocked2_+0_+0": 1 - 9 / 81, "serving2_+0_+0": 1.0}
    assert shown_to(flight, 1, 1) == pytest.approx(near | wide | widest)


@pytest.mark.usefixtures("every_engine")
def test_a_wrong_belief_shifts_the_window_but_not_the_users():
    # At 60 s drone 0 believes itself one cell too far east, and drone 1 sees it there.
    flight = Flight(square(USERS))
    flight.episode(path_of(flight.world, ASKS, error=[[(0, 0), (1, 0)]]))
    seen = shown_to(flight, 1, 0)
    assert seen["own0_-1_+0"] == 1.0
    assert seen["serving0_+0_+1"] == 1.0
    assert "free0_-1_-1" not in seen  # the user in the corner is out of the window
    assert shown_to(flight, 1, 1)["serving0_+0_-1"] == 1.0
    assert shown_to(flight, 1, 1)["others0_-1_-1"] == 1.0


@pytest.mark.usefixtures("every_engine")
def test_users_are_where_they_are_at_the_epoch():
    # It walks east at 2 m/s from x = 119.9 m on: at 60 s it is just before the edge of its cell, at
    # 240 m, and at 120 s in the next cell but one.
    world = square([(119.9, 100)], starts=[(1, 1)], radius_m=10)
    flight = Flight(world)
    flight.episode(path_of(world, walks={0: [(0.0, 119.9, 100.0, 2.0, 0.0)]}))
    cells = [next(name for name in shown_to(flight, k, 0) if "free" in name) for k in range(4)]
    assert cells == ["free0_-1_-1", "free0_-1_-1", "free0_+0_-1", "free0_+0_-1"]


@pytest.mark.usefixtures("every_engine")
def test_a_radar_shows_stations_and_who_is_away():
    # The station is on cell 4. Drone 1 flies to it from 60 s on, and is two cells away at 120 s.
    world = strip(
        [(4, 0), (2, 0)],
        [(2000, 120)],
        steps=3,
        battery={"autonomy_min": 10, "return_below": 1.0},
        observation={"kind": "radar", "cells_x": 5, "cells_y": 1, "scales": 1, "blocked": False},
    )
    flight = Flight(world)
    flight.episode(path_of(world), "", "hover goto")
    assert shown_to(flight, 1, 0) == {"stations0_+0_+0": 1.0, "serving0_-2_+0": 1.0}
    there = flight.shown[2].observations[1]
    assert there.mode in (Mode.RETURNING, Mode.QUEUED, Mode.CHARGING)
    away = there.cell[0] - 4
    assert shown_to(flight, 2, 0) == {"stations0_+0_+0": 1.0, f"away0_{away:+d}_+0": 1.0}


@pytest.mark.usefixtures("every_engine")
def test_a_radar_does_not_show_crashed_drones():
    # Both have 93 s of battery.
    raster = {"kind": "radar", "cells_x": 1, "cells_y": 5, "scales": 1, "stations": False}
    world = column({"respawn_after_min": 5.0}, starts=[(0, 4), (0, 2)], observation=raster)
    flight = Flight(world)
    flight.episode(path_of(world))
    assert shown_to(flight, 1, 0)["serving0_+0_-2"] == 1.0
    assert [drone.mode for drone in flight.shown[2].observations] == [Mode.CRASHED] * 2
    assert not {"serving0_+0_-2", "away0_+0_-2"} & shown_to(flight, 2, 0).keys()


# ---- team by hand


def teams(**parameters: Any) -> Flight:
    """Drone 0 in the middle, the others 2 cells west, 2 cells east and 1 cell east of it."""
    world = strip(
        [(4, 0), (2, 0), (6, 0), (5, 0)], steps=1, observation={"kind": "team", **parameters}
    )
    flight = Flight(world)
    flight.episode(path_of(world))
    return flight


def of_others(*east: int) -> dict[str, float]:
    """The features of drones that fly so many of nine cells to the east."""
    named = [(f"other{k}_east", x / 9) for k, x in enumerate(east)]
    return dict(named) | {f"other{k}_flying": 1.0 for k in range(len(east))}


@pytest.mark.usefixtures("every_engine")
def test_others_by_distance_and_of_equal_ones_the_lower_index_first():
    assert shown_to(teams(), 0, 0) == pytest.approx(of_others(1, -2, 2))
    assert shown_to(teams(others=2), 0, 0) == pytest.approx(of_others(1, -2))
    flight = teams(others=7)
    assert shown_to(flight, 0, 0) == pytest.approx(of_others(1, -2, 2))
    assert (
        len(flight.shown[0].observations[0].features)
        == len(Local().features(flight.world.facts)) + 7 * 3
    )


@pytest.mark.usefixtures("every_engine")
def test_others_by_index():
    assert shown_to(teams(nearest_first=False), 0, 0) == pytest.approx(of_others(-2, 2, 1))
    assert shown_to(teams(nearest_first=False, others=1), 0, 3) == pytest.approx(of_others(-1))


@pytest.mark.usefixtures("every_engine")
def test_the_mode_and_the_battery_of_another_drone_and_where_it_believes_to_be():
    # At 60 s drone 1 has 9 of 10 minutes left and believes itself one cell too far west. Without
    # this error it flies to the station in 30.990663 s, and charges 2 s a second until 120 s.
    world = strip(
        [(4, 0), (3, 0)],
        steps=3,
        battery={"autonomy_min": 10, "return_below": 1.0},
        stations={"full_charge_min": 5},
        observation={"kind": "team"},
    )
    flight = Flight(world)
    flight.episode(path_of(world, error=[[(0, 0)] * 2, [(0, 0), (-1, 0)]]))
    expected = {"other0_east": -2 / 9, "other0_flying": 1.0, "other0_battery": 0.9}
    assert shown_to(flight, 1, 0) == pytest.approx(expected)
    flight.episode(path_of(world), "", "hover goto")
    left_s = 540 - 30.990663 + 2 * (60 - 30.990663)
    expected = {"other0_charging": 1.0, "other0_battery": left_s / 600}
    assert shown_to(flight, 2, 0) == pytest.approx(expected)


# ---- from positions alone


def counted(engine: Simulation, drone: int) -> dict[str, float]:
    """What a radar must count, from positions, states of users and beliefs."""
    world, radar = engine.world, engine.world.scenario.observation
    assert isinstance(radar, Radar) and engine.latest is not None
    nx, ny = world.grid.cells
    own, found = engine.latest.observations[drone], dict[str, float]()
    places, states = engine.positions_m()[1], engine.user_states()

    def add(name: str, x: int, y: int, amount: float) -> None:
        for scale in range(radar.scales):
            side = 3**scale
            i = (x - own.cell[0] + side // 2) // side
            j = (y - own.cell[1] + side // 2) // side
            if abs(i) <= radar.cells_x // 2 and abs(j) <= radar.cells_y // 2:
                key = f"{name}{scale}_{i:+d}_{j:+d}"
                found[key] = found.get(key, 0.0) + amount

    for user, (x_m, y_m) in enumerate(places[:, :2]):
        x, y = min(int(x_m // 240), nx - 1), min(int(y_m // 240), ny - 1)
        holder = engine.state.users[user].holder
        name = "free" if holder < 0 else "own" if holder == drone else "others"
        add(name, x, y, 1 / radar.full)
        if states[user] in (UserState.OPEN, UserState.SERVED):
            add("waiting" if states[user] is UserState.OPEN else "served", x, y, 1 / radar.full)
    for x in range(-99, nx + 99):
        for y in range(-99, ny + 99):
            inside = 0 <= x < nx and 0 <= y < ny
            if not inside or world.grid.blocked[own.level][x, y]:
                add("blocked", x, y, 1.0)
    for x, y in world.stations:
        add("stations", x, y, 1.0)
    for other in engine.latest.observations:
        if other.drone != drone and other.mode is not Mode.CRASHED:
            add("serving" if other.mode is Mode.FLYING else "away", *other.cell, 1.0)
    for scale in range(radar.scales):
        for name in [name for name in found if name.startswith(f"blocked{scale}_")]:
            found[name] /= 9.0**scale
    return found


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(4))
def test_a_radar_is_what_positions_and_states_say(seed: int):
    noise = "position_noise={probability: 0.5, sigma_cells: 2}"
    raster = "observation={kind: radar, cells_x: 7, cells_y: 5, full: 3.0, demand: false}"
    world = build_world(load(scenario_path("case8"), [noise, raster]), seed)
    engine = Simulation(world, RunSettings((True,) * 3, False))
    rng, shown = np.random.default_rng(seed), engine.reset(draw(world, seed, 0))
    names = [feature.name for feature in world.scenario.observation.features(world.facts)]
    own = len(Local().features(world.facts))
    while not shown.truncated:
        if shown.step % 3 == 0:
            for drone, observation in enumerate(shown.observations):
                values = zip(names[own:], observation.features[own:], strict=True)
                assert {n: v for n, v in values if v} == pytest.approx(counted(engine, drone))
        shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])


# ---- in both engines, within bounds


RASTERS = [
    {"kind": "radar"},
    {"kind": "radar", "cells_x": 3, "scales": 3, "full": 3.0},
    {"kind": "radar", "users": False, "blocked": False},
    {"kind": "team"},
    {"kind": "team", "others": 2, "nearest_first": False},
]
"""Observations that are laid over random scenarios."""


def random_world(seed: int) -> World:
    """The world of a random scenario of radio with one of RASTERS, and the reward qoe."""
    told = {"observation": RASTERS[seed % len(RASTERS)], "reward": {"kind": "qoe", "crash": 3.0}}
    for k in range(20):
        try:
            scenario = random_radio.scenario(seed + 10_000 * k) | told
            return build_world(from_mapping(scenario), seed)
        except ScenarioError:
            continue
    raise AssertionError(f"no scenario from seed {seed} on is accepted")


@pytest.mark.thorough
@pytest.mark.parametrize("first", [0, *range(2, 42, 5)])
def test_both_engines_show_and_pay_the_same_over_any_radio(first: int):
    for seed in range(first, first + (2 if first == 0 else 5)):
        world = random_world(seed)
        one, other = engines(world, (True,) * world.scenario.drones.count)
        for episode in range(2):
            assert differences(one, other, seed, episode) == [], seed


@pytest.mark.parametrize("case", by_default(["case8"], ["case1", "case4", "case7", "case9"]))
@pytest.mark.parametrize("kind", ["radar", "team"])
def test_both_engines_show_the_same_in_the_cases(case: str, kind: str):
    own = [f"observation={{kind: {kind}}}", "position_noise={probability: 0.3}"]
    world = build_world(load(scenario_path(case), own), 1)
    one, other = engines(world, (True,) * world.scenario.drones.count)
    features = world.scenario.observation.features(world.facts)
    for episode in range(2):
        assert differences(one, other, 1, episode) == []
        assert one.latest is not None
        for drone in one.latest.observations:
            for value, feature in zip(drone.features, features, strict=True):
                assert feature.low <= value <= feature.high, feature.name


@pytest.mark.parametrize("kind", ["radar", "team"])
def test_vector_environments_have_it(kind: str):
    env = UavVectorEnv("case9", 2, {"observation": {"kind": kind}}, world_seed=0)
    rng, (seen, _) = np.random.default_rng(0), env.reset(seed=3)
    for _ in range(35):
        assert env.observation_space.contains(seen)
        seen, *_ = env.step(rng.integers(0, 9, (2, 3)))


# ---- what is declared


def test_what_an_observation_tells_is_declared():
    class Mine:
        """An observation that does not say."""

    known = [information_of(one) for one in (Position(), Local(), Team(), Radar(), Mine())]
    assert known == ["local", "local", "team", "radar", "undeclared"]


def test_the_shape_of_the_rasters():
    world = build_world(load(scenario_path("case8")), 0)
    radar, facts = Radar(cells_x=7, scales=1), world.facts
    assert radar.shape(facts) == (1, 10, 7, 5)
    behind = len(radar.features(facts)) - len(Local().features(facts))
    assert behind == 10 * 7 * 5
    assert radar.expected_features(3, 3) >= len(radar.features(facts))
    assert Team().expected_features(3, 3) >= len(Team().features(facts))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{kind: radar, cells_x: 4}", "cells_x 4: must be odd, so that the drone is in the middle"),
        ("{kind: radar, cells_y: 0}", "cells_y: 0: must be at least 1"),
        ("{kind: radar, cells_x: 103}", "cells_x: 103: must be at most 101"),
        ("{kind: radar, scales: 6}", "scales: 6: must be at most 5"),
        ("{kind: radar, full: 0}", "full: 0: must be above 0"),
        ("{kind: radar, user: true}", "unknown key .did you mean 'users'"),
        ("{kind: team, others: -1}", "others: -1: must be at least 0"),
        ("{kind: team, nearest_first: 2}", "nearest_first: 2: must be true or false"),
    ],
)
def test_a_malformed_observation_names_the_key_and_what_is_allowed(text: str, problem: str):
    with pytest.raises(ScenarioError, match=problem):
        loads(f"observation: {text}")


def test_an_observation_that_does_not_fit_in_memory_is_foreseen():
    wide = ["observation={kind: radar, cells_x: 101, cells_y: 101, scales: 5}"]
    with pytest.raises(ScenarioError, match=r"what drones observe \(observation, drones.count\)"):
        check_cost(load(scenario_path("case8"), [*wide, "drones.count=10000"]))
