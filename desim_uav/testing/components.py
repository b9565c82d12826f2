"""Checks of a scenario with a component of one's own."""

from __future__ import annotations

from collections.abc import Sequence

from desim_uav.api import arguments
from desim_uav.api.kinds import Overrides, PolicyLike, ScenarioLike
from desim_uav.api.run import run
from desim_uav.api.worlds import build_world
from desim_uav.engine.choose import lacking_of
from desim_uav.env import UavParallelEnv
from desim_uav.scenario.load import dump, from_mapping, to_plain
from desim_uav.scenario.schema import Scenario
from desim_uav.testing.batteries import require_inverse_drains
from desim_uav.testing.bystanders import require_features, require_no_effect
from desim_uav.testing.engines import compare_engines
from desim_uav.testing.environments import check_copies
from desim_uav.testing.exact import require, require_same_tables
from desim_uav.testing.memory import How, require_no_memory, together


def check_component(
    scenario: ScenarioLike,
    overrides: Overrides | None = None,
    *,
    policy: PolicyLike = "random",
    seeds: int | Sequence[int] = 2,
    episodes: int = 2,
    compiled: bool = True,
) -> None:
    """Check a scenario with a component of your own, of whatever kind.

    These promises are checked:

    - The scenario says all: written to YAML and read again, it is the same scenario.
    - A component remembers nothing outside the simulation: run again, and in the other order of
      the seeds, the same seed gives the same tables.
    - Users walk the same walks whatever the drones do, so that policies can be compared on the
      same seed.
    - Both engines give the same tables (``compare_engines``), unless ``compiled`` is false.
    - Features lie in their bounds, and rewards and observations change nothing of what happens.
    - A battery drains no less with time, and ``lasts`` is the inverse of ``drains``.
    - The copy of an environment goes on as the original does.

    Args:
        scenario: A scenario that names the component: a file, its content, or a loaded scenario.
        overrides: Keys of the scenario that are set.
        policy: The policy that flies, as in ``run``. By default, drones choose at random among
            their allowed actions.
        seeds: The number of seeds, or which.
        episodes: The number of episodes for each seed.
        compiled: Whether the component has to work in the compiled engine.

    Raises:
        AssertionError: a promise is not kept; the message says which, and where.
        ScenarioError: the scenario is invalid.
        DesimError: anything else that ``run`` refuses.
    """
    loaded = arguments.opened(scenario, overrides).scenario
    numbers = arguments.seeds_of(seeds)
    _require_round_trip(loaded)
    world = build_world(loaded, numbers[0])
    require_inverse_drains(world)
    lacking = lacking_of(world)
    require(not (compiled and lacking), "; ".join(lacking))
    if compiled:
        compare_engines(loaded, policy=policy, seeds=numbers, episodes=episodes)
    how = How(policy, episodes)
    require_no_memory(loaded, numbers, how, together(loaded, numbers, how))
    require_no_effect(loaded, numbers[0], how)
    require_features(loaded, numbers[0])
    _require_same_walks(loaded, numbers[0], episodes)
    check_copies(UavParallelEnv(loaded, engine="des"), numbers[0])


def _require_round_trip(scenario: Scenario) -> None:
    again = from_mapping(to_plain(scenario))
    require(
        dump(again) == dump(scenario),
        f"written and read again, the scenario is another one:\n{dump(again)}",
    )


def _require_same_walks(scenario: Scenario, seed: int, episodes: int) -> None:
    one, other = (
        run(scenario, policy=policy, seed=seed, episodes=episodes, progress=False, engine="des")
        for policy in ("hover", "random")
    )
    require_same_tables({"users": one.users}, {"users": other.users}, ("hover", "random"))
