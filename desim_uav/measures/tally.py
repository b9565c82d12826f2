"""The measures of a run over its counted episodes, from its tables."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import pandas as pd

from desim_uav import qoe
from desim_uav.columns import FLOAT
from desim_uav.measures.ages import Ages
from desim_uav.records import APART, ENERGY, LINKS

MEASURED = ("requests", "episodes", "sensors")
"""The tables from which measures follow."""

DERIVED = {"least_distance_m", "j_per_mbit"}
"""The measures of several episodes that are not the sums of those of each."""

OF_SENSORS = ("service", "episode", "user", "group")
"""What sensors can be grouped by; updates, but not sensors, have an outcome."""


class Tally:
    """The measures of a run, whose tables are added part by part; warm-up does not count.

    ``by`` is one of ``qoe.GROUPS`` if those of each group are wanted too.
    """

    def __init__(self, by: str | None = None) -> None:
        self.episodes = 0
        self._requests = qoe.Totals()
        self._groups = None if by is None else Groups(by)
        self._ages: Ages | None = None
        self._suppressed = self._crashes = 0
        self._qoe3, self._reward = qoe.Mean(), qoe.Mean()
        self._sums: dict[str, Any] = {}
        self._least_m: list[float] = []
        self._energy_of_all = True
        self._duration_s: dict[int, float] = {}

    def add(
        self,
        requests: pd.DataFrame | None = None,
        episodes: pd.DataFrame | None = None,
        sensors: pd.DataFrame | None = None,
    ) -> Tally:
        """Add rows of tables; itself. Those of sensors need those of their episodes before them."""
        if episodes is not None:
            self._add_episodes(counted(episodes))
        if requests is not None:
            self._add_requests(counted(requests))
        if sensors is not None:
            self._add_sensors(counted(sensors))
        return self

    def _add_requests(self, requests: pd.DataFrame) -> None:
        self._requests.add(requests)
        if self._groups is not None:
            self._groups.requests.add(requests)

    def _add_episodes(self, episodes: pd.DataFrame) -> None:
        self.episodes += len(episodes)
        self._duration_s |= zip(episodes["episode"], episodes["duration_s"], strict=True)
        self._suppressed += int(episodes["suppressed"].sum())
        self._crashes += int(episodes["crashes"].sum())
        self._qoe3.add(episodes["qoe3_percent"].to_numpy())
        self._reward.add(episodes["reward"].to_numpy())
        for name, kind in (LINKS | APART | ENERGY).items():
            if name in episodes and name not in DERIVED:
                total = self._sums.get(name, 0) + episodes[name].sum()
                self._sums[name] = float(total) if kind == FLOAT else int(total)
        if "least_distance_m" in episodes:
            self._least_m += episodes["least_distance_m"].dropna().tolist()
        if "j_per_mbit" in episodes:
            unknown = (episodes["served_mbit"] > 0.0) & episodes["j_per_mbit"].isna()
            self._energy_of_all &= not unknown.any()

    def _add_sensors(self, sensors: pd.DataFrame) -> None:
        duration_s = sensors["episode"].map(self._duration_s)
        self._ages = (self._ages or Ages()).add(sensors, duration_s)
        if self._groups is not None:
            self._groups.add_sensors(sensors, duration_s)

    def headline(self) -> dict[str, Any]:
        """Return the measures over all episodes added so far."""
        return self._requests.summary() | {
            "episodes": self.episodes,
            "suppressed": self._suppressed,
            "qoe3_percent": self._qoe3.value(),
            "crashes": self._crashes,
            "reward_mean": self._reward.value(),
            **self._sums,
            **self._derived(),
            **_throughput(self._requests, sum(self._duration_s.values())),
            **({} if self._ages is None else self._ages.summary()),
        }

    def groups(self) -> list[dict[str, Any]]:
        """Return the measures of each group, in order; a group lacks those of whole episodes."""
        assert self._groups is not None, "the groups were asked for"
        return self._groups.summaries(self._duration_s)

    def _derived(self) -> dict[str, float | None]:
        """Return those measures that need sums over all episodes."""
        measures: dict[str, float | None] = {}
        if "conflicts" in self._sums:
            measures["least_distance_m"] = min(self._least_m, default=None)
        if "energy_wh" in self._sums:
            served, used_j = self._sums["served_mbit"], 3600 * self._sums["energy_wh"]
            has_energy = self._energy_of_all and served > 0.0
            measures["j_per_mbit"] = used_j / served if has_energy else None
            done = self._requests.tasks_done
            if done is not None:
                measures["drone_j_per_task"] = used_j / done if has_energy and done else None
        return measures


class Groups:
    """The measures of each group of requests and sensors."""

    def __init__(self, by: str) -> None:
        self.requests = qoe.Groups(by)
        self._by = by
        self._ages: defaultdict[Any, Ages] | None = None

    def add_sensors(self, sensors: pd.DataFrame, duration_s: pd.Series) -> None:
        """Add rows of sensors, and the length of each row's episode."""
        if self._ages is None:
            self._ages = defaultdict(Ages)
        if self._by in OF_SENSORS:
            for value, rows in sensors.groupby(self._by, sort=True):
                key = qoe.GROUPS[self._by](value)
                self._ages[key].add(rows, duration_s[rows.index])

    def summaries(self, duration_s: dict[int, float]) -> list[dict[str, Any]]:
        """Return the measures of each group, given the length of each episode."""
        totals, whole_s = self.requests.totals, sum(duration_s.values())
        ages: dict[Any, Ages] = self._ages or {}
        rows = []
        for value in sorted({*totals, *ages}):
            lasted_s = duration_s[value] if self._by == "episode" else whole_s
            rows.append(
                {self._by: value}
                | totals[value].summary()
                | _throughput(totals[value], lasted_s)
                | ({} if self._ages is None else ages.get(value, Ages()).summary())
            )
        names = dict.fromkeys(name for row in rows for name in row)
        return [dict.fromkeys(names) | row for row in rows]


def headline(
    requests: pd.DataFrame, episodes: pd.DataFrame, sensors: pd.DataFrame | None = None
) -> dict[str, Any]:
    """Return the measures of whole tables."""
    return Tally().add(requests, episodes, sensors).headline()


def grouped(
    by: str,
    requests: pd.DataFrame,
    episodes: pd.DataFrame,
    sensors: pd.DataFrame | None = None,
) -> list[dict[str, Any]]:
    """Return the measures of each group of rows of whole tables."""
    return Tally(by).add(requests, episodes, sensors).groups()


def counted(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of all episodes except warm-up."""
    return table[table["episode"] >= 0]


def _throughput(requests: qoe.Totals, lasted_s: float) -> dict[str, float | None]:
    """Return what was delivered per second; nothing if no service asks for a volume."""
    delivered = requests.delivered_mbit
    if delivered is None:
        return {}
    return {"throughput_mbps": delivered / lasted_s if lasted_s > 0.0 else None}
