"""What an engine shows at a decision epoch: to policies, environments and rewards."""

from __future__ import annotations

from typing import NamedTuple

from desim_uav.model.grid import Cell
from desim_uav.model.rules import Mode


class Observation(NamedTuple):
    """What one drone knows at a decision epoch. It has no map and knows nothing of other drones.

    ``cell`` is where it believes it is (under position noise, not always where it is); ``level`` is
    the index of its altitude. ``battery_s`` and ``capacity_s`` are None where the battery is
    unlimited. ``return_s`` (the model's n_B) is the flight time of the quickest return to a
    charging station from ``cell``, inf where there is no way, None without a battery.
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


class Snapshot(NamedTuple):
    """The state at a decision epoch, one observation and one mask a drone.

    ``terminated``: a crash has ended the episode; ``truncated``: its time is up.
    """

    step: int
    t_us: int
    terminated: bool
    truncated: bool
    observations: tuple[Observation, ...]
    masks: tuple[tuple[bool, ...], ...]
