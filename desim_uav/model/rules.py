"""The terms of the model: actions, modes, the phases of one instant, outcomes, and masks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from functools import cache

US, MINUTE_US = 1_000_000, 60_000_000
"""Microseconds in a second and in a minute: an engine counts time in whole microseconds."""

NEVER = 2**62
"""A time after all others, in microseconds, for what does not happen."""


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
    FLY = 9
    """A free flight, whose direction and length the command gives (``motion: {space: free}``)."""


MOVES: dict[Action, tuple[int, int, int]] = {
    Action.FORWARD: (0, 1, 0),
    Action.BACKWARD: (0, -1, 0),
    Action.RIGHT: (1, 0, 0),
    Action.LEFT: (-1, 0, 0),
    Action.UP: (0, 0, 1),
    Action.DOWN: (0, 0, -1),
}
"""The change of (cell x, cell y, level) that each moving action commands."""


@dataclass(frozen=True)
class AtSpeed:
    """A moving action at one of several cruise speeds (``drones.motion.cruise``)."""

    action: Action
    cruise_mps: float

    @property
    def name(self) -> str:
        """The name of the action and the speed in m/s, such as ``RIGHT@8.3``."""
        return f"{self.action.name}@{repr(float(self.cruise_mps)).removesuffix('.0')}"

    def __int__(self) -> int:
        """Return the number of the action, which is the same at all speeds."""
        return int(self.action)


Choice = Action | AtSpeed
"""What a drone can be commanded: an action, or a moving action at a cruise speed."""


def kind_of(choice: Choice) -> Action:
    """Return the action of a choice, at whatever speed."""
    return choice.action if isinstance(choice, AtSpeed) else choice


def move_of(choice: Choice) -> tuple[int, int, int]:
    """Return the change of (cell x, cell y, level) that a choice commands, which may be none."""
    return MOVES.get(kind_of(choice), (0, 0, 0))


def fastest_of(choices: Sequence[Choice]) -> dict[Action, int]:
    """Return the number of each action among choices, at the highest speed if there are several."""
    return {kind_of(choice): number for number, choice in enumerate(choices)}


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
    LATE = "late"
    DROPPED = "dropped"


# Each mode is in AIRBORNE or in GROUNDED, unless the drone has crashed, and may be in the others.

AIRBORNE = frozenset({Mode.FLYING, Mode.RETURNING})
"""The modes in which a drone is in the air, where its battery is drained."""

GROUNDED = frozenset({Mode.QUEUED, Mode.CHARGING, Mode.CHARGED})
"""The modes in which a drone has landed on a charging station."""

IN_QUEUE = frozenset({Mode.QUEUED, Mode.CHARGING})
"""The modes in which a drone is in the queue of its station, for a pad or on one."""

DECIDES = frozenset({Mode.FLYING, Mode.CHARGED})
"""The modes in which a drone has a choice. In any other mode its mask allows one action only."""

TIMED = frozenset({Mode.FLYING})
"""The modes that may have begun with the time at which they end (``Drone.until_us``), which holds
beyond the end of an episode. Until then a drone in such a mode is not asked."""


@cache
def actions(
    three_d: bool, limited_battery: bool, cruise_mps: tuple[float, ...] = ()
) -> tuple[Choice, ...]:
    """Return the actions of a scenario. A command is an index into this tuple.

    There are 5, 7 or 9 of them. With cruise speeds, which ascend, each move exists at each of them:
    the first five or seven actions are those at the lowest speed, those at higher speeds follow,
    and the actions of charging are the last.
    """
    choices: list[Choice] = [Action.FORWARD, Action.BACKWARD, Action.RIGHT, Action.LEFT]
    choices.append(Action.HOVER)
    if three_d:
        choices += [Action.UP, Action.DOWN]
    if cruise_mps:
        plain, choices = choices, []
        for number, speed in enumerate(cruise_mps):
            at_speed = [AtSpeed(kind_of(each), speed) if each in MOVES else each for each in plain]
            choices += [each for each in at_speed if number == 0 or each is not Action.HOVER]
    if limited_battery:
        choices += [Action.GOTO_CHARGING_STATION, Action.CHARGE]
    return tuple(choices)


@cache
def free_actions(limited_battery: bool) -> tuple[Action, ...]:
    """Return the 2 or 4 actions of a scenario in which drones fly freely."""
    choices = [Action.FLY, Action.HOVER]
    if limited_battery:
        choices += [Action.GOTO_CHARGING_STATION, Action.CHARGE]
    return tuple(choices)
