"""Recorded walks, from a CSV file or from what the simulators SUMO and ns-2 read or write."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby, pairwise
from operator import itemgetter
from pathlib import Path
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from desim_uav.model.geometry.coverage import WalkLeg
from desim_uav.model.geometry.extents import Extent, are_angles, extent_of, like_degrees
from desim_uav.model.mobility.ns2 import looks_like_ns2, read_ns2
from desim_uav.model.mobility.sumo import looks_like_xml, read_fcd
from desim_uav.model.mobility.walks import Area, Walks, off_map
from desim_uav.model.random.streams import Streams
from desim_uav.model.rules import US
from desim_uav.model.traces import (
    LARGEST,
    Version,
    coordinate,
    index,
    quantity,
    read_table,
    version_of,
)
from desim_uav.registry import register
from desim_uav.rowcode.views import records

Shift = Annotated[float, Ge(-LARGEST), Le(LARGEST)]

SLOWEST_MPS = 0.01
"""If nobody who moves is faster, positions are in degrees: 0.01 degrees a second are 4,000 km/h."""


class _WayPoint(NamedTuple):
    """The position of a user at a time, with the line of the file and the user's name in it."""

    user: int
    t_us: int
    x_m: float
    y_m: float
    line: int
    name: str


WayPoints = dict[int, list[_WayPoint]]
"""The way points of each user, by its number."""


