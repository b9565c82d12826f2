"""Gauss-Markov: users whose speed and heading change a little at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Le

from desim_uav.model.mobility.walking import RowMobility, Start, go_on, later
from desim_uav.model.mobility.walks import Area
from desim_uav.model.random.distributions import on_grid, two_normals
from desim_uav.model.random.streams import heading, uniform
from desim_uav.registry import register
from desim_uav.rowcode.kernels import rule


@register("mobility", "gauss_markov")
@dataclass(frozen=True)
class GaussMarkov(RowMobility):
    """Speed and heading of each user are Gauss-Markov processes in steps of ``step_s``.

    After each step, a speed s becomes α s + (1 - α) μ + σ √(1 - α²) w with a standard normal w, and
    the heading likewise around a mean heading, which is uniform for each user (Liang and Haas 1999;
    Camp, Boleng and Davies 2002). Both have mean μ, standard deviation σ and, k steps apart,
    autocorrelation α^k. A user is reflected at the map's edge, and its mean heading with it.
    """

    mean_mps: Annotated[float, Ge(0), Le(200)] = 1.4
    """The mean speed, in metres per second."""
    sigma_mps: Annotated[float, Ge(0), Le(50)] = 0.3
    """The standard deviation of the speed, in metres per second. A user whose speed is drawn below
    0 walks backwards.
    """
    sigma_heading_deg: Annotated[float, Ge(0), Le(360)] = 45.0
    """The standard deviation of the heading around the user's mean heading, in degrees."""
    alpha: Annotated[float, Ge(0), Le(0.9999)] = 0.85
    """How much of speed and heading is kept from one step to the next: 0 is no memory."""
    step_s: Annotated[float, Ge(0.1), Le(1e6)] = 10.0
    """How long speed and heading are kept, in seconds."""
    start: Start = "stationary"
    """`stationary`: users begin anywhere on the map, as they are in the long run, and not at their
    homes. `home`: they begin at home.
    """

    stationary: int = field(init=False, repr=False, compare=False)
    novelty: float = field(init=False, repr=False, compare=False)
    """√(1 - α²)."""
    sigma_rad: float = field(init=False, repr=False, compare=False)

    remembers: ClassVar = {
        "turn_us": int,
        "begun": int,
        "speed_mps": float,
        "aside_rad": float,
        "mean_x": float,
        "mean_y": float,
        "side_x": float,
        "side_y": float,
    }
    stays_on_map = True

    def __post_init__(self) -> None:
        """Set the numbers that follow from the parameters."""
        object.__setattr__(self, "stationary", int(self.start == "stationary"))
        object.__setattr__(self, "novelty", math.sqrt(1.0 - self.alpha * self.alpha))
        object.__setattr__(self, "sigma_rad", math.radians(self.sigma_heading_deg))

    def begin(self, walker: Any, user: int, homes: Any, streams: Any, area: Any) -> None:
        """Draw a user's mean heading, speed and heading, and its place unless it is at home."""
        stream = walker.stream
        walker.mean_x, walker.mean_y = heading(stream)
        walker.side_x = walker.side_y = 1.0
        speed, aside = two_normals(stream)
        walker.speed_mps = self.mean_mps + self.sigma_mps * speed
        walker.aside_rad = self.sigma_rad * aside
        if self.stationary:
            walker.x_m = uniform(stream) * area.width_m
            walker.y_m = uniform(stream) * area.depth_m

    def next_leg(self, walker: Any, stream: Any, area: Any) -> None:
        """Walk to the end of a step or to the edge of the map."""
        if walker.t_us == walker.turn_us:
            if walker.begun:
                speed, aside = two_normals(stream)
                walker.speed_mps = (
                    self.alpha * walker.speed_mps
                    + (1.0 - self.alpha) * self.mean_mps
                    + self.sigma_mps * self.novelty * speed
                )
                walker.aside_rad = (
                    self.alpha * walker.aside_rad + self.sigma_rad * self.novelty * aside
                )
            walker.begun = 1
            x, y = turned(walker.mean_x, walker.mean_y, walker.aside_rad)
            walker.vx_mps = walker.side_x * walker.speed_mps * x
            walker.vy_mps = walker.side_y * walker.speed_mps * y
            walker.turn_us = later(walker.turn_us, self.step_s)
        vx_mps, vy_mps = walker.vx_mps, walker.vy_mps
        go_on(walker, area, walker.turn_us)
        if walker.vx_mps * vx_mps < 0.0:  # it is reflected, and so is its mean heading
            walker.side_x = -walker.side_x
        if walker.vy_mps * vy_mps < 0.0:
            walker.side_y = -walker.side_y

    @property
    def mean_speed_mps(self) -> float:
        """The mean speed, more or less."""
        return math.hypot(self.mean_mps, self.sigma_mps)

    def expected_legs(self, users: int, area: Area, horizon_s: float) -> float:
        """Return about how many legs all users walk: steps, and edges that are met."""
        walls = 2.0 / math.pi * self.mean_speed_mps * horizon_s * sum(1.0 / side for side in area)
        return users * (math.ceil(horizon_s / self.step_s) + walls)


@rule
def turned(x: float, y: float, angle: float) -> tuple[float, float]:
    """Return a vector turned to the left by an angle in radians."""
    cosine, sine = on_grid(math.cos(angle)), on_grid(math.sin(angle))
    return x * cosine - y * sine, x * sine + y * cosine
