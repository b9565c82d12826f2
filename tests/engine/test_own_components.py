"""Components of one's own over rows: both engines run them, and training compiles them."""

from __future__ import annotations

import math
import pickle
from dataclasses import dataclass
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
from desim_uav.model.admission import RowAdmission
from desim_uav.model.energy.battery import Endurance
from desim_uav.model.observations import Feature, RowObservation
from desim_uav.model.radio.functions import log10, slant_range_m
from desim_uav.model.radio.path_loss import RowPathLoss
from desim_uav.model.rewards import RowReward
from desim_uav.rules.admission import admit, turn_away
from desim_uav.rules.battery import capacity_of, is_limited
from desim_uav.rules.observations import Position, write_position
from desim_uav.rules.words import CRASHED, QUEUED
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, load
from desim_uav.shipped import scenario_path
from desim_uav.world import World, build_world
from tests.verification.engines import differences, engines, row


@dataclass(frozen=True)
class R1(RowReward):
    """The paper's R1 once more."""

    names = ("users",)

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        if not QUEUED <= drone.mode <= CRASHED:
            share = drone.attached_users * len(state.drones) / len(state.users)
            drone.terms[0] = min(share, 1.0)


@dataclass(frozen=True)
class Careful(RowReward):
    """Users served, less a penalty for a battery that is nearly empty."""

    penalty: float = 0.5
    below: float = 0.3
    whole: int = 2
    on: bool = True
    names = ("served", "risk")

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        observation = state.observations[drone.index]
        drone.terms[0] = self.whole * observation.served_requests / len(state.users)
        low_us = self.below * capacity_of(world, drone)
        if self.on and is_limited(world, drone) and observation.charge < low_us:
            drone.terms[1] = -self.penalty


@dataclass(frozen=True)
class Boundless(RowReward):
    """A reward that is no number after some steps."""

    names = ("users",)

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        drone.terms[0] = 1e300 if state.step > 3 else 0.0


@dataclass(frozen=True)
class Wordy(RowReward):
    """What compiled code cannot do."""

    names = ("users",)

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        drone.terms[0] = {"users": 1.0}[f"use{'rs'}"]


@dataclass(frozen=True)
class Named(RowReward):
    """A field that is no number."""

    name: str = "x"
    names = ("users",)

    def pay(self, world: Any, state: Any, drone: Any) -> None:
        drone.terms[0] = float(len(self.name))


@dataclass(frozen=True)
class FirstComeAgain(RowAdmission):
    """The paper's rule once more."""

    def scan_rows(self, world: Any, path: Any, state: Any, drone: Any, phase: int) -> None:
        k = 0
        while k < len(drone.waiting):
            user = drone.waiting[k]
            if state.users[user].request.needs_hz <= drone.free_hz:
                admit(world, state, drone, user, phase)
            else:
                k += 1


@dataclass(frozen=True)
class Smallest(RowAdmission):
    """The smallest bandwidth first; a request above a limit is refused."""

    limit_bps: int = 10**9

    def scan_rows(self, world: Any, path: Any, state: Any, drone: Any, phase: int) -> None:
        k = 0
        while k < len(drone.waiting):
            user = drone.waiting[k]
            if state.users[user].request.bandwidth_bps > self.limit_bps:
                turn_away(world, path, state, drone, user, phase)
            else:
                k += 1
        best = 0
        while best >= 0:
            best, best_hz = -1, drone.free_hz + 1
            for k in range(len(drone.waiting)):
                user = drone.waiting[k]
                if state.users[user].request.needs_hz < best_hz:
                    best, best_hz = user, state.users[user].request.needs_hz
            if best >= 0:
                admit(world, state, drone, best, phase)


@dataclass(frozen=True)
class Greedy(RowAdmission):
    """Serves whatever waits, whether it fits or not."""

    def scan_rows(self, world: Any, path: Any, state: Any, drone: Any, phase: int) -> None:
        while len(drone.waiting) > 0:
            admit(world, state, drone, drone.waiting[0], phase)