@register("mobility", "trace")
@dataclass(frozen=True)
class Trace:
    """Takes way points from a CSV file with the columns user, t_s, x_m, y_m, from SUMO or ns-2.

    A user stands at its first way point until that point's time, walks straight from each way
    point to the next, and stays at the last. A user without way points stays at home. A file from
    SUMO is floating car data (option `--fcd-output`): its vehicles and persons are the users, in
    the order in which they appear. A file for ns-2 has lines with `setdest`; user n is its node n.
    """

    file: Path
    """The file, relative to the scenario's file."""
    later: ClassVar = ("format", "begin_s", "offset_m")

    format: Literal["auto", "csv", "fcd", "ns2"] = "auto"
    """`csv`, `fcd` (SUMO's floating car data), `ns2` (movements of ns-2), or `auto`: what the
    file looks like.
    """
    begin_s: Annotated[float, Ge(0), Le(LARGEST)] = 0.0
    """The time of the recording at which an episode begins, in seconds. A user who is walking
    then begins at the place that it has reached by this time. Vehicles and persons from SUMO that
    are last seen before this time are left out.
    """
    offset_m: tuple[Shift, Shift] = (0.0, 0.0)
    """What is added to each x and y of the recording to get places on the map, in metres. The
    coordinates of a recording may be negative; on the map they are from 0 to `map.size_m`.
    """
    draws: ClassVar = False

    def __post_init__(self) -> None:
        """Read the file. Raises ValueError with file and line if it is not such a table."""
        for points in self._recorded().values():
            for before, after in pairwise(points):
                if after.t_us <= before.t_us:
                    raise ValueError(
                        f"{self.file}:{after.line}: {self._time}: {after.name}: times must increase"
                    )
        if self._is_fcd:
            self._require_movers()

    def _require_movers(self) -> None:
        """Raise ValueError if no vehicle or person from SUMO is there in an episode."""
        points, containers = read_fcd(self.file)
        if not points:
            some = f"{containers} containers, but " if containers else ""
            raise ValueError(
                f"{self.file}: it has {some}no vehicles or persons, which are the users"
            )
        if not self._way_points():
            raise ValueError(
                f"{self.file}: it ends at {max(point.t_s for point in points):g} s, before "
                f"begin_s: {self.begin_s:g}"
            )

    def problems(self, users: int, area: Area) -> list[str]:
        """Return the problems of the file in a scenario: unknown users, way points off its map."""
        problems, is_fcd = [], self._is_fcd
        way_points = self._way_points()
        for user, points in way_points.items():
            if user >= users and is_fcd:
                problems.append(
                    f"{self.file}:{points[0].line}: {points[0].name} is number {user + 1}, but "
                    f"the scenario has {users}"
                )
            for point in points:
                if user >= users and not is_fcd:
                    at = f"{self.file}:{point.line}"
                    problems.append(f"{at}: user: {user}: must be from 0 to {users - 1}")
        return [*problems, *self._off_the_map(way_points, area)]

    def _off_the_map(self, way_points: WayPoints, area: Area) -> Iterator[str]:
        """Yield the way points that are off the map, and what would move them onto it."""
        points = (point for points in way_points.values() for point in points)
        off = [point for point in points if off_map(point.x_m, point.y_m, area)]
        hint = self._remedy(area) if off else ""
        for point in off:
            yield (
                f"{self.file}:{point.line}: ({point.x_m:g}, {point.y_m:g}) m is off the map of "
                f"{area.width_m:g} x {area.depth_m:g} m{hint}"
            )

    def _remedy(self, area: Area) -> str:
        """Return how a recording that is not on the map could be moved onto it."""
        if self._like_degrees(area):
            return f"; {_DEGREES}"
        extent, shifts = self._extent, []
        for least_m, most_m, side_m in zip(extent[::2], extent[1::2], area, strict=True):
            if most_m - least_m > side_m:
                return ""
            shifts.append(0.0 if least_m >= 0.0 and most_m <= side_m else -least_m)
        if not any(shifts):
            return ""
        dx, dy = (own + shift for own, shift in zip(self.offset_m, shifts, strict=True))
        return f"; offset_m: [{dx:g}, {dy:g}] moves the recording onto it"

    def doubts(self, users: int, area: Area, horizon_s: float) -> Iterator[str]:
        """Yield what is allowed in a recording, but probably not intended for such an episode."""
        way_points = self._way_points()
        if not way_points:
            yield f"{self.file}: it has no way points; all users stay at home"
            return
        if self._like_degrees(area):
            yield f"{self.file}: {self._extent}: {_DEGREES}"
        containers = read_fcd(self.file).containers if self._is_fcd else 0
        if containers:
            some = _counted(containers, "container")
            yield f"{self.file}: {some} left out; the users are vehicles and persons"
        moving = [points for points in self._recorded().values() if len(points) > 1]
        horizon_us, ends = round(horizon_s * US), f"the end of an episode at {horizon_s:g} s"
        if moving and not any(
            points[0].t_us < horizon_us and points[-1].t_us > 0 for points in moving
        ):
            begins_s, ends_s = self._times_s()
            yield (
                f"{self.file}: nobody moves in an episode of {horizon_s:g} s that begins at "
                f"begin_s: {self.begin_s:g}; the recording lasts from {begins_s:g} to {ends_s:g} s"
            )
        elif self._is_fcd:
            late = sum(points[0].t_us >= horizon_us for points in way_points.values())
            if late:
                yield (
                    f"{self.file}: {late} of {len(way_points)} vehicles and persons appear after "
                    f"{ends} only, and stand there until then"
                )

    def summary(self, users: int, horizon_s: float) -> str:
        """Return in words who moves in the recording, where and when."""
        if not self._recorded():
            return f"{self.file.name}: no way points"
        names = [points[0].name.partition(" ")[0] for points in self._recorded().values()]
        movers = ", ".join(_counted(count, name) for name, count in Counter(names).items())
        begins_s, ends_s = self._times_s()
        home = max(0, users - len(self._way_points()))
        return (
            f"{self.file.name}: {movers}; {self._extent}; {begins_s:g} to {ends_s:g} s, of which "
            f"an episode has {self.begin_s:g} to {self.begin_s + horizon_s:g} s; "
            f"{home} of {users} users stay at home"
        )

    def expected_legs(self, users: int, area: Area, horizon_s: float) -> float:
        """Return the number of legs of all users in an episode."""
        return 2 * users + sum(len(points) for points in self._recorded().values())

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
        return Walks(records(WalkLeg, legs), np.array(offsets))

    @property
    def _is_fcd(self) -> bool:
        return self._form == "fcd"

    @property
    def _form(self) -> str:
        """The format of the file: csv, fcd or ns2."""
        if self.format != "auto":
            return self.format
        if looks_like_xml(self.file):
            return "fcd"
        return "ns2" if looks_like_ns2(self.file) else "csv"

    @property
    def _time(self) -> str:
        """The name of a time in the file."""
        return "time" if self._is_fcd else "t_s"

    @property
    def _extent(self) -> Extent:
        """The extent of the recording on the map."""
        return extent_of(
            np.array([point[2:4] for points in self._recorded().values() for point in points])
        )

    def _times_s(self) -> tuple[float, float]:
        """Return the first and the last time of the recording, in its own seconds."""
        times = [point.t_us for points in self._recorded().values() for point in points]
        return min(times) / US + self.begin_s, max(times) / US + self.begin_s

    def _like_degrees(self, area: Area) -> bool:
        """Return whether places are probably longitudes and latitudes in degrees.

        Then all of them lie within a metre, or nobody who moves reaches ``SLOWEST_MPS``.
        """
        own = [np.array([point[1:4] for point in points]) for points in self._recorded().values()]
        places = np.concatenate([points[:, 1:] for points in own]) - np.array(self.offset_m)
        extent = extent_of(places)
        if like_degrees(extent, area):
            return True
        if not are_angles(extent, area):
            return False
        moves = [np.diff(points, axis=0) for points in own if len(points) > 1]
        speeds = [np.hypot(x, y) / t * US for t, x, y in (one.T for one in moves)]
        fastest_mps = max((float(one.max()) for one in speeds), default=0.0)
        return 0.0 < fastest_mps < SLOWEST_MPS

    def _way_points(self) -> WayPoints:
        """Return each user's way points from the beginning of an episode on, at times since then.

        If a user is walking at that time, the first one is the place that it has then reached.
        """
        points_of: WayPoints = {}
        is_fcd = self._is_fcd
        for number, points in self._recorded().items():
            before = sum(point.t_us < 0 for point in points)
            if before < len(points):
                walks = before > 0 and points[before].t_us > 0
                first = [_between(points[before - 1], points[before])] if walks else []
                points_of[len(points_of) if is_fcd else number] = [*first, *points[before:]]
            elif not is_fcd:
                points_of[number] = [points[-1]._replace(t_us=0)]
        return points_of

    def _recorded(self) -> WayPoints:
        """Return each user's way points, in the file's order, on the map of an episode."""
        begin_us = round(self.begin_s * US)
        return _recorded(self.file, self._form, begin_us, self.offset_m, version_of(self.file))


