"""Makes the tables of a run from an engine's logs, which are in microseconds and bit/s.

Each function takes a batch of episodes, because a table of fifty takes hardly longer than one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from desim_uav import qoe
from desim_uav.columns import TEXT, to_frame
from desim_uav.drone_type import DroneType
from desim_uav.engine.base import ClosedRequest, EpisodeLog, SensorTotals
from desim_uav.model.energy.battery import WH_UJ
from desim_uav.model.rules import NEVER, US, Mode, Outcome
from desim_uav.model.sums import in_order
from desim_uav.records import (
    AGES,
    AIMED,
    APART,
    BEGUN,
    CHOSEN,
    CLASSES,
    ENERGY,
    EPISODES,
    EVENTS,
    GROUPED,
    LEGS,
    LINKS,
    NUMBERED,
    OTHERS,
    OWN,
    POINTS,
    REQUESTS,
    SENSORS,
    STAGES,
    STEPS,
    STORED,
    TASKS,
    UPDATES,
    USERS,
    VOLUMES,
)
from desim_uav.report.links import mean_rate_bps
from desim_uav.rules.words import DELIVERED, FATES
from desim_uav.sample_path import SamplePath
from desim_uav.scenario.processor import UserProcessor
from desim_uav.world import World

DERIVED = (
    *("wait_s", "completion_s", "handovers", "qoe1", "qoe1_feasible", "qoe2_iterations"),
    "throughput_kbps",
)
UBIT = 10**12
"""The millionths of a bit in a Mbit."""
MILLICYCLES = 10**12
"""The thousandths of a cycle in 10^9 cycles."""


def requests_table(logs: Sequence[EpisodeLog], world: World) -> pd.DataFrame:
    """Return one row per request, ordered by episode and request_id."""
    names = world.services.names
    has_volumes, stages = world.services.has_volumes, world.services.stages
    several = world.services.several_stages
    tasks, groups = world.services.has_tasks, _groups_of_users(world)
    own = _own_of_users(world)
    more = [*(VOLUMES if any(has_volumes) else ()), *(STAGES if several else ())]
    more += [*(TASKS if tasks else ()), *(OWN if own else ()), *(GROUPED if groups else ())]
    columns = REQUESTS.among(more)
    basic = {name: dtype for name, dtype in columns.items() if name not in DERIVED}
    rows = (
        (
            log.episode,
            r.request_id,
            r.user,
            names[r.service],
            r.t_request_us / US,
            None if r.t_first_us is None else r.t_first_us / US,
            r.t_end_us / US,
            None if has_volumes[r.service] else r.asked_us / US,
            r.served_us / US,
            r.bandwidth_bps / 1000,
            r.interruptions,
            r.drones,
            str(r.outcome),
            r.attached_us / US,
            *_volumes(r, has_volumes[r.service]) * any(has_volumes),
            *_stages(r, len(stages[r.service])) * several,
            *_task(r) * tasks,
            *(_user_j(r, one) for one in own[r.user : r.user + 1]),
            *groups[r.user : r.user + 1],
        )
        for log in logs
        for r in log.requests
    )
    frame = to_frame(basic, rows)
    duration_s = frame["episode"].map({log.episode: log.duration_us / US for log in logs})
    return qoe.derive(frame, duration_s, world.step_us / US)[list(columns)]


def _groups_of_users(world: World) -> list[str]:
    """Return the name of each user's group; an empty list if the users are not a list of groups."""
    names = world.scenario.group_names
    return [names[number] for number in world.scenario.group_numbers] if names else []


def _volumes(request: ClosedRequest, has_volumes: bool) -> tuple[float | None, ...]:
    """Return the volumes requested and delivered in Mbit, which are None for a service time."""
    return (request.asked_ubit / UBIT, request.sent_ubit / UBIT) if has_volumes else (None, None)


def _stages(request: ClosedRequest, count: int) -> tuple[float, ...]:
    """Return the number of stages, how many of them are done, and the share done of the next."""
    count = count * (request.part > 0.0) + (request.own_us > 0)
    if request.outcome == Outcome.COMPLETED:
        return count, count, 0.0
    done = request.own_share
    if request.part > 0.0:
        done += request.done / request.required
    whole = int(done)
    return count, request.stage + whole, done - whole


