"""Copies and pickles of environments are independent, and go on as the original would."""

from __future__ import annotations

import copy
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from desim_uav.env import UavEnv, UavParallelEnv, UavVectorEnv
from desim_uav.env.session import Session
from tests.env.helpers import BRITTLE
from tests.env.test_vector import assert_same

STEPS = 5
CONFIG: dict[str, Any] = {
    **BRITTLE,
    "episode.steps": STEPS,
    "position_noise": {"probability": 0.2},
}
"""Episodes of five steps, with batteries that last for seven and carry over to the next episode."""


def single(engine: str) -> UavEnv:
    return UavEnv("case8", CONFIG, engine=engine)


def stable_baselines() -> Any:
    pytest.importorskip("stable_baselines3")
    from desim_uav.env import UavVecEnv

    return UavVecEnv("case8", 3, CONFIG, threads=2)


MAKERS: dict[str, Callable[[], Any]] = {
    "single, SimPy": lambda: single("des"),
    "single, compiled": lambda: single("batch"),
    "parallel": lambda: UavParallelEnv("case8", CONFIG, engine="des"),
    "parallel, compiled": lambda: UavParallelEnv("case8", CONFIG, engine="batch"),
    "parallel, worlds": lambda: UavParallelEnv(
        "case8", CONFIG, engine="batch", world_seed=range(9)
    ),
    "vector": lambda: UavVectorEnv("case8", 3, CONFIG, AutoresetMode.SAME_STEP, threads=2),
    "vector, next step": lambda: UavVectorEnv("case8", 3, {**CONFIG, "world_seed": 4}),
    "stable-baselines3": stable_baselines,
}

WAYS: dict[str, Callable[[Any], Any]] = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda env: pickle.loads(pickle.dumps(env)),
}


def sessions_of(env: Any) -> list[Session]:
    vector = getattr(env.unwrapped, "vector", env.unwrapped)
    return list(vector.sessions) if hasattr(vector, "sessions") else [env.session]


def turn(env: Any, rng: np.random.Generator) -> Any:
    """Begin an episode where one is due, else step; everything that can be seen after that."""
    sessions = sessions_of(env)
    told = _reset(env) if _due(env) else _step(env, _actions(env, len(sessions), rng))
    return told, _masks(env), [_inside(session) for session in sessions]


def turns(env: Any, count: int, seed: int) -> list[Any]:
    rng = np.random.default_rng(seed)
    return [turn(env, rng) for _ in range(count)]


def _due(env: Any) -> bool:
    (first, *others) = sessions_of(env)
    if first.episode < 0:
        return True
    return not others and (first.snapshot.terminated or first.snapshot.truncated)


def _reset(env: Any) -> Any:
    seed = 7 if sessions_of(env)[0].episode < 0 else None
    if hasattr(env, "step_wait"):
        env.seed(seed)
        return env.reset(), list(env.reset_infos)
    return env.reset(seed=seed)


def _masks(env: Any) -> np.ndarray:
    return np.array(
        env.env_method("action_masks") if hasattr(env, "vector") else env.action_masks()
    )


def _actions(env: Any, count: int, rng: np.random.Generator) -> np.ndarray:
    masks = _masks(env).reshape(count, 3, -1)
    return np.array([[rng.choice(np.flatnonzero(mask)) for mask in one] for one in masks])


def _step(env: Any, actions: np.ndarray) -> Any:
    if isinstance(env, UavParallelEnv):
        return env.step(dict(zip(env.agents, actions[0].tolist(), strict=True)))
    return env.step(actions[0] if isinstance(env.unwrapped, UavEnv) else actions)


def _inside(session: Session) -> Any:
    """What an engine tells beside observations."""
    engine = session.engine
    places = [place.tolist() for place in engine.positions_m()]
    log = (engine.log.episode, engine.log.crashed, engine.log.duration_us, engine.log.distance_m)
    told = (session.seed, session.episode, session.snapshot, engine.measures(), engine.carried())
    return repr((told, places, engine.user_states(), log))


def assert_same_turns(some: list[Any], others: list[Any]) -> None:
    for one, other in zip(some, others, strict=True):
        assert_same(_plain(one), _plain(other))


def _plain(told: Any) -> Any:
    """Tuples and lists as mappings, which ``assert_same`` looks into."""
    if isinstance(told, tuple | list):
        return {str(k): _plain(part) for k, part in enumerate(told)}
    return {key: _plain(part) for key, part in told.items()} if isinstance(told, dict) else told


BEFORE = {"before a reset": 0, "in an episode": 3, "after its end": 1 + STEPS, "in the next": 9}
MORE = 2 * (1 + STEPS)
"""Turns to the end of an episode and through the next one."""


