"""Independent learners in whole scenarios: determinism, memory, restarts, and what they learn."""

from typing import Any

import numpy as np
import pytest

from desim_uav.engine.des import Simulation
from desim_uav.errors import PolicyError, UsageError
from desim_uav.learning.checkpoint import Checkpoint, read, to_bytes
from desim_uav.learning.training import FIRST_PATH, Training, table_features
from desim_uav.model.rules import Action, Mode
from desim_uav.scenario.learning import ALGORITHMS
from desim_uav.scenario.load import from_mapping, load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.selection import by_default

SMALL: dict[str, Any] = {
    "map": {"size_m": [960, 960], "cells": [4, 4], "dimensions": 2},
    "drones": {
        "count": 2,
        "footprint_radius_m": 200,
        "battery": {"autonomy_min": 7, "return_below": 0.6, "respawn_after_min": 1},
    },
    "stations": {"count": 1, "radius_m": 0, "full_charge_min": 3},
    "users": {"count": 6, "clusters": {"count": 2, "radius_m": [100, 200]}},
    "demand": {"kind": "dynamic", "think_time_s": 60},
    "episode": {"steps": 12, "carry_over": True},
    "position_noise": {"probability": 0.2, "sigma_cells": 1},
}


def training(seed: int = 0, base: dict[str, Any] = SMALL, **learning: Any) -> Training:
    settings = {"episodes": 50, "initial_q": "zero", **learning}
    scenario = from_mapping({**base, "seed": seed, "learning": settings})
    return Training(build_world(scenario, seed), seed)


def logged(learner: Training) -> Training:
    """A training whose engine keeps its steps."""
    learner.engine = Simulation(learner.world, learner.engine.settings._replace(keep_steps=True))
    return learner


def played(learner: Training, episodes: int) -> list[Any]:
    return [row for _ in range(episodes) for row in learner.play()]


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_same_seed_learns_the_same(algorithm: str):
    one, other = training(algorithm=algorithm), training(algorithm=algorithm)
    assert played(one, 30) == played(other, 30)
    assert (one.q == other.q).all()
    assert (one.q != 0).any()


def test_another_seed_or_algorithm_learns_something_else():
    tables = [training(seed=1), training(), *(training(algorithm=a) for a in ALGORITHMS[1:])]
    for table in tables:
        played(table, 30)
    sums = [float(np.abs(table.q).sum()) for table in tables]
    assert len(set(sums)) == len(sums)


@pytest.mark.thorough
@pytest.mark.parametrize("algorithm", ["q_learning", "double_q"])
@pytest.mark.parametrize("restart_every", [None, 7])
def test_another_training_goes_on_as_if_nothing_had_happened(algorithm, restart_every, tmp_path):
    """Bit for bit, after each of many episodes, by way of a checkpoint's file."""
    settings = {"algorithm": algorithm, "restart_every": restart_every, "initial_q": "random"}
    whole = training(**settings)
    modes = set()
    for episode in range(24):
        memory = whole.remember()
        rows = whole.play()
        modes |= {drone.mode for drone in memory.carried or ()}
        path = tmp_path / f"{episode}.npz"
        path.write_bytes(to_bytes(Checkpoint("mine", memory, rows)))
        found = read(path)
        assert found.identity == "mine" and found.rows == rows
        resumed = training(**settings)
        resumed.recall(found.memory)
        assert resumed.play() == rows
        assert (resumed.q == whole.q).all()
        after, expected = resumed.remember(), whole.remember()
        assert after.carried == expected.carried and after.pending == expected.pending
    if restart_every is None:
        assert len(modes) > 2, "drones on their way, charging or crashed were carried over"


def test_the_table_of_another_training_is_refused():
    other = training(base={**SMALL, "position_noise": None, "stations": {"count": 2}})
    other.q = np.zeros((1, 1, 2, 3), np.float32)
    with pytest.raises(PolicyError, match="shape"):
        training().recall(other.remember())


def test_drones_begin_at_their_starts_every_so_many_episodes():
    learner = training(restart_every=4)
    carried = []
    for _ in range(12):
        carried.append(learner.engine.carried() is not None)
        learner.play()
    assert carried == [episode % 4 != 0 for episode in range(12)]
    never = training(restart_every=None)
    played(never, 5)
    assert never.engine.carried() is not None


def test_without_carry_over_nothing_is_left_open():
    base = {**SMALL, "episode": {"steps": 12, "carry_over": False}}
    learner = training(base=base)
    for _ in range(5):
        learner.play()
        memory = learner.remember()
        assert memory.carried is None and [one.state for one in memory.pending] == [-1, -1]


def test_paths_are_not_those_of_a_run():
    learner = training()
    learner.play()
    assert learner.engine.log.episode == FIRST_PATH
    assert FIRST_PATH > 10**6


def test_rows_say_what_happened():
    learner = logged(training(epsilon={"start": 0.5, "decay": 0.5, "end": 0.2}, alpha=0.25))
    rows = played(learner, 4)
    assert [(row.episode, row.drone) for row in rows] == [(e, d) for e in range(4) for d in (0, 1)]
    assert [row.epsilon for row in rows[::2]] == [0.5, 0.25, 0.2, 0.2]
    assert {row.alpha for row in rows} == {0.25}
    steps = learner.engine.log.steps
    for row in rows[-2:]:
        assert row.reward == pytest.approx(sum(s.reward for s in steps if s.drone == row.drone))
        assert row.crashes == learner.engine.log.crashed.count(row.drone)
        assert row.mean_q == pytest.approx(float(learner.q[row.drone].mean()), abs=1e-7)
        assert 0 <= row.qoe3_percent <= 100


