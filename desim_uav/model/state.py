"""The state at a decision epoch, as engines show it to policies, environments and rewards."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.geometry.grid import Cell, Grid
from desim_uav.model.rules import Mode


class Facts(NamedTuple):
    """The constants of a run that rewards, observations and learners may use.

    ``capacity_s`` (a full battery) is None if the battery is unlimited, and ``bandwidth_khz`` is
    inf if the bandwidth is. ``clusters``: rows of x, y and radius, in metres. ``three_d``: whether
    drones change altitude. ``graded``: whether the links of drones have classes. If drones differ,
    ``capacity_s``, ``bandwidth_khz`` and ``graded`` are those of one type of drones; ``limited``
    says whether the battery of some type is limited.
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
    bandwidth_khz: float
    graded: bool = False
    limited: bool = False

    @property
    def some_charge(self) -> bool:
        """Whether some drones have to charge."""
        return self.limited or self.capacity_s is not None


class Observation(NamedTuple):
    """What one drone knows at a decision epoch. It has no map and knows nothing of other drones.

    ``cell`` is where the drone believes it is, which under position noise may be wrong; ``level``
    is the index of its altitude. ``battery_s`` and ``capacity_s`` are None if the battery is
    unlimited. ``return_s`` (the model's n_B) is the battery that the quickest return to a charging
    station takes from ``cell``: inf if there is no way, None without a battery. ``station`` is
    that station's index and ``flight_s`` the time of the flight; both are None if there is no way.
    ``served`` counts the requests that the drone serves, and ``asking`` the open requests of all
    users in its footprint, by service. ``features`` are the numbers that a learner gets instead,
    as the scenario's observation component writes them.
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
    bandwidth_khz: float
    station: int | None = None
    flight_s: float | None = None
    served: tuple[int, ...] = ()
    asking: tuple[int, ...] = ()
    features: tuple[float, ...] = ()


observation_of = partial(tuple.__new__, Observation)
"""Make an Observation of a tuple of all its fields: ``_make`` without counting them."""


class Snapshot(NamedTuple):
    """The state at a decision epoch, with one observation, mask and reward per drone.

    ``terminated``: a crash has ended the episode; ``truncated``: its time is up. ``open_requests``
    counts all open requests by service. ``reward_terms`` holds the terms of each drone's reward
    for the step that ends here, by name, and ``rewards`` their sums; both are empty before the
    first step.
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


snapshot_of = partial(tuple.__new__, Snapshot)
"""Make a Snapshot of a tuple of all its fields."""
