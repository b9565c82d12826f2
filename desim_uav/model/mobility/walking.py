"""Mobility over rows: models that draw a user's walk leg by leg, and that can be compiled.

One loop draws the legs, either of a whole episode (``RowWalks``) or of one span of time after
another. The compiled engine does the latter, because the legs of an episode would take more memory
than everything else.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from desim_uav.copies import Unchanging
from desim_uav.model.geometry.coverage import WalkLeg
from desim_uav.model.mobility.walks import (
    NEAR_M,
    SHORTEST_US,
    Area,
    Walker,
    Walking,
    Walks,
    begin_by,
    misstep,
    too_many,
    walk_by,
)
from desim_uav.model.naming import naming
from desim_uav.model.random.streams import FAR_US, Stream, Streams
from desim_uav.rowcode.bounds import owner_of
from desim_uav.rowcode.compiled_registers import held, put_back
from desim_uav.rowcode.compiled_rows import array_at, entries_at, place_of, pointer_to
from desim_uav.rowcode.components import (
    Compiled,
    Function,
    ValuesAt,
    call_at,
    compiled_or_none,
    over_rows,
    remembering,
    ruled,
    works_on_rows,
)
from desim_uav.rowcode.kernels import part, rule
from desim_uav.rowcode.packing import attach
from desim_uav.rowcode.rows import BoundedTable, Row, Table, blank, bound, held_by, place, row
from desim_uav.rowcode.views import View, zeros

Start = Literal["stationary", "home"]
"""Where users begin: anywhere, as they are in the long run, or at their homes."""


class RowMobility:
    """A mobility model over rows, which can be compiled.

    A subclass is a frozen dataclass whose fields are numbers or tuples of numbers. ``remembers``
    has the names and types (int or float) of the numbers that a walker has besides its place and
    velocity; they are 0 at first. A walker may also have a further random stream (Stream).
    """

    remembers: ClassVar[dict[str, type]] = {}
    stays_on_map: ClassVar[bool] = False
    """Whether all legs are made by ``go_on`` and ``stay``, so that they need not be checked."""
    plain: ClassVar = ("walks",)
    """The methods of which a subclass overrides one if it makes whole tables of legs."""

    def begin(
        self, walker: Walker, user: int, homes: Table[float], streams: Table[int], area: Area
    ) -> None:
        """Put a user where it is at time 0, which is at home if this is not overridden.

        Write ``walker.x_m`` and ``y_m``, and what the model remembers; the user's random stream
        ``walker.stream`` has begun. ``homes`` has x and y of user u at 2 u and 2 u + 1, and
        ``streams`` the four words with which its random stream begins, from 4 u on.
        """

    def next_leg(self, walker: Walker, stream: Stream, area: Area) -> None:
        """Let a user walk its next leg, from where it is at ``walker.t_us``.

        Write the leg's velocity to ``walker.vx_mps`` and ``vy_mps``, its end to ``x_m``, ``y_m``
        and ``t_us`` (see ``go_on``, ``go_to`` and ``stay``). Draw from ``stream`` only, with
        ``uniform`` and the like from ``model.random.streams``. ``area`` is the map.
        """
        raise NotImplementedError

    def walks(
        self, homes: NDArray[np.float64], streams: Streams, area: Area, horizon_us: int
    ) -> Walks:
        """Draw the walks of one episode, with one random stream per user."""
        return RowWalks(self, homes, streams.states(len(homes)), area, horizon_us).drawn()

    def from_here(self) -> RowMobility:
        """Return this model as it goes on for users who are at given places ("homes").

        A model with a field ``start``, which says where users begin, begins at their homes.
        """
        own: Any = self
        at_home: RowMobility = replace(own, start="home") if hasattr(own, "start") else own
        return at_home

    def expected_legs(self, users: int, area: Area, horizon_s: float) -> float:
        """Return an estimate of all users' legs in this time; by default one each ten seconds."""
        return users * (1.0 + horizon_s / 10.0)


def from_here(mobility: Any) -> Any:
    """Return a mobility model as it goes on for users who are at given places ("homes")."""
    return mobility.from_here() if isinstance(mobility, RowMobility) else mobility


# ---- what models do with walkers


