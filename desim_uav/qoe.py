"""Quality of experience: QoE1-3 and the measures derived from a frame of requests.

The basic columns of a request are its times, ``requested_s`` and ``served_s``, and for services
that ask for a volume ``requested_mbit`` and ``delivered_mbit``; if services have several stages,
``stages``, ``stages_done`` and ``stage_done``; for tasks those of ``records.TASKS``. ``derive``
computes the other columns from them, and ``summary`` averages them. The definitions are in
``docs/explanation/model.md``.
"""

from __future__ import annotations

import math
from collections import defaultdict
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from desim_uav.errors import UsageError

OUTCOMES = ("completed", "unfinished", "never_served")
"""The outcomes of requests in every run; those that are dropped at a deadline are LATE, and
updates of sensors that were replaced are DROPPED."""
LATE, DROPPED = "late", "dropped"
SUMMED = (
    *("t_request_s", "t_end_s", "attached_s", "wait_s", "completion_s", "outcome"),
    *("qoe1", "qoe1_feasible", "qoe2_iterations", "interruptions", "handovers"),
)
AVERAGED = {
    "qoe1_percent": ("qoe1", 100),
    "qoe1_feasible_percent": ("qoe1_feasible", 100),
    "qoe2_iterations": ("qoe2_iterations", 1),
    "wait_s": ("wait_s", 1),
    "completion_s": ("completion_s", 1),
}
"""The measures that are means, each with its column and a factor."""

PARTS = ("waiting_s", "sending_s", "computing_s", "own_s")
"""The parts of the delay of tasks, which are means over those that were completed."""

COUNTED = ("interruptions", "handovers")
WORST_SHARE = 0.1
"""The share of users, those with the lowest QoE1, of which there is a mean of their own."""

TOLERANCE_S = 1e-6
GROUPS: dict[str, type] = {
    "service": str,
    "episode": int,
    "user": int,
    "group": str,
    "outcome": str,
}


def inconsistency(requests: pd.DataFrame) -> str | None:
    """Return a message about the first row that no run can have written, or None."""
    open_s = requests["t_end_s"] - requests["t_request_s"]
    most_s = requests["requested_s"].clip(upper=open_s).fillna(open_s)
    tests = {
        "request_id occurs twice in its episode": requests.duplicated(["episode", "request_id"]),
        "t_end_s is before t_request_s": open_s < 0,
        "served_s is negative": requests["served_s"] < 0,
        "served_s exceeds requested_s, or the time the request was open": (
            requests["served_s"] > most_s + TOLERANCE_S
        ),
        f"outcome is not one of {', '.join((*OUTCOMES, LATE, DROPPED))}": (
            ~requests["outcome"].isin((*OUTCOMES, LATE, DROPPED))
        ),
    }
    for problem, rows in tests.items():
        if rows.any():
            row = requests[rows].iloc[0]
            return f"episode {row['episode']}, request {row['request_id']}: {problem}"
    return None


def derive(requests: pd.DataFrame, duration_s: pd.Series | float, step_s: float) -> pd.DataFrame:
    """Add wait_s, completion_s, handovers, qoe1, qoe1_feasible and qoe2_iterations to requests.

    If requests ask for volumes, ``throughput_kbps`` is added too.
    ``duration_s`` is the length of the episode in seconds, a number or one per row, and ``step_s``
    that of a step, the unit of QoE2, which the paper calls an iteration.
    """
    derived = requests.copy()
    first = requests["t_first_service_s"].fillna(requests["t_end_s"])
    open_s = _between(requests["t_request_s"], requests["t_end_s"])
    left_s = _between(requests["t_request_s"], duration_s)
    derived["wait_s"] = _between(requests["t_request_s"], first)
    derived["completion_s"] = open_s.where(requests["outcome"] == "completed")
    handovers = [max(len(drones) - 1, 0) for drones in requests["drones"]]
    derived["handovers"] = pd.Series(handovers, requests.index, dtype="int64")
    derived["qoe1"] = requests["served_s"] / requests["requested_s"]
    if "delivered_mbit" in requests:
        delivered = requests["delivered_mbit"]
        derived["qoe1"] = derived["qoe1"].fillna(delivered / requests["requested_mbit"])
        derived["throughput_kbps"] = 1000 * delivered / open_s.where(open_s > 0)
    if "stages" in requests:
        several = (requests["stages"] > 1) | derived["qoe1"].isna()
        share = (requests["stages_done"] + requests["stage_done"]) / requests["stages"]
        derived["qoe1"] = share.where(several, derived["qoe1"])
    feasible_s = requests["requested_s"].clip(upper=left_s)
    derived["qoe1_feasible"] = requests["served_s"] / feasible_s.where(feasible_s > 0)
    if "stages" in requests:
        derived["qoe1_feasible"] = derived["qoe1_feasible"].mask(requests["stages"] > 1)
    derived["qoe2_iterations"] = _between(requests["served_s"], open_s) / step_s
    return derived


