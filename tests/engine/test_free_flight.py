"""Free flight: by hand on every engine, against obstacles, and both engines against each other."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from desim_uav.engine.base import EpisodeLog, RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.model.rules import Mode
from desim_uav.sample_path import draw
from desim_uav.world import World
from tests.engine.helpers import (
    US,
    Flight,
    check_that_the_other_engine_goes_on,
    events,
    in_3d,
    path_of,
    seen,
    some_command,
    strip,
)
from tests.engine.random_free import world_of
from tests.engine.random_radio import audited
from tests.engine.replay import check_log
from tests.model.geometry.maps import distances
from tests.selection import by_default
from tests.verification.engines import differences, engines

MOTION = {"space": "free", "max_speed_mps": 10, "max_acceleration_mps2": 5, "margin_m": 10}
"""In a step of 60 s, 10 * (60 - 2) = 580 m; d metres take d / 10 + 2 s, from 20 m on."""

STEERED = ("depart", "blocked", "arrive", "land", "charge", "charged", "crash", "enter", "exit")


def free(motion: dict[str, Any] | None = None, **changes: Any) -> World:
    """A world of ``strip`` with drones that fly freely."""
    world = strip(**{"steps": 1, **changes, "drones": {"motion": {**MOTION, **(motion or {})}}})
    assert world.free
    return world


def fly(world: World, *told: list[Any], **settings: Any) -> EpisodeLog:
    """An episode in which each drone hears its commands, and then hovers."""
    flight = Flight(world, **settings)
    shown = flight.engine.reset(path_of(world))
    while not (shown.terminated or shown.truncated):
        now = [one[shown.step] if shown.step < len(one) else "hover" for one in told]
        commands = [flight.command(one) if isinstance(one, str) else one for one in now]
        shown = flight.engine.step(commands)
    check_log(world, flight.engine.log)
    return flight.engine.log


def ends(log: EpisodeLog, number: int) -> tuple[float, ...]:
    """Where a leg of the log ends, to a micrometre."""
    return tuple(round(float(at), 6) for at in log.legs[number].to_m)


@pytest.mark.usefixtures("every_engine")
class TestByHand:
    """Small worlds, and the logs that follow from the numbers in their files."""

    def test_a_command_is_a_share_of_the_furthest(self):
        # 580 m to x = 700, through the disc of the user at 400: in after 180 m, at 18 + 1 s, and
        # out after 380 m. Then half of it, 290 m, in 31 s, and a hover.
        world = free(users=[(400, 120)], steps=2)
        log = fly(world, [[1.0, 0.0], [0.5, 0.0]])
        assert seen(log, *STEERED) == events("""
                   0  10  depart  0
            19000000   4  enter   0  0
            39000000   2  exit    0  0
            60000000   3  arrive  0
            60000000  10  depart  0
            91000000   3  arrive  0
        """)
        assert [ends(log, 1), ends(log, 2)] == [(700, 120, 20), (990, 120, 20)]
        assert log.distance_m == 870

    def test_it_flies_straight_in_any_direction(self):
        # Along (3, 4) / 5 the user at 300 m is passed in the middle of the disc: from 200 to 400 m.
        world = free(cells=(9, 9), users=[(300, 360)])
        log = fly(world, [[0.6, 0.8]])
        assert seen(log, *STEERED) == events("""
                   0  10  depart  0
            21000000   4  enter   0  0
            41000000   2  exit    0  0
            60000000   3  arrive  0
        """)
        assert ends(log, 1) == (468, 584, 20)

    def test_the_edge_of_the_map_ends_a_leg(self):
        # From x = 120 to the west edge it is 120 m: 14 s. Off the map, nearest is where it stays.
        world = free(steps=2)
        log = fly(world, [[-1.0, 0.0], [-1.0, 0.0]])
        assert seen(log, "depart", "arrive") == events("""
                   0  10  depart  0
            14000000   3  arrive  0
        """)
        assert ends(log, 1) == (0, 120, 20)

    def test_a_zone_ends_a_leg_a_margin_before(self):
        # The zone begins at 400: the drone stops at 390, after 270 m, and then cannot go on.
        zone = {"polygon_m": [[400, 0], [500, 0], [500, 240], [400, 240]]}
        world = free(steps=2, map={"no_fly": [zone]})
        log = fly(world, [[1.0, 0.0], [1.0, 0.0]])
        assert seen(log, "depart", "blocked", "arrive") == events("""
                   0  10  blocked  0
                   0  10  depart   0
            29000000   3  arrive   0
            60000000  10  blocked  0
        """)
        assert ends(log, 1) == (390, 120, 20)

    def test_a_zone_at_another_altitude_does_not(self):
        zone = {"polygon_m": [[400, 0], [500, 0], [500, 240], [400, 240]], "altitude_m": [40, 90]}
        log = fly(free(map={"no_fly": [zone]}), [[1.0, 0.0]])
        assert ends(log, 1) == (700, 120, 20)

    @pytest.mark.parametrize("command", ["goto", [0.3, 0.3, 1.0]])
    def test_a_return_is_straight_and_quickest(self, command):
        # The station is 960 m away: 98 s. The pad gives 2 s a second: 98 of 600 s take 49 s.
        battery = {"autonomy_min": 10, "return_below": 1.0}
        log = fly(free(steps=3, battery=battery), [command])
        assert seen(log, "depart", "arrive", "land", "charge", "charged") == events("""
                    0  10  depart   0
             98000000   3  arrive   0
             98000000   3  land     0  -  -  0
             98000000   3  charge   0  -  -  0
            147000000   3  charged  0  -  -  0
        """)
        first, *_ = log.steps
        assert (
            first.return_drain == (1080 - 120 - 590) / 10 * US + 2 * US
        )  # from where it is at 60 s

    def test_a_drone_crashes_where_it_is(self):
        # After 45 s it has flown 10 * 45 - 10 = 440 m.
        battery = {"autonomy_min": 0.75, "return_below": 0.1, "on_crash": "remove"}
        log = fly(free(battery=battery), [[1.0, 0.0, -1.0]])
        assert seen(log, "crash", "arrive") == events("45000000  6  crash  0")
        assert [round(float(at), 6) for at in log.legs[-1].to_m] == [560, 120, 0]
        assert round(log.distance_m, 6) == 440

    def test_drones_climb_at_their_own_speeds(self):
        # 20 m up at 5 m/s and 2 m/s²: 20 / 5 + 5 / 2 = 6.5 s; down at 3 m/s: 20 / 3 + 3 / 2 s.
        world = in_3d([[2, 1, 50]], [(0, 0)], drones={"motion": MOTION}, steps=2)
        log = fly(world, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
        assert seen(log, "depart", "arrive") == events("""
                   0  10  depart  0
             6500000   3  arrive  0
            60000000  10  depart  0
            68166667   3  arrive  0
        """)

    def test_a_return_goes_round_a_building(self):
        # The station is on cell (1, 1). The building on (1, 0) and its margin of 10 m reach from
        # x = 230 to 490, and to y = 250: the drone stops at that corner.
        battery = {"autonomy_min": 30, "return_below": 1.0}
        stations = {"count": 1, "radius_m": 240}
        world = in_3d(
            [[1, 0, 50]], [(0, 0)], drones={"motion": MOTION}, battery=battery, stations=stations
        )
        log = fly(world, ["goto"])
        legs = [leg for leg in log.legs if leg.mode is Mode.RETURNING]
        assert [leg.to_m for leg in legs] == [(230, 250, 20), (360, 360, 20)]
        half_us = round((math.hypot(110, 130) / 10 + 2) * US)
        assert [leg.duration_us for leg in legs] == [half_us, half_us]
        assert seen(log, "land") == events(f"{2 * half_us}  3  land  0  -  -  0")

    def test_a_return_is_at_the_nearest_altitude_and_ends_at_the_lowest(self):
        # At 33 m, 40 m are nearer than 20 m: 7 m up, over to the station, and 20 m down.
        battery = {"autonomy_min": 30, "return_below": 1.0}
        world = in_3d(
            [[1, 0, 50]],
            [(0, 1)],
            drones={"motion": MOTION},
            battery=battery,
            stations={"count": 1, "radius_m": 240},
            steps=2,
        )
        reach_m = 5 * (60 - 2.5)
        log = fly(world, [[0.0, 0.0, 13 / reach_m, -1.0], "goto"])
        assert [ends(log, k) for k in range(1, 5)] == [
            (120, 360, 33),
            (120, 360, 40),
            (360, 360, 40),
            (360, 360, 20),
        ]
        up_us, over_us = round(2 * math.sqrt(7 / 2) * US), 26 * US
        down_us = round((20 / 3 + 3 / 2) * US)
        assert [leg.duration_us for leg in log.legs[2:5]] == [up_us, over_us, down_us]


def test_steps_say_what_was_commanded():
    world = free(steps=2, battery={"autonomy_min": 10, "return_below": 1.0})
    log = fly(world, [[0.5, -0.25, -1.0], [0.1, 0.2, 1.0]])
    first, second = log.steps
    assert (first.action.name, first.action_taken.name) == ("FLY", "FLY")
    assert (first.aim_x, first.aim_y, first.aim_z) == (0.5, -0.25, 0.0)
    assert second.action_taken.name == "GOTO_CHARGING_STATION"


def test_commands_are_finite_numbers_of_the_drone():
    flight = Flight(free())
    flight.engine.reset(path_of(flight.world))
    with pytest.raises(ValueError, match="2 finite numbers"):
        flight.engine.step([[1.0, 0.0, 0.0, 0.0]])
    flight.engine.reset(path_of(flight.world))
    with pytest.raises(ValueError, match="2 finite numbers"):
        flight.engine.step([[math.nan, 0.0]])


@pytest.mark.parametrize("seed", by_default(range(4), range(60)))
def test_no_log_of_a_random_scenario_is_amiss(seed):
    world = world_of(seed)
    for log in audited(world):
        check_log(world, log)


def _nearest_m(world: World, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """How near places are to a building or a zone, in metres.

    Obstacles are grown sideways, and up and down: it is the larger one of both distances.
    """
    (dx, dy), heights = world.grid.cell_m, world.grid.height_m
    corners = np.array([[0, 0], [dx, 0], [dx, dy], [0, dy]])
    obstacles = [
        (corners + np.array([ix * dx, iy * dy]), -math.inf, heights[ix, iy])
        for ix, iy in np.argwhere(heights > 0.0).tolist()
    ]
    obstacles += [(np.array(z.polygon_m), *z.altitude_m) for z in world.scenario.map.no_fly]
    nearest = np.full(len(places), np.inf)
    for polygon, low, high in obstacles:
        sideways = np.maximum(distances(places[:, :2], polygon), 0.0)
        upright = np.maximum(np.maximum(low - places[:, 2], places[:, 2] - high), 0.0)
        nearest = np.minimum(nearest, np.maximum(sideways, upright))
    return nearest


@pytest.mark.parametrize("seed", by_default(range(4), range(60)))
def test_no_place_of_a_flight_is_nearer_to_an_obstacle_than_the_margin(seed):
    world = world_of(seed)
    for log in audited(world):
        for leg in log.legs:
            if leg.mode is not Mode.CRASHED:
                shares = np.linspace(0.0, 1.0, 60)[:, None]
                places = np.array(leg.from_m) + shares * (np.array(leg.to_m) - leg.from_m)
                margin_m = world.type_of(leg.drone).drones.motion.margin_m
                assert _nearest_m(world, places).min() >= margin_m - 1e-5, leg


@pytest.mark.parametrize("seed", by_default(range(3), range(40)))
def test_a_return_takes_just_what_was_foreseen(seed):
    world, began = world_of(seed), {}

    def look(simulation: Simulation) -> None:
        for drone in simulation.drones:
            mode, own = drone.mode, began.get(drone.index)
            if mode == Mode.RETURNING and own is None:
                home = drone.course.home
                began[drone.index] = (
                    drone.since_us,
                    drone.charge,
                    home.duration_us,
                    home.drain,
                )
            elif own is not None and mode in (Mode.QUEUED, Mode.CHARGING):
                since_us, battery, duration_us, drained = began.pop(drone.index)
                assert drone.charge == battery - drained
                assert simulation.state.now_us >= since_us + duration_us
                assert mode != Mode.QUEUED or drone.since_us == since_us + duration_us
            elif mode != Mode.RETURNING:
                began.pop(drone.index, None)

    told = RunSettings((True,) * world.scenario.drone_count, False)
    engine, rng = Simulation(world, told, audit=look), np.random.default_rng(seed)
    for episode in range(2):
        began.clear()
        shown = engine.reset(draw(world, 1, episode))
        while not (shown.terminated or shown.truncated):
            shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])


@pytest.mark.parametrize("seed", by_default([], range(40)))
def test_both_engines_are_equal(seed):
    world = world_of(seed)
    one, other = engines(world, (bool(seed % 2),) * world.scenario.drone_count)
    for episode in range(3):
        assert differences(one, other, seed, episode) == []


@pytest.mark.parametrize("seed", by_default([], range(40)))
def test_both_engines_are_equal_with_links_of_all_kinds(seed):
    world = world_of(seed, links=True)
    one, other = engines(world, (True,) * world.scenario.drone_count)
    for episode in range(2):
        assert differences(one, other, seed, episode) == []


@pytest.mark.parametrize("seed", by_default([], range(20)))
def test_links_of_all_kinds_stand_up_to_the_audit(seed):
    # Drones that the edge of the map stops at one place have equal levels, which rounding may put
    # into no order. ``check_log`` reads the events of an instant in one order, so it is left out.
    assert audited(world_of(seed, links=True))


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["des", "batch"])
@pytest.mark.parametrize("seed", range(3))
def test_saved_states_go_on_as_the_original(seed, name):
    check_that_the_other_engine_goes_on(world_of(seed), name, seed)