@rule
def later(t_us: int, seconds: float) -> int:
    """Return a time some seconds later, and at least one and at most 2^61 microseconds."""
    return t_us + max(int(min(np.rint(seconds * 1e6), FAR_US)), 1)


@rule
def stay(walker: Walker, until_us: int) -> None:
    """Let a user stand still until a time."""
    walker.vx_mps = walker.vy_mps = 0.0
    walker.t_us = until_us


@rule
def go_to(walker: Walker, x_m: float, y_m: float, speed_mps: float) -> None:
    """Let a user walk straight to a place on the map, at a speed above 0."""
    away_x_m, away_y_m = x_m - walker.x_m, y_m - walker.y_m
    far_m = math.sqrt(away_x_m * away_x_m + away_y_m * away_y_m)
    go_until(walker, x_m, y_m, later(walker.t_us, far_m / speed_mps))


@rule
def go_until(walker: Walker, x_m: float, y_m: float, until_us: int) -> None:
    """Let a user walk straight to a place on the map, where it arrives at a time."""
    lasts_us = until_us - walker.t_us
    walker.vx_mps = (x_m - walker.x_m) / (lasts_us * 1e-6)
    walker.vy_mps = (y_m - walker.y_m) / (lasts_us * 1e-6)
    walker.x_m, walker.y_m = x_m, y_m
    walker.t_us = until_us


@rule
def go_on(walker: Walker, area: Area, until_us: int) -> None:
    """Let a user walk on at its velocity until a time, or until it reaches the edge of the map.

    If it is at the edge and would leave the map, it is reflected first.
    """
    x, y, vx, vy = walker.x_m, walker.y_m, walker.vx_mps, walker.vy_mps
    lasts_us = until_us - walker.t_us
    walker.x_m, walker.y_m = x + vx * lasts_us * 1e-6, y + vy * lasts_us * 1e-6
    walker.t_us += lasts_us
    inside = (walker.x_m > NEAR_M) & (walker.x_m < area.width_m - NEAR_M)
    if not (inside & (walker.y_m > NEAR_M) & (walker.y_m < area.depth_m - NEAR_M)):
        _go_to_wall(walker, area, x, y, lasts_us)


@rule
def _go_to_wall(walker: Walker, area: Area, x: float, y: float, lasts_us: int) -> None:
    """Let a user who is on the way from (x, y) to the edge of the map, or past it, stop there."""
    vx, wall_x, hit_us = _next_wall(x, walker.vx_mps, area.width_m, lasts_us)
    vy, wall_y, hit_us = _next_wall(y, walker.vy_mps, area.depth_m, hit_us)
    x = min(max(x + vx * hit_us * 1e-6, 0.0), area.width_m)
    y = min(max(y + vy * hit_us * 1e-6, 0.0), area.depth_m)
    if wall_y >= 0.0:
        y = wall_y
    elif wall_x >= 0.0:
        x = wall_x
    walker.x_m, walker.y_m, walker.vx_mps, walker.vy_mps = x, y, vx, vy
    walker.t_us += hit_us - lasts_us


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


# ---- walks of a whole episode


@cache
def walking_of(mobility: Any) -> Any:
    """Return the class of rows for the walks by a class of models."""
    kinds = {**Walking.kinds, "walkers": Table[remembering(Walker, mobility)]}  # type: ignore[misc]
    return row(type("Walking", (Row,), {"__annotations__": kinds, "scratch": Walking.scratch}))


def _around(cls: Any, values_at: ValuesAt) -> Any:
    """Return the function ``walk`` of a class of models (see ``Function.around``)."""
    walk_on = ruled(walk_by(ruled(cls.next_leg), cls.stays_on_map, held, put_back))
    begin_all, words = ruled(begin_by(ruled(cls.begin))), remembering(Walker, cls).words
    owner = owner_of(cls)
    walking_at = pointer_to(walking_of(cls), owner)
    floats_at, words_at = entries_at(float, owner), entries_at(int, owner)
    all_at = array_at(int)

    def walk(values: int, at: int, homes: int, streams: int, start_us: int, end_us: int) -> None:
        walking = walking_at(at)
        if not walking.begun:
            users = len(walking.walkers)
            numbers = all_at(place_of(walking.walkers), users * words)  # which may alias all fields
            for k in range(users * words):
                numbers[k] = 0
            places, states = floats_at(homes, 2 * users), words_at(streams, 4 * users)
            begin_all(values_at(values), walking, places, states)
        walk_on(values_at(values), walking, start_us, end_us)

    return walk


