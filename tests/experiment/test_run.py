"""A run is put into tables batch by batch; one that is interrupted keeps each finished episode."""

import os
import signal
import time

import pandas as pd
import pytest

from desim_uav.experiment import command
from desim_uav.experiment import run as experiment
from desim_uav.policies import load_policy
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.run_to_folder import run_to_folder


@pytest.fixture(autouse=True)
def small_batches(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(experiment, "BATCH", 2)


def kept(episodes=5, warmup=1):
    """The episodes that a run has kept, and whether it was interrupted."""
    done = run_to_folder(
        load(scenario_path("tiny")),
        "hover",
        episodes=episodes,
        warmup=warmup,
        keep_events=True,
        out=None,
        command=[],
    )
    folder = done.summary["run_dir"]
    found = {
        name: list(dict.fromkeys(pd.read_parquet(f"{folder}/{name}.parquet")["episode"]))
        for name in ("requests", "steps", "episodes", "users", "events", "legs")
    }
    assert all(numbers == found["episodes"] for numbers in found.values())
    assert done.summary["episodes"] == len([number for number in found["episodes"] if number >= 0])
    return found["episodes"], done.interrupted


def interrupt():
    os.kill(os.getpid(), signal.SIGINT)


def after(calls, action, do):
    """``do``, with an action before one of its calls."""
    told = iter(range(1, 100))

    def done(*given):
        if next(told) == calls:
            action()
        return do(*given)

    return done


def test_batches_join():
    world = build_world(load(scenario_path("tiny")), 0)
    results = experiment.run(world, load_policy("hover"), "hover", 0, episodes=5, warmup=1)
    assert list(results.episodes["episode"]) == [-1, 0, 1, 2, 3, 4]
    assert set(results.requests["episode"]) == set(results.episodes["episode"])
    assert kept() == ([-1, 0, 1, 2, 3, 4], False)


@pytest.mark.parametrize("calls", [2, 3, 4, 5])
def test_interrupted_in_an_episode(monkeypatch, calls):
    """It is finished, and kept."""
    monkeypatch.setattr(experiment, "draw", after(calls, interrupt, experiment.draw))
    assert kept() == (list(range(-1, calls - 1)), True)


@pytest.mark.parametrize("calls", [1, 2, 3])
@pytest.mark.parametrize("times", [1, 2, 3])
def test_interrupted_while_a_batch_is_put_into_tables(monkeypatch, calls, times):
    """Batches are put down as a whole, however often one asks for the end."""

    def insist():
        for _ in range(times):
            interrupt()

    monkeypatch.setattr(command.run, "tabulate", after(calls, insist, command.run.tabulate))
    assert kept() == (list(range(-1, 2 * calls - 1)), calls < 3)


@pytest.mark.parametrize("times", [1, 2, 3])
def test_interrupted_while_the_last_ones_are_put_into_tables(monkeypatch, times):
    """All is there by then."""

    def insist():
        for _ in range(times):
            interrupt()

    monkeypatch.setattr(command.run, "tabulate", after(3, insist, command.run.tabulate))
    assert kept(episodes=4) == ([-1, 0, 1, 2, 3], False)


def test_the_second_time_it_ends_at_once(monkeypatch):
    def twice():
        interrupt()
        time.sleep(0.5)  # two signals in one instant are one for the system
        interrupt()

    monkeypatch.setattr(experiment, "draw", after(4, twice, experiment.draw))
    assert kept() == ([-1, 0, 1], True)


def test_ctrl_c_is_as_it_was_afterwards():
    before = signal.getsignal(signal.SIGINT)
    kept(episodes=1, warmup=0)
    assert signal.getsignal(signal.SIGINT) is before
