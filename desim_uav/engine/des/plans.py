"""The planned returns of drones in the SimPy engine, which plans each when it is first needed."""

from __future__ import annotations

from collections.abc import Sequence

from desim_uav.model.geometry.grid import Grid
from desim_uav.model.motion.planner import Planner, Return
from desim_uav.rowcode.rows import BoundedTable, Table, fill
from desim_uav.rules.rows import Hop, PlanRow

NO_WAY = fill(PlanRow, (-1, -1, -1, 0, 0))
"""The plan of a place from which there is no way to a station."""


class Plans(dict[int, PlanRow]):
    """The planned returns from all places, by their numbers as in ``Constants.plans``.

    They are those of each planner in turn.
    """

    def __init__(self, planners: Sequence[Planner], grid: Grid) -> None:
        self.planners, self.grid = planners, grid
        self.hops: Table[Hop] = BoundedTable()  # which becomes longer, so it is not copied
        self._numbers: dict[tuple[tuple[int, int, int], ...], tuple[int, int]] = {}
        nx, ny = grid.cells
        self._places = len(grid.levels_m) * nx * ny

    def __missing__(self, number: int) -> PlanRow:
        """Return the plan with a number that is not known yet."""
        half, place = divmod(number, self._places)
        of, ceiling = divmod(half, 2)
        column, y = divmod(place, self.grid.cells[1])
        level, x = divmod(column, self.grid.cells[0])
        back = self.planners[of].plan((x, y, level), bool(ceiling))
        plan = self[number] = self._row(back)
        return plan

    def numbered(self, hops: Sequence[tuple[int, int, int]]) -> tuple[int, int]:
        """Return the number of the first of these hops, and the number after that of the last.

        They are added unless they are known already.
        """
        route, first = tuple(hops), len(self.hops)
        if route not in self._numbers:
            self.hops.extend(fill(Hop, hop) for hop in hops)
            self._numbers[route] = first, len(self.hops)
        return self._numbers[route]

    def _row(self, back: Return | None) -> PlanRow:
        """Return a planned return as a row, after adding its hops."""
        if back is None:
            return NO_WAY
        return fill(
            PlanRow, (back.station, back.duration_us, back.drain, *self.numbered(back.hops))
        )
