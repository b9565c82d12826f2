"""One whole number for all drones, or for each in turn: against the environment that is wrapped."""

from __future__ import annotations

import copy
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import error
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import FlattenObservation, TimeLimit

from desim_uav.env import InTurn, JointActions, SkipForced, UavEnv
from desim_uav.env.arguments import ArgumentError
from desim_uav.env.session import ActionError
from tests.env.helpers import BRITTLE

GAMMA = 0.9
BY_EVENT = {**BRITTLE, "decisions": {"kind": "event", "patience_s": 45}}
WORLDS = {"by clock": BRITTLE, "by event": BY_EVENT, "one drone": {**BRITTLE, "drones.count": 1}}


def made(config: dict[str, Any] = BRITTLE) -> UavEnv:
    return UavEnv("case8", config, engine="des", world_seed=0)


def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two infos say the same, but for masks and turns."""
    keys = set(one) - {"action_mask", "turn"}
    return all(one[key] == other[key] for key in keys)


@pytest.mark.parametrize("world", WORLDS)
def test_a_joint_action_is_the_actions_of_all_drones(world: str):
    env, plain = JointActions(made(WORLDS[world])), made(WORLDS[world])
    n = 9
    assert env.action_space.n == n**plain.drones
    (seen, info), (told, known) = env.reset(seed=1), plain.reset(seed=1)
    rng, over = np.random.default_rng(0), False
    while not over:
        masks = known["action_mask"].reshape(plain.drones, n)
        for number in rng.integers(0, env.action_space.n, 20).tolist():
            digits = [number // n**k % n for k in reversed(range(plain.drones))]
            may = all(mask[digit] for mask, digit in zip(masks, digits, strict=True))
            assert info["action_mask"][number] == may
        assert (env.action_masks() == info["action_mask"].astype(bool)).all()
        assert (seen == told).all() and same(info, known)
        number = int(rng.integers(env.action_space.n))
        digits = [number // n**k % n for k in reversed(range(plain.drones))]
        seen, reward, terminated, truncated, info = env.step(number)
        told, *others, known = plain.step(digits if plain.drones > 1 else digits[0])
        assert others == [reward, terminated, truncated]
        over = terminated or truncated


@pytest.mark.parametrize("world", WORLDS)
def test_drones_that_choose_in_turn_fly_as_if_they_chose_together(world: str):
    """The rewards of a whole episode, discounted by what the infos say, are the same, too."""
    env, plain = InTurn(made(WORLDS[world])), made(WORLDS[world])
    drones, n = plain.drones, 9
    (seen, info), (told, known) = env.reset(seed=2), plain.reset(seed=2)
    width, over, rng = len(seen) - drones * (1 + n), False, np.random.default_rng(0)
    gained, weight, due, at = 0.0, 1.0, 0.0, 1.0
    while not over:
        actions: list[int] = []
        for drone in range(drones):
            first = gymnasium.spaces.flatten(plain.observation_space, told)
            assert (seen[:width] == first).all()
            assert info["turn"] == seen[width : width + drones].argmax() == drone
            assert seen[width : width + drones].sum() == 1
            chosen = seen[width + drones :].reshape(drones, n)
            assert chosen.sum(axis=1).tolist() == [1] * drone + [0] * (drones - drone)
            assert chosen[:drone].argmax(axis=1).tolist() == actions
            own = known["action_mask"].reshape(drones, n)[drone]
            assert (info["action_mask"] == own).all() and (env.action_masks() == own).all()
            actions.append(int(rng.integers(n)))
            seen, reward, terminated, truncated, info = env.step(actions[-1])
            gained += weight * reward
            weight *= info["discount"]
            if drone < drones - 1:
                assert (reward, info["discount"], info["duration_steps"]) == (0.0, 1.0, 0.0)
        told, *others, known = plain.step(actions if drones > 1 else actions[0])
        assert others == [reward, terminated, truncated] and same(info, known)
        due, at = due + at * others[0], at * known["discount"]
        over = terminated or truncated
    assert gained == pytest.approx(due) and weight == pytest.approx(at)
    assert 0.0 < weight < 1.0


def test_forced_steps_are_skipped_beneath():
    """Rewards and discounts of several epochs by event are those that ``SkipForced`` gives."""
    env, plain = InTurn(SkipForced(made(BY_EVENT), GAMMA)), SkipForced(made(BY_EVENT), GAMMA)
    env.reset(seed=3), plain.reset(seed=3)
    rng, over, longest = np.random.default_rng(0), False, 0.0
    while not over:
        actions = rng.integers(0, 9, 3)
        steps = [env.step(int(action)) for action in actions]
        _, reward, terminated, truncated, known = plain.step(actions)
        assert steps[-1][1] == reward
        assert same(steps[-1][-1], known)
        discounts = [each[-1]["discount"] for each in steps]
        assert discounts == [1.0, 1.0, GAMMA ** known["duration_steps"]]
        longest, over = max(longest, known["duration_steps"]), terminated or truncated
    assert longest > 1.0


@pytest.mark.parametrize("wrapper", [JointActions, InTurn])
def test_gymnasium_accepts_them_and_copies_go_on(wrapper: Any):
    with pytest.warns(UserWarning, match="different from the unwrapped version"):
        check_env(wrapper(made()), skip_render_check=True)
    env = wrapper(made())
    env.reset(seed=1)
    env.step(4)
    other = copy.deepcopy(env)
    for action in (0, 3, 4, 1):
        one, another = env.step(action), other.step(action)
        assert (one[0] == another[0]).all() and one[1:4] == another[1:4]


@pytest.mark.parametrize("wrapper", [JointActions, InTurn])
def test_what_they_cannot_wrap_is_refused(wrapper: Any):
    with pytest.raises(ArgumentError, match="needs drones that fly from cell to cell"):
        wrapper(made({"drones.motion.space": "free"}))
    env = wrapper(made())
    with pytest.raises(error.ResetNeeded):
        env.step(0)
    env.reset(seed=0)
    for action in (-1, 9**3, 0.5, "left"):
        with pytest.raises(ActionError, match="must be a whole number in Discrete"):
            env.step(action)


def test_too_many_joint_actions_are_refused_with_their_number():
    with pytest.raises(ArgumentError, match=r"5 drones with 9 actions each have 59,049 joint act"):
        JointActions(made({**BRITTLE, "drones.count": 5}))
    assert JointActions(made({**BRITTLE, "drones.count": 4})).action_space.n == 6561
    with pytest.raises(ArgumentError, match="at most 728 are allowed"):
        JointActions(made(), most=728)
    with pytest.raises(ArgumentError, match="most: must be at least 1, not -1"):
        JointActions(made(), most=-1)


@pytest.mark.parametrize("outer", [JointActions, InTurn, SkipForced])
@pytest.mark.parametrize("inner", [JointActions, InTurn])
def test_actions_are_numbered_by_the_outermost_wrapper_alone(outer: Any, inner: Any):
    for between in (inner(made()), TimeLimit(FlattenObservation(inner(made())), 9)):
        said = f"{outer.__name__} cannot wrap {inner.__name__}, which has changed the actions"
        with pytest.raises(ArgumentError, match=said):
            outer(between)


@pytest.mark.parametrize("steps", [5, 1000])
def test_the_first_drone_is_not_asked_after_the_end(steps: int):
    """The time limit of the wrapper beneath, and that of the scenario, end the episode."""
    env = InTurn(TimeLimit(made(), steps))
    for seed in (0, 1):
        env.reset(seed=seed)
        over = False
        while not over:
            _, _, terminated, truncated, info = env.step(4)
            over = terminated or truncated
        assert info["turn"] == 0
        for _ in range(2):
            with pytest.raises(error.ResetNeeded, match="call reset first"):
                env.step(4)


def plain_wrappers(env: Any) -> Any:
    return TimeLimit(FlattenObservation(env), 17)


@pytest.mark.parametrize("wrapper", [JointActions, InTurn])
@pytest.mark.parametrize("beneath", [False, True], ids=["above", "beneath"])
def test_masks_stay_right_with_other_wrappers(wrapper: Any, beneath: bool):
    """Those of whole episodes, over and under wrappers that leave the actions as they are."""
    under = plain_wrappers(made(BY_EVENT)) if beneath else made(BY_EVENT)
    env = wrapper(under) if beneath else plain_wrappers(wrapper(under))
    plain = wrapper(made(BY_EVENT))
    rng = np.random.default_rng(0)
    for seed in (0, 1):
        (_, info), (_, known), over = env.reset(seed=seed), plain.reset(seed=seed), False
        while not over:
            mask = env.get_wrapper_attr("action_masks")()
            assert mask.shape == (env.action_space.n,)
            assert (mask == info["action_mask"]).all() and (mask == plain.action_masks()).all()
            assert (mask == known["action_mask"]).all()
            action = int(rng.choice(np.flatnonzero(mask)))
            _, _, terminated, truncated, info = env.step(action)
            known = plain.step(action)[-1]
            over = terminated or truncated
