"""A drone relative to a user in a piece of time, and when they are a given distance apart.

A piece is a stretch of time in which drone and user both keep their acceleration: the squared
distance is quadratic there while the drone coasts and quartic while it accelerates. Between its
turning points the distance is monotone, and each radius is passed at most once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from desim_uav.model.geometry.coverage import MARGIN_M, DroneLeg, WalkLeg
from desim_uav.rowcode.kernels import kernel, part
from desim_uav.rowcode.rows import Int16, Int32, Row, Table, row

GRAZE_M = 1e-13
"""How close to the radius, in metres, an extremum of the distance touches it without a crossing."""

Points = tuple[float, float, float]


@row
class Change(Row):
    """The change of a link between a sender and a user to another class.

    ``change`` is the new class if the link rises to it, and minus the new class if it falls to it.
    Class 0 is no link. With the paper's disc, which has one class, 1 is the entry of a user into
    the footprint and 0 its exit.
    """

    t_us: int
    user: Int32
    change: Int16


class Relative(NamedTuple):
    """A drone relative to a user at the start of a piece: position, velocity and acceleration."""

    px: float
    py: float
    wx: float
    wy: float
    ax: float
    ay: float


@part
def relative_to(
    leg: DroneLeg,
    heading: tuple[float, float],
    walk: WalkLeg,
    phase: int,
    at: float,
) -> Relative:
    """Return a drone in a phase of its transit relative to a user on a walk, at a time.

    ``heading`` is that of the leg (``coverage.heading_of``).
    """
    piece, (x0, y0, x1, y1), (ex, ey) = leg.profile[phase], leg.route, heading
    since = at - piece.start_s
    acceleration = piece.acceleration_mps2
    speed = piece.speed_mps + acceleration * since
    along = piece.from_m + 0.5 * (piece.speed_mps + speed) * since
    since_walk = at - (walk.begin_us - leg.span_us[0]) * 1e-6
    if phase + 1 == len(leg.profile):
        px, py = x1, y1
    else:
        px, py = x0 + ex * along, y0 + ey * along
    px -= walk.x_m + walk.vx_mps * since_walk
    py -= walk.y_m + walk.vy_mps * since_walk
    wx, wy = ex * speed - walk.vx_mps, ey * speed - walk.vy_mps
    return Relative(px, py, wx, wy, ex * acceleration, ey * acceleration)


@part
def moved_by(piece: Relative, span_s: float) -> tuple[float, float]:
    """Return how far drone and user move at most, and the square of how far apart they begin."""
    px, py, wx, wy, ax, ay = piece
    moved = (abs(wx) + abs(wy) + 0.5 * (abs(ax) + abs(ay)) * span_s) * span_s + MARGIN_M
    return moved, px * px + py * py


@part
def is_beyond(radius: float, moved: float, apart: float) -> bool:
    """Return whether a user who is this far apart stays outside the circle."""
    return apart > (radius + moved) * (radius + moved)


@part
def is_within(radius: float, moved: float, apart: float) -> bool:
    """Return whether a user who is this far apart stays inside the circle."""
    within = max(radius - moved, 0.0)
    return apart < within * within


@kernel
def beyond(x: float, y: float, radius: float) -> float:
    """Return x² + y² - R², without cancellation where the larger coordinate makes up the radius."""
    x, y = abs(x), abs(y)
    if x < y:
        x, y = y, x
    return (x - radius) * (x + radius) + y * y


@kernel
def place_at(piece: Relative, t: float) -> tuple[float, float]:
    """Return the position t seconds into a piece."""
    x = piece.px + t * (piece.wx + 0.5 * piece.ax * t)
    y = piece.py + t * (piece.wy + 0.5 * piece.ay * t)
    return x, y


@kernel
def excess_at(piece: Relative, radius: float, t: float) -> float:
    """Return the squared distance minus the squared radius, t seconds into a piece."""
    x, y = place_at(piece, t)
    return beyond(x, y, radius)


@kernel
def _slope(piece: Relative, t: float) -> float:
    """Return half the derivative of the squared distance."""
    x, y = place_at(piece, t)
    return x * (piece.wx + piece.ax * t) + y * (piece.wy + piece.ay * t)


@kernel
def turning_points(piece: Relative, end: float) -> tuple[int, Points]:
    """Return the number of extrema of the distance inside (0, end), and their times in seconds."""
    px, py, wx, wy, ax, ay = piece
    slope = px * wx + py * wy
    ww = wx * wx + wy * wy
    if ax == 0.0 and ay == 0.0:
        if ww > 0.0 and slope < 0.0 and -slope < ww * end:
            return 1, (-slope / ww, end, end)
        return 0, (end, end, end)
    # The slope is a cubic; between the roots of its derivative it is monotone.
    a = 1.5 * (ax * ax + ay * ay)
    b = 3.0 * (ax * wx + ay * wy)
    c = ww + ax * px + ay * py
    splits = (end, end)
    discriminant = b * b - 4.0 * a * c
    if discriminant > 0.0:
        q = -0.5 * (b + np.sqrt(discriminant)) if b >= 0.0 else -0.5 * (b - np.sqrt(discriminant))
        r1 = q / a
        r2 = c / q if q != 0.0 else r1
        splits = (min(r1, r2), max(r1, r2))
    count = 0
    points = (end, end, end)
    low = 0.0
    low_slope = slope
    for k in range(3):
        high = splits[k] if k < 2 else end
        if high <= low or (k < 2 and high >= end):
            continue
        high_slope = _slope(piece, high)
        if low_slope * high_slope < 0.0:
            root = _slope_root(piece, low, high, low_slope < 0.0)
            points = (
                root if count == 0 else points[0],
                root if count == 1 else points[1],
                root if count == 2 else points[2],
            )
            count += 1
        low, low_slope = high, high_slope
    return count, points


@kernel
def _slope_root(piece: Relative, low: float, high: float, rising: bool) -> float:
    """Return the zero of the slope between two times where it is monotone.

    It is found by Newton's method, safeguarded by bisection.
    """
    t = 0.5 * (low + high)
    for _ in range(80):  # pragma: no branch (it has converged long before)
        value = _slope(piece, t)
        if (value < 0.0) == rising:
            low = t
        else:
            high = t
        vx, vy = piece.wx + piece.ax * t, piece.wy + piece.ay * t
        x, y = place_at(piece, t)
        derivative = vx * vx + vy * vy + x * piece.ax + y * piece.ay
        step = t - value / derivative if derivative != 0.0 else low
        if not low < step < high:
            step = 0.5 * (low + high)
        if abs(step - t) <= 1e-13 * max(1.0, t) or step <= low or step >= high:
            return step
        t = step
    return t  # pragma: no cover


class Coast(NamedTuple):
    """Numbers of a piece without acceleration, of which the times of crossings are computed.

    Half the derivative of the squared distance at the start, the distance then, the square of the
    speed, the speed, and the cross product of position and velocity.
    """

    slope: float
    distance: float
    square: float
    speed: float
    cross: float


@part
def coast_of(piece: Relative) -> Coast:
    """Return these numbers of a piece."""
    px, py, wx, wy, _, _ = piece
    square = wx * wx + wy * wy
    return Coast(
        px * wx + py * wy,
        np.sqrt(px * px + py * py),
        square,
        np.sqrt(square),
        px * wy - py * wx,
    )


@kernel
def root_at(piece: Relative, radius: float, low: float, high: float, enters: bool) -> float:
    """Return the time in [low, high] at which the distance, which is monotone there, is R."""
    return root_of(piece, coast_of(piece), radius, low, high, enters)


@part
def root_of(
    piece: Relative, coast: Coast, radius: float, low: float, high: float, enters: bool
) -> float:
    """Return the same time as ``root_at``."""
    if piece.ax == 0.0 and piece.ay == 0.0:
        # Quadratic: |w|² t² + 2 (p·w) t + |p|² - R² = 0, without cancellation in either term.
        b, distance, a, speed, cross = coast
        c = (distance - radius) * (distance + radius)
        discriminant = (speed * radius - cross) * (speed * radius + cross)
        if a == 0.0:
            return low
        root = np.sqrt(max(discriminant, 0.0))
        q = -b - root if b >= 0.0 else -b + root
        r1 = q / a
        r2 = c / q if q != 0.0 else r1
        t = min(r1, r2) if enters else max(r1, r2)
        return float(min(max(t, low), high))
    return _accelerated_root(piece, radius, low, high, enters)


@kernel
def _accelerated_root(
    piece: Relative, radius: float, low: float, high: float, enters: bool
) -> float:
    """Return the same time as ``root_at``, by Newton's method that is safeguarded by bisection."""
    t = 0.5 * (low + high)
    for _ in range(80):
        value = excess_at(piece, radius, t)
        if (value <= 0.0) != enters:
            low = t
        else:
            high = t
        derivative = 2.0 * _slope(piece, t)
        step = t - value / derivative if derivative != 0.0 else low
        if not low < step < high:
            step = 0.5 * (low + high)
        if abs(step - t) <= 1e-13 * max(1.0, t) or step <= low or step >= high:
            return step
        t = step
    return t


@part
def rounded_us(start_us: int, since_s: float) -> int:
    """Return the time this many seconds after the start, in whole microseconds."""
    return start_us + int(np.rint(since_s * 1e6))


@kernel
def write(out: Table[Change], total: int, t_us: int, user: int, change: int) -> int:
    """Write a change if there is room for it, and return the new number of changes."""
    if total < len(out):
        one = out[total]
        one.t_us, one.user, one.change = t_us, user, change
    return total + 1