CHARGER: dict[str, Any] = {
    "map": {"size_m": [720, 240], "cells": [3, 1], "dimensions": 2},
    "drones": {
        "count": 1,
        "footprint_radius_m": 100,
        "start_cells": [[1, 0]],
        "battery": {"autonomy_min": 8, "return_below": 1.0},
    },
    "stations": {"count": 1, "radius_m": 0, "full_charge_min": 2},
    "users": {"positions_m": [[600, 120]], "mobility": {"kind": "static"}},
    "demand": {"kind": "continuous"},
    "reward": {"kind": "coverage"},
    "episode": {"steps": 30, "carry_over": True},
}


@pytest.mark.thorough
def test_going_home_gets_its_value_through_the_forced_steps():
    """A user on the east cell, a station in the middle, 8 minutes of battery.

    The best is to hover over the user, to go home in time and to come back: going home from the
    user's cell is worth γ^k of the value of the station's cell on a full battery, k the steps until
    the drone decides again, for which it gets nothing.
    """
    learner = training(
        base=CHARGER,
        alpha={"start": 0.5, "decay": 0.999, "end": 0.05},
        epsilon={"start": 1, "decay": 0.997, "end": 0.2},
        restart_every=None,
    )
    played(learner, 1500)
    world = learner.world
    q = learner.q[0, 0].reshape(3, 1, 9, len(world.actions))
    home = world.actions.index(Action.GOTO_CHARGING_STATION)
    right = world.actions.index(Action.RIGHT)
    full = q[1, 0, 8].max()
    assert q[1, 0, 8].argmax() == right, "from the full battery to the user"
    for battery in (2, 3, 4):
        # 31 s of flight, then the charge of what is missing: 2 min for all 8.
        missing_min = 8 - (battery - 31 / 60)
        forced = 31 / 60 + missing_min / 8 * 2
        k = int(np.ceil(forced))
        assert q[2, 0, battery, home] == pytest.approx(0.95**k * full, rel=0.15)
    assert (q[2, 0, 1].argmax(), q[2, 0, 1, home] > 0) == (home, True)


@pytest.mark.parametrize("restart_every", by_default([], [3, 1, None], at_most=1))
def test_a_way_home_that_is_cut_off_teaches_nothing_wrong(restart_every: int | None):
    """A slow charge is often cut off by a restart; what is learned is still γ^k of what follows."""
    base = {**CHARGER, "stations": {**CHARGER["stations"], "full_charge_min": 8}}
    learner = training(
        base=base,
        alpha={"start": 0.5, "decay": 0.999, "end": 0.05},
        epsilon={"start": 1, "decay": 0.998, "end": 0.3},
        restart_every=restart_every,
    )
    played(learner, 2500)
    q = learner.q[0, 0].reshape(3, 1, 9, -1)
    home = learner.world.actions.index(Action.GOTO_CHARGING_STATION)
    full = q[1, 0, 8].max()
    for battery in (3, 4):
        k = int(np.ceil(31 / 60 + (8 - (battery - 31 / 60))))
        assert q[2, 0, battery, home] == pytest.approx(0.95**k * full, rel=0.04)


@pytest.mark.thorough
def test_a_drone_that_is_removed_has_nothing_to_come():
    battery = {"autonomy_min": 8, "return_below": 0.001, "on_crash": "remove"}
    base = {**CHARGER, "drones": {**CHARGER["drones"], "battery": battery}}
    learner = training(base=base, alpha=0.5, epsilon=1.0, restart_every=2)
    played(learner, 400)
    q = learner.q[0, 0].reshape(3, 1, 9, -1)
    hover = learner.world.actions.index(Action.HOVER)
    assert (q[2, 0, 1, :4] == 0).all(), "the last minute ends in a crash"
    assert q[2, 0, 2, hover] == pytest.approx(1.0, abs=1e-2)


def test_a_crash_that_ends_everything_is_worth_what_came_before():
    base = {
        **CHARGER,
        "drones": {
            **CHARGER["drones"],
            "battery": {"autonomy_min": 8, "return_below": 0.001, "on_crash": "end_episode"},
        },
        "reward": {"kind": "coverage"},
    }
    learner = logged(training(base=base, alpha=0.5, epsilon=1.0))
    crashes = 0
    for _ in range(300):
        (row,) = learner.play()
        crashes += row.crashes
        assert row.crashes == (learner.engine.log.steps[-1].mode is Mode.CRASHED)
    assert crashes > 200
    q = learner.q[0, 0].reshape(3, 1, 9, -1)
    hover = learner.world.actions.index(Action.HOVER)
    assert (q[:, :, 0] == 0).all(), "nobody decides on an empty battery"
    assert (q[2, :, 1] == 0).all(), "the last minute ends in a crash, for which R1 gives nothing"
    assert q[2, 0, 2, hover] == pytest.approx(1.0, abs=1e-3), "one step with the user, then the end"


@pytest.mark.parametrize("case", [f"case{n}" for n in range(1, 10)])
def test_tables_are_small(case: str):
    scenario = load(scenario_path(case), ["learning.algorithm=double_q"])
    learner = Training(build_world(scenario, 0), 0)
    assert learner.q.dtype == np.float32
    assert learner.q[:, 0].nbytes <= 2 * 2**20


def test_an_observation_that_is_no_state_of_a_table():
    scenario = from_mapping({"observation": {"kind": "local"}})
    with pytest.raises(UsageError, match="'local' does not consist of whole numbers"):
        table_features(build_world(scenario, 0))


def test_a_table_that_would_not_fit():
    scenario = from_mapping({"drones": {"battery": {"autonomy_min": 1_000_000}}})
    with pytest.raises(UsageError, match="GiB; at most 2"):
        table_features(build_world(scenario, 0))
