"""The types of the arguments of verbs, which are imported when a verb is called."""

from __future__ import annotations

from pathlib import Path

from desim_uav.api.arguments import ScenarioLike
from desim_uav.api.sources import InFolders
from desim_uav.api.training import Callback
from desim_uav.experiment.compare import Comparison
from desim_uav.policies.base import PolicyLike
from desim_uav.scenario.load import Overrides
from desim_uav.scenario.schema import Scenario
from desim_uav.world import World

__all__ = [
    "Callback",
    "Drawn",
    "InFolders",
    "Overrides",
    "PolicyLike",
    "ScenarioLike",
    "Shown",
]

Drawn = str | Path | InFolders | Comparison | Scenario | World
"""What a figure is drawn of: a result, a comparison, the path of a folder or a file, the name of a
shipped scenario or policy, a scenario, or a world."""

Shown = str | Path | InFolders
"""What a page or a film is made of: a result, or the path of a folder."""
