"""The propulsion power of a rotary-wing drone: Zeng, Xu and Zhang 2019.

Energy Minimization for Wireless Communication With Rotary-Wing UAV, IEEE Transactions on Wireless
Communications 18 (4). At the horizontal speed V it takes

    P(V) = P0 (1 + 3 V²/U²) + Pi (sqrt(1 + V⁴ / 4 v0⁴) - V² / 2 v0²)^(1/2) + d0 ρ s A V³ / 2,

the powers of the blades' profile, of induction and of the fuselage's drag. While the speed changes
at a constant acceleration a, the energy is an integral of P over V, divided by a, and has a closed
form too.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from annotated_types import Ge, Gt, Le

from desim_uav.model.energy.propulsion.search import root_between
from desim_uav.rowcode.kernels import kernel, rule


class Rotor(NamedTuple):
    """The parameters of a rotary-wing drone, by the symbols of the paper's Table I."""

    weight_n: Annotated[float, Gt(0), Le(1e5)]
    """The weight of the drone, W, in newtons."""
    air_density_kg_m3: Annotated[float, Ge(1e-3), Le(100)]
    """The density of the air, ρ, in kg/m³."""
    rotor_radius_m: Annotated[float, Ge(1e-3), Le(100)]
    """The radius of a rotor, R, in metres."""
    blade_speed_rad_s: Annotated[float, Ge(1e-3), Le(1e5)]
    """The angular speed of the blades, Ω, in rad/s."""
    solidity: Annotated[float, Gt(0), Le(1)]
    """The solidity of the rotor, s: the share of the disc that the blades cover, b c / π R."""
    profile_drag: Annotated[float, Gt(0), Le(1)]
    """The coefficient of the blades' profile drag, δ."""
    fuselage_drag: Annotated[float, Ge(0), Le(100)]
    """The ratio of the fuselage's drag, d0: its flat-plate area over s A."""
    induced_factor: Annotated[float, Ge(0), Le(10)]
    """The correction of induced power, k."""
    disc_area_m2: Annotated[float, Ge(1e-6), Le(1e5)] | None = None
    """The area of the rotor's disc, A, in m²; null means π R²."""
    tip_speed_mps: Annotated[float, Ge(1e-3), Le(1e5)] | None = None
    """The speed of the blades' tips, U, in m/s; null means Ω R."""
    induced_speed_mps: Annotated[float, Ge(1e-3), Le(1e4)] | None = None
    """The mean speed of the induced flow in a hover, v0, in m/s; null means sqrt(W / 2 ρ A)."""


class Derived(NamedTuple):
    """What follows from the other parameters of a rotor: A, U and v0."""

    disc_area_m2: float
    tip_speed_mps: float
    induced_speed_mps: float


def derived(rotor: Rotor) -> Derived:
    """Return what follows from the other parameters; v0 follows from the area that is given."""
    radius_m = rotor.rotor_radius_m
    area_m2 = math.pi * radius_m * radius_m
    pushed = 2.0 * rotor.air_density_kg_m3 * (rotor.disc_area_m2 or area_m2)
    return Derived(area_m2, rotor.blade_speed_rad_s * radius_m, math.sqrt(rotor.weight_n / pushed))


def whole(rotor: Rotor) -> Rotor:
    """Return a rotor with the parameters that are not given, which follow from the others."""
    follows = derived(rotor)._asdict()
    return rotor._replace(
        **{key: value for key, value in follows.items() if getattr(rotor, key) is None}
    )


ROTORS = {
    "zeng2019": Rotor(20.0, 1.225, 0.4, 300.0, 0.05, 0.012, 0.6, 0.1, 0.503, 120.0, 4.03),
    "zeng2018": Rotor(100.0, 1.225, 0.5, 400.0, 0.05, 0.012, 0.3, 0.1, 0.79, 200.0, 7.2),
}
"""The parameters of Table I, and those of the paper's first version (arXiv 1804.02238v1)."""


GRAVITY_MPS2 = 9.81
"""The acceleration of gravity, by which a mass has a weight."""


def rotor_of(mass_kg: float, hover_w: float) -> Rotor:
    """Return a rotor that lifts a mass with this power in a hover.

    It has the shape of that of Table I: its solidity s, drag coefficients δ and d0, correction k
    and ratio c = U / v0. The power of a hover is then W v0 (1 + k + δ s c³ / 16), because
    ρ A v0² = W / 2, so the power gives v0, and v0 gives the area A = W / 2 ρ v0².
    """
    like, weight_n = ROTORS["zeng2019"], mass_kg * GRAVITY_MPS2
    like = whole(like._replace(disc_area_m2=None, tip_speed_mps=None, induced_speed_mps=None))
    assert like.tip_speed_mps is not None and like.induced_speed_mps is not None
    ratio = like.tip_speed_mps / like.induced_speed_mps
    per_lift = 1.0 + like.induced_factor + like.profile_drag * like.solidity * ratio**3 / 16.0
    flow_mps = hover_w / (weight_n * per_lift)
    area_m2 = weight_n / (2.0 * like.air_density_kg_m3 * flow_mps * flow_mps)
    radius_m = math.sqrt(area_m2 / math.pi)
    return whole(
        like._replace(
            weight_n=weight_n,
            rotor_radius_m=radius_m,
            blade_speed_rad_s=ratio * flow_mps / radius_m,
            disc_area_m2=None,
            tip_speed_mps=None,
            induced_speed_mps=None,
        )
    )


