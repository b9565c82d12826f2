"""Where users are on walks at a time, and how fast they are: read off the legs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.mobility.walks import Area, Walks
from desim_uav.model.random.streams import Purpose, Streams

US = 1_000_000

Floats = NDArray[np.float64]


def walked(model: Any, users: int, side_m: Sequence[float], last_s: float, seed: int = 0) -> Walks:
    """The walks of users whose homes are uniform on a map."""
    homes = np.random.default_rng(seed).uniform((0.0, 0.0), side_m, (users, 2))
    streams = Streams(seed, Purpose.MOBILITY, 0)
    return model.walks(homes, streams, Area(*side_m), int(last_s * US))


def legs_at(walks: Walks, t_s: float) -> NDArray[np.int64]:
    """The row of the leg that each user is on."""
    users = np.repeat(np.arange(len(walks.offsets) - 1), np.diff(walks.offsets))
    begins = walks.legs["begin_us"].astype(np.int64) + users * 10**14
    ends = int(t_s * US) + np.arange(len(walks.offsets) - 1) * 10**14
    return np.searchsorted(begins, ends, side="right") - 1


def starts_of(legs: Any) -> Floats:
    """The places, in metres, where one leg or several begin: x and y in the last dimension."""
    return np.stack([legs["x_m"], legs["y_m"]], axis=-1)


def velocities_of(legs: Any) -> Floats:
    """The velocities on legs, or on one of them, along x and y."""
    return np.stack([legs["vx_mps"], legs["vy_mps"]], axis=-1)


def places_at(walks: Walks, t_s: float) -> Floats:
    """Where all users are: (users, 2)."""
    legs = walks.legs[legs_at(walks, t_s)]
    since_s = (t_s - legs["begin_us"] / US)[:, None]
    return starts_of(legs) + velocities_of(legs) * since_s


def speeds_at(walks: Walks, t_s: float) -> Floats:
    """How fast all users are."""
    legs = walks.legs[legs_at(walks, t_s)]
    return np.hypot(legs["vx_mps"], legs["vy_mps"])


def nth_legs(walks: Walks, n: int) -> tuple[Any, Floats]:
    """The n-th leg of each user, and how long it lasts in seconds; each must have one more."""
    rows = walks.offsets[:-1] + n
    assert (rows + 1 < walks.offsets[1:]).all()
    begins = walks.legs["begin_us"]
    return walks.legs[rows], (begins[rows + 1] - begins[rows]) / US
