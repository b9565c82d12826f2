"""The search for the best cover: an integer program, which HiGHS solves.

A footprint is the set of users that a drone at one place covers, as a row of ``covers``
(footprints, users). A placement has the index of each drone's footprint; several drones may have
the same one. Users are counted in whole numbers. Only the bound on what other placements cover is
HiGHS's, which computes with floating-point numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

HeldPlaces = NDArray[np.bool_]
Placement = NDArray[np.int64]

SLACK = 1e-3
"""What is added to a bound before it is rounded down, which is far more than its rounding error."""


def covered(covers: HeldPlaces, placement: Placement) -> int:
    """Return the number of users that a placement covers."""
    return int(covers[placement].any(axis=0).sum())


def greedy_cover(covers: HeldPlaces, drones: int) -> tuple[Placement, int]:
    """Place each drone in turn where it adds most users.

    Returns the placement, and a bound on the users that any placement covers: after any turn, none
    exceeds the users covered so far by more than the ``drones`` largest gains at that time.
    """
    placement = np.zeros(0, np.int64)
    left, bound = covers, covers.shape[1]
    while True:
        gains = left.sum(axis=1)
        bound = min(bound, covered(covers, placement) + int(np.sort(gains)[-drones:].sum()))
        if len(placement) == drones:
            return placement, bound
        best = gains.argmax()
        placement = np.append(placement, best)
        left = left & ~covers[best]


def best_cover(
    covers: HeldPlaces, drones: int, limit_s: float, in_order: bool
) -> tuple[Placement | None, float]:
    """Return the placement that covers most users, and a bound on the users that any one covers.

    Among equally good placements ``in_order`` chooses one with the least sum of indices. After
    ``limit_s`` seconds the placement is the best found so far, or None. The variables of the
    program are the number of drones over each footprint, and the covered part of each group of
    users, who are those in the same footprints.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import csr_array, eye_array, hstack

    contained, users = np.unique(covers.T, axis=0, return_counts=True)
    places, groups = len(covers), len(users)
    of_drones = np.repeat([1.0, 0.0], [places, groups])
    by_drones = hstack([csr_array(-contained.astype(float)), eye_array(groups)], format="csr")
    rows = [LinearConstraint(of_drones[None], drones, drones), LinearConstraint(by_drones, ub=0)]
    order = -np.arange(places + groups) * of_drones
    placement, bound = None, np.inf
    for gains in (np.append(np.zeros(places), users), order)[: 1 + in_order]:
        solution = milp(
            -gains,
            integrality=of_drones,
            bounds=Bounds(0, np.where(of_drones, drones, 1)),
            constraints=rows,
            options={"mip_rel_gap": 0.0, "time_limit": limit_s},
        )
        if gains is not order and solution.mip_dual_bound is not None:
            bound = np.floor(SLACK - solution.mip_dual_bound)
        if solution.x is not None:
            placement = np.repeat(np.arange(places), np.rint(solution.x[:places]).astype(int))
        if solution.status != 0:
            break
        rows.append(LinearConstraint(gains[None], round(-solution.fun) - 0.5))
    return placement, float(bound)