def _task(request: ClosedRequest) -> tuple[Any, ...]:
    """Return what belongs to a request as a task, in the order of the columns ``TASKS``."""
    deadline_us, open_us = request.deadline_us, request.t_end_us - request.t_request_us
    completed = request.outcome == Outcome.COMPLETED
    late, deadline_s = None, None if deadline_us == NEVER else deadline_us / US
    if deadline_us < NEVER and completed:
        late = request.t_end_us > deadline_us
    elif deadline_us <= request.t_end_us:
        late = True
    return (
        request.asked_cycles / MILLICYCLES,
        request.part,
        (open_us - request.served_us) / US,
        request.sending_us / US,
        request.computing_us / US,
        request.own_us / US,
        request.restarts,
        deadline_s,
        late,
    )


def _own_of_users(world: World) -> list[UserProcessor | None]:
    """Return the processor of each user; none at all if no user has one."""
    own = [users.processor for users in world.scenario.user_groups for _ in range(users.count)]
    return own if any(own) else []


def _user_j(request: ClosedRequest, own: UserProcessor | None) -> float | None:
    """Return what a user's device used for a task, in J; None without a processor."""
    if own is None:
        return None
    sent_us = request.uplink_us if request.asked_cycles else 0  # else it may have come down
    return float(own.busy_w * request.own_us + own.transmit_w * sent_us) / US


STEP_VALUES: dict[str, Callable[[Any], Any]] = {
    "t_s": lambda step: step.t_us / US,
    "mode": lambda step: step.mode.name.lower(),
    "action": lambda step: None if step.action is None else step.action.name.lower(),
    "action_taken": lambda step: step.action_taken.name.lower(),
    "bandwidth_khz": lambda step: step.used_hz / 1000,
    "crashed": lambda step: step.mode is Mode.CRASHED,
}
"""How columns of steps follow from a record; the others are fields of it, of the same name."""


def steps_table(logs: Sequence[EpisodeLog], world: World) -> pd.DataFrame:
    """Return one row per step and drone."""
    names = world.commands.names
    more = [*(STORED if world.in_joules else ()), *(AIMED if names else ())]
    more += [name for name in CHOSEN if name in names]
    columns = STEPS.among(more)
    drones = range(world.scenario.drone_count)
    own = STEP_VALUES | _charge_values([world.type_of(drone) for drone in drones])
    flies = [world.commands.of(drone).numbers(drone) > 0 for drone in drones]
    own |= {name: _of_free(name, flies) for name in (*AIMED, *CHOSEN)}
    values = [own.get(name, attrgetter(name)) for name in columns if name != "episode"]
    rows = ((log.episode, *(of(step) for of in values)) for log in logs for step in log.steps)
    frame = to_frame(columns, rows)
    if world.in_joules:  # what the records hold is summed over the episode
        used = frame.groupby(["episode", "drone"], sort=False)["energy_wh"]
        frame["energy_wh"] = (used.diff().fillna(frame["energy_wh"]) / WH_UJ).astype(float)
    return frame


def _charge_values(types: Sequence[DroneType]) -> dict[str, Callable[[Any], Any]]:
    """Return how columns of batteries follow from a record, given the type of each drone."""

    def in_seconds(name: str) -> Callable[[Any], Any]:
        return lambda step: _over(getattr(step, name), types[step.drone].drain_per_s)

    def in_wh(name: str) -> Callable[[Any], Any]:
        return lambda step: (
            _over(getattr(step, name), WH_UJ) if types[step.drone].in_joules else None
        )

    return {
        "battery_s": in_seconds("charge"),
        "battery_wh": in_wh("charge"),
        "n_b_s": in_seconds("return_drain"),
        "n_b_wh": in_wh("return_drain"),
        "energy_wh": lambda step: step.used if types[step.drone].in_joules else None,
    }


def _of_free(name: str, flies: Sequence[bool]) -> Callable[[Any], Any]:
    """Return what a record has under a name if its drone flies freely, else None."""
    return lambda step: getattr(step, name) if flies[step.drone] else None


def _over(charge: float | None, unit: int) -> float | None:
    """Return a charge in larger units; None if there is none, or if it is infinite."""
    return None if charge is None or math.isinf(charge) else charge / unit


def points_table(logs: Sequence[EpisodeLog]) -> pd.DataFrame:
    """Return one row per step and access point."""
    values = [STEP_VALUES.get(name, attrgetter(name)) for name in POINTS if name != "episode"]
    rows = ((log.episode, *(of(step) for of in values)) for log in logs for step in log.point_steps)
    return to_frame(POINTS, rows)


