"""The policy that hovers."""

from __future__ import annotations

from collections.abc import Sequence

from desim_uav.model.random.streams import Streams
from desim_uav.model.rules import Action, fastest_of
from desim_uav.model.state import Observation
from desim_uav.registry import register
from desim_uav.world import World


@register("policy", "hover")
class Hover:
    """Lets each drone hover at its start until its battery is empty."""

    ceiling = True
    _hover = int(Action.HOVER)

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Note the number of the action."""
        self._hover = fastest_of(world.actions)[Action.HOVER]

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """Return "hover", which a forced action overrides."""
        return self._hover