@dataclass(frozen=True)
class Crowd(RowObservation):
    """The paper's state and how many users are attached, by classes."""

    per_class: int = 4

    def features(self, facts: Any) -> Any:
        return (*Position().features(facts), Feature("crowd", 0, 3, True))

    def write(self, world: Any, state: Any, drone: Any) -> None:
        k = write_position(world, state, drone)
        drone.features[k] = min(3, state.observations[drone.index].attached_users // self.per_class)


@dataclass(frozen=True)
class Costly(Endurance):
    """Flight costs more than a hover, and the faster it cruises, the more."""

    percent: int = 150

    def drains(self, flight: Any, elapsed_us: int) -> int:
        return elapsed_us * self._percent(flight) // 100

    def lasts(self, flight: Any, charge: int) -> int:
        return -(-charge * 100 // self._percent(flight))

    def _percent(self, flight: Any) -> int:
        return 100 if flight.distance_m == 0.0 else self.percent


@dataclass(frozen=True)
class ByPieces(Costly):
    """The same as one function, which can be compiled; fast flight costs more."""

    fast_mps: float = 5.0

    def drains(self, flight: Any, elapsed_us: int) -> int:
        fast = len(flight.pieces) > 1 and flight.pieces[1].speed_mps > self.fast_mps
        return elapsed_us * self.percent // 100 if fast else elapsed_us

    def lasts(self, flight: Any, charge: int) -> int:
        fast = len(flight.pieces) > 1 and flight.pieces[1].speed_mps > self.fast_mps
        return -(-charge * 100 // self.percent) if fast else charge


def test_both_engines_drain_batteries_alike():
    own = f"drones.battery={{kind: '{__name__}:ByPieces', autonomy_min: 9, fast_mps: 4.0}}"
    paper = "drones.battery={kind: endurance, autonomy_min: 9}"
    worlds = [build_world(load(scenario_path("case8"), [battery]), 0) for battery in (own, paper)]
    settings = RunSettings((True,) * 3, True, keep_events=True)
    one, other = Simulation(worlds[0], settings), BatchSimulation(worlds[0], settings)
    crashes = 0
    for episode in range(4):
        assert differences(one, other, 0, episode) == []
        crashes += one.log.crashes
    assert crashes > 0
    assert differences(BatchSimulation(worlds[1], settings), other, 0, 0) != []


def test_a_battery_that_cannot_be_compiled_runs_in_the_simpy_engine():
    own = f"drones.battery={{kind: '{__name__}:Costly'}}"
    world = build_world(load(scenario_path("case8"), [own]), 0)
    (problem,) = lacking(world)
    assert problem.startswith("drones.battery: 'Costly' is not compiled: ")
    engine = Simulation(world, RunSettings((True,) * 3, True))
    engine.reset(draw(world, 0, 0))
    shown = engine.step([3, 3, 3])
    assert {seen.battery_s for seen in shown.observations} == {1800.0 - 1.5 * 60}


@pytest.mark.thorough
def test_all_environments_have_an_observation_of_ones_own():
    own = {"observation": {"kind": f"{__name__}:Crowd", "per_class": 2}}
    one, other = UavEnv("case8", own), UavEnv("case8", own, engine="batch")
    vector = UavVectorEnv("case8", 2, own)
    seen, _ = one.reset(seed=5)
    assert np.array_equal(seen, other.reset(seed=5)[0])
    assert np.array_equal(seen, vector.reset(seed=5)[0][0])
    crowds = set()
    for _ in range(20):
        seen, *_ = one.step([0, 1, 2])
        assert np.array_equal(seen, other.step([0, 1, 2])[0])
        assert np.array_equal(seen, vector.step(np.array([[0, 1, 2]] * 2))[0][0])
        crowds |= set(seen[len(seen) // 3 - 1 :: len(seen) // 3].tolist())
    assert len(crowds) > 1


def test_training_with_an_observation_of_ones_own():
    own = f"observation={{kind: '{__name__}:Crowd'}}"
    world = build_world(load(scenario_path("case8"), [own]), 0)
    one, other = Training(world, 0, "des"), Training(world, 0, "batch")
    assert [row for _ in range(3) for row in one.play()] == [
        row for _ in range(3) for row in other.play()
    ]
    assert np.array_equal(one.q, other.q)


def world_admitting(rule: str, **values: Any) -> World:
    text = "".join(f", {key}: {value}" for key, value in values.items())
    own = f"drones.admission={{kind: '{__name__}:{rule}'{text}}}"
    narrow = "drones.bandwidth_kbps=3000"
    return build_world(load(scenario_path("case8"), [own, narrow]), 0)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("rule", "values", "refuses"),
    [
        ("FirstComeAgain", {}, False),
        ("Smallest", {}, False),
        ("Smallest", {"limit_bps": 600000}, True),
    ],
)
def test_both_engines_admit_the_same(rule: str, values: dict[str, Any], refuses: bool):
    world = world_admitting(rule, **values)
    settings = RunSettings((True,) * 3, True, keep_events=True)
    one, other = Simulation(world, settings), BatchSimulation(world, settings)
    kinds = set()
    for episode in range(2):
        assert differences(one, other, 0, episode) == []
        kinds |= {event[2] for event in one.log.events or ()}
    assert ("refuse" in kinds) == refuses
    assert "serve" in kinds


def test_a_copy_of_first_come_admits_as_first_come():
    settings = RunSettings((True,) * 3, True, keep_events=True)
    own = BatchSimulation(world_admitting("FirstComeAgain"), settings)
    paper = build_world(load(scenario_path("case8"), ["drones.bandwidth_kbps=3000"]), 0)
    assert differences(Simulation(paper, settings), own, 0, 0) == []


@pytest.mark.parametrize("engine", [Simulation, BatchSimulation])
def test_more_than_the_bandwidth_is_refused(engine: Any):
    world = world_admitting("Greedy")
    one = engine(world, RunSettings((True,) * 3, False))

    def play() -> None:
        for episode in range(3):
            shown = one.reset(draw(world, 0, episode))
            while not shown.truncated:
                shown = one.step([4, 4, 4])

    with pytest.raises(SimulationError, match="'Greedy' served more than a drone's bandwidth"):
        play()


def world_with(reward: str, case: str = "case8", **values: Any) -> World:
    text = ", ".join(f"{key}: {value}" for key, value in values.items())
    own = f"reward={{kind: '{__name__}:{reward}'{', ' if text else ''}{text}}}"
    return build_world(load(scenario_path(case), [own]), 0)


@pytest.mark.thorough
@pytest.mark.parametrize(("reward", "values"), [("R1", {}), ("Careful", {"penalty": 0.7})])
def test_both_engines_pay_the_same(reward: str, values: dict[str, Any]):
    world = world_with(reward, **values)
    settings = RunSettings((True,) * 3, True, keep_events=True)
    one, other = Simulation(world, settings), BatchSimulation(world, settings)
    for episode in range(3):
        assert differences(one, other, 0, episode) == []
    names = world.scenario.reward.names  # type: ignore[attr-defined]
    assert tuple(other.snapshot().reward_terms[0]) == names


def test_training_with_a_copy_of_r1_is_training_with_r1():
    own = Training(world_with("R1", "case2"), 3, "batch")
    paper = build_world(load(scenario_path("case2"), ["reward={kind: coverage}"]), 0)
    built_in = Training(paper, 3, "batch")
    assert own.fuses and built_in.fuses
    for _ in range(3):
        assert own.play(8) == built_in.play(8)
    assert np.array_equal(own.q, built_in.q)


def test_values_are_those_of_the_scenario():
    first = Training(world_with("Careful", penalty=0.1), 0, "batch").play(4)
    other = Training(world_with("Careful", penalty=2.0), 0, "batch").play(4)
    readable = Training(world_with("Careful", penalty=2.0), 0, "des")
    assert first != other
    assert [row for _ in range(4) for row in readable.play()] == other


def test_an_engine_with_it_goes_on_in_another_memory():
    world = world_with("Careful")
    engine = BatchSimulation(world, RunSettings((True,) * 3, False))
    engine.reset(draw(world, 0, 0))
    engine.step([0, 1, 2])
    other = pickle.loads(pickle.dumps(engine))
    assert other.step([3, 3, 3]) == engine.step([3, 3, 3])


@pytest.mark.parametrize("engine", [Simulation, BatchSimulation])
def test_a_reward_that_is_too_large_is_refused_in_its_step(engine: Any):
    world = world_with("Boundless", "case1")
    one = engine(world, RunSettings((True,), False))
    one.reset(draw(world, 0, 0))
    for _ in range(3):
        one.step([4])
    with pytest.raises(SimulationError, match=r"'Boundless' gave the drones .* must be"):
        one.step([4])


@pytest.mark.parametrize("engine", [Simulation, BatchSimulation])
def test_after_such_a_step_an_engine_waits_for_the_next_episode(engine: Any):
    world = world_with("Boundless", "case1")
    one = engine(world, RunSettings((True,), False))
    one.reset(draw(world, 0, 0))
    for _ in range(3):
        one.step([4])
    with pytest.raises(SimulationError, match="'Boundless'"):
        one.step([4])
    with pytest.raises(SimulationError, match="call reset first"):
        one.step([4])
    one.reset(draw(world, 0, 1))
    one.step([4])


def test_such_a_reward_ends_an_episode_that_is_played_again_with_more_room():
    """What does not fit is played again, in which the reward is too large once more."""
    walk = "users.mobility={kind: random_walk, speed_mps: 190.0, leg_s: 2.0}"
    own = f"reward={{kind: '{__name__}:Boundless'}}"
    world = build_world(load(scenario_path("case8"), [walk, own]), 0)
    one = BatchSimulation(world, RunSettings((True,) * 3, False, keep_events=True))
    one.buffers = one.buffers._replace(log=20, crossings=8)
    one._make_room()
    one.reset(draw(world, 0, 0))
    with pytest.raises(SimulationError, match="'Boundless'"):
        for _ in range(5):
            one.step([3, 3, 3])


def test_so_it_is_in_training():
    with pytest.raises(SimulationError, match="reward 'Boundless' gave the drones"):
        Training(world_with("Boundless", "case1"), 0, "batch").play(2)


@pytest.mark.parametrize(
    ("reward", "why"), [("Named", "its field 'name' is no number"), ("Wordy", "")]
)
def test_what_cannot_be_compiled_runs_in_the_simpy_engine(reward: str, why: str):
    world = world_with(reward, "case1")
    (problem,) = lacking(world)
    assert problem.startswith(f"reward: {reward!r} is not compiled: {why}")
    assert "\n" not in problem
    said: list[str] = []
    assert engine_for(world, said.append) == "des"
    assert problem in said[0]
    one = Simulation(world, RunSettings((True,), False))
    one.reset(draw(world, 0, 0))
    assert one.step([4]).rewards == (1.0,)
    assert not math.isnan(one.measures().qoe3_percent or 0.0)


@dataclass(frozen=True)
class Sampled(RowPathLoss):
    """A loss with a kink that does not say how fast a level can change."""

    break_m: float = 300.0

    def los_db(self, distance_m: float, height_m: float, carrier_ghz: float) -> float:
        slant_m = slant_range_m(distance_m, height_m)
        return 38.5 + 20.0 * log10(slant_m) + 15.0 * max(0.0, log10(slant_m / self.break_m))


@dataclass(frozen=True)
class Bounded(Sampled):
    """The same loss with bounds."""

    def slope(self, distance_m: float, height_m: float, within_m: float) -> tuple[float, float]:
        nearest_m = slant_range_m(distance_m, height_m) - within_m
        steepest = 4.343 * 3.5 / nearest_m if nearest_m > 0.0 else math.inf
        return steepest, steepest


@pytest.mark.thorough
@pytest.mark.parametrize("three_d", [False, True])
def test_a_path_loss_has_the_same_changes_with_and_without_bounds(three_d: bool) -> None:
    logs = []
    for loss in (Sampled, Bounded):
        kind = {"kind": f"{loss.__module__}:{loss.__qualname__}"}
        radio = {"kind": "link_classes", "power_dbm": 10, "path_loss": kind}
        text = {
            "map": {"dimensions": 3 if three_d else 2},
            "drones": {"count": 3, "radio": radio | {"interference": "co_channel"}},
            "users": {"count": 12},
            "episode": {"steps": 5},
            "association": "strongest",
        }
        world = build_world(from_mapping(text), 0)
        one, other = engines(world, (True,) * 3)
        assert differences(one, other, 1, 0) == []
        logs.append((one.log.events, [row(request) for request in one.log.requests]))
    assert logs[0] == logs[1]
    assert len(logs[0][0]) > 100