def summary(requests: pd.DataFrame) -> dict[str, Any]:
    """Return the measures of a set of requests; a mean over no requests is None.

    QoE1 and QoE2 are means over all requests, also those that were never served.
    ``qoe3_active_percent`` is the share of the open time in which the user was attached to a
    drone. ``fairness`` is Jain's index of the users' mean QoE1.
    """
    return Totals().add(requests).summary()


def grouped(requests: pd.DataFrame, by: str) -> list[dict[str, Any]]:
    """Return the ``summary`` of each group of requests, in the order of ``by`` (see ``GROUPS``)."""
    return Groups(by).add(requests).summaries()


def fairness(requests: pd.DataFrame) -> float | None:
    """Return Jain's index of the users' mean QoE1.

    It is 1 if all n users have the same QoE1, and 1/n if only one has any. It is None if no user
    was served.
    """
    return Fairness().add(requests).value()


def covered_once(requests: pd.DataFrame, duration_s: pd.Series, users: int) -> pd.Series:
    """Return the share of users that drones covered at least once in each episode, in percent.

    ``duration_s`` is the length of each episode by its number. A user was covered if it was
    attached for some time while a request of it was open. It was not if it was never attached and
    had a request open for the whole episode. A share is NaN if requests do not tell of all users.
    """
    to_end = requests["t_end_s"] == requests["episode"].map(duration_s)
    rows = requests[["episode", "user"]].assign(
        covered=requests["attached_s"] > 0, told=to_end & (requests["t_request_s"] == 0)
    )
    of_users = rows.groupby(["episode", "user"])[["covered", "told"]].any()
    of_users["told"] |= of_users["covered"]
    counts = of_users.groupby("episode").sum().reindex(duration_s.index, fill_value=0)
    return (100 * counts["covered"] / users).where(counts["told"] == users)


def covered_once_by_events(events: pd.DataFrame, duration_s: pd.Series, users: int) -> pd.Series:
    """Return the same as ``covered_once`` from events, which tell of all users."""
    ends = events[events["kind"].isin(("attach", "detach"))]
    signed_us = ends["t_us"].where(ends["kind"] == "detach", -ends["t_us"])
    covered = signed_us.groupby([ends["episode"], ends["user"]]).sum() > 0
    return 100 * covered.groupby("episode").sum().reindex(duration_s.index, fill_value=0) / users


class Totals:
    """Running sums of the measures of ``summary``; the added requests are not kept."""

    def __init__(self) -> None:
        self._count = 0
        self._means = {name: Mean() for name in AVERAGED}
        self._open_s = self._attached_s = 0.0
        self._counts = dict.fromkeys((*COUNTED, *OUTCOMES), 0)
        self._fairness = Fairness()
        self._tasks: Tasks | None = None
        self.delivered_mbit: float | None = None
        """The volume that was delivered; None if no service asks for a volume."""

    @property
    def tasks_done(self) -> int | None:
        """How many tasks were completed; None if no service has tasks."""
        return None if self._tasks is None else self._tasks.done

    def add(self, requests: pd.DataFrame) -> Totals:
        """Add requests; itself."""
        if "late" in requests:
            self._tasks = (self._tasks or Tasks()).add(requests)
        if "delivered_mbit" in requests:
            before_mbit = self.delivered_mbit or 0.0
            self.delivered_mbit = before_mbit + float(requests["delivered_mbit"].sum())
        column = {name: requests[name].to_numpy() for name in SUMMED}
        self._count += len(requests)
        for name, (source, factor) in AVERAGED.items():
            self._means[name].add(column[source] if factor == 1 else factor * column[source])
        self._open_s += float((column["t_end_s"] - column["t_request_s"]).sum())
        self._attached_s += float(column["attached_s"].sum())
        for name in COUNTED:
            self._counts[name] += int(column[name].sum())
        for outcome in OUTCOMES:
            self._counts[outcome] += int((column["outcome"] == outcome).sum())
        self._fairness.add(requests)
        return self

    def summary(self) -> dict[str, Any]:
        """Return the measures of all added requests, as the function ``summary`` does."""
        open_s, attached_s = self._open_s, self._attached_s
        means = {name: mean.value() for name, mean in self._means.items()}
        # Times in seconds are rounded, so that their differences may be a little too short.
        active = min(float(100 * attached_s / open_s), 100.0) if open_s > 0 else None
        return {
            "requests": self._count,
            "qoe1_percent": means["qoe1_percent"],
            "qoe1_feasible_percent": means["qoe1_feasible_percent"],
            "qoe2_iterations": means["qoe2_iterations"],
            "qoe3_active_percent": active,
            "wait_s": means["wait_s"],
            "completion_s": means["completion_s"],
            **{name: self._counts[name] for name in COUNTED},
            "fairness": self._fairness.value(),
            "worst_tenth_qoe1_percent": self._fairness.worst_tenth_percent(),
            **{outcome: self._counts[outcome] for outcome in OUTCOMES},
            **(self._tasks.summary() if self._tasks else {}),
        }


