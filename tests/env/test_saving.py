"""Environments are saved and restored at any epoch, in memory and by files."""

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

from desim_uav import array_file
from desim_uav.engine.compiled.forks import Forks
from desim_uav.env import UavEnv, UavParallelEnv, UavVectorEnv
from desim_uav.errors import StateError
from tests.env.test_copies import (
    CONFIG,
    MAKERS,
    MORE,
    STEPS,
    assert_same_turns,
    single,
    turns,
)
from tests.env.test_vector import assert_same

ONE_EACH = {name: MAKERS[name] for name in ("single, SimPy", "single, compiled", "parallel")}
EPOCHS = {"first": 1, "middle": 4, "last": 1 + STEPS, "of the next": 9}


def seen(env: Any, seed: int) -> list[Any]:
    """Turns without the parts that the two engines have in another form."""
    return [[told, masks] for told, masks, _ in turns(env, MORE, seed)]


def turns_of_all(env: Any, seed: int) -> list[Any]:
    return turns(env, MORE, seed)


@pytest.mark.parametrize("epoch", EPOCHS)
@pytest.mark.parametrize("kind", ONE_EACH)
def test_it_goes_on_from_memory_and_from_a_file(kind: str, epoch: str, tmp_path: Path):
    env = ONE_EACH[kind]()
    turns(env, EPOCHS[epoch], seed=1)
    shown = copy.deepcopy(env)._present()
    state, file = env.save(), tmp_path / "state.npz"
    state.write(file)
    told = seen if kind == "single, compiled" else turns_of_all  # a kernel does not add to the log
    expected = told(copy.deepcopy(env), 2)
    others = [ONE_EACH[kind](), *env.fork(2)]
    turns(others[1], 3, seed=8)
    for other, source in zip(others, (file, state, pickle.loads(pickle.dumps(state))), strict=True):
        assert_same(_plain(other.restore(source)), _plain(shown))
        assert_same_turns(told(other, 2), expected)
    assert_same_turns(told(env, 2), expected)
    assert (state.episode, state.step) == (
        int(EPOCHS[epoch] > 6),
        {1: 0, 4: 3, 6: 5, 9: 2}[EPOCHS[epoch]],
    )


SCENARIOS = {
    "case8": {"reward": {"kind": "qoe"}},
    "case9": {},
    "delivery_watch": {},
    "festival": {},
    "interference": {},
}


@pytest.mark.parametrize(
    "scenario",
    [
        pytest.param(name, marks=() if name == "case8" else pytest.mark.thorough)
        for name in SCENARIOS
    ],
)
def test_the_start_of_a_later_episode_goes_on_from_a_file(scenario: str, tmp_path: Path):
    """Nothing of the episode before may be in a state whose commands are none."""
    config, file = {"episode.steps": 3, **SCENARIOS[scenario]}, tmp_path / "state.npz"
    env, other = (UavEnv(scenario, config=config, world_seed=0) for _ in range(2))
    for episode in range(3):
        env.reset(seed=1 if episode == 0 else None)
        env.save().write(file)
        other.restore(file)
        assert other.save().saved.digest() == env.save().saved.digest()
        env.action_space.seed(episode)
        for _ in range(episode + 1):  # the second episode is left before its end
            env.step(env.action_space.sample())


def _plain(told: Any) -> Any:
    return {str(k): part for k, part in enumerate(told)}


@pytest.mark.parametrize("first", ["des", "batch"])
def test_an_engine_goes_on_where_the_other_was(first: str, tmp_path: Path):
    env, other = single(first), single({"des": "batch", "batch": "des"}[first])
    turns(env, 4, seed=1)
    turns(other, 2, seed=3)
    env.save().write(tmp_path / "state.npz")
    for source in (env.save(), tmp_path / "state.npz"):
        other.restore(source)
        expected = seen(copy.deepcopy(env), 2)
        for one, two in zip(seen(other, 2), expected, strict=True):
            assert_same(_plain(one[0]), _plain(two[0]))


