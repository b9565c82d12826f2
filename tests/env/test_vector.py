"""Environments in the compiled engine give the numbers of those on SimPy, one or many."""

from __future__ import annotations

import copy
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from desim_uav.env import UavEnv, UavVectorEnv
from desim_uav.env.session import ActionError
from desim_uav.errors import ScenarioError
from desim_uav.rules.rewards import Coverage
from desim_uav.testing.exact import difference

CASES = [f"case{k}" for k in range(1, 10)]
MODES = list(AutoresetMode)
SHORT = {"drones.battery.autonomy_min": 7}


def config(case: str, **more: Any) -> dict[str, Any]:
    return {"episode.steps": 10, **(SHORT if case > "case3" else {}), **more}


def legal(masks: np.ndarray, drones: int, rng: np.random.Generator) -> np.ndarray:
    """An allowed action for each drone of each environment."""
    rows = masks.reshape(len(masks), drones, -1)
    return np.array([[rng.choice(np.flatnonzero(mask)) for mask in row] for row in rows])


def assert_same(one: Any, other: Any, where: str = "") -> None:
    apart = difference(one, other, where, skips={"compiled"})  # in which alone engines differ
    assert apart is None, apart


@pytest.mark.parametrize("kind", ["position", "local"])
@pytest.mark.parametrize("case", CASES)
def test_one_environment_is_the_same_in_both_engines(case: str, kind: str):
    changes = config(case, **{"observation.kind": kind})
    one, other = UavEnv(case, changes), UavEnv(case, changes, engine="batch")
    assert one.observation_space == other.observation_space
    rng = np.random.default_rng(1)
    for seed in (3, None, None, 4):
        seen, others = one.reset(seed=seed), other.reset(seed=seed)
        assert_same(list(seen)[1], list(others)[1])
        assert_same(seen[0], others[0])
        over = False
        while not over:
            assert_same(one.action_masks(), other.action_masks())
            (action,) = legal(seen[1]["action_mask"][None], one.drones, rng)
            action = action if one.drones > 1 else action[0]
            seen, others = one.step(action)[::4], other.step(action)
            assert_same(seen[0], others[0])
            assert_same(seen[1], others[4])
            over = others[2] or others[3]
        assert one.session.snapshot == other.session.snapshot
        assert [a.tolist() for a in one.session.engine.positions_m()] == [
            b.tolist() for b in other.session.engine.positions_m()
        ]


def test_rewards_and_ends_are_the_same_too():
    changes = config("case9", **{"drones.battery.on_crash": "end_episode", "episode.steps": 40})
    one, other = UavEnv("case9", changes), UavEnv("case9", changes, engine="batch")
    ends = set()
    for seed in range(8):
        one.reset(seed=seed)
        other.reset(seed=seed)
        while True:
            told, others = one.step([4, 4, 4])[1:4], other.step([4, 4, 4])[1:4]
            assert told == others
            if told[1] or told[2]:
                ends.add(told[1:])
                break
    assert (True, False) in ends


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("case", ["case1", "case5", "case8", "case9"])
def test_many_are_those_that_gymnasium_would_step_one_by_one(case: str, mode: AutoresetMode):
    changes = config(case, **{"observation.kind": "local" if case == "case9" else "position"})
    one = SyncVectorEnv([lambda: UavEnv(case, changes)] * 3, autoreset_mode=mode)
    other = UavVectorEnv(case, 3, changes, autoreset_mode=mode, threads=2)
    assert other.metadata["autoreset_mode"] is mode
    assert one.single_action_space == other.single_action_space
    assert one.observation_space == other.observation_space
    (seen, told), (others, also) = one.reset(seed=6), other.reset(seed=6)
    assert_same(seen, others)
    assert_same(told, also)
    rng, drones = np.random.default_rng(2), UavEnv(case, changes).drones
    for _ in range(26):
        masks = other.action_masks()
        assert (masks == told["action_mask"])[told["_action_mask"]].all()
        actions = legal(masks, drones, rng)
        actions = actions if drones > 1 else actions[:, 0]
        seen, others = one.step(actions), other.step(actions)
        for part, same in zip(seen, others, strict=True):
            assert_same(part, same)
        told = seen[4]
        over = seen[2] | seen[3]
        if mode is AutoresetMode.DISABLED and over.any():
            # What Gymnasium is handed it takes the mask out of.
            (seen, told), (others, also) = (
                env.reset(options={"reset_mask": over.copy()}) for env in (one, other)
            )
            assert_same(seen, others)
            assert_same(told, also)
    other.close()