@lru_cache(maxsize=4)
def _recorded(
    file: Path, form: str, begin_us: int, offset_m: tuple[float, float], version: Version
) -> WayPoints:
    """Return the way points of a file at this version (see ``Trace``)."""
    dx, dy = offset_m
    points = (
        _WayPoint(user, round(t_s * US) - begin_us, x_m + dx, y_m + dy, line, name)
        for user, t_s, x_m, y_m, line, name in READERS[form](file)
    )
    grouped = groupby(sorted(points, key=itemgetter(0)), key=itemgetter(0))
    return {user: list(group) for user, group in grouped}


Rows = Iterator[tuple[int, float, float, float, int, str]]
"""A user's number, a time in s, x and y in m, the line, and the file's name for the user."""


def _of_table(file: Path) -> Rows:
    columns = {"user": index, "t_s": quantity, "x_m": coordinate, "y_m": coordinate}
    for row in read_table(file, columns):
        yield (*row, f"user {row[0]}")


def _of_ns2(file: Path) -> Rows:
    for node, t_s, x_m, y_m, line in read_ns2(file):
        yield node, t_s, x_m, y_m, line, f"node {node}"


def _of_sumo(file: Path) -> Rows:
    users: dict[str, int] = {}
    for mover, t_s, x_m, y_m, line in read_fcd(file).way_points:
        yield users.setdefault(mover, len(users)), t_s, x_m, y_m, line, mover


READERS = {"csv": _of_table, "fcd": _of_sumo, "ns2": _of_ns2}
"""The function that reads a file, by its format."""

_DEGREES = (
    "these are hardly metres but longitudes and latitudes in degrees; project them to metres "
    "(SUMO writes metres without --fcd-output.geo)"
)


def _between(before: _WayPoint, after: _WayPoint) -> _WayPoint:
    """Return where a user is at time 0, on its way from one point to the next."""
    share = -before.t_us / (after.t_us - before.t_us)
    x_m = before.x_m + share * (after.x_m - before.x_m)
    y_m = before.y_m + share * (after.y_m - before.y_m)
    return before._replace(t_us=0, x_m=x_m, y_m=y_m)


def _counted(count: int, name: str) -> str:
    return f"{count} {name}{'s' if count != 1 else ''}"
