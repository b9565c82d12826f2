"""A check that a run is the same whatever was run before it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from desim_uav.api.kinds import PolicyLike
from desim_uav.api.run import run
from desim_uav.scenario.schema import Scenario
from desim_uav.testing.exact import Frames, require_same_tables, tables_of


class How(NamedTuple):
    """Who flies in each seed, and for how many episodes."""

    policy: PolicyLike
    episodes: int


def together(scenario: Scenario, seeds: Sequence[int], how: How) -> Frames:
    """Run the seeds one after the other in the SimPy engine, and return their tables."""
    return tables_of(run(scenario, seeds=list(seeds), **_settings(how)))


def require_no_memory(scenario: Scenario, seeds: Sequence[int], how: How, tables: Frames) -> None:
    """Require that each seed alone, the last one first, has the rows that it has in ``tables``."""
    for seed in reversed(seeds):
        alone = tables_of(run(scenario, seed=seed, **_settings(how)))
        of_seed = {
            name: frame[frame["seed"] == seed].drop(columns="seed").reset_index(drop=True)
            for name, frame in tables.items()
        }
        require_same_tables(of_seed, alone, (f"seed {seed} after others", f"seed {seed} alone"))


def _settings(how: How) -> dict[str, Any]:
    return {**how._asdict(), "events": True, "engine": "des", "progress": False}