@pytest.mark.parametrize("mode", MODES)
def test_only_the_environments_of_a_reset_mask_are_reset(mode: AutoresetMode):
    changes = config("case8")
    one = SyncVectorEnv([lambda: UavEnv("case8", changes)] * 4, autoreset_mode=mode)
    other = UavVectorEnv("case8", 4, changes, autoreset_mode=mode.value)
    assert other.autoreset_mode is mode
    one.reset(seed=3)
    other.reset(seed=3)
    rng = np.random.default_rng(0)
    resets = {  # in mid-episode, and at the instant when the other episodes end
        2: ([True, False, False, True], None),
        5: ([False, True, False, False], 9),
        12: ([False, False, True, True], [None, None, 1, 2]),
    }
    for step in range(15):
        if step in resets:
            mask, seed = np.array(resets[step][0]), resets[step][1]
            before = other.infos(np.ones(4, np.bool_))
            options = {"reset_mask": mask}
            others, also = other.reset(seed=seed, options=options)
            assert options["reset_mask"] is mask
            seen, told = one.reset(seed=seed, options=options)
            assert_same(seen, others)
            assert_same(told, also)
            after = other.infos(np.ones(4, np.bool_))
            for key in ("sim_time_s", "episode_number", "seed"):
                assert (after[key] == before[key])[~mask].all()
            assert (after["sim_time_s"][mask] == 0).all()
        over = other.outputs.over[:, :2].any(axis=1)
        if mode is AutoresetMode.DISABLED and over.any():
            one.reset(options={"reset_mask": over})
            other.reset(options={"reset_mask": over})
        actions = legal(other.action_masks(), 3, rng)
        for part, same in zip(one.step(actions), other.step(actions), strict=True):
            assert_same(part, same)


def test_without_autoreset_a_step_past_the_end_is_refused():
    env = UavVectorEnv("case1", 3, {"episode.steps": 2}, autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=0)
    actions = np.zeros(3, int)
    env.step(actions)
    env.reset(options={"reset_mask": np.array([False, True, False])})
    assert env.step(actions)[3].tolist() == [True, False, True]
    before = env.infos(np.ones(3, np.bool_))
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"the episode is over in \[0, 2\]"):
        env.step(actions)
    assert_same(env.infos(np.ones(3, np.bool_)), before)
    env.reset(options={"reset_mask": np.array([True, False, True])})
    told = env.step(actions)
    assert told[3].tolist() == [False, True, False]
    assert told[4]["episode_number"].tolist() == [1, 1, 1]


@pytest.mark.parametrize(
    "mask", [[False] * 3, [True] * 2, [1, 0, 0], None, "abc", [[True, False, True]]]
)
def test_reset_masks_that_are_refused(mask: Any):
    env = UavVectorEnv("case1", 3)
    env.reset(seed=0)
    with pytest.raises(gymnasium.error.Error, match="must be an array of 3 bool"):
        env.reset(options={"reset_mask": mask})


def test_frames_are_those_of_single_environments():
    changes = config("case8")
    one = SyncVectorEnv([lambda: UavEnv("case8", changes, render_mode="rgb_array")] * 2)
    other = gymnasium.make_vec(
        "desim_uav/Uav-v0", 2, scenario="case8", config=changes, render_mode="rgb_array"
    )
    assert other.render_mode == "rgb_array"
    assert "rgb_array" in other.metadata["render_modes"]
    one.reset(seed=0)
    other.reset(seed=0)
    for _ in range(3):
        frames, others = one.render(), other.render()
        assert len(frames) == len(others) == 2
        for frame, same in zip(frames, others, strict=True):
            assert same.shape == (600, 800, 3)
            assert np.array_equal(frame, same)
        actions = other.action_space.sample()
        one.step(actions)
        other.step(actions)
    other.close()


