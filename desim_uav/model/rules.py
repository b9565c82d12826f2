"""The terms of the model: actions, modes, the phases of one instant, outcomes, and masks."""

from __future__ import annotations

from enum import IntEnum, StrEnum
from functools import cache

US, MINUTE_US = 1_000_000, 60_000_000
"""Microseconds in a second and in a minute: an engine counts time in whole microseconds."""


class Action(IntEnum):
    """The actions of a drone at a decision epoch, in the order of the paper."""

    FORWARD = 0
    BACKWARD = 1
    RIGHT = 2
    LEFT = 3
    HOVER = 4
    UP = 5
    DOWN = 6
    GOTO_CHARGING_STATION = 7
    CHARGE = 8


MOVES: dict[Action, tuple[int, int, int]] = {
    Action.FORWARD: (0, 1, 0),
    Action.BACKWARD: (0, -1, 0),
    Action.RIGHT: (1, 0, 0),
    Action.LEFT: (-1, 0, 0),
    Action.UP: (0, 0, 1),
    Action.DOWN: (0, 0, -1),
}
"""The change of (cell x, cell y, level) that each moving action commands."""


class Mode(IntEnum):
    """The mode of a drone. Only a FLYING drone serves users."""

    FLYING = 0
    RETURNING = 1
    QUEUED = 2
    CHARGING = 3
    CHARGED = 4
    CRASHED = 5


class Phase(IntEnum):
    """The order of events of one instant; within a phase, by drone and then by user."""

    COMPLETION = 1
    EXIT = 2
    ARRIVAL = 3
    ENTRY = 4
    REQUEST = 5
    DEPLETION = 6
    ATTACHMENT = 7
    RECORD = 8
    RESPAWN = 9
    COMMAND = 10
    COVERAGE = 11
    ADMISSION = 12
    SEPARATION = 13


class Outcome(StrEnum):
    """How a request ended."""

    COMPLETED = "completed"
    UNFINISHED = "unfinished"
    NEVER_SERVED = "never_served"


AIRBORNE = frozenset({Mode.FLYING, Mode.RETURNING})

DECIDES = frozenset({Mode.FLYING, Mode.CHARGED})
"""The modes in which a drone has a choice. In any other mode its mask allows one action only."""


@cache
def actions(three_d: bool, limited_battery: bool) -> tuple[Action, ...]:
    """Return the 5, 7 or 9 actions of a scenario. A command is an index into this tuple."""
    chosen = [Action.FORWARD, Action.BACKWARD, Action.RIGHT, Action.LEFT, Action.HOVER]
    if three_d:
        chosen += [Action.UP, Action.DOWN]
    if limited_battery:
        chosen += [Action.GOTO_CHARGING_STATION, Action.CHARGE]
    return tuple(chosen)
