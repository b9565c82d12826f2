"""Stay where you are."""

from __future__ import annotations

from collections.abc import Sequence

from desim_uav.model.rules import Action
from desim_uav.model.state import Observation
from desim_uav.model.streams import Streams
from desim_uav.registry import register
from desim_uav.world import World


@register("policy", "hover")
class Hover:
    """Hovers until the battery is empty."""

    ceiling = True

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Nothing to remember."""

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """Hover; what is forced happens anyway."""
        return int(Action.HOVER)
