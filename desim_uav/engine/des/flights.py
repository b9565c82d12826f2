"""The legs that drones can fly in a world."""

from __future__ import annotations

from desim_uav.model.motion import REST, Leg, Transit
from desim_uav.model.planner import Node
from desim_uav.model.rules import MOVES, Action
from desim_uav.world import World

Move = tuple[Node, Leg]
"""Where a move leads, and how."""


class Flights:
    """The legs of a world's drones, each made once."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._hovers: dict[Node, Leg] = {}
        self._moves: dict[tuple[Node, Action, bool], Move | None] = {}

    def hover(self, node: Node) -> Leg:
        """Staying at a place."""
        leg = self._hovers.get(node)
        if leg is None:
            leg = self._hovers[node] = self._leg(node, node, REST)
        return leg

    def move(self, node: Node, action: Action, ceiling: bool) -> Move | None:
        """What a moving action leads to; None where that is blocked."""
        key = (node, action, ceiling)
        try:
            return self._moves[key]
        except KeyError:
            target = neighbour(node, MOVES[action])
            free = self.world.grid.can_enter(*target, ceiling)
            transits = self.world.epoch_transits
            move = (target, self._leg(node, target, transits[action])) if free else None
            self._moves[key] = move
            return move

    def hop(self, node: Node, hop: Node) -> Leg:
        """A hop of a return."""
        return self._leg(node, neighbour(node, hop), self.world.fastest_transits[hop])

    def _leg(self, here: Node, there: Node, transit: Transit) -> Leg:
        grid = self.world.grid
        return Leg(
            transit,
            grid.centre(here[0], here[1]),
            grid.centre(there[0], there[1]),
            grid.levels_m[here[2]],
            grid.levels_m[there[2]],
        )


def neighbour(node: Node, hop: Node) -> Node:
    """The place a hop away."""
    return node[0] + hop[0], node[1] + hop[1], node[2] + hop[2]
