"""What an engine is, and the log it writes. An engine leaves nothing to chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import partial
from operator import itemgetter
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from desim_uav.model.planner import Node
from desim_uav.model.rows import named
from desim_uav.model.rules import Mode, Outcome
from desim_uav.model.state import Snapshot
from desim_uav.rules.rows import Record
from desim_uav.sample_path import SamplePath
from desim_uav.world import World

Event = tuple[int, int, str, int, int, int, int]
"""(t_us, phase, kind, drone, user, request_id, station); -1 is none."""

IN_ORDER = itemgetter(0, 1, 3, 4)
"""The order of a log: (t_us, phase, drone, user); rows that share it stand as they happened."""


@dataclass(slots=True)
class ClosedRequest:
    """A request that has ended; times in microseconds from the episode's start."""

    request_id: int
    user: int
    service: int
    bandwidth_bps: int
    required_us: int
    served_us: int
    attached_us: int
    t_request_us: int
    t_first_us: int | None
    t_end_us: int
    interruptions: int
    drones: list[int]
    outcome: Outcome


class Step(named(Record)):  # type: ignore[misc]  # its fields are declared in Record alone
    """One drone at the end of one step: its record (see ``rules.rows.Record``).

    ``mode`` is a Mode, and ``action`` and ``action_taken`` are Actions; ``action`` is None if there
    was none. ``battery_us`` and ``return_us`` are None without a battery, and ``return_us`` is inf
    if there is no way back.
    """

    __slots__ = ()


Place = tuple[float, float, float]
"""x, y, z in metres."""


class FlownLeg(NamedTuple):
    """What a drone began at ``t_us`` (below 0: in an episode before).

    A transit of ``duration_us``, commanded (``flying``) or on the way to a station
    (``returning``); or, with a duration of 0, a place it was put: where it began the episode, was
    put in place of another, or lies crashed. After a leg a drone stays where it has led.
    """

    t_us: int
    drone: int
    duration_us: int
    mode: Mode
    from_m: Place
    to_m: Place


@dataclass
class EpisodeLog:
    """All an engine tells of one episode.

    ``events`` is None where they are not kept; they stand in order of (t_us, phase, drone, user)
    once the episode has ended. ``legs`` are kept where events are, and stand in order of (t_us,
    drone). ``attached_us`` is the integral over time of the attached users,
    ``crashed`` names the drone of each crash, ``queueing_us`` is the time between landing and
    charging, ``bandwidth_us_bps`` the integral of the
    bandwidth in use.
    """

    episode: int
    events: list[Event] | None = None
    legs: list[FlownLeg] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    requests: list[ClosedRequest] = field(default_factory=list)
    duration_us: int = 0
    attached_us: int = 0
    bandwidth_us_bps: int = 0
    queueing_us: int = 0
    distance_m: float = 0.0
    crashed: list[int] = field(default_factory=list)
    charges: int = 0
    suppressed: int = 0

    @property
    def crashes(self) -> int:
        """The number of crashes."""
        return len(self.crashed)

    def put_in_order(self) -> None:
        """Once the episode has ended: events and legs as they are to stand."""
        if self.events is not None:
            self.events.sort(key=IN_ORDER)
        self.legs.sort(key=itemgetter(0, 1))


class RunSettings(NamedTuple):
    """What a run adds to its world; ``ceilings``: is a drone bound by the tallest building?

    Of events (and legs) and steps, the log holds what is kept.
    """

    ceilings: tuple[bool, ...]
    carry_over: bool
    keep_events: bool = False
    keep_steps: bool = True


class UserState(IntEnum):
    """What a user is doing: nothing, attached without a request, waiting with one, or served."""

    IDLE = 0
    ATTACHED = 1
    OPEN = 2
    SERVED = 3


class CarriedDrone(NamedTuple):
    """A drone between two episodes; an age is the time since, in microseconds.

    ``node`` is where it rests or began its hop, ``battery_us`` what it had then, ``age_us`` ago.
    ``hop`` is the hop of a return under way, ``route`` the hops to follow it; ``counted_m`` what
    was counted of the hop. ``place`` counts the drones before it in its station's queue, those on
    pads among them. ``fallen_m`` is where it lies crashed.
    """

    mode: Mode
    node: Node
    battery_us: int
    age_us: int
    hop: Node | None
    route: tuple[Node, ...]
    counted_m: float
    place: int
    fallen_m: tuple[float, float] | None


Carried = tuple[CarriedDrone, ...]
"""All that one episode hands on to the next: its drones."""


class Measures(NamedTuple):
    """The quality of experience of an episode so far; None where nothing was asked for."""

    qoe1_percent: float | None
    qoe2_iterations: float | None
    qoe3_percent: float | None


MEASURES = ("sim_time_s", *Measures._fields)
"""What is told of an episode under way."""

COUNTS = ("attached_users", "crashes", "requests")
"""What is counted of an episode under way: users attached now, crashes and requests so far."""

measured = partial(tuple.__new__, Measures)
"""Measures of a tuple of all its fields."""


class Engine(Protocol):
    """Runs episodes, one decision epoch at a time.

    An engine can be copied and pickled between any two of its calls. The copy shares only the
    world with the original, and it goes on, in this process or another, as the original would.
    """

    world: World
    settings: RunSettings

    @property
    def log(self) -> EpisodeLog:
        """What is told of the episode under way."""

    @property
    def terminated(self) -> bool:
        """Has a crash ended the episode?"""

    @property
    def truncated(self) -> bool:
        """Is the episode's time up?"""

    def reset(self, path: SamplePath) -> Snapshot:
        """Begin an episode on its sample path and run up to its first decision epoch.

        With carry-over each drone keeps its exact state from an episode that ran its time. One
        that was broken off, or that a crash has terminated, is followed by a fresh start.
        """

    def step(self, commands: Sequence[int]) -> Snapshot:
        """Give each drone its command (an index into the world's actions) and run one step.

        A command the mask forbids becomes the mask's only action, or hover.
        """

    def carried(self) -> Carried | None:
        """What the next episode's drones begin with; None where they start afresh."""

    def carry(self, drones: Carried | None) -> None:
        """Let the next episode begin with these drones, as if this engine had brought them there.

        It may come from another engine of the same world and settings.
        """

    def measures(self) -> Measures:
        """The quality of experience so far, open requests by what they have had so far."""

    def requests_made(self) -> int:
        """How many requests have been made in the episode so far, open ones among them."""

    def positions_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where drones and users truly are: (drones, 3) and (users, 3), to be drawn."""

    def user_states(self) -> list[UserState]:
        """What each user is doing, to be drawn; after an episode, what it did at its end."""
