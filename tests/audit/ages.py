"""Ages recomputed from the table of updates alone, and compared with all that is said of them.

Nothing that computes here is shared with the simulator. Times are whole microseconds; sums of areas
are whole numbers of half square microseconds, so means are exact but for one division.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from typing import Any

import pandas as pd

from desim_uav.engine.base import EpisodeLog
from desim_uav.experiment import tables
from desim_uav.scenario.load import to_plain
from desim_uav.world import World

US = 1_000_000
DELIVERED, DROPPED, LOST, BUFFERED, STORED = "delivered", "dropped", "lost", "buffered", "stored"
UNSENT = {"unfinished", "never_served"}
FATES = (DELIVERED, DROPPED, LOST, BUFFERED, STORED)


@dataclass(frozen=True)
class Update:
    """A row of the table, with times in microseconds; None where something has not happened."""

    number: int
    generated: int
    sent: int | None
    received: int | None
    delivered: int | None
    ended: int
    fate: str
    before: int | None
    after: int | None
    drone: int


@dataclass
class Course:
    """The age of one sensor from 0 to ``until``, delivery by delivery."""

    until: int
    freshest: int = 0
    now: int = 0
    twice_area: int = 0
    above: int = 0
    peaks: list[int] = field(default_factory=list)

    @property
    def age(self) -> int:
        """The age now."""
        return self.now - self.freshest

    def wait(self, until: int, limit: int | None = None) -> None:
        """Let the age rise as fast as time."""
        first, last = self.age, until - self.freshest
        assert until >= self.now and first >= 0, "an age is negative, or time runs backwards"
        self.twice_area += (first + last) * (until - self.now)
        if limit is not None:
            self.above += max(0, last - max(first, limit))
        self.now = until

    def deliver(self, updates: Sequence[Update]) -> None:
        """Let the age fall once if one of these updates is fresher than all before."""
        assert {one.before for one in updates} == {self.age}, f"age before update {updates}"
        freshest = max(one.generated for one in updates)
        if freshest > self.freshest:
            self.peaks.append(self.age)
            self.freshest = freshest
        assert {one.after for one in updates} == {self.age}, f"age after update {updates}"
        assert self.age >= 0, f"a negative age after update {updates}"


def audit_updates(
    updates: pd.DataFrame,
    sensors: pd.DataFrame,
    episodes: pd.DataFrame,
    services: Mapping[str, Mapping[str, Any]],
    requests: pd.DataFrame | None = None,
) -> None:
    """Check the tables of a run against each other. Raises AssertionError.

    ``services`` are the keys of each service of the kind ``collect`` in the scenario.
    """
    for episode in episodes.to_dict("records"):
        number = episode["episode"]
        own = updates[updates["episode"] == number]
        _numbers(own)
        rows = sensors[sensors["episode"] == number].to_dict("records")
        assert set(own["user"]) <= {row["user"] for row in rows}, "updates of no sensor"
        until = us(episode["duration_s"])
        refused = _refused(own, requests)
        courses = {}
        for row in rows:
            mine = [_update(one) for one in own[own["user"] == row["user"]].to_dict("records")]
            keys = services[row["service"]]
            assert set(own[own["user"] == row["user"]]["service"]) <= {row["service"]}
            _times(mine, until)
            if keys.get("preempt") == "all":
                _replaced(mine, own)
            else:
                _buffer([one for one in mine if one.number not in refused], keys)
            courses[row["user"]] = _sensor(mine, row, keys, until)
        _episode(episode, rows, courses, own)
        if requests is not None:
            _requests(own, requests[requests["episode"] == number], services)


def audit_logs(logs: Sequence[EpisodeLog], world: World) -> None:
    """Check all that logs say of sensors, by the tables that are made of them."""
    requests = tables.requests_table(logs, world)
    episodes = tables.episodes_table(logs, world, requests)
    sensors, updates = tables.sensors_table(logs, world), tables.updates_table(logs, world)
    keys = to_plain(world.scenario)["services"]
    audit_updates(updates, sensors, episodes, keys, requests)


def _refused(own: pd.DataFrame, requests: pd.DataFrame | None) -> set[int]:
    """Updates that were dropped because a drone has refused their requests."""
    if requests is None:
        return set()
    both = own[own["fate"] == DROPPED].merge(requests, on=["episode", "request_id"])
    return set(both[both["outcome"].isin(UNSENT)]["update"])


def us(time_s: float) -> int:
    """Return a time in microseconds, of which it is a whole number."""
    return round(time_s * US)


def near(ours: float, theirs: float) -> bool:
    """Return whether two numbers are equal but for rounding."""
    return math.isclose(ours, theirs, rel_tol=1e-12, abs_tol=1e-9)


def _maybe(time_s: float) -> int | None:
    return None if pd.isna(time_s) else us(time_s)


def _update(row: Mapping[str, Any]) -> Update:
    times = ("t_sent_s", "t_received_s", "t_delivered_s")
    sent, received, delivered = (_maybe(row[name]) for name in times)
    before, after = _maybe(row["age_before_s"]), _maybe(row["age_after_s"])
    generated, ended = us(row["t_generated_s"]), us(row["t_end_s"])
    number, fate = row["update"], row["fate"]
    drone = -1 if pd.isna(row["drone"]) else int(row["drone"])
    return Update(number, generated, sent, received, delivered, ended, fate, before, after, drone)


def _numbers(own: pd.DataFrame) -> None:
    """Updates are numbered from 0 on as they are generated, those of the lowest user first."""
    assert list(own["update"]) == list(range(len(own))), "numbers of updates"
    order = list(zip(own["t_generated_s"], own["user"], strict=True))
    assert order == sorted(order), "order of updates"
    assert set(own["fate"]) <= set(FATES), "an unknown fate"


def _times(mine: list[Update], until: int) -> None:
    """What happens to an update happens in order, and its fate is that of its last time."""
    for one in mine:
        passed = [t for t in (one.sent, one.received, one.delivered) if t is not None]
        times = [one.generated, *passed, one.ended]
        assert times == sorted(times) and times[0] >= 0 and times[-1] <= until, one
        assert one.sent is not None or one.received is None, f"received unsent: {one}"
        assert one.received is not None or one.delivered is None, f"not received: {one}"
        assert (one.fate == DELIVERED) == (one.delivered is not None), one
        assert (one.before is None) == (one.after is None) == (one.delivered is None), one
        if one.fate == DELIVERED:
            assert one.ended == one.delivered, one
        elif one.fate in (LOST, STORED):
            assert one.received is not None, one
        else:
            assert one.received is None, one
        assert one.ended == until or one.fate in (DELIVERED, DROPPED, LOST), one


def _buffer(mine: list[Update], keys: Mapping[str, Any]) -> None:
    """Updates wait in their order, never too many; one is dropped only as ``keeps`` says.

    At one instant, an update may leave the buffer before or after another one comes; both are
    accepted.
    """
    keeps, room = keys.get("keeps", "newest"), keys.get("buffer", 10)
    born = [one.generated for one in mine]
    left = [one.ended if one.received is None else one.received for one in mine]
    gone, there = sorted(left), list[int]()
    received = [one.received for one in mine if one.received is not None]
    in_order = keeps == "last" or keys.get("sends", "first") == "first"
    assert not in_order or received == sorted(received), "overtaken"
    for at, one in enumerate(mine):
        there = [k for k in there if left[k] > one.generated]
        at_once = one.fate == DROPPED and one.ended == one.generated
        assert at_once or len(there) < room, f"more than {room} updates in a buffer: {one}"
        there.append(at)
        if one.fate != DROPPED:
            continue
        now, last = one.ended, bisect_right(born, one.ended) - 1
        assert last >= at and born[last] == now, f"dropped when nothing came: {one}"
        before = (at if at_once else last) - bisect_left(gone, now)
        unsent = one.sent is None or one.sent >= now
        if keeps != "last":
            assert before >= room, f"dropped with room left: {one}"
            assert unsent and (at_once or keeps == "newest"), f"another one had to go: {one}"
        else:
            assert unsent or keys.get("preempt", False), f"dropped in transmission: {one}"


def _replaced(mine: list[Update], own: pd.DataFrame) -> None:
    """An update is dropped when another one comes, of any sensor; only the last one waits."""
    born = {us(t) for t in own["t_generated_s"]}
    for one, following in pairwise(mine):
        assert (one.fate != BUFFERED and one.ended <= one.generated) or (
            (one.received or one.ended) <= following.generated
        ), f"two updates in a buffer: {one}"
    for one in mine:
        assert one.fate != DROPPED or one.ended in born, f"dropped when nothing came: {one}"


def _requests(
    own: pd.DataFrame, requests: pd.DataFrame, services: Mapping[str, Mapping[str, Any]]
) -> None:
    """An update that was the first one in a buffer is a request; times and ends are the same."""
    collected = {name for name, keys in services.items() if keys["kind"] == "collect"}
    there = requests[requests["service"].isin(collected)]
    asked = own[own["request_id"].notna()]
    both = asked.merge(there, on="request_id", suffixes=("", "_of_request"))
    assert len(both) == len(asked) == len(there), "updates and requests"
    ends = {DROPPED: {"dropped", *UNSENT}, BUFFERED: UNSENT}
    for one in both.to_dict("records"):
        what = f"update {one['update']} and its request"
        assert one["user"] == one["user_of_request"], what
        last = services[one["service"]].get("sends") == "last"
        assert one["t_generated_s"] == one["t_request_s"] or last, what
        assert one["t_generated_s"] >= one["t_request_s"], what
        _same(None if pd.isna(one["t_sent_s"]) else one["t_sent_s"], one["t_first_service_s"], what)
        assert one["outcome"] in ends.get(one["fate"], {"completed"}), what
        until = one["t_end_s"] if pd.isna(one["t_received_s"]) else one["t_received_s"]
        assert until == one["t_end_s_of_request"], what


def _sensor(
    mine: list[Update], row: Mapping[str, Any], keys: Mapping[str, Any], until: int
) -> Course:
    """Recompute what the table says of a sensor in an episode."""
    limit = None if keys.get("age_limit_s") is None else us(keys["age_limit_s"])
    course = Course(until)
    delivered = [one for one in mine if one.delivered is not None]
    grounded = keys.get("delivered") == "ground"  # a drone that lands delivers all at once

    def order(one: Update) -> tuple[int, ...]:
        return (one.ended, one.drone) if grounded else (one.ended, one.received or 0, one.number)

    delivered.sort(key=lambda one: (one.received, one.number))
    for _, together in groupby(sorted(delivered, key=order), key=order):
        updates = list(together)
        course.wait(updates[0].ended, limit)
        if len({(one.before, one.after) for one in updates}) > 1:
            course.deliver(updates[:1])  # over the backhaul, just before the drone landed
            updates = updates[1:]
        course.deliver(updates)
    course.wait(until, limit)
    counts = {fate: sum(one.fate == fate for one in mine) for fate in FATES}
    assert len(mine) == row["updates"] == sum(counts.values()), "updates are not conserved"
    for fate in (DELIVERED, DROPPED, LOST):
        assert counts[fate] == row[fate], f"{fate} updates of user {row['user']}"
    assert near(course.twice_area / 2 / until / US, row["age_s"]), f"mean age: {row}"
    assert near(course.age / US, row["age_end_s"]), f"age at the end: {row}"
    _same(_mean(course.peaks), row["peak_age_s"], f"mean peak: {row}")
    _same(None if limit is None else course.above / US, row["violation_s"], f"violation: {row}")
    return course


def _mean(times: list[int]) -> float | None:
    return sum(times) / len(times) / US if times else None


def _same(ours: float | None, theirs: Any, what: str) -> None:
    assert pd.isna(theirs) if ours is None else near(ours, theirs), what


def _episode(
    episode: Mapping[str, Any],
    rows: list[dict[str, Any]],
    courses: Mapping[int, Course],
    own: pd.DataFrame,
) -> None:
    """Recompute what the table says of all sensors of an episode."""
    means = [course.twice_area / 2 / course.until / US for course in courses.values()]
    assert near(sum(means) / len(means), episode["age_s"]), "mean age of an episode"
    assert near(max(means), episode["worst_age_s"]), "the worst sensor's age"
    peaks = [peak for course in courses.values() for peak in course.peaks]
    _same(_mean(peaks), episode["peak_age_s"], "mean peak of an episode")
    counts = {"": len(own), **{f"_{f}": int((own["fate"] == f).sum()) for f in FATES[:3]}}
    for fate, count in counts.items():
        assert episode[f"updates{fate}"] == count, f"updates{fate} of an episode"
    limited = [row["violation_s"] for row in rows if not pd.isna(row["violation_s"])]
    _same(sum(limited) if limited else None, episode["age_violation_s"], "violation of an episode")