def episodes_table(
    logs: Sequence[EpisodeLog], world: World, requests: pd.DataFrame
) -> pd.DataFrame:
    """Return one row per episode with its measures."""
    by_episode = dict(list(requests.groupby("episode")))
    apart = APART if world.scenario.separation_m is not None else ()
    more = [*(LINKS if world.graded else ()), *apart, *(ENERGY if world.in_joules else ())]
    more += AGES if world.senses else ()
    columns = EPISODES.among(more)
    rows = (
        _episode_row(log, world, by_episode.get(log.episode, requests.iloc[:0]), columns)
        for log in logs
    )
    return to_frame(columns, rows)


def _episode_row(
    log: EpisodeLog, world: World, requests: pd.DataFrame, columns: dict[str, str]
) -> tuple[Any, ...]:
    available = log.duration_us * world.bandwidth_of_all_hz
    values = qoe.summary(requests) | {
        "episode": log.episode,
        "qoe3_percent": 100 * log.attached_us / (log.duration_us * len(world.homes)),
        "crashes": log.crashes,
        "reward": in_order(step.reward for step in log.steps) / world.scenario.drone_count,
        "suppressed": log.suppressed,
        "charges": log.charges,
        "queueing_s": log.queueing_us / US,
        "distance_m": log.distance_m,
        "bandwidth_percent": (
            None if math.isinf(available) else 100 * log.bandwidth_us_hz / available
        ),
        "duration_s": log.duration_us / US,
    }
    if log.links is not None:
        handovers, ping_pongs, outages, outage_us = log.links
        values |= {"link_handovers": handovers, "ping_pongs": ping_pongs, "outages": outages}
        delivered = requests["delivered_mbit"].sum() if "delivered_mbit" in requests else 0.0
        values |= {"outage_s": outage_us / US, "delivered_mbit": delivered}
    if log.apart is not None:
        conflicts, conflict_us, least_m = log.apart
        values |= {"conflicts": conflicts, "conflict_s": conflict_us / US}
        values["least_distance_m"] = None if math.isinf(least_m) else least_m
    if world.in_joules:
        values |= _energy(log, requests, world.all_in_joules)
    if log.sensors:
        values |= _ages(log, world)
    return tuple(values[name] for name in columns)


def _ages(log: EpisodeLog, world: World) -> dict[str, float | None]:
    """Return the measures of all sensors in an episode."""
    sensors, falls = log.sensors, sum(one.falls for one in log.sensors)
    ages_s = [_mean_age_s(one, log.duration_us) for one in sensors]
    limited = [one.over_us for one in sensors if _is_limited(world, one)]
    return {
        "age_s": in_order(ages_s) / len(ages_s),
        "peak_age_s": sum(one.peaks_us for one in sensors) / falls / US if falls else None,
        "worst_age_s": max(ages_s),
        "updates": sum(one.generated for one in sensors),
        "updates_delivered": sum(one.delivered for one in sensors),
        "updates_dropped": sum(one.dropped for one in sensors),
        "updates_lost": sum(one.lost for one in sensors),
        "age_violation_s": sum(limited) / US if limited else None,
    }


def _mean_age_s(sensor: SensorTotals, duration_us: int) -> float:
    """Return the time average of a sensor's age in an episode."""
    return sensor.area_us2 / (2 * duration_us) / US


def _is_limited(world: World, sensor: SensorTotals) -> bool:
    """Return whether there is a limit to the age of a sensor."""
    keeps = world.services.collecting[sensor.service]
    return keeps is not None and keeps.limit_us is not None


def updates_table(logs: Sequence[EpisodeLog], world: World) -> pd.DataFrame:
    """Return one row per update of a sensor, ordered by episode and number."""
    names = world.services.names
    rows = (
        (
            log.episode,
            update.number,
            update.user,
            names[world.senses[update.user]],
            None if update.request < 0 else update.request,
            update.size / UBIT,
            update.generated_us / US,
            _time_s(update.sent_us),
            _time_s(update.received_us),
            None if update.drone < 0 else update.drone,
            _time_s(update.ended_us if update.fate == DELIVERED else -1),
            FATES[update.fate],
            update.ended_us / US,
            _time_s(update.before_us),
            _time_s(update.after_us),
        )
        for log in logs
        for update in log.updates
    )
    return to_frame(UPDATES, rows)


