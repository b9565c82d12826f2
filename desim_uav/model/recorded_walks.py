"""Recorded walks, from a CSV file or from what the traffic simulator SUMO writes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby, pairwise
from operator import itemgetter
from pathlib import Path
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.rules import US
from desim_uav.model.streams import Streams
from desim_uav.model.sumo import looks_like_xml, read_fcd
from desim_uav.model.traces import index, quantity, read_table
from desim_uav.model.walking import Area, Walks
from desim_uav.registry import register


class _WayPoint(NamedTuple):
    """Where a user is at a time, the line of the file that says so, and its name for the user."""

    user: int
    t_us: int
    x_m: float
    y_m: float
    line: int
    name: str


@register("mobility", "trace")
@dataclass(frozen=True)
class Trace:
    """Takes way points from a CSV file with the columns user, t_s, x_m, y_m, or from SUMO.

    A user stands at its first way point until that point's time, walks straight from each way
    point to the next, and stays at the last. A user without way points stays at home. A file of
    SUMO's is floating car data (option `--fcd-output`): its vehicles and persons are the users, in
    the order in which they appear.
    """

    file: Path
    """The file, relative to the scenario's file."""
    later: ClassVar = ("format",)

    format: Literal["auto", "csv", "fcd"] = "auto"
    """`csv`, `fcd` (SUMO's floating car data), or `auto`: as the file begins."""
    draws: ClassVar = False

    def __post_init__(self) -> None:
        """Read the file. Raises ValueError with file and line if it is not such a table."""
        for points in self._way_points().values():
            for before, after in pairwise(points):
                if after.t_us <= before.t_us:
                    raise ValueError(
                        f"{self.file}:{after.line}: {self._time}: {after.name}: times must increase"
                    )

    def problems(self, users: int, area: Area) -> list[str]:
        """Return the problems of the file in a scenario: unknown users, way points off its map."""
        found, is_fcd = [], self._is_fcd
        for user, points in self._way_points().items():
            if user >= users and is_fcd:
                found.append(
                    f"{self.file}:{points[0].line}: {points[0].name} is number {user + 1}, but "
                    f"the scenario has {users}"
                )
            for point in points:
                at = f"{self.file}:{point.line}"
                if user >= users and not is_fcd:
                    found.append(f"{at}: user: {user}: must be from 0 to {users - 1}")
                if point.x_m > area.width_m or point.y_m > area.depth_m:
                    found.append(
                        f"{at}: ({point.x_m:g}, {point.y_m:g}) m is off the map of "
                        f"{area.width_m:g} x {area.depth_m:g} m"
                    )
        return found

    def expected_legs(self, users: int, area: Area, horizon_s: float) -> float:
        """Return the number of legs of all users in an episode."""
        return 2 * users + sum(len(points) for points in self._way_points().values())

    def walks(
        self, homes: NDArray[np.float64], streams: Streams, area: Area, horizon_us: int
    ) -> Walks:
        """Return the recorded walks, which are the same in every episode."""
        legs: list[tuple[float, ...]] = []
        offsets = [0]
        way_points = self._way_points()
        for user, (home_x, home_y) in enumerate(homes):
            points = [(p.t_us, p.x_m, p.y_m) for p in way_points.get(user, ())]
            points = points or [(0, home_x, home_y)]
            if points[0][0] > 0:
                points.insert(0, (0, *points[0][1:]))
            for (t0, x0, y0), (t1, x1, y1) in pairwise(points):
                seconds = (t1 - t0) / US
                legs.append((t0, x0, y0, (x1 - x0) / seconds, (y1 - y0) / seconds))
            legs.append((*points[-1], 0.0, 0.0))
            offsets.append(len(legs))
        return Walks(np.array(legs, float), np.array(offsets))

    @property
    def _is_fcd(self) -> bool:
        return self.format == "fcd" or (self.format == "auto" and looks_like_xml(self.file))

    @property
    def _time(self) -> str:
        """What the file calls a time."""
        return "time" if self._is_fcd else "t_s"

    def _way_points(self) -> dict[int, list[_WayPoint]]:
        """Return each user's way points, in the file's order."""
        rows = self._of_sumo() if self._is_fcd else self._of_table()
        grouped = groupby(sorted(rows, key=itemgetter(0)), key=itemgetter(0))
        return {user: list(group) for user, group in grouped}

    def _of_table(self) -> list[_WayPoint]:
        columns = {"user": index, "t_s": quantity, "x_m": quantity, "y_m": quantity}
        return [
            _WayPoint(user, round(t * US), x, y, line, f"user {user}")
            for user, t, x, y, line in read_table(self.file, columns)
        ]

    def _of_sumo(self) -> list[_WayPoint]:
        users: dict[str, int] = {}
        return [
            _WayPoint(users.setdefault(mover, len(users)), round(t_s * US), x_m, y_m, line, mover)
            for mover, t_s, x_m, y_m, line in read_fcd(self.file)
        ]
