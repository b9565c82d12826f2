"""Planners for fleets of several types, for free flight, and for decisions by event."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import EpisodeLog
from desim_uav.experiment.run import play, run
from desim_uav.model.rules import Mode
from desim_uav.policies import load_policy
from desim_uav.policies.base import PolicyLike
from desim_uav.policies.moves import FreeMoves
from desim_uav.policies.planning.ground import NO_WAY, grounds_of
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine.helpers import strip
from tests.selection import by_default

MINIMUM = {"max_speed_mps": 8.3, "max_acceleration_mps2": 4.0, "timing": "minimum_time"}
FREE = {"max_speed_mps": 8.3, "max_acceleration_mps2": 4.0, "space": "free", "margin_m": 10}


def logged(world: World, policy: PolicyLike, engine: str = "batch", seed: int = 0) -> EpisodeLog:
    ((log, _),) = play(world, load_policy(policy), "mine", seed, engine=engine)
    return log


def ends(log: EpisodeLog, drones: int) -> list[tuple[float, float]]:
    """Where each drone is at the end of an episode, in sides of cells from the first centre."""
    last = {step.drone: step for step in log.steps}
    return [(last[d].x_m / 240 - 0.5, last[d].y_m / 240 - 0.5) for d in range(drones)]


def kinds(*types: dict[str, Any], **changes: Any) -> World:
    """A strip of cells of 240 m with a drone of each type, which has no battery."""
    plain = {"count": 1, "footprint_radius_m": 100, "bandwidth_kbps": None, "battery": None}
    named = [{"name": f"type{k}", **plain, **own} for k, own in enumerate(types)]
    return strip(**{"cells": (9, 1), **changes, "drones": named})


def at(*places: float) -> list[tuple[float, float]]:
    """Users in the middle of a strip, in sides of cells from the first centre."""
    return [(240.0 * (x + 0.5), 120.0) for x in places]


# ---- small worlds in which the best is known


@pytest.mark.parametrize("policy", ["greedy", "clairvoyant:tries=0"])
@pytest.mark.parametrize("large", [0, 1])
def test_the_large_footprint_goes_to_the_cluster_that_needs_it(policy: str, large: int):
    """The users in the west are spread over 400 m, and those in the east over 40 m."""
    users = at(1.2, 1.6, 2.4, 2.8, 5.9, 6, 6.1)
    types = [{"footprint_radius_m": 250 if k == large else 100} for k in range(2)]
    world = kinds(*({**own, "start_cells": [[4, 0]]} for own in types), users=users, steps=5)
    reached = ends(logged(world, policy), 2)
    assert (reached[large], reached[1 - large]) == ((2, 0), (6, 0))


def test_the_fast_drone_goes_to_the_users_who_are_far():
    """With 3 m/s, a step of 60 s does not lead to the next cell of 240 m, so it has 4 of 120 m."""
    world = kinds(
        {"motion": {**FREE, "max_speed_mps": 3}, "start_cells": [[4, 0]]},
        {"motion": FREE, "start_cells": [[4, 0]]},
        users=at(3, 8, 8),
        steps=3,
    )
    assert ends(logged(world, "greedy:horizon=3"), 2) == [(3, 0), (8, 0)]


def test_drones_that_need_no_charge_stay_and_others_charge():
    short = {"autonomy_min": 8, "return_below": 0.3}
    world = kinds(
        {"battery": short, "start_cells": [[4, 0]]},
        {"start_cells": [[4, 0]]},
        users=at(2, 2, 6),
        steps=40,
        stations={"count": 1, "full_charge_min": 2},
    )
    ground, other = grounds_of(world)
    assert (ground.full, other.full) == (8, 1)
    assert ground.needs.tolist() == [5, 4, 3, 2, 1, 2, 3, 4, 5]
    assert other.needs.tolist() == [0] * 9
    log = logged(world, "greedy:horizon=12")
    assert log.crashes == 0 and log.charges >= 3
    assert ends(log, 2)[1] == (2, 0)


@pytest.mark.parametrize("engine", ["des", "batch"])
def test_in_free_flight_a_drone_flies_to_the_middle_of_its_users(engine: str):
    """The middle is halfway between two centres; a circle of 100 m reaches both users from there.

    From neither centre does it reach the user beyond the other one.
    """
    world = kinds({"motion": FREE, "start_cells": [[0, 0]]}, users=at(3.2, 3.8), steps=4)
    log = logged(world, "greedy", engine)
    assert ends(log, 1)[0] == pytest.approx((3.5, 0))
    assert log.steps[1].x_m / 240 - 0.5 == pytest.approx(3.5), "a step leads 480.8 m"
    assert [step.attached_users for step in log.steps] == [0, 2, 2, 2]


def test_in_free_flight_a_drone_flies_round_a_zone():
    """The straight way to the users is closed; ways of two legs past the zone are open."""
    zone = {"polygon_m": [[500, 300], [700, 300], [700, 700], [500, 700]]}
    world = kinds(
        {"motion": FREE, "start_cells": [[0, 2]]},
        cells=(5, 5),
        map={"no_fly": [zone]},
        users=[(1080.0, 600.0)] * 3,
        steps=6,
    )
    log = logged(world, "greedy")
    assert log.steps[-1].attached_users == 3
    assert not any(500 < step.x_m < 700 and 300 < step.y_m < 700 for step in log.steps)


def test_a_command_leads_just_to_the_place():
    world = kinds({"motion": FREE}, cells=(5, 5))
    start, stop = (600.0, 600.0, 20.0), (700.0, 350.0, 20.0)
    numbers = FreeMoves(world).towards(0, start, stop)
    ground = grounds_of(world)[0]
    reach_m = 8.3 * (60 - 8.3 / 4)
    assert np.array(numbers) * reach_m == pytest.approx([100, -250])
    assert len(ground.centres_m) == 81, "nine times nine points 120 m apart"
    far = FreeMoves(world).towards(0, start, (3000.0, 600.0, 20.0))
    assert far == pytest.approx([1, 0])


def test_by_event_a_drone_decides_when_it_arrives():
    """A flight over a cell takes 31 s; the third one ends after 93 s, and then it hovers."""
    world = kinds(
        {"motion": MINIMUM, "start_cells": [[1, 0]]},
        users=at(4, 4),
        steps=5,
        decisions={"kind": "event", "patience_s": 30},
    )
    ground = grounds_of(world)[0]
    assert ground.tick_us == 30_000_000 and set(ground.lasts.tolist()) == {1}
    log = logged(world, "greedy")
    arrived = [step.t_us / 1e6 for step in log.steps[:3]]
    one_s = 240 / 8.3 + 8.3 / 4
    assert arrived == pytest.approx([one_s, 2 * one_s, 3 * one_s], abs=1e-5)
    assert ends(log, 1) == [(4, 0)]
    assert all(step.attached_users == 2 for step in log.steps[3:])


def test_by_event_a_drone_that_waits_long_plans_its_hovers():
    """A hover lasts for 120 s, four times as long as a flight: it is four ticks of a plan."""
    world = kinds(
        {"motion": MINIMUM, "start_cells": [[4, 0]], "battery": {"autonomy_min": 10}},
        steps=5,
        stations={"count": 1},
        decisions={"kind": "event", "patience_s": 120},
    )
    ground = grounds_of(world)[0]
    assert ground.tick_us == pytest.approx(31e6, rel=0.01)
    to_the_side = [move.name for move in ground.flights.moves].index("LEFT")
    assert ground.lasts[[0, to_the_side]].tolist() == [4, 1]
    assert ground.drains[[0, to_the_side]].tolist() == [4, 1]


# ---- safety, and both engines


def test_a_plan_that_ends_before_the_episode_leaves_enough_to_reach_a_station():
    """The users are two cells from the station, and a plan of two steps sees no charge."""
    battery = {"autonomy_min": 6, "return_below": 0.5}
    world = strip([(4, 0)], at(6, 6), steps=30, battery=battery)
    assert not world.scenario.episode.carry_over
    log = logged(world, "greedy:horizon=2")
    assert log.crashes == 0 and log.charges > 0
    assert max(step.x_m for step in log.steps) == 240 * 6.5


def fleet(seed: int, *, free: str, by_event: bool) -> World:
    """A random fleet of two types with short batteries; ``free`` are the kinds of the types."""
    rng = np.random.default_rng(seed)
    size = [int(rng.integers(4, 7)), int(rng.integers(4, 7))]
    batteries = [
        {"kind": "endurance", "autonomy_min": int(rng.integers(10, 16)), "return_below": 0.6},
        {"kind": "rotary_wing", "capacity_wh": int(rng.integers(30, 50)), "return_below": 0.6},
    ]
    drones = [
        {
            "name": f"type{k}",
            "count": int(rng.integers(1, 3)),
            "footprint_radius_m": int(rng.integers(150, 400)),
            "battery": batteries[int(rng.integers(2))],
            "motion": {
                **(FREE if kind == "f" else MINIMUM),
                "max_speed_mps": float(rng.integers(6, 14)),
            },
        }
        for k, kind in enumerate(free)
    ]
    scenario = {
        "map": {"size_m": [240 * n for n in size], "cells": size, "dimensions": 2},
        "drones": drones,
        "stations": {"count": int(rng.integers(1, 3)), "radius_m": 240, "full_charge_min": 3.0},
        "users": {"count": 10, "clusters": {"count": 2, "radius_m": [100, 200]}},
        "decisions": {"kind": "event", "patience_s": 40} if by_event else {"kind": "clock"},
        "episode": {"steps": 20, "carry_over": bool(rng.random() < 0.7)},
    }
    return build_world(from_mapping(scenario), seed)


FLEETS = [("cc", False), ("ff", False), ("cf", False), ("cc", True), ("ff", True), ("cf", True)]
NAMES = [f"{free}-{'event' if by_event else 'clock'}" for free, by_event in FLEETS]


@pytest.mark.parametrize(("free", "by_event"), FLEETS, ids=NAMES)
@pytest.mark.parametrize("worlds", by_default([], [2, 40], at_most=1))
def test_no_drone_crashes(free: str, by_event: bool, worlds: int):
    for seed in range(worlds):
        world, policy = fleet(seed, free=free, by_event=by_event), load_policy("greedy:horizon=8")
        for log, _ in play(world, policy, "greedy", seed, 2, engine="batch"):
            assert log.crashes == 0, seed
            assert all(step.charge > 0 for step in log.steps if step.mode is not Mode.CRASHED)
            assert log.attached_us > 0, seed


@pytest.mark.thorough
@pytest.mark.parametrize(("free", "by_event"), FLEETS, ids=NAMES)
@pytest.mark.parametrize("name", ["greedy:horizon=8", "rollout:random+samples=1+horizon=1"])
def test_both_engines_give_the_same_tables_without_a_crash(name: str, free: str, by_event: bool):
    same_without_a_crash(name, free, by_event)


@pytest.mark.thorough
@pytest.mark.parametrize(("free", "by_event"), [("cc", False), ("ff", False), ("cc", True)])
def test_a_search_with_the_future_is_the_same_in_both_engines(free: str, by_event: bool):
    same_without_a_crash("clairvoyant:tries=1", free, by_event)


def same_without_a_crash(name: str, free: str, by_event: bool) -> None:
    world = fleet(5, free=free, by_event=by_event)
    changed = world.scenario.episode.model_copy(update={"steps": 3})
    world = build_world(world.scenario.model_copy(update={"episode": changed}), 5)
    one, other = (run(world, load_policy(name), name, 3, 2, engine=e) for e in ("batch", "des"))
    assert one.requests.equals(other.requests)
    assert one.steps.equals(other.steps)
    assert one.episodes["crashes"].sum() == 0


def test_a_place_from_which_no_drone_returns_needs_no_less_than_a_way_there():
    """Freely flying drones charge after a return only, which needs a low enough battery."""
    world = fleet(1, free="ff", by_event=False)
    for ground in grounds_of(world):
        home = ground.returns[:, 2] + 2
        may = (ground.returns[:, 3] == 1) & (ground.returns[:, 2] < ground.return_at)
        assert (ground.needs[may] <= home[may]).all() and (ground.needs < NO_WAY).all()
        assert (ground.charges_at == -1).all()
