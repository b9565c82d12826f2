"""From an engine's log, in microseconds and bit/s, to the tables of a run."""

from __future__ import annotations

import math
from typing import Any

import pandas as pd

from desim_uav import qoe
from desim_uav.engine.base import EpisodeLog
from desim_uav.model.coverage import T0_US
from desim_uav.model.rules import US, Mode
from desim_uav.records import EPISODES, EVENTS, REQUESTS, STEPS, USERS, to_frame
from desim_uav.sample_path import SamplePath
from desim_uav.world import World

DERIVED = ("wait_s", "completion_s", "handovers", "qoe1", "qoe1_feasible", "qoe2_iterations")


def requests_table(log: EpisodeLog, world: World) -> pd.DataFrame:
    """One row a request, by request_id."""
    names = world.services.names
    basic = {name: dtype for name, dtype in REQUESTS.items() if name not in DERIVED}
    rows = (
        (
            log.episode,
            r.request_id,
            r.user,
            names[r.service],
            r.t_request_us / US,
            None if r.t_first_us is None else r.t_first_us / US,
            r.t_end_us / US,
            r.required_us / US,
            r.served_us / US,
            r.bandwidth_bps / 1000,
            r.interruptions,
            r.drones,
            str(r.outcome),
            r.attached_us / US,
        )
        for r in log.requests
    )
    frame = qoe.derive(to_frame(basic, rows), log.duration_us / US, world.step_us / US)
    return frame[list(REQUESTS)]


def steps_table(log: EpisodeLog, world: World) -> pd.DataFrame:
    """One row a step and drone."""
    rows = (
        (
            log.episode,
            s.step,
            s.t_us / US,
            s.drone,
            s.x_m,
            s.y_m,
            s.z_m,
            None if s.battery_us is None else s.battery_us / US,
            s.mode.name.lower(),
            None if s.action is None else s.action.name.lower(),
            s.action_taken.name.lower(),
            s.attached_users,
            s.served_requests,
            s.bandwidth_bps / 1000,
            None if s.return_us is None or math.isinf(s.return_us) else s.return_us / US,
            s.mode is Mode.CRASHED,
            None,
        )
        for s in log.steps
    )
    return to_frame(STEPS, rows)


def episodes_table(log: EpisodeLog, world: World, requests: pd.DataFrame) -> pd.DataFrame:
    """One row: the episode's measures."""
    measured = qoe.summary(requests)
    available = log.duration_us * world.scenario.drones.count * world.bandwidth_bps
    values: dict[str, Any] = measured | {
        "episode": log.episode,
        "qoe3_percent": 100 * log.attached_us / (log.duration_us * len(world.homes)),
        "crashes": log.crashes,
        "reward": None,
        "suppressed": log.suppressed,
        "charges": log.charges,
        "queueing_s": log.queueing_us / US,
        "distance_m": log.distance_m,
        "bandwidth_percent": (
            None if math.isinf(available) else 100 * log.bandwidth_us_bps / available
        ),
        "duration_s": log.duration_us / US,
    }
    return to_frame(EPISODES, [tuple(values[name] for name in EPISODES)])


def events_table(log: EpisodeLog) -> pd.DataFrame:
    """One row an event, in order of time, phase, drone and user."""
    rows = (
        (log.episode, t_us, int(phase), kind, *(None if i < 0 else i for i in concerned))
        for t_us, phase, kind, *concerned in log.events or ()
    )
    return to_frame(EVENTS, rows)


def users_table(path: SamplePath, world: World) -> pd.DataFrame:
    """The way points of all walks: one row where a leg begins, and one at the episode's end."""
    legs, offsets = path.walks
    rows: list[tuple[Any, ...]] = []
    for user, (_, _, z) in enumerate(world.homes.tolist()):
        own = legs[offsets[user] : offsets[user + 1]].tolist()
        own = [leg for leg in own if leg[T0_US] <= world.horizon_us]
        rows += [(path.episode, user, t0 / US, x, y, z) for t0, x, y, _, _ in own]
        t0, x, y, vx, vy = own[-1]
        if t0 < world.horizon_us:
            dt = (world.horizon_us - t0) / US
            rows.append((path.episode, user, world.horizon_us / US, x + vx * dt, y + vy * dt, z))
    return to_frame(USERS, rows)
