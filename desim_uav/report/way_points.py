"""The exact positions of users along their walks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from desim_uav.model.geometry.coverage import WalkLeg
from desim_uav.model.rules import US
from desim_uav.rowcode.views import records

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class WayPoints:
    """The way points of all users in an episode, and where users are between them."""

    def __init__(self, users: pd.DataFrame, count: int) -> None:
        """Take an episode of the table ``users``; there are so many users."""
        points = users.sort_values(["user", "t_s"], kind="stable")
        self._times_us: Ints = (points["t_s"] * US).round().to_numpy(np.int64)
        self._room = int(self._times_us.max()) + 1
        self._keys = points["user"].to_numpy(np.int64) * self._room + self._times_us
        self._places: Floats = points[["x_m", "y_m", "z_m"]].to_numpy(np.float64)
        self._count = count

    def all_m(self, t_us: int) -> Floats:
        """Return the positions of all users at a time, as (users, 3)."""
        return self._at(np.arange(self._count), min(t_us, self._room - 1))

    def places_m(self, user: int, times_us: Ints) -> Floats:
        """Return the position of a user at some times, as (times, 3)."""
        return self._at(user, np.minimum(times_us, self._room - 1))

    def _at(self, users: Any, times_us: Any) -> Floats:
        """Return positions of users at times, of which one is an array."""
        before = np.searchsorted(self._keys, users * self._room + times_us, "right") - 1
        after = np.minimum(before + 1, len(self._keys) - 1)
        length = self._times_us[after] - self._times_us[before]
        moves = length > 0  # otherwise it is a user's last way point
        passed_us = times_us - self._times_us[before]
        share = np.where(moves, passed_us / np.where(moves, length, 1), 0.0)
        moved_m = self._places[after] - self._places[before]
        places_m: Floats = self._places[before] + share[:, None] * moved_m
        return places_m

    def legs(self, user: int) -> Any:
        """Return the legs of a user's walk as an array of ``WalkLeg``."""
        bounds = [user * self._room, (user + 1) * self._room]
        own = slice(*np.searchsorted(self._keys, bounds).tolist())
        t_us, places = self._times_us[own], self._places[own, :2]
        speeds = np.zeros((len(t_us), 2))
        speeds[:-1] = np.diff(places, axis=0) / (np.maximum(np.diff(t_us), 1) / US)[:, None]
        return records(WalkLeg, np.column_stack([t_us, places, speeds]))
