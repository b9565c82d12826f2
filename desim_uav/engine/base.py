"""What an engine is, and the log it writes. An engine draws nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import NamedTuple, Protocol

from desim_uav.model.rules import Action, Mode, Outcome
from desim_uav.model.state import Snapshot
from desim_uav.sample_path import SamplePath

Event = tuple[int, int, str, int, int, int, int]
"""(t_us, phase, kind, drone, user, request_id, station); -1 is none."""

IN_ORDER = itemgetter(0, 1, 3, 4)
"""The order of a log: (t_us, phase, drone, user); rows that share it stand as they happened."""


class ClosedRequest(Protocol):
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


class Step(NamedTuple):
    """One drone at the end of one step."""

    step: int
    t_us: int
    drone: int
    x_m: float
    y_m: float
    z_m: float
    battery_us: int | None
    mode: Mode
    action: Action | None
    action_taken: Action
    attached_users: int
    served_requests: int
    bandwidth_bps: int
    return_us: float | None


@dataclass
class EpisodeLog:
    """All an engine tells of one episode.

    ``events`` is None where they are not kept; they stand in order of (t_us, phase, drone, user)
    once the episode has ended. ``attached_us`` is the integral over time of the attached users,
    ``queueing_us`` the time between landing and charging, ``bandwidth_us_bps`` the integral of the
    bandwidth in use.
    """

    episode: int
    events: list[Event] | None = None
    steps: list[Step] = field(default_factory=list)
    requests: list[ClosedRequest] = field(default_factory=list)
    duration_us: int = 0
    attached_us: int = 0
    bandwidth_us_bps: int = 0
    queueing_us: int = 0
    distance_m: float = 0.0
    crashes: int = 0
    charges: int = 0
    suppressed: int = 0


class RunSettings(NamedTuple):
    """What a run adds to its world; ``ceilings``: is a drone bound by the tallest building?"""

    ceilings: tuple[bool, ...]
    carry_over: bool
    keep_events: bool = False


class Engine(Protocol):
    """Runs episodes, one decision epoch at a time."""

    log: EpisodeLog

    def reset(self, path: SamplePath) -> Snapshot:
        """Begin an episode on its sample path and run up to its first decision epoch.

        With carry-over each drone keeps its exact state from the episode before.
        """

    def step(self, commands: Sequence[int]) -> Snapshot:
        """Give each drone its command (an index into the world's actions) and run one step.

        A command the mask forbids becomes the mask's only action, or hover.
        """
