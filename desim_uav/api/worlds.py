"""The worlds of scenarios."""

from __future__ import annotations

from desim_uav.api.arguments import ScenarioLike, opened
from desim_uav.api.parameters import Seed
from desim_uav.scenario.load import Overrides
from desim_uav.typed import typed
from desim_uav.world import World
from desim_uav.world import build_world as built

__all__ = ["build_world"]


@typed
def build_world(
    scenario: ScenarioLike, seed: Seed = None, overrides: Overrides | None = None
) -> World:
    """Draw the world of a scenario: its buildings, stations, clusters and the homes of its users.

    Args:
        scenario: A shipped name such as ``"case8"``, a file, its content, or a loaded scenario.
        seed: The world seed. Default: that of the scenario, or else its seed.
        overrides: Values for keys of the scenario, such as ``{"users.count": 60}``.

    Raises:
        ScenarioError: the scenario is invalid, an episode would cost more than any engine has on
            this machine, no drawn map leaves the free cells connected, or a cluster does not fit
            on the map.
        UsageError: an override names no key, or the seed is not valid.
    """
    source = opened(scenario, overrides)
    with source.located():
        return built(
            source.scenario, source.scenario.effective_world_seed if seed is None else seed
        )
