"""Free flight to places on the map (``reach: map``): worlds by hand, and both engines at random."""

from __future__ import annotations

import json
from typing import Any

import pytest

from desim_uav.env.carried_drones import checked, plain
from desim_uav.errors import ScenarioError
from desim_uav.policies.moves import FreeMoves
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World
from tests.engine import random_all
from tests.engine.helpers import US, Flight, events, path_of, seen
from tests.engine.random_parts import accepted
from tests.engine.random_radio import audited
from tests.engine.test_by_event import asked
from tests.engine.test_free_by_event import by_event, fly
from tests.verification.engines import differences, engines

TO_THE_MAP = {
    "motion": {"space": "free", "reach": "map", "max_speed_mps": 10, "max_acceleration_mps2": 5}
}
"""In d metres, of at least 20, such drones take d / 10 + 2 s."""

every_engine = pytest.mark.usefixtures("every_engine")


def place(x_m: float) -> list[float]:
    """The command of a place in the middle of a strip of 2,160 m."""
    return [x_m / 1080 - 1, 0.0]


@every_engine
def test_a_leg_to_any_place_lasts_as_long_as_it_takes():
    # From 120 m to 1,920 m are 1,800 m in 182 s, more than three steps; then back to the start.
    flight = fly(by_event(steps=7, drones=TO_THE_MAP), [place(1920), place(1820), place(120)])
    assert seen(flight.engine.log, "depart", "arrive") == events("""
               0  10  depart  0
       182000000   3  arrive  0
       182000000  10  depart  0
       194000000   3  arrive  0
       202000000  10  depart  0
       374000000   3  arrive  0
    """)
    assert [t / US for t in asked(flight, 0)] == [0, 182, 202, 374, 394, 414]
    assert [leg.to_m[0] for leg in flight.engine.log.legs if leg.duration_us] == pytest.approx(
        [1920, 1820, 120]
    )


@every_engine
def test_numbers_beyond_the_map_mean_its_edge_and_those_of_here_a_hover():
    flight = fly(by_event(steps=5, drones=TO_THE_MAP), [place(120), [7.0, -9.0]])
    (leg,) = [leg for leg in flight.engine.log.legs if leg.duration_us]
    assert (leg.t_us, leg.to_m) == (20 * US, (2160.0, 0.0, 20.0))


@every_engine
def test_users_are_met_on_a_long_leg():
    # The footprint of 100 m reaches a user at 1,500 m when the drone is at 1,400 m: 1,280 m, 129 s.
    world = by_event(steps=4, users=[(1500, 120)], drones=TO_THE_MAP)
    log = fly(world, [place(1920)]).engine.log
    assert [event[0] for event in seen(log, "enter", "exit")] == [129 * US, 149 * US]


@every_engine
def test_a_leg_goes_on_for_more_than_a_whole_episode():
    # It takes 182 s, and each episode lasts for 60 s: two end on the way.
    flight = Flight(by_event(steps=1, drones=TO_THE_MAP), carry_over=True)
    arrived, stands_m = [], []
    for episode in range(4):
        shown = flight.engine.reset(path_of(flight.world, episode=episode))
        while not (shown.terminated or shown.truncated):
            shown = flight.engine.step([place(1920)])
        arrived += [60 * episode + event[0] / US for event in seen(flight.engine.log, "arrive")]
        stands_m.append(flight.engine.position_m(0)[0])
        carried = json.loads(json.dumps(plain(flight.engine.carried())))
        assert checked(carried, flight.world, (True,)) == flight.engine.carried()
    assert arrived == [182]
    assert stands_m == [pytest.approx(120 + 10 * 59), pytest.approx(120 + 10 * 119), 1910.0, 1920]


@every_engine
def test_a_leg_ends_before_an_obstacle():
    zone = {"polygon_m": [[1000, 0], [1100, 0], [1100, 240], [1000, 240]], "altitude_m": [0, 99]}
    flight = fly(by_event(steps=4, drones=TO_THE_MAP, map={"no_fly": [zone]}), [place(1920)])
    (leg,) = [leg for leg in flight.engine.log.legs if leg.duration_us]
    assert leg.to_m[0] == pytest.approx(995, abs=0.01)
    assert len(seen(flight.engine.log, "blocked")) == 1


@pytest.mark.parametrize("in_wind", [False, True])
def test_planners_name_the_places_that_they_mean(in_wind: bool):
    world = by_event(drones=TO_THE_MAP, wind_mps=[3, -2] if in_wind else [0, 0])
    command = FreeMoves(world).towards(0, (120.0, 120.0, 20.0), (1500.0, 30.0, 20.0))
    flight = fly(world, [command])
    (leg,) = [leg for leg in flight.engine.log.legs if leg.duration_us]
    assert leg.to_m == pytest.approx((1500, 30, 20), abs=1e-9)


def random_world(seed: int) -> World:
    """A random world of everything whose drones fly to places, by event."""

    def make(number: int) -> dict[str, Any]:
        made = random_all.one_of_all(number)
        for each in made["drones"]:
            if each["motion"].get("space") == "free":
                each["motion"]["reach"] = "map"
        return made

    return accepted(make, seed, lambda found: found.free and found.decisions.by_event)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(4))
def test_both_engines_fly_alike_and_no_event_breaks_a_rule(seed: int):
    world = random_world(7000 + seed)
    one, other = engines(world, (True,) * world.scenario.drone_count)
    assert [differences(one, other, seed, episode) for episode in range(2)] == [[], []]
    audited(world)


@pytest.mark.parametrize(
    ("motion", "decisions", "said"),
    [
        ({"space": "free", "reach": "map"}, "clock", "map needs decisions: event"),
        ({"reach": "map"}, "event", "map needs drones.motion: space: free"),
    ],
)
def test_what_it_needs(motion: dict[str, Any], decisions: str, said: str):
    made = {"drones": {"motion": motion}, "decisions": {"kind": decisions}}
    if decisions == "event":
        made["decisions"]["patience_s"] = 30
    with pytest.raises(ScenarioError, match=said):
        from_mapping(made)
