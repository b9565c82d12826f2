"""A plain Python function as a policy."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from desim_uav.errors import PolicyError, did_you_mean
from desim_uav.model.random.streams import Streams
from desim_uav.model.rules import Action, Variant
from desim_uav.model.state import Observation
from desim_uav.world import World

Answer = Callable[[Observation, Sequence[bool]], Action | Variant | int | str | Sequence[float]]
"""A function that chooses a drone's action from its observation and mask. It returns an ``Action``,
the name of an action, or an index into ``world.actions``; in free flight also the numbers of a
command, from -1 to 1. If commands choose a cruise speed or a share of tasks, an action without one
has the highest."""


class FunctionPolicy:
    """Calls a function for every drone at every decision epoch.

    The function is not called while only one action is allowed: a drone that returns, waits,
    charges or has crashed continues what it does.
    """

    ceiling = True

    def __init__(self, choose: Answer) -> None:
        self.choose = choose
        self.name = f"{choose.__module__}:{getattr(choose, '__qualname__', type(choose).__name__)}"

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Note the actions of the scenario."""
        self._commands = world.commands

    def act(self, observation: Observation, mask: Sequence[bool]) -> int | Sequence[float]:
        """Call the function. Raises PolicyError for an action that the scenario does not have."""
        if sum(mask) == 1:
            return list(mask).index(True)
        answer = self.choose(observation, mask)
        if not isinstance(answer, str | Action | Variant):
            return answer
        name = answer if isinstance(answer, str) else answer.name.lower()
        index_of = self._commands.of(observation.drone).named
        if name.lower() in index_of:
            return index_of[name.lower()]
        raise PolicyError(
            f"policy {self.name!r}: {name!r} is not an action of "
            f"{self._commands.whose(observation.drone)}{did_you_mean(name, index_of)}; "
            f"allowed: {', '.join(index_of)}"
        )
