"""Every table of the frozen runs and trainings is the one that was frozen, bit for bit."""

from __future__ import annotations

from typing import Any

import pandas as pd
import pytest

from desim_uav.records import REQUESTS
from desim_uav.scenario.load import load, to_plain
from desim_uav.shipped import scenario_path
from tests.frozen.digest import of_table
from tests.frozen.known import circumstances, differences, known
from tests.frozen.programs import (
    ENGINES,
    POLICIES,
    SEEDS,
    TRAINED,
    Episode,
    Run,
    Training,
    episodes,
    programs,
    runs,
    trainings,
)
from tests.frozen.scenarios import CASES, SCENARIOS, of_name

QUICK = {"des": "random", "batch": "learned"}
"""The policy that runs by default in each engine."""


def check(chosen: list[Run] | list[Training], engine: str) -> None:
    found = differences("digests", chosen, (engine,))
    assert not found, "\n".join([*found, *circumstances("digests")])


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("engine", ENGINES)
def test_a_run_of_each_case(engine: str, case: str):
    check([Run(case, QUICK[engine], 0)], engine)


@pytest.mark.parametrize("algorithm", range(4))
def test_a_training_with_each_algorithm(algorithm: int):
    check([trainings("case8")[algorithm]], "batch")


@pytest.mark.thorough
@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("engine", ENGINES)
def test_every_policy_on_one_seed(engine: str, scenario: str):
    check(runs(scenario, seeds=[0]), engine)


@pytest.mark.thorough
@pytest.mark.parametrize("scenario", TRAINED)
@pytest.mark.parametrize("engine", ENGINES)
def test_every_training(engine: str, scenario: str):
    check(trainings(scenario), engine)


@pytest.mark.thorough
@pytest.mark.parametrize("program", [*episodes()], ids=str)
def test_an_episode_of_every_scenario(program: Episode):
    engines = ENGINES if is_small(program) else ("batch",)
    found = differences("episodes", [program], engines)
    assert not found, "\n".join([*found, *circumstances("episodes")])


@pytest.mark.slow
@pytest.mark.parametrize("program", [*episodes()], ids=str)
def test_an_episode_of_every_scenario_in_both_engines(program: Episode):
    if not is_small(program):
        assert not differences("episodes", [program], ENGINES)


def is_small(program: Episode) -> bool:
    return isinstance(program.scenario, int) or not program.scenario.startswith("bench")


@pytest.mark.slow
@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("engine", ENGINES)
def test_every_policy_on_every_seed(engine: str, scenario: str):
    check(runs(scenario), engine)


# ---- that these tests can fail


def test_everything_is_frozen():
    frozen = known("digests")["programs"]
    assert list(frozen) == [str(program) for program in programs()]
    of_runs, of_trainings = len(SCENARIOS) * len(POLICIES) * len(SEEDS), 4 * len(TRAINED)
    assert len(frozen) == of_runs + of_trainings
    assert list(known("episodes")["programs"]) == [str(episode) for episode in episodes()]


KINDS = {
    "demand.kind": {"continuous", "static", "dynamic", "poisson", "trace"},
    "users.mobility.kind": {"static", "random_walk", "trace"},
    "reward.kind": {"coverage", "coverage_battery", "multi_service"},
    "drones.motion.timing": {"fill_epoch", "minimum_time"},
    "drones.battery.on_crash": {"respawn", "remove", "end_episode"},
    "episode.carry_over": {True, False},
    "map.dimensions": {2, 3},
    "stations.pads": {1, 2},
}


@pytest.mark.parametrize("key", KINDS)
def test_every_kind_is_frozen(key: str):
    found = set()
    for name in SCENARIOS:
        case, changes = of_name(name)
        value: Any = to_plain(load(scenario_path(case), changes))
        for part in key.split("."):
            value = None if value is None else value[part]
        found.add(value)
    assert KINDS[key] <= found


def test_a_difference_is_named(monkeypatch: pytest.MonkeyPatch):
    run = Run("case1", "baseline", 0)
    frozen = known("digests")["programs"][str(run)]
    other = known("digests") | {"programs": {str(run): frozen | {"steps": "0" * 16}}}
    monkeypatch.setattr("tests.frozen.known.known", lambda name: other)
    (found,) = differences("digests", [run], ("batch",))
    assert found.startswith("case1, baseline, seed 0, engine batch: the table 'steps'")


ROW = {
    "int64": 3,
    "float64": 0.1,
    "str": "data_gathering",
    "object": [0, 2],
    "Int64": 4,
    "bool": True,
}


def table(**values: object) -> pd.DataFrame:
    """Two requests, of which the second one has these values."""
    rows = [{name: ROW[dtype] for name, dtype in REQUESTS.items()} for _ in range(2)]
    rows[1] |= values
    return pd.DataFrame(rows)


@pytest.mark.parametrize(
    "change",
    [
        {"user": 2},
        {"qoe1": 0.1 + 2**-56},
        {"wait_s": float("nan")},
        {"outcome": "data_gatherin"},
        {"drones": [2, 0]},
        {"drones": [0]},
    ],
    ids=str,
)
def test_the_smallest_change_of_a_value_changes_the_digest(change: dict[str, object]):
    assert of_table(table(**change), REQUESTS) != of_table(table(), REQUESTS)
