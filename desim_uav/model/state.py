"""What an engine shows at a decision epoch: to policies, environments and rewards."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.grid import Cell, Grid
from desim_uav.model.rules import Mode


class Facts(NamedTuple):
    """What does not change in a run, as far as rewards, observations and learners may use it.

    ``capacity_s`` (a full battery) is None where the battery is unlimited, ``bandwidth_kbps`` inf
    where the bandwidth is. ``clusters``: rows x, y, radius, in metres. ``three_d``: do drones
    change altitude?
    """

    grid: Grid
    stations: tuple[Cell, ...]
    clusters: NDArray[np.float64]
    drones: int
    users: int
    services: tuple[str, ...]
    steps: int
    step_s: float
    three_d: bool
    capacity_s: float | None
    bandwidth_kbps: float


class Observation(NamedTuple):
    """What one drone knows at a decision epoch. It has no map and knows nothing of other drones.

    ``cell`` is where it believes it is (under position noise, not always where it is); ``level`` is
    the index of its altitude. ``battery_s`` and ``capacity_s`` are None where the battery is
    unlimited. ``return_s`` (the model's n_B) is the battery that the quickest return to a charging
    station takes from ``cell``, inf where there is no way, None without a battery; ``station`` is
    that station's index and ``flight_s`` the time of the flight, None where there is no way.
    ``served`` and ``asking`` count, by service, the requests it serves and the open requests of
    all users in its footprint.
    """

    drone: int
    step: int
    steps: int
    cell: Cell
    level: int
    mode: Mode
    battery_s: float | None
    capacity_s: float | None
    return_s: float | None
    attached_users: int
    served_requests: int
    bandwidth_kbps: float
    station: int | None = None
    flight_s: float | None = None
    served: tuple[int, ...] = ()
    asking: tuple[int, ...] = ()


observed = partial(tuple.__new__, Observation)
"""An Observation of a tuple of all its fields: ``_make`` without counting them."""


class Snapshot(NamedTuple):
    """The state at a decision epoch, one observation, mask and reward a drone.

    ``terminated``: a crash has ended the episode; ``truncated``: its time is up. ``open_requests``
    counts all open requests by service. ``reward_terms`` are what each drone was rewarded for in
    the step that ends here, by name, and ``rewards`` their sums; both are empty before the first
    step.
    """

    step: int
    t_us: int
    terminated: bool
    truncated: bool
    observations: tuple[Observation, ...]
    masks: tuple[tuple[bool, ...], ...]
    open_requests: tuple[int, ...]
    rewards: tuple[float, ...]
    reward_terms: tuple[dict[str, float], ...]


shown = partial(tuple.__new__, Snapshot)
"""A Snapshot of a tuple of all its fields."""
