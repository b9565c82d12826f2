"""How users move: straight legs (t0, x0, y0, vx, vy) from home, anew in each episode."""

from __future__ import annotations

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
    """Legs of all users: rows T0_US X0 Y0 VX VY; user u's are ``offsets[u]:offsets[u + 1]``.

    A user's first leg begins at 0, its legs ascend in time and join; the last one goes on.
    """

    legs: NDArray[np.float64]
    offsets: NDArray[np.int64]

    def drawn(self) -> Walks:
        """They are (see ``RandomWalks``)."""
        return self


class Mobility(Protocol):
    """A mobility model.

    One that draws nothing may say ``draws = False``: its walks are asked for once, not for each
    episode.
    """

    def walks(
        self, homes: NDArray[np.float64], streams: Streams, area: Area, horizon_us: int
    ) -> Walks:
        """The walks of one episode from ``homes`` (users, 2); user u draws from stream u only."""


@register("mobility", "static")
@dataclass(frozen=True)
class Static:
    """Users stay at home."""

    draws: ClassVar = False

    def walks(
        self, homes: NDArray[np.float64], streams: Streams, area: Area, horizon_us: int
    ) -> Walks:
        """One leg each, at no speed."""
        legs = np.zeros((len(homes), 5))
        legs[:, X0 : Y0 + 1] = homes
        return Walks(legs, np.arange(len(homes) + 1))


Law = tuple[float, int, int, float, float]
"""Of a random walk: speed, the time of a leg, the horizon, width and depth of the map."""


@register("mobility", "random_walk")
@dataclass(frozen=True)
class RandomWalk:
    """A new uniform heading every ``leg_s``; mirrored at the map's edge, the leg split there."""

    speed_mps: Annotated[float, Ge(0), Le(200)] = 1.4
    """The walking speed, in metres per second."""
    leg_s: Annotated[float, Ge(0.001)] = 60.0
    """How long a user walks before it takes a new heading, in seconds."""

    def walks(
        self, homes: NDArray[np.float64], streams: Streams, area: Area, horizon_us: int
    ) -> Walks:
        """A stream for each user."""
        law = self.law(area, horizon_us)
        return RandomWalks(homes, streams.states(len(homes)), law).drawn()

    def law(self, area: Area, horizon_us: int) -> Law:
        """What the compiled loop goes by."""
        return self.speed_mps, round(self.leg_s * US), horizon_us, *area


@dataclass(frozen=True, eq=False)
class RandomWalks(Unchanging):
    """Random walks that are drawn, by a compiled loop, once their legs are asked for.

    ``states`` (users, 4) are the beginnings of the users' streams. The compiled engine asks for no
    more: it walks on from them by itself, step by step, with the same ``next_leg``.
    """

    homes: NDArray[np.float64]
    states: NDArray[np.uint64]
    law: Law

    def drawn(self) -> Walks:
        """The walks."""
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
    """Those of several episodes; ``states`` (episodes, users, 4)."""

    homes: NDArray[np.float64]
    states: NDArray[np.uint64]
    law: Law

    def __len__(self) -> int:
        return len(self.states)

    def __getitem__(self, k: Any) -> Any:
        """Those of an episode."""
        return RandomWalks(self.homes, self.states[k], self.law)


@register("mobility", "trace")
@dataclass(frozen=True)
class Trace:
    """Way points from a CSV file with the columns user, t_s, x_m, y_m.

    A user stands at its first way point until then, walks straight from each to the next, and
    stays at the last; a user without way points stays at home.
    """

    file: Path
    """The CSV file, relative to the scenario's file."""
    draws: ClassVar = False

    def __post_init__(self) -> None:
        """Raises ValueError, naming file and line, where the file is not such a table."""
        for user, points in self._way_points().items():
            for (t0, *_), (t1, _, _, line) in pairwise(points):
                if t1 <= t0:
                    raise ValueError(f"{self.file}:{line}: t_s: user {user}: times must ascend")

    def problems(self, users: int, area: Area) -> list[str]:
        """What does not fit a scenario: users it does not have, way points off its map."""
        found = []
        for user, points in self._way_points().items():
            for _, x, y, line in points:
                if user >= users:
                    found.append(f"{self.file}:{line}: user: {user}: there are {users} users")
                if x > area.width_m or y > area.depth_m:
                    found.append(
                        f"{self.file}:{line}: ({x:g}, {y:g}) m is off the map of "
                        f"{area.width_m:g} x {area.depth_m:g} m"
                    )
        return found

    def walks(
        self, homes: NDArray[np.float64], streams: Streams, area: Area, horizon_us: int
    ) -> Walks:
        """The recorded walks, the same in every episode."""
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
        """(t_us, x, y, line of the file) for each user, as they stand in the file."""
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
    """The walks of several episodes, from ``homes`` (users, 2); those at random not drawn yet."""
    if isinstance(mobility, RandomWalk) and type(mobility).walks is RandomWalk.walks:
        states = states_of(seed, Purpose.MOBILITY, episodes, len(homes))
        return ManyRandomWalks(homes, states, mobility.law(area, horizon_us))
    streams = [Streams(seed, Purpose.MOBILITY, episode) for episode in episodes]
    return [mobility.walks(homes, each, area, horizon_us) for each in streams]


Walker = tuple[float, float, float, float, int, int]
"""Who walks at random: place and velocity, when it got there, and when it will turn."""


@kernel
def _random_walk(
    homes: NDArray[np.float64],
    states: NDArray[np.uint64],
    law: Law,
    offsets: NDArray[np.int64],
    legs: NDArray[np.float64],
) -> int:
    """Write all users' legs; their number. What does not fit ``legs`` is not written."""
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
    """Along one axis, mirrored if it stands at a wall: velocity, the wall met, and when.

    A wall of -1: none is met in ``most_us``.
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
    """Draw a velocity of uniform heading, by rejection; it, and the stream's state after that.

    Square roots and quotients are the same on every platform; sines are not.
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
    """Walk a leg, to the next turn or wall; where that leads, and the stream's state after it.

    What is drawn, if it is time to turn, is the heading.
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
