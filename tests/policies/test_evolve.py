"""The evolution strategy that learns the few numbers of dispatchers and planners."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest

from desim_uav.experiment.bench.tasks import find_task
from desim_uav.policies import dispatcher, load_policy, planner
from desim_uav.scenario.load import from_mapping, load

ROOT = Path(__file__).parents[2]
TASK = find_task("uav-v1/dispatch/small").path

SMALL = {
    "map": {"size_m": [720, 720], "cells": [3, 3], "dimensions": 2},
    "drones": {"count": 2, "battery": {"autonomy_min": 8}},
    "stations": {"count": 1},
    "users": {"count": 4, "clusters": {"count": 1}},
    "demand": {"kind": "dynamic", "think_time_s": 60},
    "episode": {"steps": 5, "carry_over": True},
}


@pytest.fixture(scope="module")
def trainer() -> Any:
    spec = importlib.util.spec_from_file_location("evolve_script", ROOT / "policies/evolve.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.thorough
def test_a_training_is_the_same_again_and_keeps_to_its_steps(trainer: Any, tmp_path: Path) -> None:
    contents = []
    for name in ("one.npz", "two.npz"):
        asked = ["--population", "4", "--episodes", "1", "--steps", "1500", "--out"]
        assert trainer.main([str(TASK), *asked, str(tmp_path / name)]) == 0
        contents.append(load_policy(str(tmp_path / name)).weights)  # type: ignore[attr-defined]
    assert contents[0] == contents[1] != dispatcher.WEIGHTS


def test_all_of_a_generation_fly_in_the_same_training_worlds(
    trainer: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two generations of four planners in two worlds of five steps are 80 steps."""
    scenario, flights, kept = from_mapping(SMALL), [], []
    flown = trainer.flown

    def noted(world: Any, policy: Any, seed: int, episodes: int) -> Any:
        flights.append((world.seed, seed, tuple(policy.weights.values())))
        return flown(world, policy, seed, episodes)

    monkeypatch.setattr(trainer, "flown", noted)
    options = trainer.options_of(worlds="train", population=4, many=2, episodes=1, steps=80)
    mean = trainer.train(scenario, options, lambda kind, weights, steps: kept.append(steps))
    assert kept == [40, 80]
    generations = [flights[:8], flights[8:]]
    for flights in generations:
        assert [(world, seed) for world, seed, _ in flights] == [one[:2] for one in flights[:2]] * 4
        assert len({weights for *_, weights in flights}) == 4
        assert all(1_000_000 <= world < 1_001_024 for world, *_ in flights)
    first, second = ({world for world, *_ in flights} for flights in generations)
    assert len(first) == len(second) == 2 and not first & second
    assert dict(zip(planner.WEIGHTS, mean, strict=True)) != planner.WEIGHTS


def test_the_kind_follows_from_how_drones_fly(trainer: Any) -> None:
    assert trainer.kind_of(load(TASK)) is dispatcher
    assert trainer.kind_of(from_mapping(SMALL)) is planner


@pytest.mark.parametrize(
    "asked", [[str(TASK), "-S", "wind_mps=[1, 0]"], [str(TASK), "--population", "3"]]
)
def test_what_cannot_be_trained_ends_with_code_2(
    trainer: Any, tmp_path: Path, asked: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert trainer.main([*asked, "--out", str(tmp_path / "none.npz")]) == 2
    assert "must be" in capsys.readouterr().err
    assert not (tmp_path / "none.npz").exists()
