"""Actions, masks and what a command leads to."""

import itertools

import pytest

from desim_uav.model.rules import (
    AIRBORNE,
    MOVES,
    Action,
    Mode,
    Outcome,
    Phase,
    actions,
)
from desim_uav.rowcode.rows import Table, blank, fill
from desim_uav.rules.decide import taken
from desim_uav.rules.rows import Constants, Drone, Move, State
from tests.masks import mask

GOTO, CHARGE, HOVER = Action.GOTO_CHARGING_STATION, Action.CHARGE, Action.HOVER
FLAT = ("FORWARD", "BACKWARD", "RIGHT", "LEFT", "HOVER")
TALL = (*FLAT, "UP", "DOWN")
RETURN = ("GOTO_CHARGING_STATION", "CHARGE")
WITH_BATTERY = {Mode.RETURNING, Mode.QUEUED, Mode.CHARGING, Mode.CHARGED}
EVERY = [
    (three_d, battery, mode, may_return, may_charge)
    for three_d, battery, mode, may_return, may_charge in itertools.product(
        [False, True], [False, True], Mode, [False, True], [False, True]
    )
    if battery or mode not in WITH_BATTERY
]


def obeyed(command, marks, allowed):
    """The action that a drone's row says it takes."""
    world, state, drone = blank(Constants), blank(State), blank(Drone)
    world.moves = Table(fill(Move, (int(action), 0, 0, 0, 0, 1.0)) for action in allowed)
    state.masks, drone.command = Table(map(int, marks)), command if command < len(marks) else -1
    return allowed[taken(world, state, drone)]


def legal(mode, *, three_d=True, battery=True, may_return=False, may_charge=False):
    """The names of what a drone may be told."""
    allowed = actions(three_d, battery)
    marks = mask(allowed, mode, may_return, may_charge)
    assert len(marks) == len(allowed)
    return {action.name for action, mark in zip(allowed, marks, strict=True) if mark}


class TestActions:
    @pytest.mark.parametrize(
        ("three_d", "battery", "names"),
        [
            (False, False, FLAT),
            (True, False, TALL),
            (False, True, FLAT + RETURN),
            (True, True, TALL + RETURN),
        ],
    )
    def test_in_the_order_of_the_paper(self, three_d, battery, names):
        assert tuple(action.name for action in actions(three_d, battery)) == names

    def test_forward_is_north_and_right_is_east(self):
        assert MOVES[Action.FORWARD] == (0, 1, 0)
        assert MOVES[Action.RIGHT] == (1, 0, 0)
        assert MOVES[Action.UP] == (0, 0, 1)
        for there, back in [
            (Action.FORWARD, Action.BACKWARD),
            (Action.RIGHT, Action.LEFT),
            (Action.UP, Action.DOWN),
        ]:
            assert MOVES[there] == tuple(-step for step in MOVES[back])
        assert len(MOVES) == 6


class TestMask:
    @pytest.mark.parametrize(
        ("mode", "names"),
        [
            (Mode.FLYING, set(TALL)),
            (Mode.RETURNING, {"GOTO_CHARGING_STATION"}),
            (Mode.QUEUED, {"CHARGE"}),
            (Mode.CHARGING, {"CHARGE"}),
            (Mode.CHARGED, set(TALL)),
            (Mode.CRASHED, {"HOVER"}),
        ],
    )
    def test_by_mode(self, mode, names):
        assert legal(mode) == names

    @pytest.mark.parametrize("mode", [Mode.RETURNING, Mode.QUEUED, Mode.CHARGING, Mode.CRASHED])
    def test_a_drone_that_cannot_choose_is_told_one_thing_only(self, mode):
        for may_return, may_charge in itertools.product([False, True], repeat=2):
            assert legal(mode, may_return=may_return, may_charge=may_charge) == legal(mode)
            assert len(legal(mode)) == 1

    def test_returning_and_charging_are_for_those_who_may(self):
        assert legal(Mode.FLYING, may_return=True) == {*TALL, "GOTO_CHARGING_STATION"}
        assert legal(Mode.FLYING, may_charge=True) == {*TALL, "CHARGE"}
        assert legal(Mode.FLYING, may_return=True, may_charge=True) == {*TALL, *RETURN}
        both = {"may_return": True, "may_charge": True}
        assert legal(Mode.FLYING, three_d=False, **both) == {*FLAT, *RETURN}
        assert legal(Mode.FLYING, battery=False, **both) == set(TALL)

    @pytest.mark.parametrize(("three_d", "battery", "mode", "may_return", "may_charge"), EVERY)
    def test_never_all_false(self, three_d, battery, mode, may_return, may_charge):
        assert any(mask(actions(three_d, battery), mode, may_return, may_charge))


class TestObeyed:
    @pytest.mark.parametrize(("three_d", "battery", "mode", "may_return", "may_charge"), EVERY)
    def test_a_legal_command_is_obeyed_and_another_is_no_error(
        self, three_d, battery, mode, may_return, may_charge
    ):
        allowed = actions(three_d, battery)
        marks = mask(allowed, mode, may_return, may_charge)
        only = {Mode.RETURNING: GOTO, Mode.QUEUED: CHARGE, Mode.CHARGING: CHARGE}.get(mode, HOVER)
        for command, action in enumerate(allowed):
            assert obeyed(command, marks, allowed) is (action if marks[command] else only)

    @pytest.mark.parametrize("command", [-1, -5, 9, 1000])
    def test_a_command_that_is_none(self, command):
        allowed = actions(True, True)
        flying = mask(allowed, Mode.FLYING, True, True)
        assert obeyed(command, flying, allowed) is HOVER
        returning = mask(allowed, Mode.RETURNING, True, True)
        assert obeyed(command, returning, allowed) is GOTO


def test_the_order_of_one_instant():
    assert [phase.name for phase in Phase] == [
        "COMPLETION",
        "EXIT",
        "ARRIVAL",
        "ENTRY",
        "REQUEST",
        "DEPLETION",
        "ATTACHMENT",
        "RECORD",
        "RESPAWN",
        "COMMAND",
        "COVERAGE",
        "ADMISSION",
        "SEPARATION",
    ]
    assert sorted(Phase) == list(Phase)


def test_who_is_in_the_air():
    assert {Mode.FLYING, Mode.RETURNING} == AIRBORNE


def test_how_requests_end():
    ends = ["completed", "unfinished", "never_served", "late", "dropped"]
    assert [str(outcome) for outcome in Outcome] == ends
