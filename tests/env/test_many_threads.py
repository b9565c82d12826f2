"""Threads share the steps and the beginnings of many environments."""

from __future__ import annotations

import copy
import os
import pickle
import signal
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from gymnasium import error
from gymnasium.vector import AutoresetMode

from desim_uav.env import UavEnv, UavParallelEnv, UavParallelVectorEnv, UavVectorEnv
from desim_uav.env.many import FEWEST_DRAWN, shares_of
from desim_uav.model.rules import Mode
from desim_uav.rules.words import OUT_OF_MEMORY
from tests.env.helpers import BRITTLE
from tests.env.test_parallel_vector import random_actions
from tests.env.test_vector import assert_same

SHORT = {**BRITTLE, "episode.steps": 3}
COUNT = 2 * FEWEST_DRAWN + 5
MODES = [
    AutoresetMode.NEXT_STEP,
    *[
        pytest.param(mode, marks=pytest.mark.thorough)
        for mode in (AutoresetMode.SAME_STEP, AutoresetMode.DISABLED)
    ],
]


@pytest.mark.parametrize(("count", "threads"), [(1, 1), (1024, 1), (1024, 2), (5, 5), (37, 16)])
def test_shares_are_all_environments_once_and_the_large_ones_come_first(count: int, threads: int):
    shares = shares_of(count, threads)
    assert [k for share in shares for k in range(count)[share]] == list(range(count))
    sizes = [share.stop - share.start for share in shares]
    assert sizes[:-1] == sorted(sizes[:-1], reverse=True) and min(sizes) > 0
    assert sizes[0] <= -(-count // threads)


def played(mode: AutoresetMode, threads: int, world_seed: Any) -> list[dict[str, Any]]:
    """What 10 steps of many environments tell, from the reset on, with resets of some of them."""
    env = UavParallelVectorEnv("case8", COUNT, SHORT, mode, threads, None, world_seed)
    seen, infos = env.reset(seed=3)
    rng, told = np.random.default_rng(0), [{"seen": seen, **infos}]
    for step in range(10):
        over = env.over()
        if step == 5 or (mode is AutoresetMode.DISABLED and over.any()):
            some = over if over.any() else rng.random(COUNT) < 0.9
            seen, infos = env.reset(options={"reset_mask": some})
            told.append({"seen": seen, **infos})
        seen, paid, ended, cut, infos = env.step(random_actions(infos["action_mask"], rng))
        final = infos.pop("final_info", {})
        told.append({"seen": seen, "paid": paid, "ended": ended, "cut": cut, **infos, **final})
    told.append({"state": env.state(), "saved": np.array([env.save(40).saved.digest()])})
    env.close()
    return told


@pytest.mark.parametrize("world_seed", [1, range(20, 23)], ids=["one world", "any world"])
@pytest.mark.parametrize("mode", MODES)
def test_the_number_of_threads_changes_nothing(mode: AutoresetMode, world_seed: Any):
    expected = played(mode, 1, world_seed)
    for threads in (2, 3):
        for one, other in zip(played(mode, threads, world_seed), expected, strict=True):
            assert_same(one, other)


def test_a_task_that_fails_leaves_the_others_done():
    env, done = UavVectorEnv("case8", 2, {"world_seed": 1}, threads=2), []

    def fail() -> int:
        raise ValueError("a component of one's own")

    def task() -> int:
        done.append(1)
        return 0

    with pytest.raises(ValueError, match="one's own"):
        env._do([task, fail, *[task] * 20], env._all)
    assert len(done) == 21
    env.close()


class TestTwoThreadsOfTheCaller:
    """Compiled code runs without Python's lock, so a second thread must not get there."""

    @pytest.mark.parametrize(
        ("make", "action"),
        [
            (lambda: UavVectorEnv("tiny", 2, {"world_seed": 1}, threads=2), np.zeros((2, 1), int)),
            (lambda: UavParallelVectorEnv("tiny", 2, {"world_seed": 1}), np.zeros((2, 1), int)),
            (lambda: UavEnv("tiny", engine="batch"), 0),
            (lambda: UavParallelEnv("tiny"), {"drone_0": 0}),
        ],
        ids=["vector", "parallel_vector", "single", "parallel"],
    )
    def test_the_second_one_is_refused(self, make: Any, action: Any):
        env = make()
        calls: dict[str, Any] = {
            "reset": env.reset,
            "step": lambda: env.step(action),
            "save": env.save,
            "restore": lambda: env.restore(saved),
            "fork": lambda: env.fork(2),
            "render": env.render,
        }
        env.reset(seed=1)
        saved = env.save()
        with ThreadPoolExecutor(1) as other:
            with env.guard:
                for call in calls.values():
                    with pytest.raises(error.Error, match="another thread is using this"):
                        other.submit(call).result()
            told = other.submit(calls["step"]).result()  # one after the other is no fault
        twin = copy.deepcopy(env)
        assert twin.guard is not env.guard and pickle.loads(pickle.dumps(env)).guard is not None
        env.restore(saved)
        again = env.step(action)
        np.testing.assert_equal(again[1], told[1])
        for each in (env, twin):
            each.close()


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.skipif(not hasattr(os, "fork"), reason="a system without fork")
def test_a_child_that_was_forked_after_threads_were_used_has_threads_of_its_own():
    """It has none of its parent's; a call in it would wait for them without an end."""
    env = UavVectorEnv("tiny", 4, {"world_seed": 1}, threads=2)
    env.reset(seed=1)
    actions = np.zeros((4, 1), int)
    env.step(actions)
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:  # no exception may reach pytest here
        signal.alarm(30)  # ends the child if it hangs
        os.write(writer, env.step(actions)[1].tobytes())
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as answer:
        told = np.frombuffer(answer.read())
    assert os.waitpid(child, 0)[1] == 0
    np.testing.assert_array_equal(told, env.step(actions)[1])
    env.close()


def in_second_episode() -> tuple[UavVectorEnv, list[Any]]:
    """Two environments after some steps of the second episode; how their drones began it."""
    config = {**BRITTLE, "episode.steps": 7, "world_seed": 1, "stations.count": 1}
    env = UavVectorEnv("case8", 2, config, threads=2)
    rng = np.random.default_rng(1)
    env.reset(seed=1)

    def step() -> None:
        env.step(random_actions(env.action_masks().reshape(2, 3, -1), rng))

    while not env.over().all():
        step()
    began = [session.engine.carried() for session in env.sessions]
    both = [(drone.mode, drone.place) for drones in began for drone in drones]
    assert {(Mode.FLYING, 0), (Mode.CHARGING, 0), (Mode.QUEUED, 1), (Mode.CRASHED, 0)} == {*both}
    for _ in range(4):
        step()
    return env, began


def test_a_saved_state_knows_how_the_drones_began_an_episode():
    env, began = in_second_episode()
    for k in range(2):
        assert env.save(k).saved.before == began[k]
        assert copy.deepcopy(env).save(k).saved.before == began[k]
    env.assign(0)
    assert env.save(1).saved.before == began[0]
    env.close()


def test_an_episode_that_goes_on_is_repeated_in_more_memory():
    env, _ = in_second_episode()
    twin = copy.deepcopy(env)
    for session in env.sessions:
        engine = session.engine
        expected, room = engine.save().digest(), engine.buffers.crossings
        engine.state.faults |= OUT_OF_MEMORY
        session.go_on()
        assert engine.buffers.crossings == 2 * room and engine.save().digest() == expected
    for _ in range(9):
        actions = np.zeros(env.action_space.shape, np.int64)
        told = zip(env.step(actions), twin.step(actions), strict=True)
        for one, other in told:
            assert_same({"it": one} if not isinstance(one, dict) else one, _named(other))
    env.close()
    twin.close()


def _named(told: Any) -> dict[str, Any]:
    return told if isinstance(told, dict) else {"it": told}
