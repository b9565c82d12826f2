"""Training in the compiled engine learns what the readable learners learn, bit for bit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numba.core.errors import UnsupportedBytecodeError

from desim_uav.engine.choose import ENGINES
from desim_uav.engine.compiled import BatchSimulation, simulation
from desim_uav.errors import SimulationError
from desim_uav.learning.q_learning import QLearning
from desim_uav.learning.training import Training
from desim_uav.model.observations import Feature, RowObservation
from desim_uav.model.state import Facts
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.engine.test_store_memory import filling
from tests.selection import by_default

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
    chosen = [f"learning.algorithm={algorithm}", *WORLDS.get(name, [])]
    return Training(build_world(load(scenario_path(case), chosen), seed), seed, engine)


def assert_same(one: Training, other: Training) -> None:
    assert (one.q == other.q).all()
    first, second = one.remember(), other.remember()
    assert (first.episode, first.pending) == (second.episode, second.pending)
    assert first.carried == second.carried


@pytest.mark.parametrize("name", by_default(["case8 q_learning"], WORLDS))
def test_the_same_is_learned(name: str):
    one, other = training(name, "des"), training(name, "batch")
    assert other.fuses and not one.fuses
    before = one.q.copy()
    for _ in range(25):
        assert one.play() == other.play()
        assert_same(one, other)
    assert (one.q != before).any()


@pytest.mark.parametrize("at_once", [1, 3])
def test_stores_of_drones_have_memory_for_all_updates(at_once: int):
    """Compiled training cannot play an episode again, so the memory of stores is foreseen."""
    one, other = (Training(filling(), 0, engine) for engine in ENGINES)
    assert isinstance(other.engine, BatchSimulation) and other.fuses
    before = other.engine.buffers.log
    rows = [[row for _ in range(3) for row in one.play()]]
    rows.append([row for _ in range(3 // at_once) for row in other.play(at_once)])
    assert rows[0] == rows[1]
    assert_same(one, other)
    stores = [len(sender.store) for sender in other.engine.state.senders]
    assert max(stores) > before


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


class Copied:
    """SARSA once more."""

    tables = 1

    @staticmethod
    def update(q: Any, lesson: Any) -> None:
        old = q[0, lesson.state, lesson.action]
        target = lesson.gained + lesson.discount * q[0, lesson.next_state, lesson.next_action]
        q[0, lesson.state, lesson.action] += lesson.alpha * (target - old)


class Entangled:
    """Two tables whose values are computed with each other, and changes of another action too."""

    tables = 2

    @staticmethod
    def update(q: Any, lesson: Any) -> None:
        state, action, other = lesson.state, lesson.action, 0 if lesson.action else 1
        apart = q[0, state, action] - q[1, state, action]
        following = q[0, lesson.next_state, lesson.next_action] * (1 - lesson.epsilon) / 3
        target = lesson.gained + lesson.discount * following + 0.1 * apart
        learns = 0 if lesson.coin < 0.7 else 1
        q[learns, state, action] += lesson.alpha * (target - q[1 - learns, state, other])
        q[1, state, other] = q[1, state, other] * 0.9 - q[0, state, other] * 0.1


class Wordy(QLearning):
    """Q-learning that compiled code cannot run."""

    @staticmethod
    def update(q: Any, lesson: Any) -> None:
        QLearning.update(q, {"lesson": lesson}[f"les{'son'}"])


class Astray(QLearning):
    """Writes where there is no value."""

    @staticmethod
    def update(q: Any, lesson: Any) -> None:
        beyond = len(lesson.allowed)  # where the first action of the next state is
        q[0, 0, beyond] = 1.0


@dataclass(frozen=True)
class Crowd(RowObservation):
    """The cell, and up to ``most`` attached users."""

    most: int = 2

    def features(self, facts: Facts) -> tuple[Feature, ...]:
        nx, ny = facts.grid.cells
        highest = {"cell_x": nx - 1, "cell_y": ny - 1, "users": 2}
        return tuple(Feature(name, 0, high, True) for name, high in highest.items())

    def write(self, world: Any, state: Any, drone: Any) -> None:
        observation, out = state.observations[drone.index], drone.features
        out[0], out[1], out[2] = (
            observation.x,
            observation.y,
            min(observation.attached_users, self.most),
        )


def own(algorithm: type, case: str = "case8") -> str:
    return f"{case} {__name__}:{algorithm.__name__}"


@pytest.mark.parametrize("algorithm", [Copied, Entangled])
def test_an_algorithm_of_ones_own_is_compiled(algorithm: type):
    one, other = training(own(algorithm), "des"), training(own(algorithm), "batch")
    assert other.fuses and not one.fuses
    for _ in range(10):
        assert one.play() == other.play()
        assert_same(one, other)
    values = one.q[0].sum(dtype=np.float64)
    assert one.learners[0].q.sum == pytest.approx(values, rel=1e-9)


def test_a_copy_of_sarsa_learns_as_sarsa():
    one, other = training(own(Copied, "case2"), "batch"), training("case2 sarsa", "batch")
    assert one.play(8) == other.play(8)
    assert (one.q == other.q).all()


def test_what_is_not_compiled_learns_in_the_compiled_engine_all_the_same(capsys):
    readable, fused = training(own(Wordy), "batch"), training("case8 q_learning", "batch")
    told = capsys.readouterr().err
    assert f"'{__name__}:Wordy' is not compiled, so training is slower: " in told
    assert told.count("\n") == 1
    assert isinstance(readable.engine, BatchSimulation) and not readable.fuses
    for _ in range(10):
        assert readable.play() == fused.play()
        assert_same(readable, fused)


def test_bytecode_that_numba_does_not_know_is_a_reason_too(capsys, monkeypatch):
    """As Python 3.12 has it for ``super()``; Numba's error is none of its NumbaErrors."""

    def refuse(algorithm: Any) -> int:
        raise UnsupportedBytecodeError("Use of unsupported opcode (LOAD_SUPER_ATTR) found")

    monkeypatch.setattr("desim_uav.learning.fused.compiled_update", refuse)
    assert not training("case8 q_learning", "batch").fuses
    assert "is not compiled, so training is slower: Use of unsupp" in capsys.readouterr().err


