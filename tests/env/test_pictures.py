"""Frames, and the window that shows them."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Iterator

import gymnasium
import matplotlib.pyplot as plt
import numpy as np
import pytest

from desim_uav.engine.base import UserState
from desim_uav.env import UavEnv, UavParallelEnv
from tests.env import fake_display
from tests.env.helpers import BRITTLE, CASES, play_parallel, play_single


@pytest.mark.parametrize("case", CASES)
def test_frames_are_pictures_of_one_size_and_change(case: str):
    env = UavEnv(case, render_mode="rgb_array")
    frames = [env.render() for _ in play_single(env, 1, seed=0)]
    assert len({frame.tobytes() for frame in frames}) == 31
    for frame in frames:
        assert frame.shape == (600, 800, 3)
        assert frame.dtype == np.uint8
        assert frame.flags.writeable
        assert frame.std() > 10


def test_a_frame_is_of_the_state_alone():
    env, other = (UavParallelEnv("case8", render_mode="rgb_array") for _ in range(2))
    for _ in zip(play_parallel(env, 1, seed=0), play_parallel(other, 1, seed=0), strict=True):
        assert np.array_equal(env.render(), env.render())
        assert np.array_equal(env.render(), other.render())
    other.reset(seed=1)
    assert not np.array_equal(env.render(), other.render())
    other.close()
    env.reset(seed=1)
    assert np.array_equal(env.render(), other.render())


@pytest.mark.parametrize(
    "config",
    [
        {"drones.count": 40},
        {"users.count": 2000},
        {"map": {"size_m": [4800, 1200], "cells": [20, 5]}, "stations.radius_m": 500},
        {"map": {"size_m": [240, 2400], "cells": [1, 10]}, "stations.count": 0,
         "drones.battery": None, "users.clusters.radius_m": [50, 100]},
        {"map": {"cells": [100, 100]}, "stations.radius_m": 960},
        {"name": "a_name_that_is_much_too_long_to_fit"},
    ],
    ids=["drones", "users", "wide", "tall", "fine", "name"],
)  # fmt: skip
def test_frames_of_unusual_scenarios(config: dict[str, object]):
    env = UavEnv("case8", {"episode.steps": 2, **config}, render_mode="rgb_array")
    for _ in play_single(env, 1, seed=0):
        assert env.render().shape == (600, 800, 3)


def test_every_mode_of_a_drone_can_be_drawn():
    env = UavEnv("case8", BRITTLE, render_mode="rgb_array")
    met = set()
    for _ in play_single(env, 5, seed=0):
        env.render()
        met |= {seen.mode for seen in env.session.snapshot.observations}
    assert len(met) == 6


def test_the_states_of_users_are_those_of_their_requests():
    env = UavEnv("case8", {"drones.bandwidth_kbps": 500})
    met = set()
    for _ in play_single(env, 2, seed=0):
        engine, shown = env.session.engine, env.session.snapshot
        states = engine.user_states()
        met |= set(states)
        assert states.count(UserState.SERVED) == sum(s.served_requests for s in shown.observations)
        asking = states.count(UserState.SERVED) + states.count(UserState.OPEN)
        assert asking == sum(shown.open_requests)
        attached = sum(s.attached_users for s in shown.observations)
        assert attached <= len(states) - states.count(UserState.IDLE)
        assert attached >= states.count(UserState.ATTACHED) + states.count(UserState.SERVED)
    assert met == set(UserState)


def test_without_a_mode_nothing_is_rendered():
    env = UavEnv("case1")
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="rgb_array"):
        assert env.render() is None


def test_an_unknown_mode():
    for env in (UavEnv, UavParallelEnv):
        with pytest.raises(gymnasium.error.UnsupportedMode, match="'rgb_array' or 'human'"):
            env("case1", render_mode="ansi")


def test_no_frame_before_an_episode():
    with pytest.raises(gymnasium.error.ResetNeeded):
        UavEnv("case1", render_mode="rgb_array").render()


@pytest.fixture
def display() -> Iterator[type[fake_display.FigureCanvas]]:
    before = plt.get_backend()
    plt.switch_backend("module://tests.env.fake_display")
    yield fake_display.FigureCanvas
    plt.switch_backend(before)
    fake_display.FigureCanvas.opened = 0
    fake_display.FigureCanvas.shown.clear()


@pytest.mark.parametrize("make", [UavEnv, UavParallelEnv])
def test_a_window_follows_the_episode(make: type, display: type[fake_display.FigureCanvas]):
    env = make("case1", render_mode="human")
    env.reset(seed=0)
    for _ in range(3):
        env.step(0 if make is UavEnv else {"drone_0": 0})
    assert env.render() is None
    assert display.opened == 1
    assert len(display.shown) == 5
    assert len(set(display.shown)) == 4
    env.close()
    env.close()
    assert not plt.get_fignums()


def test_a_window_that_was_closed_stays_closed(display: type[fake_display.FigureCanvas]):
    env = UavEnv("case1", render_mode="human")
    env.reset(seed=0)
    plt.close("all")
    env.step(0)
    assert len(display.shown) == 1


@pytest.mark.parametrize("engine", ["des", "batch"])
def test_a_copy_opens_a_window_when_it_first_renders(
    engine: str, display: type[fake_display.FigureCanvas]
):
    env = UavEnv("case1", render_mode="human", engine=engine)
    env.reset(seed=0)
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env)), copy.copy(env)]
    assert display.opened == len(plt.get_fignums()) == 1
    copies[0].close()
    assert len(plt.get_fignums()) == 1
    copies[1].step(0)
    assert copies[2].render() is None
    assert display.opened == len(plt.get_fignums()) == 3
    assert display.shown[-1] == display.shown[0]
    copies[1].close()
    assert len(plt.get_fignums()) == 2
    plt.close("all")


@pytest.mark.parametrize("backend", ["agg", "tkagg"])
def test_without_a_display_there_is_no_window(backend: str, monkeypatch: pytest.MonkeyPatch):
    before = plt.get_backend()
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with plt.rc_context({"backend": backend}):
        monkeypatch.setattr("matplotlib.pyplot._backend_mod", None)
        with pytest.raises(gymnasium.error.UnsupportedMode, match="render_mode='rgb_array'"):
            UavEnv("case1", render_mode="human")
        assert not plt.get_fignums()
    plt.switch_backend(before)
