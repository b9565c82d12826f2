"""Random allowed actions in an environment of Gymnasium, or in a parallel one of PettingZoo."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias

import numpy as np
from gymnasium import Env
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete, Space, Tuple
from pettingzoo import ParallelEnv

AnyEnv: TypeAlias = Env[Any, Any] | ParallelEnv[Any, Any, Any]
MASK = "action_mask"


def play(
    env: AnyEnv, rng: np.random.Generator, seen: Any, steps: int | None = None
) -> Iterator[tuple[Any, ...]]:
    """Yield what each step returns, to the end of the episode or for so many ``steps``.

    ``seen`` is the latest observation, or those of all agents.
    """
    while steps is None or steps > 0:
        shown = env.step(some_action(env, rng, seen))
        yield shown
        if is_over(env, shown):
            return
        seen, steps = shown[0], steps and steps - 1


def is_over(env: AnyEnv, shown: tuple[Any, ...]) -> bool:
    """Return whether the step that returned this was the last one of its episode."""
    if isinstance(env, ParallelEnv):
        return not env.agents
    return bool(shown[2] or shown[3])


def some_action(env: AnyEnv, rng: np.random.Generator, seen: Any) -> Any:
    """Return a random action, or a mapping with one for each agent, that the masks allow."""
    if isinstance(env, Env):
        return sample(env.action_space, rng, mask_of(env))
    return {
        agent: sample(env.action_space(agent), rng, mask_in(seen[agent])) for agent in env.agents
    }


def mask_in(seen: Any) -> Any:
    """Return the mask that is a part of an agent's observation, or None."""
    return seen.get(MASK) if isinstance(seen, Mapping) else None


def mask_of(env: Env[Any, Any]) -> Any:
    """Return the mask of a single environment, which is a method of it, or None."""
    if not env.has_wrapper_attr("action_masks"):
        return None
    return env.get_wrapper_attr("action_masks")()


def sample(space: Space[Any], rng: np.random.Generator, mask: Any = None) -> Any:
    """Return a random element of a space; masks apply to spaces of action numbers."""
    if isinstance(space, Discrete):
        allowed = np.arange(space.n) if mask is None else np.flatnonzero(mask)
        return int(space.start + rng.choice(allowed))
    if isinstance(space, MultiDiscrete):
        sizes = space.nvec.ravel()
        flat = np.ones(sizes.sum(), bool) if mask is None else np.concatenate(mask, axis=None)
        each = np.split(flat, np.cumsum(sizes)[:-1])
        chosen = [rng.choice(np.flatnonzero(allowed)) for allowed in each]
        return np.array(chosen, space.dtype).reshape(space.shape) + space.start
    if isinstance(space, Box):
        low, high = np.maximum(space.low, -1e3), np.minimum(space.high, 1e3)
        return rng.uniform(low, high).astype(space.dtype)
    if isinstance(space, Tuple):
        return tuple(sample(part, rng) for part in space.spaces)
    if isinstance(space, Dict):
        return {name: sample(part, rng) for name, part in space.spaces.items()}
    space.seed(int(rng.integers(2**31)))
    return space.sample()
