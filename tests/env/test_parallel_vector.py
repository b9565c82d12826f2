"""Many multi-agent environments as arrays have the numbers of single ones on SimPy."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from desim_uav.env import UavParallelEnv, UavParallelVectorEnv, UavVectorEnv
from desim_uav.env.session import ActionError
from desim_uav.errors import ScenarioError
from tests.env.helpers import BRITTLE
from tests.env.test_vector import Shown, assert_same

MODES = list(AutoresetMode)
SHORT = {"episode.steps": 7}
ENDS = {"drones.battery": {**BRITTLE["drones.battery"], "on_crash": "end_episode"}}
SCENARIOS: dict[str, tuple[str, dict[str, Any]]] = {
    "one drone": ("case1", SHORT),
    "carried over": ("case8", {**BRITTLE, **SHORT}),
    "real numbers, noise": (
        "case9",
        {**BRITTLE, **SHORT, "observation.kind": "local", "position_noise": {"probability": 0.2}},
    ),
    "ended by crashes": ("case8", {**BRITTLE, **ENDS, "episode.steps": 12}),
    "users who stand still": ("case5", {**SHORT, "world_seed": 3}),
    "a new start": ("case8", {**BRITTLE, **SHORT, "episode.carry_over": False}),
}
RADIO: dict[str, tuple[str, dict[str, Any]]] = {
    "links with classes": ("urban_downlink", SHORT),
    "interference": ("interference", SHORT),
}
BY_EVENT: dict[str, Any] = {
    **BRITTLE,
    "drones.motion.timing": "minimum_time",
    "decisions": {"kind": "event", "patience_s": 40},
    "episode.steps": 2,
}
COUNT = 3
thorough = pytest.mark.thorough


class Reference:
    """The environment of each row, on SimPy, with the resets of an autoreset mode."""

    def __init__(self, case: str, config: dict[str, Any], mode: AutoresetMode) -> None:
        self.envs = [UavParallelEnv(case, config, engine="des") for _ in range(COUNT)]
        self.mode = mode
        self.told: list[Any] = [None] * COUNT

    def reset(self, which: Any = None, seed: int | None = None) -> Any:
        for k, env in enumerate(self.envs):
            if which is None or which[k]:
                self.told[k] = env.reset(seed=None if seed is None else seed + k)
        return self.seen()

    def step(self, actions: np.ndarray) -> Any:
        rewards, ends, cuts = np.zeros(actions.shape), *np.zeros((2, *actions.shape), bool)
        final: list[Any] = [None] * COUNT
        for k, env in enumerate(self.envs):
            if not env.agents:
                self.told[k] = env.reset()
                continue
            seen, paid, ended, cut, infos = env.step(
                dict(zip(env.agents, actions[k].tolist(), strict=True))
            )
            rewards[k] = list(paid.values())
            ends[k], cuts[k] = list(ended.values()), list(cut.values())
            self.told[k] = seen, infos
            if not env.agents and self.mode is AutoresetMode.SAME_STEP:
                final[k], self.told[k] = self.told[k], env.reset()
        return self.seen(), rewards, ends, cuts, final

    def seen(self) -> Any:
        return stacked(self.told)


def stacked(told: list[Any]) -> Any:
    """Observations, masks and infos of the environments as arrays."""
    parts = [[[one[part] for one in seen.values()] for seen, _ in told] for part in PARTS]
    infos = {
        key: np.array([[info[key] for info in infos.values()] for _, infos in told])
        for key in next(iter(told[0][1].values()))
    }
    return np.array(parts[0]), np.array(parts[1]), infos


PARTS = ("observation", "action_mask")


def check(seen: Any, observations: Any, infos: dict[str, Any], where: str = "") -> None:
    """Each array is that of the reference, bit for bit."""
    expected, masks, told = seen
    assert_same(observations, expected, where)
    assert_same(infos["action_mask"], masks, where)
    assert list(infos) == [*told, "action_mask"]
    for key, values in told.items():
        found = infos[key]
        if key == "compiled":
            assert found.all() and not values.any()
            continue
        assert found.shape in ((COUNT,), values.shape), key
        assert_same(found, values if found.ndim == 2 else values[:, 0], f"{where}/{key}")


def random_actions(masks: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """An allowed action for each drone of each environment."""
    return (rng.random(masks.shape) * masks).argmax(axis=-1)


MOST = [
    pytest.param(name, marks=() if name in ("carried over", "real numbers, noise") else thorough)
    for name in SCENARIOS
]
EACH = [  # the default tests have each scenario once, and each mode twice
    pytest.param(name, mode, marks=() if k % 3 == which % 3 else thorough)
    for k, name in enumerate(SCENARIOS)
    for which, mode in enumerate(MODES)
]


@pytest.mark.parametrize(("name", "mode"), EACH)
def test_whole_episodes_are_those_of_simpy(name: str, mode: AutoresetMode):
    play(*SCENARIOS[name], mode)


@pytest.mark.thorough
@pytest.mark.parametrize("name", RADIO)
def test_whole_episodes_with_radio_links_are_those_of_simpy(name: str):
    play(*RADIO[name], AutoresetMode.SAME_STEP, 15)


@pytest.mark.thorough
@pytest.mark.parametrize("mode", MODES)
def test_whole_episodes_by_event_are_those_of_simpy(mode: AutoresetMode):
    play("case8", BY_EVENT, mode, 60)


def play(case: str, config: dict[str, Any], mode: AutoresetMode, steps: int = 26) -> None:
    reference = Reference(case, config, mode)
    env = UavParallelVectorEnv(case, COUNT, config, mode, threads=2)
    rng = np.random.default_rng(3)
    observations, infos = env.reset(seed=5)
    check(reference.reset(seed=5), observations, infos)
    for step in range(steps):
        actions = random_actions(env.action_masks(), rng)
        assert observations in env.observation_space and actions in env.action_space
        observations, rewards, ends, cuts, infos = env.step(actions)
        seen, *told, final = reference.step(actions)
        for array, expected in zip((rewards, ends, cuts), told, strict=True):
            assert_same(array, expected, f"step {step}")
        over = ends[:, 0] | cuts[:, 0]
        assert ("final_obs" in infos) == (mode is AutoresetMode.SAME_STEP and over.any())
        if "final_obs" in infos:
            check_final(final, infos, over)
        check(seen, observations, infos, f"step {step}")
        if mode is AutoresetMode.DISABLED and over.any():
            observations, infos = env.reset(options={"reset_mask": over})
            check(reference.reset(over), observations, infos)
    env.close()


def check_final(final: list[Any], infos: dict[str, Any], over: np.ndarray) -> None:
    """What is at the end of episodes, which is removed from the infos."""
    shown, mask, told = (infos.pop(key) for key in ("final_obs", "_final_obs", "final_info"))
    assert_same(mask, over)
    for k in np.flatnonzero(over):
        expected, masks, infos_of_one = stacked([final[k]])
        assert_same(shown[k], expected[0])
        assert_same(told["action_mask"][k], masks[0])
        for key, values in infos_of_one.items():
            found = told[key][k]
            if key == "compiled":
                assert found and not values.any()
                continue
            assert_same(np.asarray(found), np.asarray(values[0] if found.ndim else values[0, 0]))
    for array in (shown, *told.values()):
        assert not array[~over].any()


@pytest.mark.parametrize("name", MOST)
def test_the_compiled_parallel_environment_tells_what_that_on_simpy_tells(name: str):
    case, config = SCENARIOS[name]
    both = [UavParallelEnv(case, config, engine=engine) for engine in ("des", "batch")]
    rng = np.random.default_rng(0)
    for seed in (2, None, None, 4):
        (seen, told), (others, also) = (env.reset(seed=seed) for env in both)
        compare(seen, others)
        assert alike(told) == alike(also)
        while both[0].agents:
            masks = np.array([one["action_mask"] for one in seen.values()])
            actions = dict(zip(seen, random_actions(masks, rng).tolist(), strict=True))
            (seen, *told), (others, *also) = (env.step(actions) for env in both)
            compare(seen, others)
            told[-1], also[-1] = alike(told[-1]), alike(also[-1])
            assert told == also
            assert repr(told) == repr(also)  # types too
        assert not both[1].agents


def alike(infos: dict[str, Any]) -> dict[str, Any]:
    """Infos without what they say of the engine."""
    return {
        agent: {key: value for key, value in info.items() if key != "compiled"}
        for agent, info in infos.items()
    }


def compare(one: dict[str, Any], other: dict[str, Any]) -> None:
    assert one.keys() == other.keys()
    for agent, seen in one.items():
        assert_same(seen, other[agent])


def test_the_number_of_threads_changes_nothing():
    outcomes = []
    for threads in (1, 2, 5):
        env = UavParallelVectorEnv("case8", 5, BRITTLE, threads=threads, world_seed=1)
        env.reset(seed=[4, 9, 3, 1, 0])
        rng = np.random.default_rng(3)
        told = [env.step(random_actions(env.action_masks(), rng)) for _ in range(35)]
        outcomes.append([np.concatenate([np.ravel(part) for part in one[:4]]) for one in told])
        env.close()
    assert np.array_equal(outcomes[0], outcomes[1]) and np.array_equal(outcomes[0], outcomes[2])


def test_arrays_are_new_or_always_the_same():
    for copied in (True, False):
        env = UavParallelVectorEnv("case8", 2, world_seed=0, copy=copied)
        first, infos = env.reset(seed=0)
        masks = infos["action_mask"]
        actions = np.full((2, 3), 4)
        told = env.step(actions)
        again = env.step(actions)
        for one, other in zip((first, *told[:4]), (told[0], *again[:4]), strict=True):
            assert np.shares_memory(one, other) is not copied
        assert np.shares_memory(masks, again[4]["action_mask"]) is not copied
        assert not np.shares_memory(told[4]["qoe3_percent"], again[4]["qoe3_percent"])


@pytest.mark.parametrize(
    "actions", [[0, 1], np.zeros((2, 3)), [[0, 0, 9]] * 2, [[0, -1, 0]] * 2, "abc", [[0], [0, 1]]]
)
def test_what_are_no_actions(actions: Any):
    env = UavParallelVectorEnv("case8", 2, world_seed=0)
    env.reset(seed=0)
    with pytest.raises(ActionError, match="action"):
        env.step(actions)
    assert env.infos()["sim_time_s"].tolist() == [0.0, 0.0]


def test_what_cannot_be_asked_for():
    for wrong in ({"num_envs": 0}, {"num_envs": 2, "threads": 0}):
        with pytest.raises(gymnasium.error.Error, match=r"must be (a whole number, )?1 or more"):
            UavParallelVectorEnv("case1", **wrong)
    with pytest.raises(gymnasium.error.Error, match="autoreset_mode 'never'"):
        UavParallelVectorEnv("case1", 2, autoreset_mode="never")
    with pytest.raises(gymnasium.error.Error, match="2 environments"):
        UavParallelVectorEnv("case1", 2).reset(seed=[1, 2, 3])
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"no episode has begun in \[0, 1\]"):
        UavParallelVectorEnv("case1", 2).step(np.zeros((2, 1), int))
    with pytest.raises(gymnasium.error.Error, match="'des' or 'batch'"):
        UavParallelEnv("case1", engine="gpu")
    shown = {"observation": {"kind": f"{Shown.__module__}:Shown"}}
    for make in (
        lambda: UavParallelEnv("case1", shown, engine="batch"),
        lambda: UavParallelVectorEnv("case1", 2, shown),
    ):
        with pytest.raises(ScenarioError, match=r"observation: .*Shown.* is not compiled"):
            make()


@pytest.mark.parametrize("way", [copy.copy, copy.deepcopy, lambda e: pickle.loads(pickle.dumps(e))])
def test_a_copy_goes_on_and_leaves_the_original_alone(way: Any):
    env = UavParallelVectorEnv("case8", 3, {**BRITTLE, **SHORT}, "SameStep", threads=2)
    env.reset(seed=1)
    rng = np.random.default_rng(0)
    for _ in range(9):
        env.step(random_actions(env.action_masks(), rng))
    twin, other = way(env), way(env)
    for _ in range(9):
        other.step(random_actions(other.action_masks(), np.random.default_rng(7)))
    for _ in range(20):
        actions = random_actions(env.action_masks(), rng)
        for part, same in zip(env.step(actions), twin.step(actions), strict=True):
            assert_same(part, same)


def test_it_tells_what_the_joint_environments_tell():
    """Means over drones are the rewards of ``UavVectorEnv``, and the rest is the same."""
    each = UavParallelVectorEnv("case8", 2, {**BRITTLE, **SHORT}, world_seed=0)
    joint = UavVectorEnv("case8", 2, {**BRITTLE, **SHORT}, world_seed=0)
    each.reset(seed=0)
    joint.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(20):
        actions = random_actions(each.action_masks(), rng)
        seen, rewards, *_, told = each.step(actions)
        others, mean, *_, also = joint.step(actions)
        assert_same(seen.reshape(2, -1), others)
        assert np.allclose(rewards.mean(axis=1), mean, rtol=1e-15)
        assert_same(told["forced"].min(axis=1), also["forced"])
        assert_same(told["elapsed_steps"].min(axis=1), also["elapsed_steps"])
        assert_same(told["crashes"].sum(axis=1), also["crashes"])
        for key in ("sim_time_s", "qoe1_percent", "requests", "seed", "episode_number"):
            assert_same(told[key], also[key])


@pytest.mark.parametrize("name", MOST)
def test_the_whole_state_is_that_of_simpy(name: str):
    case, config = SCENARIOS[name]
    both = [UavParallelEnv(case, config, engine=engine) for engine in ("des", "batch")]
    many = UavParallelVectorEnv(case, 1, config)
    rng = np.random.default_rng(1)
    for seed in (3, None, None):
        for env in (*both, many):
            env.reset(seed=seed)
        while both[0].agents:
            state = both[0].state()
            assert state in both[0].state_space and len(state) == len(many.state_names)
            assert_same(both[1].state(), state)
            assert_same(many.state()[0], state)
            check_state(both[0], dict(zip(many.state_names, state.tolist(), strict=True)))
            actions = random_actions(many.action_masks(), rng)
            for env in both:
                env.step(dict(zip(env.agents, actions[0].tolist(), strict=True)))
            many.step(actions)
        assert_same(both[1].state(), both[0].state())


def check_state(env: UavParallelEnv, state: dict[str, float]) -> None:
    """Each number is what the engine itself says."""
    engine, world = env.session.engine, env.session.world
    (drones_m, users_m), doing = engine.positions_m(), engine.user_states()
    for d, (x_m, y_m, z_m) in enumerate(drones_m.tolist()):
        seen = env.session.snapshot.observations[d]
        assert state[f"drone_{d}_x"] == pytest.approx(x_m / world.grid.width_m)
        assert state[f"drone_{d}_y"] == pytest.approx(y_m / world.grid.depth_m)
        assert state[f"drone_{d}_z"] == pytest.approx(z_m / world.grid.levels_m[-1])
        assert state[f"drone_{d}_mode_{seen.mode.name.lower()}"] == 1.0
        if seen.capacity_s is not None:
            assert state[f"drone_{d}_battery"] == pytest.approx(seen.battery_s / seen.capacity_s)
    for k, name in enumerate(("idle", "attached", "waiting", "served")):
        assert state[f"users_{name}"] == pytest.approx(doing.count(k) / len(doing))
    x, y = (int(at * 10 // side) for at, side in zip(users_m[0, :2], world.area, strict=True))
    assert state[f"users_{x}_{y}"] > 0
    waiting = sum(value for name, value in state.items() if name.startswith("waiting_"))
    assert waiting == pytest.approx(doing.count(2) / len(doing), abs=1e-6)


def test_asking_for_the_state_changes_nothing():
    envs = [UavParallelEnv("case8", BRITTLE, engine="batch") for _ in range(2)]
    rng = np.random.default_rng(1)
    for seed in (3, None):
        for env in envs:
            env.reset(seed=seed)
        while envs[0].agents:
            envs[0].state()
            masks = envs[0].action_masks().reshape(3, -1)
            actions = dict(zip(envs[0].agents, random_actions(masks, rng).tolist(), strict=True))
            assert repr(envs[0].step(actions)) == repr(envs[1].step(actions))
    with pytest.raises(gymnasium.error.ResetNeeded):
        UavParallelVectorEnv("case8", 1).state()
    with pytest.raises(gymnasium.error.ResetNeeded):
        UavParallelEnv("case8").state()


def test_resets_without_a_seed():
    """Before the first one there is an engine only in the first environment."""
    env = UavParallelVectorEnv("case8", 2, world_seed=0)
    for other in (env, copy.deepcopy(env)):
        _, infos = other.reset()
        assert infos["episode_number"].tolist() == [0, 0]
        other.step(np.zeros((2, 3), int))
