"""What seldom happens, by hand and in both engines: of one instant, without room, between hops."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import Carried, CarriedDrone, EpisodeLog, RunSettings
from desim_uav.engine.compiled import BatchSimulation, calls, simulation
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError, SimulationError
from desim_uav.model.rules import Action, Mode
from desim_uav.rules.rows import State
from desim_uav.sample_path import SamplePath
from desim_uav.world import World
from tests.engine.helpers import US, Flight, events, in_3d, path_of, returning, seen, strip
from tests.engine.replay import check_log
from tests.verification.engines import SUMS, row


def both(
    world: World, carried: Carried | None = None, keep_events: bool = True
) -> tuple[Simulation, BatchSimulation]:
    drones = world.scenario.drones.count
    settings = RunSettings((True,) * drones, carried is not None, keep_events)
    one, other = Simulation(world, settings), BatchSimulation(world, settings)
    for engine in (one, other) if carried else ():
        engine.carry(carried)
    return one, other


def alike(engines: tuple[Simulation, BatchSimulation], path: SamplePath, *told: str) -> EpisodeLog:
    """An episode of both; missing actions are hover. The same is shown and logged."""
    one, other = engines
    world, wanted = one.world, [text.split() for text in told]
    command = Flight(world).command
    shown, seen_ = one.reset(path), other.reset(path)
    while not (shown.terminated or shown.truncated):
        assert shown == seen_
        words = [text[shown.step] if shown.step < len(text) else "hover" for text in wanted]
        words += ["hover"] * (world.scenario.drones.count - len(words))
        commands = [command(word) for word in words]
        shown, seen_ = one.step(commands), other.step(commands)
    assert shown == seen_
    assert one.measures() == other.measures()
    assert [row(r) for r in one.log.requests] == [row(r) for r in other.log.requests]
    for name in ("events", "legs", "steps", *SUMS):
        assert getattr(one.log, name) == getattr(other.log, name), name
    assert one.carried() == other.carried()
    if one.log.events is not None:
        check_log(world, one.log)
    return one.log


def resting(node: tuple[int, int, int], battery_s: float = 0.0, **changes: Any) -> CarriedDrone:
    """A drone that hovers, as an episode hands it on."""
    there = CarriedDrone(Mode.FLYING, node, round(battery_s * US), 0, None, (), 0.0, 0, None)
    return there._replace(**changes)


# ---- one instant


@pytest.mark.parametrize("legs", [1, 2])
def test_who_leaves_comes_before_who_enters(legs: int):
    """Both stand 100 m from where the drone is half-way, one behind it and one ahead."""
    world = strip(users=[(340, 120), (140, 120)], steps=1)
    walks = {0: [(10.0 * k, 340.0, 120.0, 0.0, 0.0) for k in range(legs)]}
    log = alike(both(world), path_of(world, walks=walks), "right")
    gone, come = seen(log, "exit", "enter")[1:3]
    assert (gone[2], gone[4], come[2], come[4]) == ("exit", 1, "enter", 0)
    assert gone[0] == come[0] == pytest.approx(30_990_663 / 2, abs=1)


def test_who_stands_on_the_edge_is_left_as_the_drone_departs():
    world = strip(users=[(20, 120)], steps=2)
    log = alike(both(world), path_of(world), "hover right")
    assert seen(log, "enter", "exit", "depart") == events("""
               0   4  enter   0  0
        60000000  10  depart  0
        60000000  11  exit    0  0
    """)


def test_pads_are_left_by_whoever_is_full_first():
    world = returning(starts=[(4, 0)] * 2, stations={"pads": 2}, steps=6)
    carried = (resting((4, 0, 0), 100), resting((4, 0, 0), 500))
    log = alike(both(world, carried), path_of(world), "charge", "charge")
    assert [e[3] for e in seen(log, "charge")] == [0, 1]
    assert [e[3] for e in seen(log, "charged")] == [1, 0]


# ---- after the end, and before the beginning


def test_nobody_asks_after_the_end():
    world = strip(users=[(120, 120)] * 2, steps=1)
    asks = {0: [(10, 5, 100), (60, 5, 100)], 1: [(61, 5, 100)]}
    log = alike(both(world), path_of(world, asks))
    assert [(r.user, r.t_request_us) for r in log.requests] == [(0, 10 * US)]


def test_a_drone_that_is_between_hops_plans_its_way_home():
    world = returning(steps=3)
    carried = (resting((2, 0, 0), 300, mode=Mode.RETURNING),)
    log = alike(both(world, carried), path_of(world))
    assert seen(log, "depart", "land")[:3] == events("""
               0  3  depart  0
        30990663  3  depart  0
        61981326  3  land    0  -  -  0
    """)


def test_a_drone_goes_on_in_the_middle_of_a_hop():
    """10 s and 33.2 m of its first hop are behind it; it began to charge what it flies on."""
    world = returning(steps=3)
    hop = (1, 0, 0)
    under_way = resting((1, 0, 0), 300, mode=Mode.RETURNING, age_us=10 * US)
    carried = (under_way._replace(hop=hop, route=(hop, hop), counted_m=50.0),)
    log = alike(both(world, carried), path_of(world))
    assert seen(log, "arrive", "depart", "land")[:3] == events("""
        20990663  3  arrive  0
        20990663  3  depart  0
        51981326  3  arrive  0
    """)
    assert log.distance_m == pytest.approx(3 * 240 - 50)


def test_every_way_home_can_be_gone_on_with():
    """From each cell, with its first hop under way and the others to go."""
    world = returning(cells=(5, 5), starts=[(0, 0)], users=[(0, 0)], steps=4)
    for x, y in np.ndindex(5, 5):
        first, *others = world.only_type.planner.plan((x, y, 0)).hops or (None,)
        under_way = resting((x, y, 0), 300, mode=Mode.RETURNING, hop=first, route=tuple(others))
        log = alike(both(world, (under_way,)), path_of(world))
        assert log.distance_m == pytest.approx(240 * (abs(x - 2) + abs(y - 2)))


def test_who_lies_crashed_lies_there_until_another_comes():
    battery = {"autonomy_min": 10, "respawn_after_min": 2}
    world = strip(battery=battery, steps=4)
    fallen = resting((2, 0, 0), mode=Mode.CRASHED, fallen_m=(500.0, 120.0), age_us=30 * US)
    log = alike(both(world, (fallen,)), path_of(world))
    assert [(e[0], e[5:]) for e in seen(log, "respawn")] == [(120 * US, (-1, 0))]


def test_a_route_that_no_plan_ends_with_cannot_be_carried_on():
    world = returning(steps=3)
    sideways = resting((1, 0, 0), 300, mode=Mode.RETURNING, hop=(1, 0, 0), route=((0, 1, 0),))
    engine = BatchSimulation(world, RunSettings((True,), True))
    engine.carry((sideways,))
    with pytest.raises(SimulationError, match="no way back of this world"):
        engine.reset(path_of(world))


def test_landed_drones_keep_their_places():
    world = returning(starts=[(4, 0)] * 3, steps=4)
    waiting = resting((4, 0, 0), 500, mode=Mode.QUEUED, age_us=5 * US)
    carried = (
        waiting._replace(place=2),
        waiting._replace(place=1),
        waiting._replace(mode=Mode.CHARGING),
    )
    log = alike(both(world, carried), path_of(world))
    assert [(e[0], e[3]) for e in seen(log, "charge")] == [(45 * US, 1), (95 * US, 0)]


# ---- nowhere to go


def test_a_drone_that_sees_no_way_home():
    """It believes that it is in a court whose buildings are higher than it may fly."""
    world = in_3d(
        [[0, 1, 60], [1, 0, 60], [1, 1, 60]],
        [(3, 0)],
        cells=(4, 2),
        battery={"autonomy_min": 10, "return_below": 1.0},
        observation={"kind": "local"},
        reward={"kind": "coverage_battery", "low_battery": 1.0},
        steps=4,
    )
    one, other = both(world)
    path = path_of(world, error=[[(0, 0), (-3, 0), (-3, 0)]])
    shown, hover = one.reset(path), [world.actions.index(Action.HOVER)]
    assert shown == other.reset(path)
    for lost in (True, True, False):
        shown = one.step(hover)
        assert shown == other.step(hover)
        (seen_,) = shown.observations
        assert (seen_.return_s == math.inf, seen_.station is None) == (lost, lost)
        assert shown.reward_terms[0]["return"] == (-1.0 if lost else pytest.approx(-0.3, abs=0.3))
        encoded = world.scenario.observation.encode(seen_, world.facts)
        assert looked_at(other, len(encoded)) == pytest.approx(encoded, abs=1e-6)
    home = alike((one, other), path, "hover goto")
    assert [e[2] for e in seen(home, "depart", "land")][-1] == "land"


def looked_at(engine: BatchSimulation, numbers: int) -> list[float]:
    """What a drone is shown, encoded by the kernels."""
    values, mask = np.empty(numbers), np.empty(len(engine.world.actions), np.int8)
    reward, told, over = np.empty(1), np.empty(16), np.empty(3, np.int8)
    rewards, own = np.empty(1), np.empty(16)
    arrays = (values, mask, reward, told, over, rewards, own)
    shown = [array.ctypes.data for array in arrays]
    calls.look_at_all(np.array([[*engine.addresses(), *shown]], np.int64), np.ones(1, bool))
    return values.tolist()


# ---- no room


@pytest.mark.parametrize("keep_events", [True, False])
@pytest.mark.parametrize("timing", ["minimum_time", "fill_epoch"])
def test_room_is_made_for_everything_that_may_happen(
    timing: str, keep_events: bool, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(simulation, "BUFFER", 1)
    monkeypatch.setattr(simulation, "REQUESTS_A_USER", 0)
    monkeypatch.setattr(simulation, "CROSSINGS_A_USER", 0)
    users = [(120 + 20 * k, 120) for k in range(24)]
    world = strip(starts=[(0, 0), (2, 0)], users=users, steps=4, timing=timing)
    engines = both(world, keep_events=keep_events)
    asks = {user: [(0, 5, 100), (20, 5, 100), (90, 5, 100)] for user in range(24)}
    alike(engines, path_of(world, asks), "right right left right", "left left right left")
    assert engines[1].buffers.log > 1
    assert engines[1].buffers.crossings > 16


def test_too_many_who_look_for_a_drone_are_not_written_beyond_their_room():
    world = strip(users=[(120, 120)] * 8, steps=1)
    one, other = both(world)
    other.memory.view(np.int32)[State.byte_of["loose"] // 4 + 2] = 3  # its buffer
    alike((one, other), path_of(world))


# ---- refused


def test_the_longest_battery_flies_in_both_engines_and_a_longer_one_is_refused():
    for engine in both(strip(battery={"autonomy_min": 10**6})):
        assert engine.reset(path_of(engine.world)).observations[0].battery_s == 6e7
    with pytest.raises(ScenarioError, match=r"autonomy_min: 1000001: must be at most 1000000 min"):
        strip(battery={"autonomy_min": 10**6 + 1})


def test_as_many_commands_as_drones():
    for engine in both(strip()):
        engine.reset(path_of(engine.world))
        with pytest.raises(ValueError, match="2 commands for 1 drones"):
            engine.step([0, 0])


class Generous:
    """An admission that serves all, whatever is left."""

    def scan(self, waiting: Any, free_hz: float) -> tuple[list[Any], list[Any]]:
        return list(waiting), []


def test_an_admission_that_serves_more_than_there_is_ends_the_simulation():
    drones = {"admission": {"kind": "tests.engine.test_corners:Generous"}}
    world = strip(users=[(120, 120)] * 2, bandwidth_kbps=150, drones=drones)
    engine = Simulation(world, RunSettings((True,), False))
    with pytest.raises(SimulationError, match="'Generous' served more than a drone's bandwidth"):
        engine.reset(path_of(world, {0: [(0, 5, 100)], 1: [(0, 5, 100)]}))
        engine.step([world.actions.index(Action.HOVER)])