def test_another_process_goes_on(tmp_path: Path):
    """Each engine reads what the other has written, without a pickle."""
    file = tmp_path / "state.npz"
    env = single("batch")
    turns(env, 4, seed=1)
    env.save().write(file)
    script = (
        "import pickle, sys; from tests.env.test_saving import seen, single\n"
        "env = single('des')\n"
        "env.restore(sys.argv[1])\n"
        "pickle.dump(seen(env, 2), open(sys.argv[2], 'wb'))\n"
    )
    root = Path(__file__).parents[2]
    path = os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])
    told = tmp_path / "told"
    subprocess.run(
        [sys.executable, "-c", script, str(file), str(told)],
        check=True,
        env={**os.environ, "PYTHONPATH": path},
    )
    for one, two in zip(pickle.loads(told.read_bytes()), seen(env, 2), strict=True):
        assert_same(_plain(one[0]), _plain(two[0]))


@pytest.mark.parametrize("world_seed", ["scenario", 4])
def test_environments_of_a_vector_one_by_one(world_seed: Any, tmp_path: Path):
    config = CONFIG if world_seed == "scenario" else {**CONFIG, "world_seed": world_seed}
    env = UavVectorEnv("case8", 3, config, threads=2)
    turns(env, 4, seed=1)
    state = env.save(1)
    state.write(tmp_path / "state.npz")
    alone = UavEnv("case8", config)
    observation, info = alone.restore(state)
    forked = env.fork(2, 1)
    shown, infos = env.restore(state, [0])
    assert np.array_equal(shown[0], observation) and np.array_equal(shown[0], shown[1])
    assert infos["seed"][0] == info["seed"] and infos["_seed"].tolist() == [True, False, False]
    env.restore(tmp_path / "state.npz", 2)
    assert env.save(0).saved.digest() == env.save(2).saved.digest() == state.saved.digest()
    same = env.fork(3, 2)
    env.assign(1)
    for each in (same, env, forked, UavVectorEnv("case8", 1, config)):
        if each.num_envs == 1:
            each.restore(state)
        told = [each.step(np.full((each.num_envs, 3), 4)) for _ in range(5)]
        own = copy.deepcopy(alone)
        for seen_here, _, _, _, infos in told[:2]:
            expected, *_, info = own.step(np.full(3, 4))
            assert all(np.array_equal(row, expected) for row in seen_here)
            assert infos["qoe1_percent"].tolist() == [info["qoe1_percent"]] * each.num_envs
        each.close()


def test_stable_baselines(tmp_path: Path):
    env = MAKERS["stable-baselines3"]()
    turns(env, 4, seed=1)
    state = env.save(1)
    observations = env.restore(state)
    assert (observations == observations[1]).all()
    forked = env.fork(2, 1)
    assert forked.reset_infos[0]["seed"] == env.reset_infos[1]["seed"]
    assert (forked.step(np.full((2, 3), 4))[0] == env.step(np.full((3, 3), 4))[0][:2]).all()


@pytest.mark.parametrize("kind", ["single, SimPy", "parallel", "vector"])
def test_there_is_no_state_before_the_first_reset(kind: str):
    env = MAKERS[kind]()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.save()


def test_indices_that_a_vector_does_not_have():
    env = UavVectorEnv("case8", 2, {**CONFIG, "world_seed": 4})
    env.reset(seed=0)
    for which in (2, -1, []):
        with pytest.raises(gymnasium.error.Error, match="must be from 0 to 1"):
            env.restore(env.save(), which)
    with pytest.raises(gymnasium.error.Error, match="must be 1 or more"):
        env.fork(0)


# ---- states that do not fit, and files that are none


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    env = single("batch")
    turns(env, 9, seed=1)
    file: Path = tmp_path_factory.mktemp("states") / "state.npz"
    env.save().write(file)
    return file


def test_a_state_of_another_scenario_or_world(written: Path):
    other = UavEnv("case8", {**CONFIG, "users.count": 20})
    for source in (written, single_state()):
        with pytest.raises(StateError, match="of another scenario"):
            other.restore(source)
        fixed = UavEnv("case8", {**CONFIG, "world_seed": 4})
        with pytest.raises(StateError, match="of world 7, but this environment flies in world 4"):
            fixed.restore(source)
    assert StateError.exit_code == 4


def single_state() -> Any:
    env = single("batch")
    env.reset(seed=7)
    return env.save()


def altered(file: Path, to: Path, change: Callable[[dict[str, Any]], Any]) -> Path:
    stored = array_file.Stored(file, "saved state", ["commands"], 1)
    about, arrays = dict(stored.about), stored.arrays()
    change(about)
    to.write_bytes(array_file.pack(about, commands=about.pop("commands", arrays["commands"])))
    return to


