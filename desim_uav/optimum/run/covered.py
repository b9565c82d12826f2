"""QoE3 as a measure that prices bound.

A user with the price p, between 0 and 1, is covered by any drone for at most 1 - p of a step, and
p times the sum over drones of the shares for which each covers it.
"""

from __future__ import annotations

import numpy as np

from desim_uav.optimum.run.prices import Prices, Slope


class Covered:
    """The share of time for which users are covered, over all steps and users of a run."""

    most = 1.0

    def at_most(self, prices: Prices, earned: float) -> Slope:
        """Return the bound on QoE3, and its slope."""
        bound = (float((1.0 - prices).sum()) + earned) / prices.size
        return Slope(bound, np.ones_like(prices), float(prices.size))