def test_no_other_memory_is_read_or_written():
    astray = training(own(Astray), "batch")
    before = astray.q.copy()
    with pytest.raises(SimulationError, match=r":Astray' failed: IndexError: .* for the actions"):
        astray.play(5)
    assert astray.fuses and (astray.q == before).all()


def observing(engine: str, most: int) -> Training:
    changes = [f"observation={{kind: '{__name__}:Crowd', most: {most}}}", "users.count=40"]
    return Training(build_world(load(scenario_path("case8"), changes), 0), 0, engine)


def test_an_observation_of_ones_own_is_compiled():
    one, other = observing("des", 2), observing("batch", 2)
    assert other.fuses
    for _ in range(5):
        assert one.play() == other.play()
        assert_same(one, other)


@pytest.mark.parametrize("engine", ["des", "batch"])
def test_a_state_that_a_table_does_not_have_is_told(engine: str):
    crowded = observing(engine, 40)
    with pytest.raises(SimulationError, match=r"observation: \(.*\) is outside the bounds"):
        for _ in range(20):
            crowded.play()


@pytest.mark.thorough
def test_there_is_room_for_users_who_cross_many_rings_in_a_leg():
    """All users stand together, so that each ring passes all of them at about the same time."""
    homes = ", ".join(["[1200, 1200]"] * 40)
    changes = [
        f"users={{positions_m: [{homes}], mobility: {{kind: static}}}}",
        "drones={count: 1, start_cells: [[4, 4]], radio: {kind: link_classes, power_dbm: 7}}",
        *("reward={kind: coverage}", "demand.think_time_s=30"),
    ]
    world = build_world(load(scenario_path("case8"), changes), 0)
    one, other = Training(world, 0, "des"), Training(world, 0, "batch")
    assert other.fuses
    for _ in range(5):
        assert one.play() == other.play()
        assert_same(one, other)


def test_there_is_room_for_all_users_in_the_footprints_of_many_drones_at_once():
    drones = ["drones.count=20", f"drones.start_cells={[[5, 5]] * 20}"]
    scenario = load(scenario_path("case8"), [*drones, "drones.footprint_radius_m=20000"])
    training = Training(build_world(scenario, 0), 0, "batch")
    assert training.fuses
    assert len(training.play(1)) == 20


def test_a_leg_with_more_crossings_than_there_is_room_for_is_told(monkeypatch: pytest.MonkeyPatch):
    """Nothing is learned from an episode that was not simulated whole."""
    monkeypatch.setattr(simulation, "CROSSINGS_A_USER", 0)
    changes = ["users.count=300", "drones.count=1", "drones.bandwidth_kbps=null"]
    crowded = Training(build_world(load(scenario_path("case3"), changes), 0), 0, "batch")
    assert crowded.fuses
    with pytest.raises(SimulationError, match=r"has more than 16 crossings; --engine des has room"):
        for _ in range(20):
            crowded.play()
