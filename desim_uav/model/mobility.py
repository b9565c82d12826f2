"""Mobility: how users walk in each episode, as straight legs (t0, x0, y0, vx, vy) from home."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby, pairwise
from operator import itemgetter
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple, Protocol

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from desim_uav.copies import Unchanging
from desim_uav.errors import SimulationError
from desim_uav.model.coverage import T0_US, VX, VY, X0, Y0
from desim_uav.model.kernels import kernel, part
from desim_uav.model.rules import US
from desim_uav.model.streams import Purpose, State, Streams, advanced, as_uniform, states_of
from desim_uav.model.traces import index, quantity, read_table
from desim_uav.registry import register


class Area(NamedTuple):
    """The map: 0 … width_m by 0 … depth_m."""

    width_m: float
    depth_m: float


class Walks(NamedTuple):
    """The walks of all users: rows of T0_US X0 Y0 VX VY, in microseconds, metres and m/s.

    The rows of user u are ``offsets[u]:offsets[u + 1]``. A user's first leg begins at time 0. Each
    leg begins where and when the one before ends; the last one has no end.
    """

    legs: NDArray[np.float64]
    offsets: NDArray[np.int64]

    def drawn(self) -> Walks:
        """Return these walks, which need not be drawn (see ``RandomWalks``)."""
        return self


class Mobility(Protocol):
    """A mobility model, which determines the walks of all users.

    A model without randomness may have ``draws = False``; its walks are then made once and used in
    every episode.
    """

    def walks(
        self, homes: NDArray[np.float64], streams: Streams, area: Area, horizon_us: int
    ) -> Walks:
        """Return the walks of one episode from ``homes`` (users, 2), in metres.

        User u may draw from stream u only. ``horizon_us`` is the length of the episode in
        microseconds.
        """


@register("mobility", "static")
@dataclass(frozen=True)
class Static:
    """Users stay at home."""

    draws: ClassVar = False

    def walks(
        self, homes: NDArray[np.float64], streams: Streams, area: Area, horizon_us: int
    ) -> Walks:
        """Return one leg per user, at speed 0."""
        legs = np.zeros((len(homes), 5))
        legs[:, X0 : Y0 + 1] = homes
        return Walks(legs, np.arange(len(homes) + 1))

    def expected_legs(self, users: int, area: Area, horizon_s: float) -> float:
        """The number of legs of all users in an episode."""
        return users


Law = tuple[float, int, int, float, float]
"""The parameters of a random walk: speed, time per leg, horizon, width and depth of the map."""


@register("mobility", "random_walk")
@dataclass(frozen=True)
class RandomWalk:
    """Each user takes a new uniform heading every ``leg_s``, and is reflected at the map's edge."""

    speed_mps: Annotated[float, Ge(0), Le(200)] = 1.4
    """The walking speed, in metres per second."""
    leg_s: Annotated[float, Ge(0.001)] = 60.0
    """How long a user walks before it takes a new heading, in seconds."""

    def walks(
        self, homes: NDArray[np.float64], streams: Streams, area: Area, horizon_us: int
    ) -> Walks:
        """Return random walks, with one random stream per user."""
        law = self.law(area, horizon_us)
        return RandomWalks(homes, streams.states(len(homes)), law).drawn()

    def law(self, area: Area, horizon_us: int) -> Law:
        """Return the parameters of the compiled loop."""
        return self.speed_mps, round(self.leg_s * US), horizon_us, *area

    def expected_legs(self, users: int, area: Area, horizon_s: float) -> float:
        """The number of legs of all users in an episode: turns, and walls that are met.

        The mean speed along an axis is 2/π of the speed; a wall is met once per side of the map.
        """
        walls = 2.0 / math.pi * self.speed_mps * horizon_s * sum(1.0 / side for side in area)
        return users * (math.ceil(horizon_s / self.leg_s) + walls)


