"""What a drone's battery held at any time of a logged episode."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from desim_uav.model.rules import US, Phase
from desim_uav.report.run import Run

Floats = NDArray[np.float64]
Known = list[tuple[float, int, float]]
"""When, that as a key, and what the battery held, in seconds."""

PHASES = 16
"""An instant and a phase are one number, ``t_us * PHASES + phase``, which sorts as they do."""


def knots(run: Run, episode: int, events: pd.DataFrame, drone: int) -> tuple[Floats, Floats] | None:
    """Where a drone's battery is known, (t_s, s): at steps' ends, and where its change changes.

    In between it is linear. ``events`` are the episode's, with their keys. None where the battery
    is unlimited.
    """
    if run.scenario.drones.battery is None:
        return None
    events = events[events["drone"] == drone]
    known = _told(run, episode, events, drone)
    known = sorted(known + _landed(run, events, known))
    full_s = run.world.capacity_us / US
    times_s = np.array([t_s for t_s, _, _ in known])
    return times_s, np.clip([battery_s for _, _, battery_s in known], 0.0, full_s)


def first_battery_s(run: Run, episode: int, drone: int) -> float:
    """What a drone begins an episode with: what it carries over, else all of it."""
    full_s, steps = run.world.capacity_us / US, run.of("steps", episode - 1)
    if not run.scenario.episode.carry_over or steps.empty:
        return full_s
    if round(run.duration_s(episode - 1) * US) < run.world.horizon_us:
        return full_s  # a crash ended that episode, and this one starts afresh
    return float(steps.loc[steps["drone"] == drone, "battery_s"].iloc[-1])


def _told(run: Run, episode: int, events: pd.DataFrame, drone: int) -> Known:
    """What steps and events say, in order."""
    steps = run.of("steps", episode)
    steps = steps[steps["drone"] == drone]
    told: Known = [(0.0, -1, first_battery_s(run, episode, drone))]
    for t_s, battery_s in zip(steps["t_s"], steps["battery_s"], strict=True):
        told.append((t_s, round(t_s * US) * PHASES + Phase.RECORD, battery_s))
    full_s = run.world.capacity_us / US
    for kind, battery_s in (("charged", full_s), ("crash", 0.0), ("respawn", full_s)):
        rows = events[events["kind"] == kind]
        told += [(t / US, key, battery_s) for t, key in zip(rows["t_us"], rows["key"], strict=True)]
    return sorted(told)


def _landed(run: Run, events: pd.DataFrame, told: Known) -> Known:
    """What a drone landed with, reckoned back from its charge, which is at a constant rate."""
    rate = run.world.capacity_us / run.world.full_charge_us
    keys = [key for _, key, _ in told]
    found: Known = []
    for kind in ("land", "charge"):
        rows = events[events["kind"] == kind]
        for t_us, key in zip(rows["t_us"].tolist(), rows["key"].tolist(), strict=True):
            after = int(np.searchsorted(keys, key, "right"))
            if after == len(told):
                continue
            later = events.loc[(events["kind"] == "charge") & (events["key"] >= key), "t_us"]
            t_s, _, battery_s = told[after]
            charged_s = 0.0 if later.empty else max(0.0, t_s - int(later.iloc[0]) / US)
            found.append((t_us / US, key, battery_s - rate * charged_s))
    return found
