"""Training in the compiled engine learns what the readable learners learn, bit for bit."""

from __future__ import annotations

import pytest

from desim_uav.engine.compiled import BatchSimulation, simulation
from desim_uav.errors import SimulationError
from desim_uav.learning.training import Training
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world

SHORT = "drones.battery.autonomy_min=9"
WORLDS = {
    "case1 expected_sarsa": [],
    "case3 double_q": [],
    "case4 double_q": ["learning.restart_every=null"],
    "case5 sarsa": ["learning.initial_q=random"],
    "case6 q_learning": [],
    "case8 q_learning": [],
    "case8 sarsa": ["episode.carry_over=false"],
    "case9 expected_sarsa": [SHORT, "drones.battery.respawn_after_min=0"],
    "case9 q_learning": [SHORT, "drones.battery.on_crash=remove"],
    "case9 sarsa": [SHORT, "drones.battery.on_crash=end_episode"],
}


def training(name: str, engine: str, seed: int = 4) -> Training:
    case, algorithm = name.split()
    chosen = [f"learning.algorithm={algorithm}", *WORLDS[name]]
    return Training(build_world(load(scenario_path(case), chosen), seed), seed, engine)


def assert_same(one: Training, other: Training) -> None:
    assert (one.q == other.q).all()
    first, second = one.remember(), other.remember()
    assert (first.episode, first.pending) == (second.episode, second.pending)
    assert first.carried == second.carried


@pytest.mark.parametrize("name", WORLDS)
def test_the_same_is_learned(name: str):
    one, other = training(name, "des"), training(name, "batch")
    assert other.fuses and not one.fuses
    before = one.q.copy()
    for _ in range(25):
        assert one.play() == other.play()
        assert_same(one, other)
    assert (one.q != before).any()


def test_either_goes_on_where_the_other_has_stopped():
    name = "case9 expected_sarsa"
    one, other = training(name, "des"), training(name, "batch")
    for _ in range(4):
        for _ in range(5):
            one.play()
        other.recall(one.remember())
        for _ in range(5):
            other.play()
        one.recall(other.remember())
    undisturbed = training(name, "batch")
    for _ in range(40):
        undisturbed.play()
    assert_same(one, undisturbed)


def test_what_is_not_compiled_learns_in_the_compiled_engine_all_the_same():
    readable, fused = training("case8 q_learning", "batch"), training("case8 q_learning", "batch")
    readable.fuses = False
    assert isinstance(readable.engine, BatchSimulation)
    for _ in range(10):
        assert readable.play() == fused.play()
        assert_same(readable, fused)


def test_a_leg_with_more_crossings_than_there_is_room_for_is_told(monkeypatch: pytest.MonkeyPatch):
    """Nothing is learned from an episode that was not simulated whole."""
    monkeypatch.setattr(simulation, "CROSSINGS_A_USER", 0)
    changes = ["users.count=300", "drones.count=1", "drones.bandwidth_kbps=null"]
    crowded = Training(build_world(load(scenario_path("case3"), changes), 0), 0, "batch")
    assert crowded.fuses
    with pytest.raises(SimulationError, match=r"has more than 16 crossings; --engine des has room"):
        for _ in range(20):
            crowded.play()
