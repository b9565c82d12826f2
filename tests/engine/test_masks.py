"""What a drone may be told, and what becomes of what it may not."""

from __future__ import annotations

import pytest

from desim_uav.model.rules import Action
from tests.engine.helpers import Flight, events, path_of, returning, seen, strip

pytestmark = pytest.mark.usefixtures("every_engine")


def test_a_command_that_is_masked_or_unknown_becomes_hover():
    world = strip(steps=5, battery={"autonomy_min": 30, "return_below": 0.2})
    flight = Flight(world)
    log = flight.episode(path_of(world), "goto charge 99 -1 right")
    assert [step.action for step in log.steps] == [
        Action.GOTO_CHARGING_STATION, Action.CHARGE, None, None, Action.RIGHT,
    ]  # fmt: skip
    assert [step.action_taken for step in log.steps] == [Action.HOVER] * 4 + [Action.RIGHT]
    for shown in flight.shown:
        assert shown.masks[0] == (True,) * 5 + (False, False)


@pytest.mark.parametrize(
    ("autonomy_min", "return_below", "epoch"),
    [(30, 0.2, 24), (10, 0.5, 5), (100, 0.7, 30), (50, 0.58, 21), (20, 0.35, 13)],
)
def test_a_return_is_allowed_at_the_limit_and_below(
    autonomy_min: float, return_below: float, epoch: int
):
    # At this decision epoch the battery holds exactly that part of its capacity.
    world = strip(
        steps=epoch + 1, battery={"autonomy_min": autonomy_min, "return_below": return_below}
    )
    flight = Flight(world)
    flight.episode(path_of(world))
    goto = world.actions.index(Action.GOTO_CHARGING_STATION)
    assert [shown.masks[0][goto] for shown in flight.shown[:-1]] == [False] * epoch + [True]


def test_charge_is_allowed_on_a_station_when_not_full():
    world = strip([(4, 0)], steps=4, battery={"autonomy_min": 30})
    flight = Flight(world)
    flight.episode(path_of(world), "charge right left hover")
    charge = world.actions.index(Action.CHARGE)
    assert [shown.masks[0][charge] for shown in flight.shown] == [False, True, False, True, True]


def test_masks_go_by_where_a_drone_is():
    # On the station but thinking it is elsewhere, and the other way round.
    world = returning(starts=[(4, 0), (3, 0)], steps=2)
    flight = Flight(world)
    error = [[(0, 0), (-1, 0)], [(0, 0), (1, 0)]]
    log = flight.episode(path_of(world, error=error), "hover charge", "hover charge")
    charge = world.actions.index(Action.CHARGE)
    assert [mask[charge] for mask in flight.shown[1].masks] == [True, False]
    assert seen(log, "land") == events("60000000  10  land  0  -  -  0")
