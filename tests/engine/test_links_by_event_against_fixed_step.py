"""Links beside decisions by event against the simulator with fixed time steps.

The scenarios are those of ``test_links_against_fixed_step.py``, with interference, all kinds of
association and access points, but their drones are asked when they are free. The reference looks up
each level and each class at each tick, so that it knows neither legs nor spans. Line of sight is
always the mean one.
"""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from tests.engine.test_by_event_against_fixed_step import check_decisions
from tests.selection import by_default
from tests.verification.convergence import DTS_S, FINEST_S, case_of, sampled, slopes
from tests.verification.figure import check
from tests.verification.links import MEASURES, linked_by_event

SEEDS = range(24)
FEW_SEEDS = (0, 2, 3, 5, 10, 12)

pytestmark = pytest.mark.thorough


@pytest.mark.parametrize("seed", by_default(FEW_SEEDS, FEW_SEEDS))
def test_agrees_at_the_finest_dt(seed: int) -> None:
    """Drones decide the same at the same places, and users are handed over as often."""
    check_at(seed, FINEST_S)


def check_at(seed: int, dt_s: float) -> None:
    case, result = case_of(seed, linked_by_event), sampled(seed, dt_s, linked_by_event)
    check_decisions(case, result, dt_s)
    assert case.log.links is not None
    assert result.handovers == case.log.links.handovers


def unlike(seeds: Iterable[int], dt_s: float) -> list[int]:
    found = []
    for seed in seeds:
        try:
            check_at(seed, dt_s)
        except AssertionError:
            found.append(seed)
    return found


@pytest.mark.slow
def test_agrees_in_all_but_one_scenario_with_shorter_steps() -> None:
    """A user who comes or goes within ``dt`` of a decision is counted by one of the two only.

    So is a handover if one drone loses a user and another one reaches it within ``dt``. In scenario
    18, drones 0 and 1 replace crashed ones at the same station at the same time. Their levels are
    equal at this instant, and drone 0 flies away: users are attached to drone 0 for one tick in the
    reference, and to drone 1 at once by the engines, which count one handover instead of two.
    """
    coarse = unlike(SEEDS, FINEST_S)
    assert len(coarse) <= 4, coarse
    assert unlike(coarse, FINEST_S / 4.0) in ([], [18])


@pytest.mark.slow
def test_converges_with_slope_one() -> None:
    check(slopes(SEEDS, 0.35, DTS_S, linked_by_event, MEASURES))


def test_converges_in_a_few_scenarios() -> None:
    check(slopes(range(12), 0.4, DTS_S[:3], linked_by_event, ("qoe3",)))


@pytest.mark.slow
def test_the_scenarios_have_everything_in_them() -> None:
    scenarios = [case_of(seed, linked_by_event).world.scenario for seed in SEEDS]
    assert {one.fleet[0].radio.reuse for one in scenarios} == {0, 1, 2}
    associations = {type(one.association).__name__ for one in scenarios}
    assert associations == {"EnteredFirst", "Strongest", "A3"}
    assert {len(one.access_points) for one in scenarios} == {0, 1, 2}
