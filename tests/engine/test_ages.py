"""Ages: formulas, an independent queue, and the audit of the tables of updates and sensors."""

from __future__ import annotations

from typing import Any

import pandas as pd
import pytest

from tests.audit.ages import audit_updates
from tests.verification import ages
from tests.verification.age_queue import mean_age, received
from tests.verification.figure import check


def test_formulas_are_those_that_are_printed() -> None:
    check(ages.printed())


@pytest.mark.thorough
def test_another_queue_has_these_ages() -> None:
    check(ages.queues(20))


@pytest.mark.thorough
@pytest.mark.parametrize("part", ["engines_are_equal", "curves", "sources", "at_will", "visits"])
def test_the_simulator_has_these_ages(part: str) -> None:
    arguments = {"curves": (8, 1), "sources": (8,), "at_will": (8, (1.0,)), "visits": (8,)}.get(
        part, ()
    )
    check(getattr(ages, part)(*arguments))


@pytest.mark.parametrize(
    ("buffer", "expected"),
    [
        ((9.0, "newest", False), [4.0, 6.0, 9.0, 10.0]),
        ((1, "oldest", False), [4.0, None, None, 6.0]),
        ((2, "oldest", False), [4.0, 6.0, None, 7.0]),
        ((2, "newest", False), [4.0, None, 7.0, 8.0]),
        ((9, "last", False), [4.0, None, 7.0, 8.0]),
        ((9, "last", True), [None, None, 5.0, 6.0]),
        ((9.0, "newest", False, "last"), [4.0, 10.0, 7.0, 8.0]),
    ],
)
def test_a_queue_by_hand(buffer: Any, expected: list[float | None]) -> None:
    """Updates of 0, 1, 2 and 5 s need 4, 2, 3 and 1 s."""
    found = received([0.0, 1.0, 2.0, 5.0], [4.0, 2.0, 3.0, 1.0], *buffer)
    assert found == [float("inf") if one is None else one for one in expected]


def test_an_age_by_hand() -> None:
    """It rises to 4, falls to 3, rises to 5 (an older update changes nothing), and falls to 1."""
    area = 4 * 4 / 2 + (3 + 5) / 2 * 2 + (1 + 3) / 2 * 2
    assert mean_age([1.0, 0.5, 5.0], [4.0, 5.0, 6.0], 0.0, 8.0) == area / 8


# ---- the audit

SERVICES = {"reading": {"kind": "collect", "buffer": 2, "keeps": "newest", "age_limit_s": 4.0}}


def tables() -> dict[str, pd.DataFrame]:
    """A sensor with five updates in 12 s, two of which can be in its buffer.

    Update 0 takes from 1 to 4 s; its age falls from 4 to 3. Update 1 is dropped when 2 comes at
    3 s, which is delivered at 8 s: the age falls from 7 to 5. Update 3 is sent at the end, when 4
    waits. The age is 9 then, and above 4 from 5 to 12 s.
    """
    nothing = float("nan")
    names = ("generated", "sent", "received", "delivered", "end")
    rows = [
        (1.0, 1.0, 4.0, 4.0, 4.0, "delivered", 4.0, 3.0),
        (2.0, nothing, nothing, nothing, 3.0, "dropped", nothing, nothing),
        (3.0, 4.0, 8.0, 8.0, 8.0, "delivered", 7.0, 5.0),
        (9.0, 9.0, nothing, nothing, 12.0, "buffered", nothing, nothing),
        (10.0, nothing, nothing, nothing, 12.0, "buffered", nothing, nothing),
    ]
    columns = [*(f"t_{name}_s" for name in names), "fate", "age_before_s", "age_after_s"]
    updates = pd.DataFrame(rows, columns=columns).assign(
        episode=0, user=0, service="reading", drone=0
    )
    updates["update"] = range(len(updates))
    area = 4 * 4 / 2 + (3 + 7) / 2 * 4 + (5 + 9) / 2 * 4
    counts = {"updates": 5, "delivered": 2, "dropped": 1, "lost": 0}
    ages_s = {"age_s": area / 12, "peak_age_s": 5.5}
    sensor = {"episode": 0, "user": 0, "service": "reading", **counts, **ages_s}
    sensor |= {"age_end_s": 9.0, "violation_s": 3.0 + 4.0}
    episode = {"episode": 0, "duration_s": 12.0, **ages_s, "worst_age_s": area / 12}
    episode |= {"updates": 5, "age_violation_s": 7.0}
    episode |= {f"updates_{fate}": counts[fate] for fate in ("delivered", "dropped", "lost")}
    sensors, episodes = pd.DataFrame([sensor]), pd.DataFrame([episode])
    return {"updates": updates, "sensors": sensors, "episodes": episodes}


def test_the_audit_accepts_what_was_worked_by_hand() -> None:
    audit_updates(**tables(), services=SERVICES)


@pytest.mark.parametrize(
    ("table", "row", "column", "value", "what"),
    [
        ("updates", 0, "age_after_s", 2.0, "age after"),
        ("updates", 2, "age_before_s", 8.0, "age before"),
        ("updates", 2, "t_delivered_s", 7.0, "Update"),
        ("updates", 1, "fate", "delivered", "Update"),
        ("updates", 1, "t_end_s", 3.5, "nothing came"),
        ("updates", 0, "t_received_s", float("nan"), "not received"),
        ("updates", 4, "t_generated_s", 7.0, "order"),
        ("sensors", 0, "age_s", 5.0, "mean age"),
        ("sensors", 0, "peak_age_s", 5.0, "mean peak"),
        ("sensors", 0, "age_end_s", 8.0, "at the end"),
        ("sensors", 0, "violation_s", 6.0, "violation"),
        ("sensors", 0, "dropped", 2, "dropped updates"),
        ("sensors", 0, "updates", 4, "conserved"),
        ("episodes", 0, "age_s", 5.0, "mean age of an episode"),
        ("episodes", 0, "worst_age_s", 5.0, "worst"),
        ("episodes", 0, "updates_lost", 1, "updates_lost"),
        ("episodes", 0, "age_violation_s", 1.0, "violation of an episode"),
    ],
)
def test_the_audit_notices(table: str, row: int, column: str, value: Any, what: str) -> None:
    changed = tables()
    changed[table].loc[row, column] = value
    with pytest.raises(AssertionError, match=what):
        audit_updates(**changed, services=SERVICES)


def test_the_audit_knows_which_updates_a_buffer_keeps() -> None:
    for keys, what in (
        ({"buffer": 1}, "more than 1 updates"),
        ({"buffer": 3}, "dropped with room left"),
        ({"keeps": "oldest"}, "another one had to go"),
    ):
        with pytest.raises(AssertionError, match=what):
            audit_updates(**tables(), services={"reading": SERVICES["reading"] | keys})
