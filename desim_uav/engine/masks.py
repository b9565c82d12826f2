"""The actions that a drone may take wherever it is, by the rules that engines run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from desim_uav.engine.base import RunSettings
from desim_uav.engine.constants import set_needs
from desim_uav.engine.des import Simulation
from desim_uav.engine.episode import Engine
from desim_uav.model.motion.planner import Node
from desim_uav.rules import words
from desim_uav.rules.battery import type_of
from desim_uav.rules.decide import allow, taken
from desim_uav.rules.flight import appear, hover_at
from desim_uav.rules.note import place
from desim_uav.rules.shield import shield
from desim_uav.sample_path import draw
from desim_uav.world import World


class Masks:
    """The masks of a world's drones that fly from cell to cell, with and without a shield.

    ``ceiling``: they fly no higher than the levels below the ceiling.
    """

    def __init__(self, world: World, ceiling: bool) -> None:
        ceilings = (ceiling,) * world.scenario.drone_count
        self._engine = Simulation(world, RunSettings(ceilings, carry_over=False))
        self._engine.reset(draw(world, world.seed, 0))

    def at(self, drone: int, node: Node, charge: int) -> tuple[bool, ...]:
        """Return the mask of a drone that hovers at a node (x, y, level) and is asked.

        It believes itself to be where it is. Its charge is in units of its battery.
        """
        world, state = self._engine.constants, self._engine.state
        row, observation = state.drones[drone], state.observations[drone]
        (x, y, level), actions = node, len(world.moves)
        appear(world, state, row, x, y)
        hover_at(row, x, y, level)
        row.waits = 1
        observation.mode, observation.charge = words.FLYING, charge
        observation.x, observation.y, observation.level = node
        observation.believed = place(world, *node)
        allow(world, state)
        own = slice(drone * actions, (drone + 1) * actions)
        return tuple(map(bool, state.masks[own]))


class Shield:
    """A shield for a world whose scenario has none: it narrows the masks of an engine.

    It forbids what the rules forbid to shielded drones, and allows nothing more than the engine:
    no return above ``return_below``. The drones fly from cell to cell.
    """

    def __init__(self, world: World, ceilings: tuple[bool, ...]) -> None:
        self._made_of = world, ceilings
        settings = RunSettings(ceilings, carry_over=False)
        self._engine = Simulation(world, settings)
        for row, own in zip(self._engine.constants.types, world.types, strict=True):
            row.shielded = int(own.limited)
        set_needs(self._engine.constants, world, settings, early=False)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what makes a copy: a copy of the engine would have no shield."""
        return Shield, self._made_of

    def narrowed(self, engine: Engine, masks: Sequence[Sequence[bool]]) -> list[tuple[bool, ...]]:
        """Return the masks of an engine's drones at its decision epoch, as far as they are safe.

        Raises SimulationError if nothing is left to a drone.
        """
        found = [self._narrowed(engine, drone, mask) for drone, mask in enumerate(masks)]
        self._engine.check_components()
        return found

    def _narrowed(self, engine: Engine, drone: int, mask: Sequence[bool]) -> tuple[bool, ...]:
        world, state = self._engine.constants, self._engine.state
        row, observation, first = state.drones[drone], state.observations[drone], drone * len(mask)
        for k, allowed in enumerate(mask):
            state.masks[first + k] = int(allowed)
        if sum(mask) == 1 or not type_of(world, row).shielded:
            return tuple(mask)
        true, seen = engine.drones[drone], engine.state.observations[drone]
        row.x, row.y, row.level = true.x, true.y, true.level
        observation.charge, observation.believed = seen.charge, seen.believed
        shield(world, state, row)
        for k, allowed in enumerate(mask):
            state.masks[first + k] &= int(allowed)
        found = tuple(map(bool, state.masks[first : first + len(mask)]))
        if not any(found):
            state.faults |= words.STRANDED
        return found

    def taken(self, commands: Sequence[int]) -> list[int]:
        """Return commands with what a shielded drone takes in place of those now forbidden."""
        world, state = self._engine.constants, self._engine.state
        for row, command in zip(state.drones, commands, strict=True):
            row.command = command
        return [taken(world, state, row) for row in state.drones]
