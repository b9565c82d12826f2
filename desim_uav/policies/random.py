"""The policy that chooses at random."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from desim_uav.commands.given import Command
from desim_uav.model.random.streams import Streams
from desim_uav.model.state import Observation
from desim_uav.registry import register
from desim_uav.world import World


@register("policy", "random")
class Random:
    """Chooses each allowed action with equal probability, from one random stream per drone.

    In free flight, it draws the numbers of each command uniformly from -1 to 1.
    """

    ceiling = True

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Take a new random stream for each drone."""
        self._commands = world.commands
        self._streams = [streams.generator(d) for d in range(world.scenario.drone_count)]

    def memory(self) -> list[list[int]]:
        """Return the state of each drone's random stream, as four whole numbers."""
        states: list[dict[str, Any]] = [dict(one.bit_generator.state) for one in self._streams]
        return [state["state"]["state"].tolist() for state in states]

    def remember(self, memory: list[list[int]]) -> None:
        """Continue the random streams from these states."""
        for stream, words in zip(self._streams, memory, strict=True):
            state: dict[str, Any] = dict(stream.bit_generator.state)
            stream.bit_generator.state = state | {"state": {"state": np.array(words, np.uint64)}}

    def act(self, observation: Observation, mask: Sequence[bool]) -> Command:
        """Draw one of the allowed actions."""
        drone = observation.drone
        return self._commands.of(drone).drawn(drone, self._streams[drone], mask)
