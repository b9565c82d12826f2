"""The propulsion power of a fixed-wing drone: Zeng and Zhang 2017.

Energy-Efficient UAV Communication With Trajectory Optimization, IEEE Transactions on Wireless
Communications 16 (6). In level flight at the speed V > 0, with an acceleration a across the way,

    P(V) = c1 V³ + (c2 / V) (1 + a² / g²).

Along the way the change of kinetic energy is added, which a rest-to-rest flight gets back.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from annotated_types import Gt, Le

from desim_uav.model.energy.propulsion.search import root_between
from desim_uav.rowcode.kernels import kernel, rule

GRAVITY_MPS2 = 9.8
"""The acceleration of gravity that the paper takes."""


class Wing(NamedTuple):
    """The parameters of a fixed-wing drone."""

    c1: Annotated[float, Gt(0), Le(1e3)]
    """The coefficient of parasitic drag, in kg/m."""
    c2: Annotated[float, Gt(0), Le(1e9)]
    """The coefficient of lift-induced drag, in kg m³/s⁴."""


WINGS = {"zeng2017": Wing(9.26e-4, 2250.0)}
"""The parameters of the paper's numerical results."""


class BestSpeeds(NamedTuple):
    """The speed of the least power (V_me) and that of the least energy per metre (V_mr), in m/s."""

    endurance_mps: float
    range_mps: float


@rule
def power_w(own: Wing, speed_mps: float, across_mps2: float = 0.0) -> float:
    """Return the power at a speed and an acceleration across the way, in watts."""
    turn = across_mps2 / GRAVITY_MPS2
    lift_w = own.c2 / speed_mps * (1.0 + turn * turn)
    return own.c1 * speed_mps * speed_mps * speed_mps + lift_w


@kernel
def speeding_j(c1: float, c2: float, from_mps: float, to_mps: float) -> float:
    """Return the integral of the power over the speeds between two, in W m/s.

    Divided by an acceleration along the way, it is the energy in joules that drag takes meanwhile.
    """
    squared_from, squared_to = from_mps * from_mps, to_mps * to_mps
    parasitic = 0.25 * c1 * (squared_to * squared_to - squared_from * squared_from)
    return parasitic + c2 * math.log(to_mps / from_mps)


def best_speeds(own: Wing, other_w: float = 0.0) -> BestSpeeds:
    """Return the speeds of the longest flight in time, and of the longest in distance.

    ``other_w`` is a constant power beside that of flight; V P'(V) - P(V) then has to equal it.
    """
    least = (own.c2 / (3.0 * own.c1)) ** 0.25
    if other_w == 0.0:
        return BestSpeeds(least, (own.c2 / own.c1) ** 0.25)

    def gain(v: float) -> float:
        return 2.0 * own.c1 * v * v * v - 2.0 * own.c2 / v - other_w

    return BestSpeeds(least, root_between(gain, least, least))