def test_frames_of_a_copy_are_its_own():
    env = UavVectorEnv("case8", 2, render_mode="rgb_array", world_seed=0)
    env.reset(seed=0)
    copied = copy.deepcopy(env)
    before = env.render()
    copied.step(np.zeros((2, 3), int))
    for frame, same, other in zip(before, env.render(), copied.render(), strict=True):
        assert np.array_equal(frame, same)
        assert not np.array_equal(frame, other)


def test_no_frames_unless_they_are_asked_for():
    env = UavVectorEnv("case1", 2)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode='rgb_array'"):
        assert env.render() is None
    with pytest.raises(gymnasium.error.UnsupportedMode, match="'human'"):
        UavVectorEnv("case1", 2, render_mode="human")


def test_the_number_of_threads_changes_nothing():
    outcomes = []
    for threads in (1, 2, 5):
        env = UavVectorEnv("case8", 5, {"world_seed": 1}, threads=threads)
        env.reset(seed=[4, 9, None, 1, 0] if threads else None)
        rng = np.random.default_rng(3)
        shown = [env.step(legal(env.action_masks(), 3, rng))[0][[0, 1, 3, 4]] for _ in range(35)]
        outcomes.append(np.array(shown))
        env.close()
    assert (outcomes[0] == outcomes[1]).all() and (outcomes[0] == outcomes[2]).all()


def test_one_world_for_all_where_its_seed_is_given():
    env = UavVectorEnv("case8", 4, {"world_seed": 7})
    _, told = env.reset(seed=1)
    assert told["world_seed"].tolist() == [7] * 4 and told["seed"].tolist() == [1, 2, 3, 4]
    sessions = env.sessions
    assert len({id(session.world) for session in sessions}) == 1
    assert len({id(session.engine.fixed) for session in sessions}) == 1
    _, told = UavVectorEnv("case8", 2).reset(seed=1)
    assert told["world_seed"].tolist() == [1, 2]


def test_more_crossings_than_there_is_room_for():
    """Users who run: one environment runs out of room, is played again with more, and goes on."""
    run = {"users.mobility": {"kind": "random_walk", "speed_mps": 190.0, "leg_s": 2.0}}
    one = SyncVectorEnv([lambda: UavEnv("case2", run)] * 2)
    other = UavVectorEnv("case2", 2, run)
    room = other.sessions[0].engine.buffers.crossings
    one.reset(seed=0)
    _, told = other.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(12):
        actions = legal(told["action_mask"], other.sessions[0].drones, rng)
        actions = actions.reshape(other.action_space.shape)
        seen, others = one.step(actions), other.step(actions)
        for part, same in zip(seen, others, strict=True):
            assert_same(part, same)
        told = others[4]
    assert max(s.engine.buffers.crossings for s in other.sessions) > room


def test_gymnasium_makes_them():
    env = gymnasium.make_vec("desim_uav/Case8-v0", num_envs=3, threads=2)
    assert isinstance(env.unwrapped, UavVectorEnv)
    _, told = env.reset(seed=5)
    assert told["seed"].tolist() == [5, 6, 7]
    env.close()


@pytest.mark.parametrize("case", ["case1", "case8"])
def test_gymnasium_finds_nothing(case: str):
    check_env(UavEnv(case, engine="batch"), skip_render_check=True)
    env = gymnasium.make(f"desim_uav/{case.title()}-v0", engine="batch")
    env.reset(seed=0)
    env.step(env.action_space.sample())


@pytest.mark.parametrize(
    "actions", [[0, 1], [[0], [1], [99]], [[0], [-1], [1]], [[0.5]] * 3, "abc", [[0], [0, 1], [2]]]
)
def test_what_are_no_actions(actions: Any):
    env = UavVectorEnv("case1", 3)
    env.reset(seed=0)
    with pytest.raises(ActionError):
        env.step(actions)