CHANGES: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "format": (lambda about: about.update(format=2), "reads format 1"),
    "no seed": (lambda about: about.pop("seed"), "seed is missing or wrong"),
    "text": (lambda about: about.update(episode="1"), "episode is missing or wrong"),
    "negative": (lambda about: about.update(seed=-1), "a seed is out of range"),
    "seed": (lambda about: about.update(seed=8), "of world 7"),
    "digest": (lambda about: about.update(digest="0"), "lead to another state"),
    "episode": (lambda about: about.update(episode=5), "lead to another state"),
    "drones": (lambda about: about.update(before=[]), "cannot be played"),
    "no drones": (lambda about: about.update(before=None), "lead to another state"),
    "place": (lambda about: about["before"][0].__setitem__(1, [99, 0, 0]), "cannot be played"),
    "mode": (lambda about: about["before"][0].__setitem__(0, 7), "cannot be played"),
    "station": (lambda about: about["before"][0].__setitem__(0, 3), "cannot be played"),
    "battery": (lambda about: about["before"][0].__setitem__(2, 2**60), "cannot be played"),
    "number": (lambda about: about["before"][0].__setitem__(6, "x"), "cannot be played"),
    "more steps": (
        lambda about: about.update(commands=np.zeros((STEPS + 1, 3), np.int64)),
        "commands of the shape",
    ),
    "fewer drones": (
        lambda about: about.update(commands=np.zeros((2, 1), np.int64)),
        "commands of the shape",
    ),
    "odd commands": (
        lambda about: about.update(commands=np.full((2, 3), 2**40)),
        "lead to another state",
    ),
    "floats": (lambda about: about.update(commands=np.zeros((2, 3))), "commands are wrong"),
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("engine", ["des", "batch"])
def test_an_altered_file_is_refused_and_changes_nothing(
    change: str, engine: str, written: Path, tmp_path: Path
):
    env = single(engine)
    turns(env, 3, seed=1)
    before, how = env.save().saved.digest(), CHANGES[change]
    file = altered(written, tmp_path / "altered.npz", how[0])
    with pytest.raises(StateError, match=how[1]) as raised:
        env.restore(file)
    assert str(file) in str(raised.value)
    assert env.save().saved.digest() == before


def test_files_that_are_no_states(written: Path, tmp_path: Path):
    env, broken = single("batch"), tmp_path / "broken.npz"
    for content in (b"", b"text", written.read_bytes()[:-30], pickle.dumps(single_state())):
        broken.write_bytes(content)
        with pytest.raises(StateError, match="not a readable saved state"):
            env.restore(broken)
    with pytest.raises(StateError, match="No such file"):
        env.restore(tmp_path / "none.npz")


def test_an_engine_may_write_what_it_read(written: Path, tmp_path: Path):
    """A state that is written twice gives files of equal bytes."""
    env = single("des")
    env.restore(written)
    env.save().write(tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == written.read_bytes()


def test_agents_of_a_restored_end_are_none():
    env = UavParallelEnv("case8", CONFIG)
    turns(env, 1 + STEPS, seed=1)
    assert env.agents == []
    over = env.save()
    env.reset()
    env.restore(over)
    assert env.agents == []


def forked(engine):
    """Let forks of an engine get so much room that its state moves in memory."""
    forks = Forks(engine, 2)
    forks.take()
    for _ in range(3):
        forks.more_room()


def test_an_environment_goes_on_after_forks_have_got_more_room():
    env, twin = (UavEnv("case8", engine="batch", world_seed=0) for _ in range(2))
    for one in (env, twin):
        one.reset(seed=3)
        one.step([0, 2, 4])
    forked(env.session.engine)
    for _ in range(4):
        mine, other = (one.step([1, 4, 0]) for one in (env, twin))
        assert np.array_equal(mine[0], other[0]) and mine[1:4] == other[1:4]


def test_vectors_and_copies_of_them_go_on_after_forks_have_got_more_room():
    env, twin = (UavVectorEnv("case8", 3, {"world_seed": 0}) for _ in range(2))
    for one in (env, twin):
        one.reset(seed=3)
    own = copy.deepcopy(env)
    for one in (env, own):
        forked(one.sessions[1].engine)
    for _ in range(4):
        seen, *others = (one.step(np.full((3, 3), 1)) for one in (twin, env, own))
        for other in others:
            assert np.array_equal(seen[0], other[0]) and np.array_equal(seen[1], other[1])
    for one in (env, twin, own):
        one.close()
