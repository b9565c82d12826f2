"""A charging station: pads behind one first-come first-served queue."""

from __future__ import annotations

import simpy

from desim_uav.engine.des.agenda import Agenda
from desim_uav.model.grid import Cell


class Station:
    """A station on ``cell`` with ``pads`` places to charge, one drone each."""

    def __init__(self, agenda: Agenda, index: int, cell: Cell, pads: int) -> None:
        self.index = index
        self.cell = cell
        self.pads = simpy.Resource(agenda, capacity=pads)

    def place(self, pad: simpy.Event) -> int:
        """How many drones are before the one that asked for ``pad``, those on pads among them."""
        return [*self.pads.users, *self.pads.queue].index(pad)