def _time_s(t_us: int) -> float | None:
    """Return a time in seconds, or None if it is below 0 and so does not exist."""
    return None if t_us < 0 else t_us / US


def sensors_table(logs: Sequence[EpisodeLog], world: World) -> pd.DataFrame:
    """Return one row per episode and sensor."""
    names, groups = world.services.names, _groups_of_users(world)
    columns = SENSORS.among(GROUPED if groups else ())
    rows = (
        (
            log.episode,
            one.user,
            names[one.service],
            _mean_age_s(one, log.duration_us),
            one.peaks_us / one.falls / US if one.falls else None,
            one.falls,
            one.age_us / US,
            one.over_us / US if _is_limited(world, one) else None,
            one.generated,
            one.delivered,
            one.dropped,
            one.lost,
            *groups[one.user : one.user + 1],
        )
        for log in logs
        for one in log.sensors
    )
    return to_frame(columns, rows)


def _energy(log: EpisodeLog, requests: pd.DataFrame, of_all: bool) -> dict[str, float | None]:
    """Return what drones used and were charged with in an episode, and what was served with it.

    ``of_all`` says that this is the energy of all drones. If it is not, there is none per Mbit:
    the drones whose energy is unknown have served a part.
    """
    rates = mean_rate_bps(requests) * requests["served_s"].to_numpy(float)
    served_mbit = in_order(rates.tolist()) / 1e6
    return {
        "energy_wh": log.used / WH_UJ,
        "charged_wh": log.gained / WH_UJ,
        "served_mbit": served_mbit,
        "j_per_mbit": log.used / 1e6 / served_mbit if of_all and served_mbit > 0.0 else None,
    }


def events_table(logs: Sequence[EpisodeLog], world: World) -> pd.DataFrame:
    """Return one row per event, in order of time, phase, drone and user."""
    more = [*(CLASSES if any(log.links is not None for log in logs) else ())]
    more += OTHERS if any(log.apart is not None for log in logs) else ()
    more += BEGUN if world.services.several_stages else ()
    more += NUMBERED if world.senses else ()
    rows = (
        (log.episode, t_us, int(phase), kind, *(None if i < 0 else i for i in concerned))
        for log in logs
        for t_us, phase, kind, *concerned in log.events or ()
    )
    return to_frame(EVENTS.among(more), rows)


def legs_table(logs: Sequence[EpisodeLog]) -> pd.DataFrame:
    """Return one row per leg that a drone flew, in order of time and drone."""
    rows = (
        (
            log.episode,
            leg.t_us / US,
            leg.drone,
            leg.duration_us / US,
            leg.mode.name.lower(),
            *leg.from_m,
            *leg.to_m,
        )
        for log in logs
        for leg in log.legs
    )
    return to_frame(LEGS, rows)


def users_table(paths: Sequence[SamplePath], world: World) -> pd.DataFrame:
    """Return the way points of all walks: the start of each leg, and the episode's end."""
    tables = [_way_points(path, world) for path in paths]
    frame = pd.DataFrame(np.concatenate(tables or [np.empty((0, len(USERS)))]), columns=list(USERS))
    frame = frame.astype(USERS)
    if groups := _groups_of_users(world):
        frame["group"] = pd.Series([groups[user] for user in frame["user"]], dtype=TEXT)
    return frame


def _way_points(path: SamplePath, world: World) -> NDArray[np.float64]:
    legs, offsets = path.walks
    user = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    underway = legs["begin_us"] <= world.horizon_us
    legs, user = legs[underway], user[underway]
    last = np.flatnonzero(np.diff(user, append=-1))  # each user's last leg begun in the episode
    goes_on = last[legs["begin_us"][last] < world.horizon_us]
    ends = legs[goes_on]
    moved_s = (world.horizon_us - ends["begin_us"]) / US
    ends["x_m"] += ends["vx_mps"] * moved_s
    ends["y_m"] += ends["vy_mps"] * moved_s
    ends["begin_us"] = world.horizon_us
    points, user = np.concatenate((legs, ends)), np.concatenate((user, user[goes_on]))
    order = np.lexsort((points["begin_us"], user))
    points, user = points[order], user[order]
    episode = np.full(len(points), path.episode)
    columns = (episode, user, points["begin_us"] / US, points["x_m"], points["y_m"])
    return np.column_stack((*columns, world.homes[user, 2]))
