"""A check that both engines give the same tables for a scenario."""

from __future__ import annotations

from collections.abc import Sequence

from desim_uav.api.kinds import Overrides, PolicyLike, ScenarioLike
from desim_uav.api.run import run
from desim_uav.testing.exact import require_same_tables, tables_of

ENGINES = ("des", "batch")


def compare_engines(
    scenario: ScenarioLike,
    overrides: Overrides | None = None,
    *,
    policy: PolicyLike = "random",
    seeds: int | Sequence[int] = 2,
    world_seed: int | None = None,
    episodes: int = 2,
) -> None:
    """Check that the SimPy engine and the compiled engine give the same tables, bit for bit.

    All tables of the runs are compared, with the event log and the flights of the drones.

    Args:
        scenario: A shipped name such as ``"case8"``, a file, its content, or a loaded scenario.
        overrides: Keys of the scenario that are set, such as ``{"users.count": 60}``.
        policy: The policy that flies, as in ``run``. By default, drones choose at random among
            their allowed actions, and so come to situations that better policies avoid.
        seeds: The number of seeds, or which.
        world_seed: The seed of the world alone. By default each seed has a world of its own.
        episodes: The number of episodes for each seed.

    Raises:
        AssertionError: a value differs; the message names the table, the row and the column.
        ScenarioError: the scenario is invalid, or has a component that cannot be compiled.
        DesimError: anything else that ``run`` refuses.
    """
    one, other = (
        run(
            scenario,
            overrides,
            policy=policy,
            seeds=seeds,
            world_seed=world_seed,
            episodes=episodes,
            events=True,
            engine=engine,
            progress=False,
        )
        for engine in ENGINES
    )
    require_same_tables(tables_of(one), tables_of(other), ENGINES)
