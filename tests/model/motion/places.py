"""A helper of tests: the place of a drone at a time of its leg."""

from desim_uav.model.motion.motion import TRAPEZOID, travelled


def place_on(leg, profile, elapsed_s):
    """The place of a drone some seconds after the start of a leg; it hovers at the end."""
    x0, y0, z0, x1, y1, z1 = leg.route
    if leg.distance_m == 0.0:
        return x0, y0, z0
    share = travelled(profile[:TRAPEZOID], elapsed_s) / leg.distance_m
    return x0 + share * (x1 - x0), y0 + share * (y1 - y0), z0 + share * (z1 - z0)
