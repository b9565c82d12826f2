"""A run that is interrupted keeps each finished episode once, wherever it was."""

import pytest

from desim_uav.experiment import run as experiment
from desim_uav.policies import load_policy
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world


@pytest.fixture
def world(monkeypatch):
    monkeypatch.setattr(experiment, "BATCH", 2)
    return build_world(load(scenario_path("tiny")), 0)


def episodes_of(world, on_episode=lambda: None):
    results, interrupted = experiment.run(
        world, load_policy("hover"), "hover", 0, episodes=5, warmup=1, on_episode=on_episode
    )
    assert set(results.requests["episode"]) == set(results.episodes["episode"])
    return list(results.episodes["episode"]), interrupted


def test_batches_join(world):
    assert episodes_of(world) == ([-1, 0, 1, 2, 3, 4], False)


@pytest.mark.parametrize("after", [1, 2, 3, 4, 5])
def test_interrupted_between_episodes(world, after):
    ended = []

    def on_episode():
        ended.append(None)
        if len(ended) == after:
            raise KeyboardInterrupt

    assert episodes_of(world, on_episode) == (list(range(-1, after - 1)), True)


@pytest.mark.parametrize("call", [1, 2, 3])
def test_interrupted_while_a_batch_is_put_into_tables(world, monkeypatch, call):
    tabulate, calls = experiment._tabulate, []

    def interrupted_once(*args):
        calls.append(None)
        if len(calls) == call:
            raise KeyboardInterrupt
        return tabulate(*args)

    monkeypatch.setattr(experiment, "_tabulate", interrupted_once)
    assert episodes_of(world) == (list(range(-1, 2 * call - 1)), True)
