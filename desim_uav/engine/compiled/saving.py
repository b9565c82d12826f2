"""The state of the compiled engine as a block of memory, which is copied as it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from desim_uav.engine.compiled.pack import Fixed
from desim_uav.engine.saved import Rows, read
from desim_uav.engine.state import Buffers
from desim_uav.rowcode.rows import Words
from desim_uav.rowcode.views import View, array_of
from desim_uav.rules.rows import Constants, State
from desim_uav.rules.words import NEVER, RETURNING


@dataclass(frozen=True, eq=False)
class Block:
    """A copy of the memory of a state, and what determines its layout and what it refers to.

    ``path`` is the sample path in memory, which is shared, because nothing writes to it.
    """

    words: Words
    path: Words
    fixed: Fixed
    buffers: Buffers
    leg_buffer: int

    def rows(self) -> Rows:
        """Return the state as rows."""
        state: Any = View(self.words, State)
        hops = array_of(self.fixed.block, Constants, "hops")
        routes = [
            tuple(hops[drone.route : drone.route_end].tolist()) if drone.mode == RETURNING else ()
            for drone in state.drones
        ]
        times, keys = state.slot_times, state.slot_keys
        slots = np.flatnonzero(times != NEVER)
        slots = slots[np.lexsort((keys[slots], times[slots]))]
        due = zip(slots.tolist(), times[slots].tolist(), keys[slots].tolist(), strict=True)
        return Rows(read(state, State), tuple(routes), tuple(due))
