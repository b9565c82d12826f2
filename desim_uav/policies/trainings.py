"""How a network of stable-baselines3 may have been trained: its spaces, and how it chooses."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.commands.given import Command
from desim_uav.world import World

if TYPE_CHECKING:
    from gymnasium.spaces import Space

WRAPPERS = "FlattenObservation, JointActions and InTurn"
"""The wrappers of environments whose networks fly."""

MOST_NUMBERS = 2**31
"""More joint actions than a network of a file that can be read has outputs."""

Masks = Sequence[Sequence[bool]]
Scores = Callable[[NDArray[Any]], NDArray[np.float64]]
"""What a network makes of an observation: a number for each action, the higher the better."""

Choose = Callable[[Scores, NDArray[Any], Masks], list[Command]]
"""Returns the command of each drone, from the numbers that are observed of all, and their masks."""


class Training(NamedTuple):
    """The spaces of an environment, and how its drones choose; ``jointly``: all at once.

    ``wrapper``: whether the environment is one of ``WRAPPERS``.
    """

    observations: Any
    actions: Any
    choose: Choose
    jointly: bool
    wrapper: bool


def trainings(world: World) -> Iterator[Training]:
    """Return the ways to train a network that flies the drones of a world.

    Raises ScenarioError if some of its drones fly freely and others from cell to cell.
    """
    from desim_uav.spaces import observation_space, widest

    drones, encoding = world.scenario.drone_count, world.scenario.observation
    for count, facts in itertools.product((drones, 1), (widest(world), world.facts)):
        observed = observation_space(encoding.features(facts) * count)
        yield from _alike(world, observed, count)
        if count == drones and not world.free:
            yield from _one_number(world, observed)


def _alike(world: World, observed: Space[Any], count: int) -> Iterator[Training]:
    """A number for each drone, or a displacement; with FlattenObservation, too."""
    from gymnasium.spaces import flatten_space

    commands, jointly = world.commands.of_all("a network"), count == world.scenario.drone_count
    actions = commands.space_of(count)

    def choose(scores: Scores, numbers: NDArray[Any], masks: Masks) -> list[Command]:
        return commands.best(scores(numbers).reshape(len(masks), -1), masks)

    def flat(scores: Scores, numbers: NDArray[Any], masks: Masks) -> list[Command]:
        return choose(scores, _flat(observed, numbers), masks)

    yield Training(observed, actions, choose, jointly, False)
    yield Training(flatten_space(observed), actions, flat, jointly, True)


def _one_number(world: World, observed: Space[Any]) -> Iterator[Training]:
    """One number for all drones (with FlattenObservation, too), or for one after the other."""
    from gymnasium.spaces import Discrete, flatten_space

    from desim_uav.one_number import InOrder, JointNumber

    numbered = JointNumber(world.scenario.drone_count, len(world.actions))
    order = InOrder(observed, numbered.drones, numbered.actions)

    def joint(scores: Scores, numbers: NDArray[Any], masks: Masks) -> list[Command]:
        best = np.where(numbered.mask(masks), scores(numbers), -np.inf).argmax()
        return [*numbered.split(int(best))]

    def flat(scores: Scores, numbers: NDArray[Any], masks: Masks) -> list[Command]:
        return joint(scores, _flat(observed, numbers), masks)

    def in_turn(scores: Scores, numbers: NDArray[Any], masks: Masks) -> list[Command]:
        chosen: list[int] = []
        for mask in masks:
            liked = scores(order.observation(numbers.astype(observed.dtype), chosen))
            chosen.append(int(np.where(mask, liked, -np.inf).argmax()))
        return [*chosen]

    if numbered.count <= MOST_NUMBERS:
        yield Training(observed, numbered.space(), joint, True, True)
        yield Training(flatten_space(observed), numbered.space(), flat, True, True)
    yield Training(order.space, Discrete(numbered.actions), in_turn, True, True)


def _flat(space: Space[Any], numbers: NDArray[Any]) -> NDArray[Any]:
    """Return numbers of a space as FlattenObservation does: whole ones as one-hot vectors."""
    from gymnasium.spaces import flatten

    flat: Any = flatten(space, numbers.astype(space.dtype))
    return np.asarray(flat)
