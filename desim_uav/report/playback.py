"""An episode in continuous time: positions and states of drones and users at any instant.

Positions are exact: those of drones follow from their legs and the profiles of their motion, those
of users from their way points. States follow from the events up to the instant. A phase can be
given with an instant; events after that phase are then left out. By default all events of the
instant count, except the final record at the end of an episode, which closes all requests.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from desim_uav.engine.base import Measures, TaskQueue, UserState
from desim_uav.errors import PolicyError
from desim_uav.model.radio.tracks import Flight
from desim_uav.model.rules import US, Mode, Phase
from desim_uav.model.services import COMPUTING
from desim_uav.report.batteries import battery_curve, charges_before
from desim_uav.report.links import full_service_s
from desim_uav.report.run import Run
from desim_uav.report.tracks import Track
from desim_uav.report.way_points import WayPoints
from desim_uav.rules.words import LEADS_TO

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PHASES = 16
"""An instant and a phase are one number, ``t_us * PHASES + phase``, which sorts as they do."""

CLOSES = ("complete", "refuse", "close", "late", "drop")
"""The events that end a request."""

ON_TASKS = ("request", "stage", "serve", *CLOSES)
"""The events that move a task, in the order in which they follow each other in an instant."""

MODES = tuple(mode.name.lower() for mode in Mode)


class Moment(NamedTuple):
    """The state at an instant. Positions are in metres; unlimited ``batteries_s`` are None.

    ``holders`` has the drone that each user is attached to, or -1, and ``serving`` the drone that
    serves each user's request, or -1. ``queues`` are those at the processors of drones and access
    points; there are none if no service has tasks.
    """

    t_us: int
    drones_m: Floats
    modes: tuple[Mode, ...]
    batteries_s: tuple[float | None, ...]
    users_m: Floats
    states: list[UserState]
    holders: Ints
    serving: Ints
    measures: Measures
    queues: list[TaskQueue]


@dataclass(frozen=True)
class Playback:
    """One episode of a run that kept its events, or is played again for them."""

    run: Run
    episode: int

    @cached_property
    def duration_us(self) -> int:
        """The duration of the episode."""
        return round(self.run.duration_s(self.episode) * US)

    def at(self, t_us: int, phase: int | None = None) -> Moment:
        """Return the state at an instant, after the events of ``phase``."""
        if phase is None:
            phase = PHASES - 1 if t_us < self.duration_us else Phase.ATTACHMENT
        key = t_us * PHASES + phase
        holders, serving, asking = self._users_at(key)
        states = np.full(len(holders), UserState.IDLE)
        states[holders >= 0] = UserState.ATTACHED
        states[asking] = UserState.OPEN
        states[serving >= 0] = UserState.SERVED
        modes = tuple(self._mode(drone, key) for drone in range(len(self._tracks)))
        return Moment(
            t_us,
            np.array([track.position_m(t_us) for track in self._tracks]),
            modes,
            tuple(self._battery_s(drone, t_us) for drone in range(len(modes))),
            self.walks.all_m(t_us),
            [UserState(state) for state in states],
            holders,
            serving,
            self._measures(t_us, key),
            self._queues(key, serving),
        )

    # ---- drones

    def paths_m(self, times_us: Ints) -> Floats:
        """Return the position of each drone at some times, as (drones, times, 3)."""
        return np.array([self.path_m(drone, times_us) for drone in range(len(self._tracks))])

    def path_m(self, drone: int, times_us: Ints) -> Floats:
        """Return the position of a drone at some times, as (times, 3)."""
        track = self._tracks[drone]
        return np.array([track.position_m(t_us) for t_us in times_us.tolist()]).reshape(-1, 3)

    def flights(self, drone: int) -> list[tuple[Flight, tuple[int, int]]]:
        """Return the flights of a drone in the episode, each with the time for which it is on it.

        That is until the next one begins.
        """
        return self._tracks[drone].flown(self.duration_us)

    def way_m(self, drone: int, t_us: int) -> Floats:
        """Return the places at which a drone's path begins and bends until an instant, (n, 3)."""
        track = self._tracks[drone]
        starts_us = track.starts_us[(track.starts_us > 0) & (track.starts_us < t_us)]
        return np.array([track.position_m(t) for t in (0, *starts_us.tolist(), t_us)])

    def spans(self, drone: int) -> Iterator[tuple[int, int, Mode]]:
        """Yield a drone's modes one after the other: start and end (µs), and the mode."""
        keys, modes = self.mode_changes[drone]
        starts = [0, *(keys[1:] // PHASES).tolist()]
        for start, end, mode in zip(starts, [*starts[1:], self.duration_us], modes, strict=True):
            if end > start:
                yield start, end, mode

    def crashes_us(self, drone: int) -> list[int]:
        """Return the times at which a drone crashed."""
        events = self.events
        mine = (events["kind"] == "crash") & (events["drone"] == drone)
        return [int(t_us) for t_us in events.loc[mine, "t_us"]]

    def cell_times_us(self, drone: int) -> Iterator[tuple[int, int, tuple[int, int]]]:
        """Yield start, end and cell of a drone's service, in order."""
        track, cell_of = self._tracks[drone], self.run.world.grid.cell_of
        times_us = track.cuts_us(self.run.world.grid)
        for start, end, mode in self.spans(drone):
            if mode is not Mode.FLYING:
                continue
            cuts = times_us[(start < times_us) & (times_us < end)].tolist()
            for a, b in pairwise([start, *sorted(cuts), end]):
                x, y, _ = track.position_m((a + b) // 2)
                yield a, b, cell_of(x, y)

    @cached_property
    def _tracks(self) -> list[Track]:
        legs = self.run.of("legs", self.episode)
        drones = range(self.run.scenario.drone_count)
        if set(legs["drone"]) != set(drones) or not set(legs["mode"]) <= set(MODES):
            raise self._unfit("legs", "the drones or modes are not those of the scenario")
        return [Track(legs[legs["drone"] == drone], self.run, drone) for drone in drones]

    def _unfit(self, name: str, why: str) -> PolicyError:
        file = self.run.folder / f"{name}.parquet"
        return PolicyError(f"{file}: not of this run, episode {self.episode}: {why}")

    @cached_property
    def mode_changes(self) -> list[tuple[Ints, list[Mode]]]:
        """For each drone the keys of the events that change its mode, and the new modes."""
        events = self.events[self.events["kind"].isin([*LEADS_TO, "depart"])]
        changes = []
        for drone, track in enumerate(self._tracks):
            mine = events[events["drone"] == drone]
            flown = dict(zip(track.starts_us.tolist(), track.modes, strict=True))
            departures = mine.loc[mine["kind"] == "depart", "t_us"]
            if not set(departures) <= set(flown):
                raise self._unfit("events", "a departure has no leg")
            modes = [
                flown[t_us] if kind == "depart" else LEADS_TO[kind]
                for kind, t_us in zip(mine["kind"], mine["t_us"].tolist(), strict=True)
            ]
            keys = np.concatenate(([-1], mine["key"].to_numpy()))
            changes.append((keys, [track.modes[0], *modes]))
        return changes

    def _mode(self, drone: int, key: int) -> Mode:
        keys, modes = self.mode_changes[drone]
        return modes[int(np.searchsorted(keys, key, "right")) - 1]

    @cached_property
    def batteries(self) -> list[tuple[Floats, Floats]]:
        """The times and charges (s, s) of each drone's battery; the charge is linear in between.

        There are none of a drone whose battery is unlimited.
        """
        world, steps = self.run.world, self.run.of("steps", self.episode)
        charges = []
        for drone, begins_us in enumerate(charges_before(self.run, self.episode)):
            own, drone_type = steps[steps["drone"] == drone], world.type_of(drone)
            if not drone_type.limited:
                charges.append((np.empty(0), np.empty(0)))
                continue
            events = self.events[(self.events["drone"] == drone) & self.events["user"].isna()]
            knots = battery_curve(
                drone_type,
                self._tracks[drone],
                begins_us,
                [
                    (round(t_s * US), round(left_s * drone_type.drain_per_s))
                    for t_s, left_s in zip(own["t_s"], own["battery_s"], strict=True)
                ],
                [*zip(events["t_us"].tolist(), events["kind"], strict=True)],
                self.duration_us,
            )
            t_us, left = np.array(knots, np.float64).T
            charges.append((t_us / US, left / drone_type.drain_per_s))
        return charges

    def _battery_s(self, drone: int, t_us: int) -> float | None:
        t_s, battery_s = self.batteries[drone]
        if not len(t_s):
            return None
        after = int(np.searchsorted(t_s, t_us / US, "right"))
        if after == len(t_s):
            return float(battery_s[-1])
        share = (t_us / US - t_s[after - 1]) / (t_s[after] - t_s[after - 1])
        return float(battery_s[after - 1] + share * (battery_s[after] - battery_s[after - 1]))

    # ---- users

    @cached_property
    def events(self) -> pd.DataFrame:
        """The events of the episode, with their keys."""
        events = self.run.of("events", self.episode)
        return events.assign(key=events["t_us"] * PHASES + events["phase"])

    @cached_property
    def attachments(self) -> Spells:
        """The attachments of users to drones, with their times."""
        return self._spells("attach", "detach")

    @cached_property
    def services(self) -> Spells:
        """The services of requests by drones, with their times."""
        return self._spells("serve", "stop")

    @cached_property
    def own_parts(self) -> Spells:
        """The times in which users compute parts of their tasks themselves; at most one each."""
        return self._spells("compute", "computed")

    @cached_property
    def standing(self) -> Spells:
        """The times in which tasks stand at processors, which compute them then or later.

        A task arrives with a ``stage``, or with ``serve`` if it is computed first of all, and
        stands there until another stage begins, also because it is lost, or until it is over.
        """
        events = self.events.dropna(subset=["request_id"])
        order = events["kind"].map({kind: k for k, kind in enumerate(ON_TASKS)})
        events = events.assign(order=order).dropna(subset=["order"])
        events = events.sort_values(["key", "order"], kind="stable")
        if "stage" not in events:
            events = events.assign(stage=0)
        names = ["key", "kind", "drone", "user", "request_id", "stage"]
        columns = [events[name].fillna(-1).tolist() for name in names]
        since, stage_of = dict[int, tuple[int, int]](), dict[int, int]()
        spells: list[tuple[int, ...]] = []
        for key, kind, drone, user, request, stage in zip(*columns, strict=True):
            if kind != "serve":
                stage_of[request] = max(stage, 0)
                if request in since:
                    site, came = since.pop(request)
                    times = came, came // PHASES, key, key // PHASES
                    spells.append((site, user, request, *times))
            stands = kind in ("stage", "serve") and request not in since and drone >= 0
            if stands and self._computed[request, stage_of[request]]:
                since[request] = drone, key
        return Spells(*np.array(spells, np.int64).reshape(-1, len(Spells._fields)).T)

    @cached_property
    def _computed(self) -> NDArray[np.bool_]:
        """Whether a processor does a stage, by request and stage."""
        services, requests = self.run.world.services, self.run.of("requests", self.episode)
        most = max(map(len, services.stages))
        computed = np.zeros((len(requests), most), bool)
        for name, stages in zip(services.names, services.stages, strict=True):
            own = requests.loc[requests["service"] == name, "request_id"].to_numpy(np.int64)
            for number, (line, *_) in enumerate(stages):
                computed[own, number] = line == COMPUTING
        return computed

    def _queues(self, key: int, serving: Ints) -> list[TaskQueue]:
        """Return the queues at the processors; ``serving`` is the drone that serves each user."""
        if not self.run.world.services.has_tasks:
            return []
        on = self.standing.on(key)
        sites, at_work = self.standing.drone[on], serving[self.standing.user[on]] >= 0
        senders = self.run.scenario.drone_count + len(self.run.scenario.access_points)
        counts = [np.bincount(sites[of], minlength=senders) for of in (at_work, ~at_work)]
        return [TaskQueue(*each) for each in np.transpose(counts).tolist()]

    def _spells(self, begins: str, ends: str) -> Spells:
        """Return each beginning with its end, which is the next of the same drone and user."""
        events = self.events[self.events["kind"].isin([begins, ends])]
        events = events.sort_values(["drone", "user"], kind="stable")
        first, last = events["kind"] == begins, events["kind"] == ends
        if first.sum() != last.sum():
            raise self._unfit("events", f"not every {begins} has a {ends}")

        def column(name: str, rows: pd.Series) -> Ints:
            return np.asarray(events.loc[rows, name].fillna(-1), np.int64)

        return Spells(
            *(column(name, first) for name in ("drone", "user", "request_id", "key", "t_us")),
            *(column(name, last) for name in ("key", "t_us")),
        )

    @cached_property
    def _requests(self) -> RequestTimes:
        requests = self.run.of("requests", self.episode)
        events = self.events.dropna(subset=["request_id"])
        opened = events[events["kind"] == "request"]
        closed = events[events["kind"].isin(CLOSES)]

        def key_of(rows: pd.DataFrame) -> Ints:
            keys = pd.Series(rows["key"].to_numpy(), rows["request_id"].to_numpy(np.int64))
            return np.asarray(keys[requests["request_id"]], np.int64)

        columns = [requests[name].to_numpy() for name in RequestTimes._fields[:4]]
        full_s = full_service_s(requests)
        return RequestTimes._make([*columns, full_s, key_of(opened), key_of(closed)])

    def _users_at(self, key: int) -> tuple[Ints, Ints, Ints]:
        """Return by user the drone it is attached to and the one that serves it, and who asks."""
        count = len(self.run.world.homes)
        holders, serving = np.full(count, -1), np.full(count, -1)
        for drones, spells in ((holders, self.attachments), (serving, self.services)):
            on = spells.on(key)
            drones[spells.user[on]] = spells.drone[on]
        requests = self._requests
        is_open = (requests.from_key <= key) & (key < requests.to_key)
        return holders, serving, requests.user[is_open]

    @cached_property
    def walks(self) -> WayPoints:
        """The walks of the users."""
        return WayPoints(self.run.of("users", self.episode), len(self.run.world.homes))

    # ---- measures

    def _measures(self, t_us: int, key: int) -> Measures:
        """Return the quality of experience so far, including that of open requests."""
        requests, attachments = self._requests, self.attachments
        underway = requests.from_key <= key
        held_us = attachments.lasted_us(t_us, key).sum()
        users = len(self.run.world.homes)
        qoe3 = float(100 * held_us / (t_us * users)) if t_us else None
        if not underway.any():
            return Measures(None, None, qoe3)
        served_us = self._served_us(t_us, key)[underway]
        end_s = np.minimum(requests.t_end_s[underway], t_us / US)
        open_us = (end_s - requests.t_request_s[underway]) * US
        qoe1 = 100 * float((served_us / US / requests.full_service_s[underway]).mean())
        qoe2 = float((open_us - served_us).mean()) / self.run.world.step_us
        return Measures(qoe1, qoe2, qoe3)

    def _served_us(self, t_us: int, key: int) -> Floats:
        """Return for how long each request has been served, by a drone, by its user, or by both."""
        ids, served, own = self._requests.request_id, self.services, self.own_parts
        of_request = np.searchsorted(ids, served.request_id)
        counted_us = np.bincount(of_request, served.lasted_us(t_us, key), len(ids))
        lasted_us: Floats = counted_us.astype(np.float64)
        if not len(own.request_id):
            return lasted_us
        of_own = np.searchsorted(ids, own.request_id)
        begun_us, ended_us = np.zeros((2, len(ids)))
        begun_us[of_own], ended_us[of_own] = own.from_us, np.minimum(own.to_us, t_us)
        own_us = np.maximum(ended_us - begun_us, 0.0)
        last_us = np.minimum(ended_us[of_request], np.minimum(served.to_us, t_us))
        both_us = np.maximum(last_us - np.maximum(begun_us[of_request], served.from_us), 0.0)
        return lasted_us + own_us - np.bincount(of_request, both_us, len(ids))


class RequestTimes(NamedTuple):
    """The requests of an episode as columns, in order of their numbers.

    Each is completed once it has been served for ``full_service_s`` (see ``report.links``).
    """

    request_id: Ints
    user: Ints
    t_request_s: Floats
    t_end_s: Floats
    full_service_s: Floats
    from_key: Ints
    to_key: Ints


class Spells(NamedTuple):
    """Intervals of one drone and one user each, as columns; see ``PHASES`` for the keys."""

    drone: Ints
    user: Ints
    request_id: Ints
    from_key: Ints
    from_us: Ints
    to_key: Ints
    to_us: Ints

    def on(self, key: int) -> NDArray[np.bool_]:
        """Return which intervals contain an instant."""
        return (self.from_key <= key) & (key < self.to_key)

    def lasted_us(self, t_us: int, key: int) -> Ints:
        """Return how long each interval has lasted at an instant."""
        underway = self.from_key <= key
        return np.where(underway, np.minimum(self.to_us, t_us) - self.from_us, 0)
