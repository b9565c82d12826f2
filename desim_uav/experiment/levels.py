"""The links of a run over time, and all over the map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from desim_uav.errors import UsageError
from desim_uav.experiment.replay.again import Source, playable
from desim_uav.model.rules import US
from desim_uav.report.run import Run

if TYPE_CHECKING:
    import pandas as pd

MOST_ROWS = 20_000_000
"""The most rows of a table of links."""


def levels_of(
    source: Path | Source,
    user: int | Sequence[int] | None,
    drone: int | Sequence[int] | None,
    episode: int | None,
    *,
    every_s: float | None,
    at_s: float | Sequence[float] | None,
    show_progress: bool = True,
) -> pd.DataFrame:
    """Return the links between users and drones over time (see ``RunResult.levels``)."""
    from desim_uav.report.levels import levels_frame
    from desim_uav.report.playback import Playback

    run = playable(source, show_progress)
    _need_levels(run)
    scenario = run.scenario
    users = _chosen("user", user, scenario.user_count, "users")
    senders = scenario.drone_count + len(scenario.access_points)
    drones = _chosen("drone", drone, senders, "drones and access points")
    number = run.episode(episode)
    times_us = _times_us(every_s, at_s, run.duration_s(number))
    count = 0 if times_us is None else len(times_us)
    if len(users) * len(drones) * count > MOST_ROWS:
        raise UsageError(
            f"{len(users)} users, {len(drones)} drones and {count} times are more than "
            f"{MOST_ROWS:,} rows: choose a user, a drone or fewer times"
        )
    run.need([number])
    instants = None if times_us is None else np.array(times_us, np.int64)
    return levels_frame(Playback(run, number), users, drones, instants)


def map_of(
    source: Path | Source,
    episode: int | None,
    minute: float | None,
    points: int,
    every_s: float,
    show_progress: bool = True,
) -> pd.DataFrame:
    """Return what users on the ground would receive (see ``RunResult.map``)."""
    from desim_uav.report.radio_map import MOST_POINTS, frame_of

    if not 1 <= points <= MOST_POINTS:
        raise UsageError(f"points: {points}: must be a whole number from 1 to {MOST_POINTS}")
    _step_us(every_s, 1000)
    return frame_of(playable(source, show_progress), episode, minute, points, every_s)


def _need_levels(run: Run) -> None:
    """Raise UsageError if no radio has levels."""
    if not any(links.radio.graded for links in run.world.links):
        raise UsageError(
            f"{run.scenario.name}: its links have no level, because the radio of its drones is the "
            "paper's disc; write drones.radio: {kind: link_classes} in the scenario, and leave out "
            "drones.footprint_radius_m and drones.bandwidth_kbps"
        )


def _chosen(
    name: str, numbers: int | Sequence[int] | None, count: int, all_of: str
) -> Sequence[int]:
    """Return the numbers that an argument names. Raises UsageError if one is not there."""
    if numbers is None:
        return range(count)
    each = [int(number) for number in _listed(name, numbers)]
    for number in each:
        if not 0 <= number < count:
            raise UsageError(f"{name}: {number}: the {all_of} are 0 to {count - 1}")
    return sorted(set(each))


def _times_us(
    every_s: float | None, at_s: float | Sequence[float] | None, duration_s: float
) -> Sequence[int] | None:
    """Return the times that arguments name, or None. Raises UsageError if one is not there."""
    end_us = round(duration_s * US)
    if every_s is not None and at_s is not None:
        raise UsageError("every_s: give either a step or times (at_s), not both")
    if every_s is not None:
        return range(0, end_us + 1, _step_us(every_s, 1))
    if at_s is None:
        return None
    each = _listed("at_s", at_s)
    for t_s in each:
        if not 0 <= t_s <= duration_s:
            raise UsageError(f"at_s: {t_s:g}: the episode is from 0 to {duration_s:g} s")
    return sorted({round(float(t_s) * US) for t_s in each})


def _step_us(every_s: float, least_us: int) -> int:
    """Return a step in microseconds. Raises UsageError if it is shorter than the least, or none."""
    step_us = round(float(every_s) * US, 0)
    if not least_us <= step_us < math.inf:
        raise UsageError(f"every_s: {every_s:g}: must be finite, and at least {least_us / US:g} s")
    return int(step_us)


def _listed(name: str, values: Any) -> list[Any]:
    """Return a number, or several in any sequence, as a list. Raises UsageError if it is empty."""
    each = [values] if isinstance(values, Real) else list(values)
    if not each:
        raise UsageError(f"{name}: give at least one; leave the argument out for the default")
    return each