class Powers(NamedTuple):
    """What the power depends on: P(V) = blade + induced + drag V³, as above.

    ``blade_w`` (P0) and ``induced_w`` (Pi) are the powers in a hover; ``drag_w`` is that of the
    fuselage at 1 m/s.
    """

    blade_w: float
    induced_w: float
    drag_w: float
    tip_mps: float
    flow_mps: float


def powers_of(rotor: Rotor) -> Powers:
    """Return the coefficients of the power of a rotor."""
    rotor = whole(rotor)
    assert rotor.disc_area_m2 and rotor.tip_speed_mps and rotor.induced_speed_mps
    swept = rotor.air_density_kg_m3 * rotor.solidity * rotor.disc_area_m2
    blades_mps = rotor.blade_speed_rad_s * rotor.rotor_radius_m
    blade_w = rotor.profile_drag / 8.0 * swept * blades_mps * blades_mps * blades_mps
    lifted = rotor.weight_n * math.sqrt(rotor.weight_n)
    pushed = math.sqrt(2.0 * rotor.air_density_kg_m3 * rotor.disc_area_m2)
    return Powers(
        blade_w,
        (1.0 + rotor.induced_factor) * lifted / pushed,
        0.5 * rotor.fuselage_drag * swept,
        rotor.tip_speed_mps,
        rotor.induced_speed_mps,
    )


@rule
def power_w(own: Powers, speed_mps: float) -> float:
    """Return the power in level flight, in watts.

    The induced part is written without the difference of two nearly equal numbers, so it stays
    exact at high speeds: sqrt(1 + x²) - x = 1 / (sqrt(1 + x²) + x), with x = V² / 2 v0².
    """
    ratio, tip = speed_mps / own.flow_mps, speed_mps / own.tip_mps
    x = 0.5 * ratio * ratio
    induced_w = own.induced_w / math.sqrt(math.sqrt(1.0 + x * x) + x)
    drag_w = own.drag_w * speed_mps * speed_mps * speed_mps
    return own.blade_w * (1.0 + 3.0 * tip * tip) + induced_w + drag_w


@rule
def speeding_j(own: Powers, speed_mps: float) -> float:
    """Return the integral of the power over speeds from 0, in W m/s.

    Divided by an acceleration, it is the energy in joules that speeding up takes, or slowing down.
    """
    tip = speed_mps / own.tip_mps
    blade = own.blade_w * speed_mps * (1.0 + tip * tip)
    induced = own.induced_w * induced_integral(speed_mps, own.flow_mps)
    squared = speed_mps * speed_mps
    return blade + induced + 0.25 * own.drag_w * squared * squared


@kernel
def induced_integral(speed_mps: float, flow_mps: float) -> float:
    """Return the integral of (sqrt(1 + x²) - x)^(1/2) over speeds from 0, in m/s.

    It is (v0 / 2) (q + artanh q) with q² = 1 - (sqrt(1 + x²) - x)², which is taken apart so that
    neither q at low speeds nor artanh q at high ones loses digits.
    """
    ratio = speed_mps / flow_mps
    x = 0.5 * ratio * ratio
    root = math.sqrt(1.0 + x * x)
    s = 1.0 / (root + x)
    q = math.sqrt(x * (1.0 + root - x) / (1.0 + root) * (1.0 + s))
    artanh = math.log1p(q * (root + x) + x + x * x / (1.0 + root))
    return 0.5 * flow_mps * (q + artanh)


def slope_w(own: Powers, speed_mps: float) -> float:
    """Return the derivative of the power by the speed, in W/(m/s)."""
    ratio = speed_mps / own.flow_mps
    x = 0.5 * ratio * ratio
    root = math.sqrt(1.0 + x * x)
    induced = -0.5 * own.induced_w * ratio / (own.flow_mps * root * math.sqrt(root + x))
    blade = 6.0 * own.blade_w * speed_mps / (own.tip_mps * own.tip_mps)
    return blade + induced + 3.0 * own.drag_w * speed_mps * speed_mps


class BestSpeeds(NamedTuple):
    """The speed of the least power (V_me) and that of the least energy per metre (V_mr), in m/s."""

    endurance_mps: float
    range_mps: float


def best_speeds(own: Powers, other_w: float = 0.0) -> BestSpeeds:
    """Return the speeds of the longest flight in time, and of the longest in distance.

    ``other_w`` is a constant power beside that of flight.

    The power falls at first, since its slope at 0 is 0 and then that of induction, and has one
    minimum; beyond it V P'(V) - P(V), which has the sign of the slope of P / V, rises from -P to
    above 0. Each root is therefore enclosed by two speeds and found by bisection.
    """
    least = root_between(lambda v: slope_w(own, v), 1e-6 * own.flow_mps, own.flow_mps)

    def gain(speed_mps: float) -> float:
        return speed_mps * slope_w(own, speed_mps) - power_w(own, speed_mps) - other_w

    return BestSpeeds(least, root_between(gain, least, own.flow_mps))
