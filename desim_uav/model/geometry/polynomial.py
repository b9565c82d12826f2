"""The points at which a polynomial of degree four or less changes its sign.

Between two neighbouring turning points a polynomial is monotone, and so has at most one root there.
The turning points are the roots of its derivative, which are found in the same way; those of a
quadratic polynomial have a closed form.
"""

from __future__ import annotations

import numpy as np

from desim_uav.rowcode.kernels import kernel, part

Coefficients = tuple[float, float, float, float, float]
"""The coefficients of 1, t, t², t³ and t⁴."""

Points = tuple[float, float, float, float]

Vector = tuple[float, float, float]

NEARLY = 1e-9
"""How far places that are nearly right may be from those of ``sign_changes``."""

APART = 1e-4
"""Places that are closer to each other may be farther from the right ones."""

NOTHING: Points = (np.inf, np.inf, np.inf, np.inf)


@part
def square_of(at: Vector, speed: Vector, pull: Vector) -> Coefficients:
    """Return the squared length of ``at`` + t ``speed`` + t² ``pull`` / 2 as a polynomial of t."""
    (px, py, pz), (vx, vy, vz), (ax, ay, az) = at, speed, pull
    return (
        px * px + py * py + pz * pz,
        2.0 * (px * vx + py * vy + pz * vz),
        vx * vx + vy * vy + vz * vz + px * ax + py * ay + pz * az,
        vx * ax + vy * ay + vz * az,
        0.25 * (ax * ax + ay * ay + az * az),
    )


@kernel
def sign_changes(c: Coefficients, above: bool, end: float, graze: float) -> tuple[int, Points]:
    """Return the number of changes of sign of a polynomial in [0, ``end``], and where they are.

    The sign is positive above zero, and negative at zero and below; ``above`` says whether it was
    positive just before 0. At a turning point or at the end, a value within ``graze`` of zero is no
    change. The places are in order.
    """
    count, turns = _turns(c, end)
    return _between(c, above, count, turns, end, graze, 0.0)


@kernel
def near_changes(c: Coefficients, above: bool, end: float) -> tuple[int, Points]:
    """Return as many places as ``sign_changes`` does, without ``graze``, but less exact ones.

    Where two of them are ``APART`` from each other or more, they differ from the exact ones by less
    than ``NEARLY``, relatively or absolutely.
    """
    count, turns = _turns(c, end)
    return _between(c, above, count, turns, end, 0.0, NEARLY)


@kernel
def _turns(c: Coefficients, end: float) -> tuple[int, Points]:
    """Return the number of turning points inside (0, ``end``), and where they are."""
    slope = (c[1], 2.0 * c[2], 3.0 * c[3], 4.0 * c[4], 0.0)
    bend = (slope[1], 2.0 * slope[2], 3.0 * slope[3], 0.0, 0.0)
    if c[2] == 0.0 and c[3] == 0.0 and c[4] == 0.0:
        return 0, NOTHING
    if c[3] == 0.0 and c[4] == 0.0:
        return _inside(-c[1] / slope[1], end)
    count, turns = _quadratic(bend, end)
    return _between(slope, slope[0] > 0.0, count, turns, end, 0.0, 0.0)


@part
def _inside(t: float, end: float) -> tuple[int, Points]:
    if 0.0 < t < end:
        return 1, (t, np.inf, np.inf, np.inf)
    return 0, NOTHING


@kernel
def _quadratic(c: Coefficients, end: float) -> tuple[int, Points]:
    """Return the roots of a polynomial of degree two inside (0, ``end``), without cancellation."""
    a, b = c[2], c[1]
    if a == 0.0:
        if b == 0.0:
            return 0, NOTHING
        return _inside(-c[0] / b, end)
    discriminant = b * b - 4.0 * a * c[0]
    if not discriminant > 0.0:
        return 0, NOTHING
    q = -0.5 * (b + np.sqrt(discriminant)) if b >= 0.0 else -0.5 * (b - np.sqrt(discriminant))
    first, second = q / a, c[0] / q
    low, high = min(first, second), max(first, second)
    if not 0.0 < low < end:
        return _inside(high, end)
    if not high < end:
        return _inside(low, end)
    return 2, (low, high, np.inf, np.inf)


@kernel
def _between(
    c: Coefficients,
    above: bool,
    count: int,
    turns: Points,
    end: float,
    graze: float,
    within: float,
) -> tuple[int, Points]:
    """Return the changes of sign of a polynomial that is monotone between ``turns``.

    They are exact if ``within`` is 0, or else may be so far away.
    """
    changes, roots = 0, NOTHING
    low = 0.0
    for k in range(count + 1):
        high = turns[k] if k < count else end
        value = value_at(c, high)
        is_above = above if abs(value) <= graze else value > 0.0
        if is_above != above:
            root = _root(c, low, high, is_above, within)
            roots = (
                root if changes == 0 else roots[0],
                root if changes == 1 else roots[1],
                root if changes == 2 else roots[2],
                root if changes == 3 else roots[3],
            )
            changes += 1
            above = is_above
        low = high
    return changes, roots


@part
def value_at(c: Coefficients, t: float) -> float:
    """Return the value of a polynomial."""
    return c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * c[4])))


@kernel
def _root(c: Coefficients, low: float, high: float, rises: bool, within: float) -> float:
    """Return the root in [``low``, ``high``], where a polynomial is monotone and changes its sign.

    It is found by Newton's method, safeguarded by bisection. A value of 0 makes that long, so it
    ends before if it may be ``within`` a distance, relative or absolute, of the exact root.
    """
    t = 0.5 * (low + high)
    for _ in range(80):  # pragma: no branch (it has converged long before)
        value = value_at(c, t)
        if (value > 0.0) == rises:
            high = t
        else:
            low = t
        slope = c[1] + t * (2.0 * c[2] + t * (3.0 * c[3] + t * 4.0 * c[4]))
        step = t - value / slope if slope != 0.0 else low
        if abs(step - t) < 0.01 * within * max(1.0, t):
            return step
        if not low < step < high:
            step = 0.5 * (low + high)
        if abs(step - t) <= 1e-13 * max(1.0, t) or step <= low or step >= high:
            return step
        t = step
    return t  # pragma: no cover
