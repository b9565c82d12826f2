"""Forks of a compiled engine for planners, which cost no Python for each fork or row."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.engine.base import OWN_COUNTS
from desim_uav.engine.compiled import calls
from desim_uav.engine.compiled.calls import ADDRESSES, NUMBERS
from desim_uav.engine.compiled.scratch import scratch
from desim_uav.engine.compiled.simulation import BatchSimulation
from desim_uav.errors import SimulationError
from desim_uav.rules.words import AIMS, OUT_OF_MEMORY


class Forks:
    """States in memory that go on from the present state of an engine, each by commands of its own.

    They share the constants of the engine, and its sample path. ``table`` (count, ADDRESSES) is a
    table of environments for ``calls.step_all``, ``look_at_all`` and kernels of a planner's own;
    the columns from 3 on are the addresses of ``outputs``, whose rows ``calls.OutputRow`` explains.
    Forks keep no log. The engine may go on, or be put into another state, while they exist.
    """

    def __init__(self, engine: BatchSimulation, count: int) -> None:
        """Make memory for ``count`` forks of an engine, which ``take`` begins."""
        self.engine, self.count = engine, count
        drones, actions = len(engine.drones), len(engine.world.actions)
        self.outputs = calls.OutputRow(
            np.zeros((count, drones * engine.constants.features)),
            np.zeros((count, drones * actions), np.bool_),
            np.zeros((count, 1)),
            np.zeros((count, NUMBERS + len(engine.term_names))),
            np.zeros((count, 3), np.bool_),
            np.zeros((count, drones)),
            np.zeros((count, drones * (len(OWN_COUNTS) + len(engine.term_names)))),
        )
        self.table = np.zeros((count, ADDRESSES), np.int64)
        self.table[:, 0] = engine.fixed.at  # which kernels read of all forks
        for k, row in enumerate(self.table):
            row[3:] = [array[k:].ctypes.data for array in self.outputs]
        self._all = np.ones(count, np.bool_)
        self._make_room()
        self.outputs.over[:] = True  # until they are taken

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Raise TypeError, because a copy would hold the addresses of these forks."""
        raise TypeError("forks cannot be copied or pickled; make new ones of a copied engine")

    def _make_room(self) -> None:
        """Make memory for states as large as that of the engine is now."""
        self.blocks = np.zeros((self.count, len(self.engine.memory)), np.int64)
        self.table[:, 2] = [block.ctypes.data for block in self.blocks]

    def take(self) -> None:
        """Copy the present state of the engine into all forks.

        Their outputs are written when they are stepped. Raises SimulationError if the engine has
        not begun an episode, or if its last step has failed.
        """
        engine = self.engine
        engine.require_epoch("take")
        if self.blocks.shape[1] != len(engine.memory):
            self._make_room()
        self._path = engine.path  # which must live as long as its address is used
        calls.fork_all(*engine.addresses(), len(engine.memory), self.table, self._all)
        self.outputs.over[:] = engine.terminated, engine.truncated, False

    def step(
        self,
        commands: NDArray[np.int64],
        which: NDArray[np.bool_] | None = None,
        aims: NDArray[np.float64] | None = None,
    ) -> int:
        """Step the forks, or those of a mask (count,), by commands (count, drones).

        ``aims`` (count, drones, AIMS) are the numbers of drones that fly freely, as
        ``world.commands.arrays`` returns them for one fork; None stands for zeros. Forks that are
        over stay as they are, and the outputs of the others are written. Returns the number of
        forks that a fault has stopped now, which the last column of ``outputs.over`` says;
        ``more_room`` lets them be taken anew. Raises ValueError if a shape is another one, or if a
        command is not an action.
        """
        shape = (self.count, len(self.engine.drones))
        commands = np.ascontiguousarray(commands, np.int64)
        going = ~self.outputs.over.any(axis=1)
        if which is not None:
            going &= which
        if commands.shape != shape:
            raise ValueError(f"commands must have the shape {shape}, not {commands.shape}")
        if self.engine.world.free:
            aims = np.zeros((*shape, AIMS)) if aims is None else np.ascontiguousarray(aims, float)
            if aims.shape != (*shape, AIMS):
                raise ValueError(f"aims must have the shape {(*shape, AIMS)}, not {aims.shape}")
            calls.aim_all(self.table, aims, going)
        stopped = calls.step_all(self.table, commands, going, scratch(), 0)
        if stopped < 0:
            raise ValueError(f"commands must be from 0 to {len(self.engine.world.actions) - 1}")
        return stopped

    def more_room(self) -> None:
        """Double the buffers of the engine, because forks have run out of them; its state stays.

        All forks must then be taken anew. Raises SimulationError if a component of one's own has
        stopped a fork.
        """
        faults = [calls.faults_of(address) for address in self.table[:, 2].tolist()]
        if any(fault and not fault & OUT_OF_MEMORY for fault in faults):
            raise SimulationError("a component has broken its contract in a fork")
        self.engine.enlarge()
        self._make_room()
        self.outputs.over[:] = True
