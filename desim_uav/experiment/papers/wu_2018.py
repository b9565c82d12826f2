"""Wu, Zeng and Zhang 2018: the rate that one drone cannot exceed for each of several users."""

from __future__ import annotations

import math
from collections.abc import Iterator

from desim_uav.experiment.papers.row import GalleryRow, evaluated
from desim_uav.model.radio.link import LinkBudget
from desim_uav.model.radio.path_loss import LogDistance

HEIGHT_M, USERS = 100.0, 6
LOSS = LogDistance(2.0, 60.0)
BUDGET = LinkBudget(power_dbm=20.0, bandwidth_mhz=1e-6, noise_figure_db=0, noise_dbm_per_hz=-110)
"""0.1 W, and noise of -110 dBm in all: the paper gives no density, so the band counts as 1 Hz."""


def rows() -> Iterator[GalleryRow]:
    """Yield the link to a user right below the drone, and the bound that follows from it."""
    how = "eq. 41 with the numbers of section V"
    snr_db = BUDGET.snr_db(LOSS.los_db(0.0, HEIGHT_M, 2.0))
    yield evaluated("signal-to-noise ratio right above a user, dB", how, 30.0, snr_db, 4)
    yield evaluated(
        "bound of the least rate of 6 users, bit/s/Hz", how, 1.6612, least_rate_bound(USERS), 4
    )


def least_rate_bound(users: int) -> float:
    """Return what the least of the users' mean rates cannot exceed, in bit/s/Hz.

    The drone sends to one user at a time, at a rate that is highest right above this user. So all
    mean rates together are at most this rate, and the least one is at most an equal share of it.
    """
    above_db = BUDGET.snr_db(LOSS.los_db(0.0, HEIGHT_M, 2.0))
    return math.log2(1.0 + 10.0 ** (above_db / 10.0)) / users
