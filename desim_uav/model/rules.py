"""The terms of the model: actions, modes, the phases of one instant, outcomes, and masks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from functools import cache
from itertools import pairwise

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
class Variant:
    """An action with what a command chooses beside it; None where there is no choice.

    A move is at one of several cruise speeds (``drones.motion.cruise``), and a move or a hover has
    the share of tasks that is offloaded (``offloading: {kind: commanded}``).
    """

    action: Action
    cruise_mps: float | None = None
    share: float | None = None

    @property
    def name(self) -> str:
        """The name of the action, the speed in m/s and the share, such as ``RIGHT@8.3+0.5``."""
        return self.action.name + self.suffix

    @property
    def suffix(self) -> str:
        """The speed and the share as they follow the action in the name, such as ``@8.3+0.5``."""
        beside = (("@", self.cruise_mps), ("+", self.share))
        return "".join(mark + _shortest(value) for mark, value in beside if value is not None)

    def __int__(self) -> int:
        """Return the number of the action, which is that of all its variants."""
        return int(self.action)


def _shortest(number: float) -> str:
    return repr(float(number)).removesuffix(".0")


Choice = Action | Variant
"""What a drone can be commanded: an action, or one with what is chosen beside it."""


MOST_CHOICES = 8
"""The largest number of cruise speeds, or of shares, that a command can choose from."""


def ascend(numbers: Sequence[float] | None) -> None:
    """Raise ValueError unless numbers ascend."""
    for lower, higher in pairwise(numbers or ()):
        if lower >= higher:
            raise ValueError(f"must ascend; {higher:g} follows {lower:g}")


def kind_of(choice: Choice) -> Action:
    """Return the action of a choice, whatever is chosen beside it."""
    return choice.action if isinstance(choice, Variant) else choice


def share_of(choice: Choice, otherwise: float) -> float:
    """Return the share of tasks that a choice offloads, or another number if it chooses none."""
    share = choice.share if isinstance(choice, Variant) else None
    return otherwise if share is None else share


def move_of(choice: Choice) -> tuple[int, int, int]:
    """Return the change of (cell x, cell y, level) that a choice commands, which may be none."""
    return MOVES.get(kind_of(choice), (0, 0, 0))


def fastest_of(choices: Sequence[Choice]) -> dict[Action, int]:
    """Return the number of each action among choices, at the highest speed and share it has."""
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
    three_d: bool,
    limited_battery: bool,
    cruise_mps: tuple[float, ...] = (),
    shares: tuple[float, ...] = (),
) -> tuple[Choice, ...]:
    """Return the actions of a scenario. A command is an index into this tuple.

    There are 5, 7 or 9 of them. With cruise speeds, which ascend, each move exists at each of them:
    the first five or seven actions are those at the lowest speed, and those at higher speeds
    follow. With shares, which ascend, all of these exist at each share, those at the lowest one
    first. The actions of charging are the last.
    """
    plain = [Action.FORWARD, Action.BACKWARD, Action.RIGHT, Action.LEFT, Action.HOVER]
    if three_d:
        plain += [Action.UP, Action.DOWN]
    speeds: tuple[float | None, ...] = cruise_mps or (None,)
    choices = [
        _variant(each, speed, share)
        for share in shares or (None,)
        for speed in speeds
        for each in plain
        if speed == speeds[0] or each in MOVES
    ]
    return (*choices, *_charging(limited_battery))


@cache
def free_actions(limited_battery: bool, shares: tuple[float, ...] = ()) -> tuple[Choice, ...]:
    """Return the actions of a scenario in which drones fly freely; they hover at each share."""
    hovers = [_variant(Action.HOVER, None, share) for share in shares or (None,)]
    return (Action.FLY, *hovers, *_charging(limited_battery))


def _variant(action: Action, cruise_mps: float | None, share: float | None) -> Choice:
    """Return an action with what is chosen beside it, or alone; only a move has a speed."""
    speed = cruise_mps if action in MOVES else None
    return action if speed is None and share is None else Variant(action, speed, share)


def _charging(limited_battery: bool) -> tuple[Action, ...]:
    return (Action.GOTO_CHARGING_STATION, Action.CHARGE) if limited_battery else ()
