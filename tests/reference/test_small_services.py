"""Small worlds with processors and sensors of the fixed-step simulator, worked by hand.

A class carries 1 bit/s/Hz over 1 MHz, and a drone hovers over users who stand still. Everything
happens at multiples of dt, where the simulator is exact.
"""

from __future__ import annotations

from typing import Any

import pytest

from tests.reference.inputs import US, Processor, Request, Result, Sensing
from tests.reference.test_small_worlds import STILL, fly, radio

HERE = (50.0, 50.0, *STILL)
"""A user below the drone."""
GHZ = 1_000_000
"""The clock of a GHz, in thousandths of a cycle per microsecond."""


def task(mbit: float, gigacycles: float, at_s: float, result: float = 0.0, **terms: Any) -> Request:
    """A task."""
    computed = Request(0, 0, 0, cycles=round(gigacycles * 1e12))
    down = (Request(0, 0, 0, round(result * 1e12)),) if result else ()
    sent = round(mbit * 1e12)
    return Request(round(at_s * US), 0, 0, sent, (computed, *down), **terms)


def computed(asks: dict[int, list[Request]], processor: Processor, **changes: Any) -> Result:
    """Let the drone's processor compute tasks; the band is shared equally."""
    links = [radio((0.0, 1.0), sharing="equal")]
    return fly(links, [(0, 0)], [HERE] * 2, asks, processors=[processor], **changes)


def ends(result: Result) -> list[tuple[int, float]]:
    """The users whose requests were completed, and when."""
    return [(one.user, one.t_end_us / US) for one in result.requests if one.completed]


def test_a_task_is_sent_computed_and_sent_back() -> None:
    result = computed({0: [task(2, 3, 1, result=1)]}, Processor(1, GHZ))
    assert ends(result) == [(0, 1 + 2 + 3 + 1)]
    assert result.requests[0].computing_us == 3 * US
    assert result.requests[0].share == 1.0
    assert result.requests[0].served_us == 6 * US


@pytest.mark.parametrize(
    ("sharing", "both"),
    [
        ("first_come", [(0, 5.0), (1, 7.0)]),
        ("processor_sharing", [(0, 7.0), (1, 7.0)]),
        ("earliest_deadline", [(1, 5.0), (0, 7.0)]),
    ],
)
def test_disciplines_of_processors(sharing: str, both: list[tuple[int, float]]) -> None:
    """One arrives at 1 s and needs 4 s; the other one arrives at 3 s and needs 2 s."""
    asks = {
        0: [task(1, 4, 0, deadline_us=60 * US)],
        1: [task(0.5, 2, 2.5, deadline_us=20 * US)],
    }
    assert ends(computed(asks, Processor(1, GHZ, sharing))) == both


def test_late_tasks_are_dropped_unless_they_have_begun() -> None:
    for rule, late in (("count", 0), ("drop", 2), ("leave", 1)):
        asks = {
            user: [task(1, 10, 0.5 * user, deadline_us=5 * US, on_deadline=rule)] for user in (0, 1)
        }
        result = computed(asks, Processor(1, GHZ))
        assert result.late == late
        assert len(ends(result)) == 2 - late


