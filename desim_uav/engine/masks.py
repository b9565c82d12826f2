"""The actions that a drone may take wherever it is, by the rules that engines run."""

from __future__ import annotations

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.model.motion.planner import Node
from desim_uav.rules import words
from desim_uav.rules.decide import allow
from desim_uav.rules.flight import appear, hover_at
from desim_uav.rules.note import place
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
