"""Where a scenario comes from, and how it is changed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from desim_uav.env import UavEnv, UavParallelEnv
from desim_uav.env.configure import configured
from desim_uav.errors import DesimError, ScenarioError
from desim_uav.scenario.load import dump, from_mapping, load
from desim_uav.shipped import scenario_path


def test_a_scenario_is_a_file_a_name_a_mapping_or_itself(tmp_path: Path):
    expected = load(scenario_path("case8"))
    file = tmp_path / "mine.yaml"
    file.write_text(dump(expected), encoding="utf-8")
    plain = {"name": "case8", "episode": {"carry_over": True}}
    for source in ("case8", scenario_path("case8"), str(scenario_path("case8")), file, expected):
        assert configured(source) == expected
    assert configured(plain).episode == expected.episode
    assert UavParallelEnv(expected).session.scenario is expected


@pytest.mark.parametrize(
    "config",
    [
        {"drones.count": 5, "users.mobility.speed_mps": 2.5, "map.cells": [8, 12]},
        {"drones": {"count": 5}, "users": {"mobility": {"speed_mps": 2.5}}, "map.cells": (8, 12)},
        {"drones": {"count": np.int64(5)}, "users.mobility": {"speed_mps": np.float64(2.5)},
         "map": {"cells": np.array([8, 12])}},
    ],
)  # fmt: skip
@pytest.mark.parametrize("given", ["name", "scenario", "mapping"])
def test_config_changes_keys_and_leaves_the_rest(config: dict[str, Any], given: str):
    case = load(scenario_path("case8"))
    mapping = {"drones": {"bandwidth_kbps": 5000}, "episode": {"carry_over": True}}
    source = {"name": "case8", "scenario": case, "mapping": mapping}[given]
    scenario = configured(source, config)
    assert scenario.drones.count == 5
    assert scenario.users.mobility.speed_mps == 2.5
    assert scenario.map.cells == (8, 12)
    assert scenario.users.mobility.leg_s == case.users.mobility.leg_s
    assert scenario.episode.carry_over


def test_a_component_with_its_kind_replaces_another():
    scenario = configured("case8", {"demand": {"kind": "poisson", "rate_per_hour": 3}})
    assert scenario.demand.rate_per_hour == 3
    named = configured("case8", {"users": {"mobility": {"kind": "static"}}})
    assert named.users.mobility.kind == "static"
    assert named.users.count == 48


def test_null_and_text_are_values():
    assert configured("case8", {"drones.bandwidth_kbps": None}).drones.bandwidth_kbps is None
    assert configured("case8", {"name": "on"}).name == "on"


def test_only_a_seed_that_was_given_is_the_scenarios_own():
    assert "seed" not in configured("case8", {"drones.count": 2}).model_fields_set
    unseeded, seeded = from_mapping({}), from_mapping({"seed": 0})
    assert "seed" not in configured(unseeded, {"drones.count": 2}).model_fields_set
    assert "seed" in configured(seeded, {"drones.count": 2}).model_fields_set


@pytest.mark.parametrize(
    ("config", "told"),
    [
        ({"drones.cuont": 5}, "did you mean 'count'"),
        ({"drones": {"cuont": 5}}, "did you mean 'count'"),
        ({"dornes": {"count": 5}}, "did you mean 'drones'"),
        ({"drones.count": 0}, "drones.count"),
        ({"drones.count": "many"}, "drones.count"),
        ({"users": {"mobility": {"kind": "random_wlk"}}}, "did you mean 'random_walk'"),
        (
            {"drones.count": object()},
            "drones.count: a value of type object cannot be written in YAML",
        ),
        ({"drones": {3: 4}}, "key 3"),
        ({"drones.count=1": 4}, "key 'drones.count=1'"),
        ({"": 4}, "key.path=value"),
    ],
)
def test_what_config_refuses(config: dict[Any, Any], told: str):
    for source in ("case8", {}, load(scenario_path("case8"))):
        for env in (UavEnv, UavParallelEnv):
            with pytest.raises(DesimError) as caught:
                env(source, config)
            assert told in str(caught.value)


def test_every_problem_is_told_at_once():
    with pytest.raises(ScenarioError) as caught:
        UavEnv("case8", {"drones": {"count": 0, "cuont": 5}, "seed": -1})
    assert len(caught.value.problems) == 3


def test_an_unknown_scenario():
    with pytest.raises(ScenarioError, match="did you mean 'case8'"):
        UavEnv("case88")
