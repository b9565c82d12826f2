"""Checks of an environment in whole episodes, after those of its library."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from contextlib import redirect_stdout
from io import StringIO
from typing import Any

import numpy as np
from gymnasium import Env
from gymnasium.utils.env_checker import check_env
from pettingzoo import ParallelEnv
from pettingzoo.test import parallel_api_test

from desim_uav.testing.exact import difference, require
from desim_uav.testing.play import AnyEnv, is_over, mask_in, mask_of, play

STOCK_CYCLES = 100
"""So many steps PettingZoo's own check takes."""

NOT_COMPARED = ("compiled", "episode")
"""What infos say of the engine, and of the time that an episode took (RecordEpisodeStatistics)."""


def check_environment(
    env: AnyEnv, *, episodes: int = 2, seed: int = 0, most_steps: int = 100_000
) -> None:
    """Check an environment in whole episodes of random allowed actions.

    The library's own check comes first (``check_env`` of Gymnasium, ``parallel_api_test`` of
    PettingZoo), which looks at a few steps. Then these promises are checked:

    - Observations lie in their spaces, from the first to the last one; rewards are finite numbers.
    - A mask allows at least one action.
    - Every episode ends within ``most_steps``.
    - The same seed and actions give the same observations, rewards, flags and infos.
    - A deep copy that is made in an episode goes on as the original does, and leaves it alone.

    Args:
        env: An environment of Gymnasium or a parallel one of PettingZoo, of this package or your
            own, with or without wrappers. It is reset, and closed at the end.
        episodes: The number of episodes, which follow each other without a new seed.
        seed: The seed of the first reset and of the actions.
        most_steps: So many steps an episode may have.

    Raises:
        AssertionError: a promise is not kept; the message says which, and after which step.
        gymnasium.error.Error: one of Gymnasium's own check.
        TypeError: ``env`` is neither of the two kinds of environments.
    """
    _check_by_library(env)
    first = list(_episodes(env, episodes, seed, most_steps))
    again = list(_episodes(env, episodes, seed, most_steps))
    _require_same(first, again, "played again with the same seed and actions")
    check_copies(env, seed)
    env.close()


def _check_by_library(env: AnyEnv) -> None:
    if isinstance(env, Env):
        check_env(env.unwrapped, skip_render_check=True, skip_close_check=True)
    elif isinstance(env, ParallelEnv):
        with redirect_stdout(StringIO()):
            parallel_api_test(env, num_cycles=STOCK_CYCLES)
    else:
        raise TypeError(f"{env!r} is neither an Env of Gymnasium nor a ParallelEnv of PettingZoo")


def _episodes(env: AnyEnv, episodes: int, seed: int, most: int) -> Iterator[tuple[Any, ...]]:
    """Play episodes, check and yield all that is returned."""
    rng = np.random.default_rng(seed)
    for episode in range(episodes):
        begun = env.reset(seed=seed if episode == 0 else None)
        _check_seen(env, begun[0], f"episode {episode}, at the reset")
        yield begun
        step, over = 0, False
        for step, shown in enumerate(play(env, rng, begun[0], most), 1):
            _check_step(env, shown, f"episode {episode}, step {step}")
            over = is_over(env, shown)
            yield shown
        require(over, f"episode {episode} has not ended after {step} steps")


def _check_step(env: AnyEnv, shown: tuple[Any, ...], where: str) -> None:
    _check_seen(env, shown[0], where)
    rewards, terminated, truncated = (_by_agent(part) for part in shown[1:4])
    for agent, reward in rewards.items():
        finite = bool(np.isfinite(np.asarray(reward, float)).all())
        require(finite, f"{where}: the reward{agent} is {reward!r}")
    flags = [*terminated.values(), *truncated.values()]
    require(all(isinstance(flag, bool | np.bool_) for flag in flags), f"{where}: flags {flags}")


def _by_agent(part: Any) -> dict[str, Any]:
    if isinstance(part, Mapping):
        return {f" of {agent}": of for agent, of in part.items()}
    return {"": part}


def _check_seen(env: AnyEnv, seen: Any, where: str) -> None:
    """Check observations and masks."""
    if isinstance(env, ParallelEnv):
        for agent, of in seen.items():
            space = env.observation_space(agent)
            require(of in space, f"{where}: {agent} sees {of!r}, which is not in {space}")
            _check_mask(mask_in(of), f"{where}: {agent}")
    else:
        space = env.observation_space
        require(seen in space, f"{where}: {seen!r} is not in {space}")
        _check_mask(mask_of(env), where)


def _check_mask(mask: Any, where: str) -> None:
    allowed = True if mask is None else bool(np.any(mask))
    require(allowed, f"{where}: the mask allows no action")


def check_copies(env: AnyEnv, seed: int, before: int = 3) -> None:
    """Require that a deep copy goes on as the original does, and leaves it alone."""
    seen, _ = env.reset(seed=seed)
    for shown in play(env, np.random.default_rng(seed), seen, before):
        seen = shown[0]
    disturbed, other = copy.deepcopy(env), copy.deepcopy(env)
    _rest(disturbed, seen, seed + 1)
    _require_same(
        _rest(env, seen, seed),
        _rest(other, seen, seed),
        f"a copy that was made after {before} steps",
    )
    disturbed.close()
    other.close()


def _rest(env: AnyEnv, seen: Any, seed: int) -> list[tuple[Any, ...]]:
    return list(play(env, np.random.default_rng(seed), seen))


def _require_same(some: list[Any], others: list[Any], what: str) -> None:
    for k, (one, other) in enumerate(zip(some, others, strict=False)):
        apart = difference(one, other, skips=NOT_COMPARED)
        require(apart is None, f"{what}, turn {k} differs: {apart}")
    require(len(some) == len(others), f"{what}: {len(some)} turns are {len(others)}")
