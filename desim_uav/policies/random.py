"""Any allowed action, equally likely."""

from __future__ import annotations

from collections.abc import Sequence

from desim_uav.model.state import Observation
from desim_uav.model.streams import Streams
from desim_uav.registry import register
from desim_uav.world import World


@register("policy", "random")
class Random:
    """Uniform over the mask, a stream of the learner's for each drone."""

    ceiling = True

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """A fresh stream for each drone."""
        self._streams = [streams.generator(d) for d in range(world.scenario.drones.count)]

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """One of the allowed actions."""
        allowed = [action for action, legal in enumerate(mask) if legal]
        return allowed[int(self._streams[observation.drone].random() * len(allowed))]