class Tasks:
    """Running measures of requests that are tasks, for ``Totals``; their delays are kept."""

    def __init__(self) -> None:
        self._delays: list[NDArray[np.float64]] = []
        self._parts = {name: Mean() for name in PARTS}
        self._met = self._late = self._dropped = self._restarts = 0
        self.done = 0
        self._user_j: float | None = None
        self._done_by_users_with_own = 0

    def add(self, requests: pd.DataFrame) -> Tasks:
        """Add requests; itself."""
        done = requests[requests["outcome"] == "completed"]
        self.done += int((done["gigacycles"] > 0.0).sum())
        self._delays.append(done["completion_s"].to_numpy())
        for name, mean in self._parts.items():
            mean.add(done[name].to_numpy())
        late = requests["late"].dropna()
        self._late += int(late.sum())
        self._met += int((~late).sum())
        self._dropped += int((requests["outcome"] == LATE).sum())
        self._restarts += int(requests["restarts"].sum())
        if "user_j" in requests:
            self._user_j = (self._user_j or 0.0) + float(requests["user_j"].sum())
            own = (done["gigacycles"] > 0.0) & done["user_j"].notna()
            self._done_by_users_with_own += int(own.sum())
        return self

    def summary(self) -> dict[str, Any]:
        """Return the measures of all added requests."""
        delays_s, decided = np.concatenate(self._delays), self._met + self._late
        return {
            "completion_p95_s": float(np.percentile(delays_s, 95)) if len(delays_s) else None,
            **{name: mean.value() for name, mean in self._parts.items()},
            "deadlines_met_percent": 100 * self._met / decided if decided else None,
            "restarts": self._restarts,
            LATE: self._dropped,
            **({} if self._user_j is None else {"user_j_per_task": self._user_j_per_task()}),
        }

    def _user_j_per_task(self) -> float | None:
        """Return what users used over the tasks completed, both of users with a processor."""
        done = self._done_by_users_with_own
        return self._user_j / done if self._user_j is not None and done else None


class Groups:
    """``Totals`` of each group of requests; ``by`` is one of ``GROUPS``."""

    def __init__(self, by: str) -> None:
        self.by = by
        self.totals: defaultdict[Any, Totals] = defaultdict(Totals)

    def add(self, requests: pd.DataFrame) -> Groups:
        """Add requests; itself. Raises UsageError if their users are in no groups."""
        if self.by not in requests:
            raise UsageError(f"by: {self.by}: the users of this run are not a list of groups")
        for value, group in requests.groupby(self.by, sort=True):
            self.totals[GROUPS[self.by](value)].add(group)
        return self

    def summaries(self) -> list[dict[str, Any]]:
        """Return the measures of each group, as ``grouped`` does."""
        return [{self.by: value} | self.totals[value].summary() for value in sorted(self.totals)]


class Fairness:
    """A running computation of Jain's index (see ``fairness``)."""

    def __init__(self) -> None:
        self._of_users: dict[int, tuple[float, int]] = {}

    def add(self, requests: pd.DataFrame) -> Fairness:
        """Add requests; itself."""
        users, of_request = np.unique(requests["user"].to_numpy(), return_inverse=True)
        sums = np.bincount(of_request, requests["qoe1"].to_numpy(), len(users))
        counts = np.bincount(of_request, minlength=len(users))
        for one, total, count in zip(users.tolist(), sums.tolist(), counts.tolist(), strict=True):
            before, requests_before = self._of_users.get(one, (0.0, 0))
            self._of_users[one] = before + total, requests_before + count
        return self

    def of_each_user(self) -> NDArray[np.float64]:
        """The mean QoE1 of each user that asked, by user."""
        return np.array([total / count for _, (total, count) in sorted(self._of_users.items())])

    def value(self) -> float | None:
        """Return the index, or None if no user was served."""
        of_users = self.of_each_user()
        squares = float((of_users**2).sum())
        return float(of_users.sum() ** 2 / (len(of_users) * squares)) if squares > 0 else None

    def worst_tenth_percent(self) -> float | None:
        """Return the mean QoE1 of the tenth of users with the lowest, at least of one."""
        of_users = np.sort(self.of_each_user())
        worst = of_users[: math.ceil(WORST_SHARE * len(of_users))]
        return float(100.0 * worst.mean()) if len(worst) else None


class Mean:
    """A running mean of values, of which NaN is left out."""

    def __init__(self) -> None:
        self._total, self._count = 0.0, 0

    def add(self, values: NDArray[np.float64]) -> None:
        """Add values."""
        there = values[~np.isnan(values)]
        self._total += float(there.sum())
        self._count += len(there)

    def value(self) -> float | None:
        """Return the mean, or None if there are no values."""
        return self._total / self._count if self._count else None


def _between(start_s: pd.Series, end_s: pd.Series | float) -> pd.Series:
    """Return the time between in whole microseconds, as all times are."""
    return (end_s - start_s).round(6)