@pytest.mark.parametrize(
    ("offloading", "end_s", "own_s"),
    [("always", 3.0, 0.0), ("never", 4.0, 4.0), ("shortest", 3.0, 0.0), ("split", 12 / 7, 12 / 7)],
)
def test_offloading(offloading: str, end_s: float, own_s: float) -> None:
    """All of it takes 1 + 2 s at the drone and 4 s at the user: 4/7 of it are offloaded."""
    changes = {"clocks": [GHZ // 2, 0], "offloading": offloading}
    asks = {0: [task(1, 2, 1)]}
    result = computed(asks, Processor(1, GHZ), dt_s=0.03125, **changes)
    assert ends(result)[0][1] == pytest.approx(1 + end_s, abs=0.0626)
    assert result.requests[0].own_us / US == pytest.approx(own_s, abs=0.0626)


def test_users_are_attached_before_they_ask_at_the_start() -> None:
    """A task of time 0 is offloaded, as its user is covered: nobody knows of a drone otherwise."""
    changes = {"clocks": [GHZ // 2, 0], "offloading": "shortest"}
    result = computed({0: [task(1, 2, 0)]}, Processor(1, GHZ), **changes)
    assert (ends(result)[0][1], result.requests[0].own_us) == (3.0, 0)


def sensed(rule: Sensing, updates_s: list[float], mbit: float = 4) -> Result:
    """One sensor, which needs 4 s for an update."""
    links = [radio((0.0, 1.0), sharing="equal")]
    asks = {0: [Request(round(at_s * US), 0, 0, round(mbit * 1e12)) for at_s in updates_s]}
    return fly(links, [(0, 0)], [HERE], asks, steps=1, sensors=[rule])


@pytest.mark.parametrize(
    ("keeps", "preempt", "delivered_s", "dropped"),
    [
        ("newest", False, [5, 9, 13], 1),
        ("oldest", False, [5, 9, 13], 1),
        ("last", False, [5, 9], 2),
        ("last", True, [8], 3),
    ],
)
def test_buffers(keeps: str, preempt: bool, delivered_s: list[float], dropped: int) -> None:
    """Updates come at 1, 2, 3 and 4 s, and a buffer has room for three."""
    result = sensed(Sensing(3, keeps, preempt), [1, 2, 3, 4])
    assert [t_us / US for *_, t_us in result.delivered] == delivered_s
    assert result.dropped == dropped


@pytest.mark.parametrize(
    ("keeps", "fresh_s", "dropped"),
    [("newest", [1, 4, 3], 1), ("oldest", [1, 3, 2], 1), ("last", [1, 4], 2)],
)
def test_the_last_update_is_sent_first(keeps: str, fresh_s: list[float], dropped: int) -> None:
    """Of the updates at 1, 2, 3 and 4 s, those that wait at 5 s are sent in the reverse order."""
    result = sensed(Sensing(3, keeps, sends_last=True), [1, 2, 3, 4])
    assert [t_us / US for *_, t_us in result.delivered] == [5 + 4 * k for k in range(len(fresh_s))]
    assert result.dropped == dropped
    last_s = max(fresh_s)
    area = 5 * 5 / 2 + (4 + 8) / 2 * 4 + (9 - last_s + 60 - last_s) / 2 * 51
    assert result.ages_us[0] / US == pytest.approx(area / 60)


def test_a_new_update_replaces_those_of_all_sensors() -> None:
    """Sensor 0 sends for 1 s when sensor 1 takes an update; a phone is no sensor."""
    links = [radio((0.0, 1.0), sharing="equal")]
    asks = {user: [Request(round((1 + user) * US), 0, 0, round(4e12))] for user in (0, 1)}
    asks[2] = [Request(round(20 * US), 0, 0, round(4e12))]
    rule = Sensing(3, "last", True, preempts_all=True)
    result = fly(links, [(0, 0)], [HERE] * 3, asks, steps=1, sensors=[rule, rule, None])
    assert [t_us / US for *_, t_us in result.delivered] == [6]
    assert (result.dropped, dict(ends(result))) == (1, {1: 6, 2: 24})


def test_the_age_is_a_sum_of_trapezoids() -> None:
    """It falls from 5 to 4 s at 5 s, and from 19 - 1 = 18 to 4 s at 19 s."""
    result = sensed(Sensing(3, "newest"), [1, 15])
    area = 5 * 5 / 2 + (4 + 18) / 2 * 14 + (4 + 45) / 2 * 41
    assert result.ages_us[0] / US == pytest.approx(area / 60)


def test_what_is_carried_to_the_ground_is_not_delivered_in_the_air() -> None:
    result = sensed(Sensing(3, "newest", at_ground=True), [1, 15])
    assert result.delivered == []
    assert result.ages_us[0] / US == pytest.approx(30.0)