@pytest.mark.thorough
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", MAKERS)
def test_a_copy_goes_on_and_leaves_the_original_alone(kind: str, way: str):
    twin = turns(MAKERS[kind](), max(BEFORE.values()) + MORE, seed=1)
    env = MAKERS[kind]()
    rng = np.random.default_rng(1)
    seen, kept = [], []
    for k in range(max(BEFORE.values()) + MORE):
        if k in BEFORE.values():
            disturbed = WAYS[way](env)
            kept.append((k, WAYS[way](env), copy.deepcopy(rng)))
            turns(disturbed, MORE, seed=100 + k)
            disturbed.close()
        seen.append(turn(env, rng))
    env.close()
    assert_same_turns(seen, twin)
    for k, other, own_rng in kept:
        went_on = [turn(other, own_rng) for _ in range(MORE)]
        assert_same_turns(went_on, twin[k : k + MORE])
        other.close()


@pytest.mark.parametrize("kind", MAKERS)
def test_a_shallow_copy_is_as_independent_as_a_deep_one(kind: str):
    env = MAKERS[kind]()
    turns(env, 3, seed=1)
    shallow, deep = copy.copy(env), copy.deepcopy(env)
    turns(shallow, MORE, seed=2)
    assert_same_turns(turns(env, MORE, seed=3), turns(deep, MORE, seed=3))


@pytest.mark.parametrize("kind", ["single, SimPy", "single, compiled", "vector"])
def test_copies_of_an_environment_without_a_seed_draw_the_same_run(kind: str):
    env = MAKERS[kind]()
    copies = [way(env) for way in WAYS.values()]
    seeds = env.reset()[1]["seed"]
    for other in copies:
        assert_same(other.reset()[1]["seed"], seeds)


def test_a_copy_shares_the_world_and_a_pickle_holds_it_once():
    env = UavVectorEnv("case8", 3, {**CONFIG, "world_seed": 4})
    env.reset(seed=1)
    worlds = {id(session.world) for session in sessions_of(copy.deepcopy(env))}
    assert worlds == {id(sessions_of(env)[0].world)}
    other = pickle.loads(pickle.dumps(env))
    assert len({id(session.world) for session in sessions_of(other)}) == 1


def test_what_a_world_has_worked_out_is_not_pickled():
    env = single("des")
    world = env.session.world
    before = len(pickle.dumps(world))
    turns(env, 8, seed=0)
    assert len(pickle.dumps(world)) == before


@pytest.mark.thorough
def test_another_process_goes_on(tmp_path: Path):
    """Unpickled in a process of its own, where no address of this one means anything."""
    envs = {kind: make() for kind, make in MAKERS.items() if kind != "stable-baselines3"}
    for env in envs.values():
        turns(env, 3, seed=1)
    (tmp_path / "envs").write_bytes(pickle.dumps(envs))
    script = (
        "import pickle, sys; from tests.env.test_copies import MORE, turns\n"
        "envs = pickle.load(open(sys.argv[1], 'rb'))\n"
        "told = {kind: turns(env, MORE, seed=2) for kind, env in envs.items()}\n"
        "pickle.dump(told, open(sys.argv[2], 'wb'))\n"
    )
    files = [str(tmp_path / name) for name in ("envs", "told")]
    root = Path(__file__).parents[2]
    path = os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])
    subprocess.run(
        [sys.executable, "-c", script, *files], check=True, env={**os.environ, "PYTHONPATH": path}
    )
    told = pickle.loads((tmp_path / "told").read_bytes())
    for kind, env in envs.items():
        assert_same_turns(told[kind], turns(env, MORE, seed=2))


@pytest.mark.parametrize("kind", ["single, compiled", "vector", "single, SimPy"])
@pytest.mark.parametrize("read_only", [False, True], ids=["shared", "read only"])
def test_a_pickle_with_buffers_out_of_band_has_memory_of_its_own(kind: str, read_only: bool):
    """As Ray has them: arrays that lie in the original's memory, or cannot be written to."""
    env = MAKERS[kind]()
    turns(env, 3, seed=1)
    twin, third = copy.deepcopy(env), copy.deepcopy(env)
    buffers: list[pickle.PickleBuffer] = []
    pickled = pickle.dumps(env, protocol=5, buffer_callback=buffers.append)
    other = pickle.loads(pickled, buffers=[bytes(b) if read_only else b for b in buffers])
    assert_same_turns(turns(other, MORE, seed=3), turns(third, MORE, seed=3))
    assert_same_turns(turns(env, MORE, seed=2), turns(twin, MORE, seed=2))


@pytest.mark.parametrize("engine", ["des", "batch"])
def test_an_environment_that_gymnasium_has_wrapped(engine: str):
    env = gymnasium.make("desim_uav/Case8-v0", engine=engine, config=CONFIG)
    env.reset(seed=1)
    env.step([0, 1, 2])
    other = pickle.loads(pickle.dumps(copy.deepcopy(env)))
    for _ in range(STEPS - 1):
        told, same = env.step([4, 4, 4]), other.step([4, 4, 4])
        assert_same_turns([told], [same])
    assert_same_turns([env.reset()], [other.reset()])
