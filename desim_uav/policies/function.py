"""A plain Python function as a policy."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from desim_uav.errors import PolicyError
from desim_uav.model.rules import Action
from desim_uav.model.state import Observation
from desim_uav.model.streams import Streams
from desim_uav.registry import did_you_mean
from desim_uav.world import World

Choice = Callable[[Observation, Sequence[bool]], "Action | int | str"]
"""Chooses a drone's action from its observation and mask: an ``Action``, the name of one, or the
index of one in ``world.actions``."""


class Function:
    """Asks a function for every drone at every decision epoch.

    The function is not asked while an action is forced, because then only one is allowed: a drone
    that returns, waits, charges or has crashed goes on with what it does.
    """

    ceiling = True

    def __init__(self, choose: Choice) -> None:
        self.choose = choose
        self.name = f"{choose.__module__}:{getattr(choose, '__qualname__', type(choose).__name__)}"

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Learn which actions there are."""
        self._index = {action: index for index, action in enumerate(world.actions)}
        self._by_name = {action.name.lower(): action for action in world.actions}

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        """Ask the function. Raises PolicyError for an action that the scenario does not have."""
        if sum(mask) == 1:
            return list(mask).index(True)
        chosen = self.choose(observation, mask)
        if isinstance(chosen, str):
            chosen = self._by_name.get(chosen.lower(), chosen)
        if isinstance(chosen, Action) and chosen in self._index:
            return self._index[chosen]
        if isinstance(chosen, str | Action):
            name = chosen if isinstance(chosen, str) else chosen.name.lower()
            raise PolicyError(
                f"policy {self.name!r}: {name!r} is not an action of this scenario"
                f"{did_you_mean(name, self._by_name)}; allowed: {', '.join(self._by_name)}"
            )
        return chosen
