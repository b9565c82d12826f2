"""A plain Python function as a policy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from desim_uav.errors import PolicyError, did_you_mean
from desim_uav.model.random.streams import Streams
from desim_uav.model.rules import Action, AtSpeed, fastest_of
from desim_uav.model.state import Observation
from desim_uav.rules.decide import can_take
from desim_uav.world import World

Choice = Callable[[Observation, Sequence[bool]], Action | AtSpeed | int | str | Sequence[float]]
"""A function that chooses a drone's action from its observation and mask. It returns an ``Action``,
the name of an action, or an index into ``world.actions``; in free flight also the numbers of a
command, from -1 to 1. If commands choose a cruise speed, a move without one is that at the highest
speed."""


class Function:
    """Calls a function for every drone at every decision epoch.

    The function is not called while only one action is allowed: a drone that returns, waits,
    charges or has crashed continues what it does.
    """

    ceiling = True

    def __init__(self, choose: Choice) -> None:
        self.choose = choose
        self.name = f"{choose.__module__}:{getattr(choose, '__qualname__', type(choose).__name__)}"

    def begin(self, world: World, streams: Streams, carried: bool = False) -> None:
        """Note the actions of the scenario."""
        self._index: dict[Any, int] = {**fastest_of(world.actions)}
        self._index |= {action: k for k, action in enumerate(world.actions)}
        self._by_name = {action.name.lower(): action for action in self._index}
        self._own = self._own_actions(world) if world.mixed else None

    def _own_actions(self, world: World) -> list[set[int]]:
        """Return the actions of each drone, if some fly freely and others from cell to cell."""
        types = [world.types[number] for number in world.type_numbers]
        return [
            {k for k, each in enumerate(world.actions) if can_take(int(each), own.free)}
            for own in types
        ]

    def act(self, observation: Observation, mask: Sequence[bool]) -> Any:
        """Call the function. Raises PolicyError for an action that the scenario does not have."""
        if sum(mask) == 1:
            return list(mask).index(True)
        chosen = self.choose(observation, mask)
        if isinstance(chosen, str):
            chosen = self._by_name.get(chosen.lower(), chosen)
        if isinstance(chosen, Action | AtSpeed) and chosen in self._index:
            number = self._index[chosen]
            if self._own is None or number in self._own[observation.drone]:
                return number
        if isinstance(chosen, str | Action | AtSpeed):
            raise self._no_action(chosen, observation.drone)
        return chosen

    def _no_action(self, chosen: str | Action | AtSpeed, drone: int) -> PolicyError:
        """Return the error of an action that the scenario, or the drone, does not have."""
        name = chosen if isinstance(chosen, str) else chosen.name.lower()
        whose, known = "this scenario", self._by_name
        if self._own is not None:
            whose, own = f"drone {drone}", self._own[drone]
            known = {word: action for word, action in known.items() if self._index[action] in own}
        return PolicyError(
            f"policy {self.name!r}: {name!r} is not an action of {whose}"
            f"{did_you_mean(name, known)}; allowed: {', '.join(known)}"
        )
