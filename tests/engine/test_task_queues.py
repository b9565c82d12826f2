"""Processors against the queues of textbooks (``tests/verification/tasks.py``)."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from tests.selection import at_length
from tests.verification import tasks
from tests.verification.figure import check
from tests.verification.tasks import Job, any_order, in_time, jobs_of


def test_formulas_have_the_known_values() -> None:
    check(tasks.printed())
    assert tasks.EXPONENTIAL.mean() == pytest.approx(1.0, abs=1e-12)
    assert (tasks.EXPONENTIAL**2).mean() == pytest.approx(1.99892, abs=1e-5)


def test_all_ways_are_tried() -> None:
    """The second task has to interrupt the first; if both took a second more, one were late."""
    jobs = (Job(0, 3, 5), Job(1, 2, 3))
    assert any_order(jobs) and in_time(jobs)
    late = (Job(0, 4, 5), Job(1, 2, 3))
    assert not any_order(late) and not in_time(late)
    for seed in range(20):
        jobs = jobs_of(seed)
        assert any_order(jobs) >= any(_one_by_one(order) for order in permutations(jobs))


def _one_by_one(jobs: tuple[Job, ...]) -> bool:
    """Whether all are in time if each is done as a whole, in this order."""
    ends = np.zeros(1)
    for job in jobs:
        ends = np.append(ends, max(ends[-1], job.from_s) + job.takes_s)
    return all(end <= job.until_s for end, job in zip(ends[1:], jobs, strict=True))


@pytest.mark.parametrize("sets", at_length(30, 1000))
def test_earliest_deadline_is_in_time_if_any_order_is(sets: int) -> None:
    check([tasks.earliest_deadline(sets)])


@pytest.mark.thorough
def test_earliest_deadline_is_so_in_the_compiled_engine() -> None:
    check([tasks.earliest_deadline(200, "batch")])


@pytest.mark.thorough
@pytest.mark.parametrize(
    "part", ["engines_are_equal", "first_come", "shared", "tandem", "waits", "deadlines"]
)
def test_queues(part: str) -> None:
    arguments = {"engines_are_equal": (), "tandem": (10, True), "shared": (10, (0.5,))}.get(
        part, (10,)
    )
    check(getattr(tasks, part)(*arguments))