@dataclass(frozen=True, eq=False)
class RandomWalks(Unchanging):
    """Random walks whose legs are drawn by a compiled loop only when they are needed.

    ``states`` (users, 4) are the initial states of the users' random streams. The compiled engine
    needs no more than these; it draws the legs itself, step by step, with ``next_leg``.
    """

    homes: NDArray[np.float64]
    states: NDArray[np.uint64]
    law: Law

    def drawn(self) -> Walks:
        """Draw the legs and return the walks."""
        return self._walks

    @cached_property
    def _walks(self) -> Walks:
        _, leg_us, horizon_us, *_ = self.law
        offsets = np.zeros(len(self.homes) + 1, np.int64)
        legs = np.empty((len(self.homes) * (horizon_us // leg_us + 8), 5))
        count = _random_walk(self.homes, self.states, self.law, offsets, legs)
        if count > len(legs):
            legs = np.empty((count, 5))
            _random_walk(self.homes, self.states, self.law, offsets, legs)
        return Walks(legs[:count], offsets)


@dataclass(frozen=True, eq=False)
class ManyRandomWalks(Sequence[RandomWalks]):
    """The random walks of several episodes; ``states`` has the shape (episodes, users, 4)."""

    homes: NDArray[np.float64]
    states: NDArray[np.uint64]
    law: Law

    def __len__(self) -> int:
        return len(self.states)

    def __getitem__(self, k: Any) -> Any:
        """Return the walks of episode k."""
        return RandomWalks(self.homes, self.states[k], self.law)


@register("mobility", "trace")
@dataclass(frozen=True)
class Trace:
    """Takes way points from a CSV file with the columns user, t_s, x_m, y_m.

    A user stands at its first way point until that point's time, walks straight from each way
    point to the next, and stays at the last. A user without way points stays at home.
    """

    file: Path
    """The CSV file, relative to the scenario's file."""
    draws: ClassVar = False

    def __post_init__(self) -> None:
        """Read the file. Raises ValueError with file and line if it is not such a table."""
        for user, points in self._way_points().items():
            for (t0, *_), (t1, _, _, line) in pairwise(points):
                if t1 <= t0:
                    raise ValueError(f"{self.file}:{line}: t_s: user {user}: times must increase")

    def problems(self, users: int, area: Area) -> list[str]:
        """Return the problems of the file in a scenario: unknown users, way points off its map."""
        found = []
        for user, points in self._way_points().items():
            for _, x, y, line in points:
                if user >= users:
                    found.append(f"{self.file}:{line}: user: {user}: must be from 0 to {users - 1}")
                if x > area.width_m or y > area.depth_m:
                    found.append(
                        f"{self.file}:{line}: ({x:g}, {y:g}) m is off the map of "
                        f"{area.width_m:g} x {area.depth_m:g} m"
                    )
        return found

    def expected_legs(self, users: int, area: Area, horizon_s: float) -> float:
        """The number of legs of all users in an episode."""
        return 2 * users + sum(len(points) for points in self._way_points().values())

    def walks(
        self, homes: NDArray[np.float64], streams: Streams, area: Area, horizon_us: int
    ) -> Walks:
        """Return the recorded walks, which are the same in every episode."""
        legs: list[tuple[float, ...]] = []
        offsets = [0]
        way_points = self._way_points()
        for user, (home_x, home_y) in enumerate(homes):
            points = [p[:3] for p in way_points.get(user, [(0, home_x, home_y, 0)])]
            if points[0][0] > 0:
                points.insert(0, (0, *points[0][1:]))
            for (t0, x0, y0), (t1, x1, y1) in pairwise(points):
                seconds = (t1 - t0) / US
                legs.append((t0, x0, y0, (x1 - x0) / seconds, (y1 - y0) / seconds))
            legs.append((*points[-1], 0.0, 0.0))
            offsets.append(len(legs))
        return Walks(np.array(legs, float), np.array(offsets))

    def _way_points(self) -> dict[int, list[tuple[int, float, float, int]]]:
        """Return (t_us, x, y, line of the file) of each user's way points, in the file's order."""
        columns = {"user": index, "t_s": quantity, "x_m": quantity, "y_m": quantity}
        rows = sorted(read_table(self.file, columns), key=itemgetter(0))
        return {
            user: [(round(t * US), x, y, line) for _, t, x, y, line in group]
            for user, group in groupby(rows, key=itemgetter(0))
        }


def walks_of(
    mobility: Mobility,
    homes: NDArray[np.float64],
    seed: int,
    episodes: Sequence[int],
    area: Area,
    horizon_us: int,
) -> Sequence[Walks | RandomWalks]:
    """Return the walks of several episodes from ``homes`` (users, 2); random legs come later."""
    if isinstance(mobility, RandomWalk) and type(mobility).walks is RandomWalk.walks:
        states = states_of(seed, Purpose.MOBILITY, episodes, len(homes))
        return ManyRandomWalks(homes, states, mobility.law(area, horizon_us))
    streams = [Streams(seed, Purpose.MOBILITY, episode) for episode in episodes]
    walking = [mobility.walks(homes, each, area, horizon_us) for each in streams]
    for walks in walking:
        problem = misshapen(walks, len(homes)) or leaves_the_map(walks, area, horizon_us)
        if problem:
            kind = f"{type(mobility).__module__}:{type(mobility).__qualname__}"
            raise SimulationError(f"users.mobility: {kind!r}: {problem}")
    return walking


STRAY_M = 1e-4
"""How far a walk may be off the map: rounding, which the model allows for everywhere."""


def misshapen(walks: Walks, users: int) -> str:
    """Say so if these are not legs of five columns, one at least for each user."""
    legs, offsets = (np.asarray(part) for part in walks)
    if legs.ndim == 2 and legs.shape[1] == 5 and offsets.shape == (users + 1,):
        bounds = offsets[0] == 0 and offsets[-1] == len(legs)
        if bounds and (np.diff(offsets) >= 1).all():
            return ""
    return f"walks() must return legs of five columns, one at least for each of {users} users"


def leaves_the_map(walks: Walks, area: Area, horizon_us: int) -> str:
    """Say which user is off the map first and when; nothing if all walks stay on it."""
    legs, offsets = walks
    begins = legs[:, T0_US]
    ends = np.append(begins[1:], 0.0)
    ends[offsets[1:] - 1] = horizon_us  # the last leg of each user goes on
    seconds = np.maximum(np.minimum(ends, horizon_us) - begins, 0.0) / US
    found = []
    for t_us, shift_s in ((begins, 0.0), (begins + seconds * US, seconds)):
        x, y = legs[:, X0] + legs[:, VX] * shift_s, legs[:, Y0] + legs[:, VY] * shift_s
        on_map = (x >= -STRAY_M) & (x <= area.width_m + STRAY_M)
        on_map &= (y >= -STRAY_M) & (y <= area.depth_m + STRAY_M)
        off = np.flatnonzero(~on_map & (t_us <= horizon_us))
        if len(off):
            first = off[np.argmin(t_us[off])]
            user = int(np.searchsorted(offsets, first, side="right")) - 1
            found.append((t_us[first] / US, user, x[first], y[first]))
    if not found:
        return ""
    t_s, user, x_m, y_m = min(found)
    return (
        f"user {user} is off the map of {area.width_m:g} x {area.depth_m:g} m "
        f"at {t_s:g} s: ({x_m:g}, {y_m:g}) m"
    )


Walker = tuple[float, float, float, float, int, int]
"""A random walker: position, velocity, start of its present leg, and time of its next turn."""


@kernel
def _random_walk(
    homes: NDArray[np.float64],
    states: NDArray[np.uint64],
    law: Law,
    offsets: NDArray[np.int64],
    legs: NDArray[np.float64],
) -> int:
    """Write all users' legs and return their number; only those that fit ``legs`` are written."""
    count, horizon_us = 0, law[2]
    for user in range(len(homes)):
        state = (states[user, 0], states[user, 1], states[user, 2], states[user, 3])
        walker = (homes[user, 0], homes[user, 1], 0.0, 0.0, 0, 0)
        while walker[4] < horizon_us:
            x, y, _, _, t_us, _ = walker
            walker, state = next_leg(walker, state, law)
            if count < len(legs):
                legs[count, T0_US] = t_us
                legs[count, X0], legs[count, Y0] = x, y
                legs[count, VX], legs[count, VY] = walker[2], walker[3]
            count += 1
        offsets[user + 1] = count
    return count


@part
def _next_wall(at: float, velocity: float, size: float, most_us: int) -> tuple[float, float, int]:
    """Return velocity, next wall and time to it along one axis; at a wall, reflect the velocity.

    The wall is -1 if none is reached within ``most_us``.
    """
    if velocity == 0.0:
        return velocity, -1.0, most_us
    wall = size if velocity > 0.0 else 0.0
    if at == wall:
        velocity = -velocity
        wall = size - wall
    if abs(wall - at) > abs(velocity) * most_us * 1e-6 + 1.0:
        return velocity, -1.0, most_us  # far away: no need to divide
    hit = (wall - at) / velocity * 1e6
    if hit < most_us:
        return velocity, wall, max(int(np.rint(hit)), 1)
    return velocity, -1.0, most_us


@part
def _draw_heading(state: State, speed: float) -> tuple[float, float, State]:
    """Draw a velocity of uniform heading; return it and the state of the stream after it.

    The heading is drawn by rejection, because square roots and quotients are the same on every
    platform, but sines are not.
    """
    while True:
        word, state = advanced(state)
        x = 2.0 * as_uniform(word) - 1.0
        word, state = advanced(state)
        y = 2.0 * as_uniform(word) - 1.0
        squared = x * x + y * y
        if 1e-6 < squared <= 1.0:
            break
    length = np.sqrt(squared)
    return speed * (x / length), speed * (y / length), state


@part
def next_leg(walker: Walker, state: State, law: Law) -> tuple[Walker, State]:
    """Return the walker after its next leg, to a turn or a wall, and the stream's state then.

    A new heading is drawn if it is time to turn.
    """
    x, y, vx, vy, t_us, turn_us = walker
    speed, leg_us, horizon_us, width, depth = law
    if t_us == turn_us:
        vx, vy, state = _draw_heading(state, speed)
        turn_us = min(t_us + leg_us, horizon_us)
    far_m = speed * (turn_us - t_us) * 1e-6 + 1.0
    if (far_m < x) & (x < width - far_m) & (far_m < y) & (y < depth - far_m):
        lasts_us = turn_us - t_us  # no wall is in reach
        x, y = x + vx * lasts_us * 1e-6, y + vy * lasts_us * 1e-6
        return (x, y, vx, vy, turn_us, turn_us), state
    vx, wall_x, hit_us = _next_wall(x, vx, width, turn_us - t_us)
    vy, wall_y, hit_us = _next_wall(y, vy, depth, hit_us)
    x = min(max(x + vx * hit_us * 1e-6, 0.0), width)
    y = min(max(y + vy * hit_us * 1e-6, 0.0), depth)
    if wall_y >= 0.0:
        y = wall_y
    elif wall_x >= 0.0:
        x = wall_x
    return (x, y, vx, vy, t_us + hit_us, turn_us), state
