"""Ages of sensors over several episodes, from the tables of sensors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

COUNTS = {
    "updates": "updates",
    "updates_delivered": "delivered",
    "updates_dropped": "dropped",
    "updates_lost": "lost",
}
"""The measures that are sums of a column."""

NAMES = ("age_s", "peak_age_s", "worst_age_s", "age_violation_percent", *COUNTS)
"""The measures of sensors."""


class Ages:
    """Running measures of sensors. An average over time is weighted by the length of an episode."""

    def __init__(self) -> None:
        self._of_users: dict[int, tuple[float, float]] = {}
        """The area below each sensor's age in s², and the time in s."""
        self._peaks_s = self._above_s = self._limited_s = 0.0
        self._falls = 0
        self._counts = dict.fromkeys(COUNTS, 0)

    def add(self, sensors: pd.DataFrame, duration_s: pd.Series) -> Ages:
        """Add rows of sensors; itself. ``duration_s`` is the length of each row's episode."""
        lasted_s = duration_s.to_numpy(float)
        users, of_row = np.unique(sensors["user"].to_numpy(), return_inverse=True)
        areas = np.bincount(of_row, sensors["age_s"].to_numpy() * lasted_s, len(users))
        times = np.bincount(of_row, lasted_s, len(users))
        for user, area, time in zip(users.tolist(), areas.tolist(), times.tolist(), strict=True):
            before, time_before = self._of_users.get(user, (0.0, 0.0))
            self._of_users[user] = before + area, time_before + time
        falls = sensors["falls"].to_numpy()
        self._falls += int(falls.sum())
        self._peaks_s += float(np.nansum(sensors["peak_age_s"].to_numpy() * falls))
        above_s = sensors["violation_s"].to_numpy()
        self._above_s += float(np.nansum(above_s))
        self._limited_s += float(lasted_s[~np.isnan(above_s)].sum())
        for name, column in COUNTS.items():
            self._counts[name] += int(sensors[column].sum())
        return self

    def summary(self) -> dict[str, Any]:
        """Return the measures of all added sensors; those of no sensors are None."""
        if not self._of_users:
            return dict.fromkeys(NAMES)
        areas, times = map(sum, zip(*self._of_users.values(), strict=True))
        percent = 100.0 * self._above_s / self._limited_s if self._limited_s else None
        return {
            "age_s": areas / times,
            "peak_age_s": self._peaks_s / self._falls if self._falls else None,
            "worst_age_s": max(area / time for area, time in self._of_users.values()),
            "age_violation_percent": percent,
            **self._counts,
        }