WALK = Function("walk", _around, (int,) * 6)
"""The function of a model that writes the legs of a span of time, after it has begun the walks.

Its arguments are the addresses of the model's values, of the Walking, of the users' homes and of
the initial states of their random streams, and then the start and the end of the span.
"""


def compiled_walk(mobility: Any) -> Compiled | None:
    """Return the function WALK of a model over rows; None for others and if it is not compiled."""
    if not works_on_rows(mobility, RowMobility):
        return None
    return compiled_or_none("users.mobility", mobility, (WALK,))


@dataclass(frozen=True, eq=False)
class RowWalks(Unchanging):
    """Walks over rows, whose legs are drawn only when they are needed.

    ``states`` (users, 4) are the initial states of the users' random streams. The compiled engine
    needs no more than these; it draws the legs itself, step by step.
    """

    mobility: RowMobility
    homes: NDArray[np.float64]
    states: NDArray[np.uint64]
    area: Area
    horizon_us: int

    def drawn(self) -> Walks:
        """Draw the legs and return the walks. Raises SimulationError if a leg is invalid."""
        return self._walks

    @cached_property
    def _walks(self) -> Walks:
        users = len(self.homes)
        most = int(self.mobility.expected_legs(users, self.area, self.horizon_us / 1e6)) + 8 * users
        offsets = np.zeros(users + 1, np.int64)
        while True:
            legs = zeros(WalkLeg, most)
            walking = self._walk(legs, offsets)
            if walking.lost:
                raise misstep(self.mobility, walking)
            if walking.count > users * (1.0 + self.horizon_us / SHORTEST_US):
                raise too_many(self.mobility, walking.count, self.horizon_us)
            if walking.count <= most:
                return Walks(legs[: walking.count], offsets)
            most = walking.count

    def _walk(self, legs: NDArray[Any], offsets: NDArray[np.int64]) -> Any:
        """Write the legs of the episode, and return the Walking."""
        model: Any = type(self.mobility)
        cls: Any = walking_of(model)
        own: Any = held_by(cls.kinds["walkers"])
        code = compiled_walk(self.mobility)
        block = np.zeros(cls.words + len(self.homes) * own.words, np.int64)
        walking: Any = View(block, cls) if code else blank(cls)
        walking.width_m, walking.depth_m = self.area
        walking.horizon_us = self.horizon_us
        if code is None:
            walking.legs, walking.legs_at = legs, offsets
            walking.walkers = Table(blank(own) for _ in self.homes)
            mobility = over_rows(self.mobility, ())
            arrays, owner = (self.homes, self.states), owner_of(model)
            at, words = (BoundedTable(array.reshape(-1).tolist()) for array in arrays)
            if owner:
                bound(walking)
            naming(owner, begin_by(model.begin))(mobility, walking, at, words)
            walk = naming(owner, walk_by(model.next_leg, model.stays_on_map))
            walk(mobility, walking, 0, self.horizon_us)
            return walking
        for name, array in (("walkers", block[cls.words :]), ("legs", legs), ("legs_at", offsets)):
            attach(block, cls, name, array)
        homes, states = map(np.ascontiguousarray, (self.homes, self.states))
        places = (code.values, block, homes, states)
        call_at(code.functions["walk"], (*map(place, places), 0, self.horizon_us))
        return walking


@dataclass(frozen=True, eq=False)
class ManyRowWalks(Sequence[RowWalks]):
    """The walks over rows in several episodes; ``states`` has the shape (episodes, users, 4)."""

    mobility: RowMobility
    homes: NDArray[np.float64]
    states: NDArray[np.uint64]
    area: Area
    horizon_us: int

    def __len__(self) -> int:
        return len(self.states)

    def __getitem__(self, k: Any) -> Any:
        """Return the walks of episode k."""
        return RowWalks(self.mobility, self.homes, self.states[k], self.area, self.horizon_us)
