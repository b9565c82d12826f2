"""Checks of a policy: that it obeys its masks and can be repeated."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from desim_uav.api import arguments
from desim_uav.api.kinds import Overrides, PolicyLike, ScenarioLike
from desim_uav.api.worlds import build_world
from desim_uav.engine.choose import lacking_of
from desim_uav.testing.engines import compare_engines
from desim_uav.testing.memory import How, require_no_memory, together


def check_policy(
    policy: PolicyLike,
    scenario: ScenarioLike = "case8",
    overrides: Overrides | None = None,
    *,
    seeds: int | Sequence[int] = 2,
    world_seed: int | None = None,
    episodes: int = 2,
) -> None:
    """Check a policy, in whole episodes of a scenario.

    These promises are checked:

    - It obeys its masks: no command is one that the simulation has to replace.
    - It draws random numbers from its streams only, and remembers nothing of an earlier run: run
      again, and each seed alone, it gives the same commands.
    - It flies alike in both engines (``compare_engines``).

    Args:
        policy: A policy as in ``run``: a name, a file, a class, an object or a function.
        scenario: The scenario to fly in.
        overrides: Keys of the scenario that are set.
        seeds: The number of seeds, or which.
        world_seed: The seed of the world alone, for a policy that was trained in one world.
        episodes: The number of episodes for each seed.

    Raises:
        AssertionError: a promise is not kept; the message says which, and where.
        DesimError: the scenario or the policy is refused.
    """
    loaded = arguments.opened(scenario, overrides, None, world_seed).scenario
    numbers = arguments.seeds_of(seeds)
    how = How(policy, episodes)
    tables = together(loaded, numbers, how)
    _require_obedience(tables["steps"])
    require_no_memory(loaded, numbers, how, tables)
    if not lacking_of(build_world(loaded, numbers[0])):
        compare_engines(loaded, policy=policy, seeds=numbers, episodes=episodes)


def _require_obedience(steps: pd.DataFrame) -> None:
    replaced = steps[steps["action"].notna() & (steps["action"] != steps["action_taken"])]
    if len(replaced):
        first = replaced.iloc[0]
        raise AssertionError(
            f"{len(replaced)} commands were not allowed, the first in seed {first['seed']}, "
            f"episode {first['episode']}, step {first['step']}: drone {first['drone']} was told "
            f"{first['action']!r}, and did {first['action_taken']!r}"
        )