def test_nothing_happens_before_a_reset():
    with pytest.raises(gymnasium.error.ResetNeeded):
        UavVectorEnv("case1", 2).step(np.zeros(2, int))
    env = UavVectorEnv("case1", 2)
    env.reset(options={"reset_mask": np.array([False, True])})
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"\[0\]"):
        env.step(np.zeros(2, int))
    with pytest.raises(gymnasium.error.ResetNeeded):
        UavEnv("case1", engine="batch").step(0)


@pytest.mark.parametrize(
    "wrong",
    [{"num_envs": 0}, {"num_envs": 2, "threads": 0}, {"num_envs": 2, "autoreset_mode": "never"}],
)
def test_what_cannot_be_asked_for(wrong: dict[str, Any]):
    with pytest.raises(gymnasium.error.Error):
        UavVectorEnv("case1", **wrong)
    with pytest.raises(gymnasium.error.Error, match="'des' or 'batch'"):
        UavEnv("case1", engine="gpu")
    with pytest.raises(gymnasium.error.Error, match="2 environments"):
        UavVectorEnv("case1", 2).reset(seed=[1, 2, 3])


class Mine(Coverage):
    """A reward that is not compiled."""

    def terms(self, observation: Any, asked: Any, facts: Any) -> Any:
        return {"users": observation.attached_users / facts.users}


class Shown:
    """An observation without a kernel."""

    def features(self, facts: Any) -> Any:
        from desim_uav.model.observations import Feature

        return (Feature("time", 0.0, 1.0, False),)

    def encode(self, observation: Any, facts: Any) -> Any:
        return (observation.step / observation.steps,)


@pytest.mark.parametrize(("key", "name"), [("reward", "Mine"), ("observation", "Shown")])
def test_components_without_a_kernel_are_refused_by_name(key: str, name: str):
    changes = {key: {"kind": f"{__name__}:{name}"}}
    UavEnv("case1", changes)
    with pytest.raises(ScenarioError, match=f"{key}: .*{name}.* is not compiled"):
        UavVectorEnv("case1", 2, changes)
    with pytest.raises(ScenarioError, match=f"{key}: .*{name}.* is not compiled"):
        UavEnv("case1", changes, engine="batch")


class TestStableBaselines:
    def test_its_vector_environment_is_one_of_single_ones(self):
        pytest.importorskip("stable_baselines3")
        from stable_baselines3.common.vec_env import DummyVecEnv

        from desim_uav.env import UavVecEnv

        changes = config("case8")
        one = DummyVecEnv([lambda: UavEnv("case8", changes)] * 2)
        other = UavVecEnv("case8", 2, changes, threads=2)
        one.seed(5)
        other.seed(5)
        assert_same(one.reset(), other.reset())
        rng = np.random.default_rng(0)
        for _ in range(25):
            masks = np.array(other.env_method("action_masks"))
            assert (masks == np.array(one.env_method("action_masks"))).all()
            actions = legal(masks, 3, rng)
            ours, theirs = other.step(actions), one.step(actions)
            for part, same in zip(ours[:3], theirs[:3], strict=True):
                assert_same(part, same)
            for told, also in zip(ours[3], theirs[3], strict=True):
                assert_same(told, also)
        other.close()

    def test_its_frames_are_put_side_by_side(self):
        pytest.importorskip("stable_baselines3")
        from desim_uav.env import UavVecEnv

        env = UavVecEnv("case1", 2, render_mode="rgb_array")
        env.reset()
        assert env.render_mode == "rgb_array"
        first, second = env.get_images()
        picture = env.render()
        assert np.array_equal(picture, np.concatenate([first, second], axis=0)) or np.array_equal(
            picture, np.concatenate([first, second], axis=1)
        )
        with pytest.warns(UserWarning, match="render_mode='rgb_array'"):
            assert list(UavVecEnv("case1", 2).get_images()) == [None, None]

    @pytest.mark.thorough
    def test_maskable_ppo_learns_in_it(self):
        sb3_contrib = pytest.importorskip("sb3_contrib")
        from desim_uav.env import UavVecEnv

        env = UavVecEnv("case1", 4, {"world_seed": 0})
        model = sb3_contrib.MaskablePPO("MlpPolicy", env, n_steps=32, batch_size=64, n_epochs=1)
        model.learn(256)
        assert model.num_timesteps >= 256
