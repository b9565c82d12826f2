"""A run in the compact form a page carries: what does not change, and a block for each episode."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from desim_uav.errors import PolicyError
from desim_uav.model.rules import US, Action, Mode, Phase
from desim_uav.records import EPISODES
from desim_uav.report.batteries import batteries_before_us, battery_knots
from desim_uav.report.replay.columns import Column, codes, delta, floats, pack, plain
from desim_uav.report.run import Run, Tables

if TYPE_CHECKING:
    import pandas as pd

FORMAT = 1
CENTIMETRE = 0.01

KINDS = (
    *("request", "serve", "stop", "complete", "refuse", "close"),
    *("enter", "exit", "attach", "detach"),
    *("decide", "depart", "blocked", "arrive", "land", "charge", "charged"),
    *("deplete", "crash", "respawn"),
)
"""Of events; a page knows them by their place here."""

TAKING = {"enter": 1, "attach": 2, "serve": 3, "refuse": 3}
"""In a phase, whatever lets go of a user comes before what takes it, and that in this order."""

NAMES_DRONE = {*KINDS[6:]} | {"serve", "stop"}
NAMES_USER = {*KINDS[:10]}
NAMES_REQUEST = {*KINDS[:6]}
NAMES_STATION = {"land", "charge", "charged", "respawn"}

Whole = NDArray[np.int64]


class Encoder:
    """Makes the blocks of a folder's episodes, and then what they have in common."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.scenario = run.scenario
        self.drones = self.scenario.drones.count
        self.users = len(run.map["users"])
        self.services = list(self.scenario.services)
        self.step_us = round(self.scenario.episode.step_s * US)
        battery = self.scenario.drones.battery
        self.capacity_us = None if battery is None else round(battery.autonomy_min * 60 * US)
        self.full_charge_us = round(self.scenario.stations.full_charge_min * 60 * US)
        self.profiles: list[list[list[float]]] = []
        self._profile_of: dict[tuple[bool, float], tuple[int, int]] = {}

    # ---- one episode

    def episode(self, number: int, tables: Tables) -> bytes:
        """The block of an episode. Raises PolicyError for tables that do not fit together."""
        duration_us = round(float(self._row(number)["duration_s"]) * US)
        events = self._events(tables["events"], len(tables["requests"]), duration_us)
        columns = self._requests(tables["requests"])
        columns |= {f"event.{name}": column for name, column in _event_columns(events).items()}
        columns |= self._legs(tables["legs"])
        columns |= self._walks(tables["users"])
        columns |= self._steps(tables["steps"], duration_us)
        columns |= self._batteries(number, tables["steps"], events)
        return pack(columns)

    def _row(self, number: int) -> dict[str, Any]:
        episodes = self.run.table("episodes")
        rows = episodes[episodes["episode"] == number].to_dict("records")
        self._expect(len(rows) == 1, "episodes", f"episode {number} has {len(rows)} rows, not one")
        row = cast("dict[str, Any]", rows[0])
        duration_s = row["duration_s"]
        self._expect(
            0 < duration_s <= 1e9, "episodes", f"episode {number}: duration_s: {duration_s}"
        )
        return row

    def _requests(self, requests: pd.DataFrame) -> dict[str, Column]:
        requests = requests.sort_values("request_id")
        numbers = requests["request_id"].to_numpy()
        self._expect(
            np.array_equal(numbers, np.arange(len(numbers))),
            "requests",
            "request_id: not numbered from 0 on in each episode",
        )
        self._within(requests, "requests", "user", self.users)
        service = requests["service"].map({name: k for k, name in enumerate(self.services)})
        unknown = requests["service"][service.isna()]
        self._expect(
            unknown.empty,
            "requests",
            f"service: {next(iter(unknown), None)!r} is not in scenario.yaml",
        )
        required_us = self._us(requests, "requests", "requested_s", 1)
        return {
            "request.user": plain(requests["user"]),
            "request.service": codes(service),
            "request.t_us": delta(self._us(requests, "requests", "t_request_s", 0)),
            "request.required_us": plain(required_us),
            "request.bandwidth_bps": plain(self._bandwidth_bps(requests)),
        }

    def _bandwidth_bps(self, requests: pd.DataFrame) -> Whole:
        kbps = requests["bandwidth_kbps"].to_numpy(float)
        self._expect(
            bool(((kbps >= 0) & (kbps <= 1e9)).all()), "requests", "bandwidth_kbps: out of range"
        )
        return _whole(kbps * 1000)

    def _events(self, events: pd.DataFrame, requests: int, duration_us: int) -> dict[str, Whole]:
        """The events in a reader's order, what they do not concern as -1."""
        kind = events["kind"].map({name: k for k, name in enumerate(KINDS)})
        unknown = events["kind"][kind.isna()]
        self._expect(unknown.empty, "events", f"kind: {next(iter(unknown), None)!r} is not known")
        found: dict[str, Whole] = {
            name: events[name].fillna(-1).to_numpy(np.int64)
            for name in ("t_us", "phase", "drone", "user", "request_id", "station")
        }
        found["kind"] = kind.to_numpy(np.int64)
        limits = {
            "t_us": (NOTHING, duration_us + 1),
            "phase": (NOTHING, max(Phase) + 1),
            "drone": (NAMES_DRONE, self.drones),
            "user": (NAMES_USER, self.users),
            "request_id": (NAMES_REQUEST, requests),
            "station": (NAMES_STATION, len(self.run.map["stations"])),
        }
        for name, (kinds, end) in limits.items():
            values = found[name]
            needed = np.isin(found["kind"], [KINDS.index(word) for word in sorted(kinds)])
            lowest = np.where(needed, 0, -1) if kinds else np.zeros(len(values), np.int64)
            within = bool(((values >= lowest) & (values < end)).all())
            self._expect(within, "events", f"{name}: not of this run (0 to {end - 1})")
        rank = np.array([TAKING.get(name, 0) for name in KINDS])[found["kind"]]
        order = np.lexsort((rank, found["phase"], found["t_us"]))
        return {name: values[order] for name, values in found.items()}

    def _legs(self, legs: pd.DataFrame) -> dict[str, Column]:
        """Legs drone by drone, each in order of time, with the profile it was flown by."""
        self._within(legs, "legs", "drone", self.drones)
        legs = legs.sort_values("drone", kind="stable")
        t_us = self._us(legs, "legs", "t_s", -(10**15))
        drone = legs["drone"].to_numpy(np.int64)
        first = np.searchsorted(drone, np.arange(self.drones + 1))
        told = np.diff(first) > 0
        self._expect(bool(told.all()), "legs", "a drone has none: where it begins is not told")
        ascends = (np.diff(t_us) >= 0) | (np.diff(drone) > 0)
        self._expect(bool(ascends.all()), "legs", "t_s: not in order")
        self._expect(bool((t_us[first[:-1]] <= 0).all()), "legs", "a drone's first is after 0")
        duration_us = self._us(legs, "legs", "duration_s", 0)
        places = {}
        for side in ("from", "to"):
            for axis in "xyz":
                places[f"leg.{axis}_{side}"] = floats(
                    self._finite(legs, "legs", f"{axis}_{side}_m")
                )
        mode = self._codes(legs, "legs", "mode", Mode)
        profile = self._flown_by(places, mode, duration_us)
        return places | {
            "leg.first": plain(first),
            "leg.t_us": delta(t_us),
            "leg.duration_us": plain(duration_us),
            "leg.mode": codes(mode),
            "leg.profile": plain(profile),
        }

    def _flown_by(self, places: dict[str, Column], mode: Whole, duration_us: Whole) -> Whole:
        """Of each leg the number of its profile, -1 of one that leads nowhere."""
        between = [
            np.abs(
                places[f"leg.{axis}_to"].values.astype(float)
                - places[f"leg.{axis}_from"].values.astype(float)
            )
            for axis in "xyz"
        ]
        length_m = np.sum(between, axis=0)
        profile = np.full(len(mode), -1, np.int64)
        for k in np.flatnonzero(duration_us > 0):
            number, takes_us = self._profile(int(mode[k]) == Mode.FLYING, float(length_m[k]))
            self._expect(
                abs(takes_us - int(duration_us[k])) <= 1,
                "legs",
                f"duration_s: {length_m[k]:g} m take {takes_us / US:g} s in this scenario, "
                f"not {duration_us[k] / US:g}",
            )
            profile[k] = number
        return profile

    def _profile(self, commanded: bool, length_m: float) -> tuple[int, int]:
        """The number of the profile of a transit, and how long it takes (µs)."""
        key = commanded, round(length_m, 6)
        if key not in self._profile_of:
            motion = self.scenario.drones.motion
            self._expect(length_m > 0, "legs", "a transit leads nowhere")
            try:
                transit = (
                    motion.epoch_transit(length_m, self.scenario.episode.step_s)
                    if commanded
                    else motion.fastest_transit(length_m)
                )
            except ValueError as error:
                raise self._error("legs", str(error)) from error
            self._profile_of[key] = len(self.profiles), transit.duration_us
            # As shares of the way: x = from + share * (to - from).
            shares = transit.profile / [1.0, length_m, length_m, length_m]
            self.profiles.append(shares.tolist())
        return self._profile_of[key]

    def _walks(self, users: pd.DataFrame) -> dict[str, Column]:
        """The way points of all walks, user by user."""
        self._within(users, "users", "user", self.users)
        users = users.sort_values(["user", "t_s"], kind="stable")
        user = users["user"].to_numpy(np.int64)
        first = np.searchsorted(user, np.arange(self.users + 1))
        self._expect(bool((np.diff(first) > 0).all()), "users", "a user has no way point")
        heights_m = self._finite(users, "users", "z_m")[first[:-1]]
        return {
            "walk.count": plain(np.diff(first)),
            "walk.t_us": delta(self._us(users, "users", "t_s", 0)),
            "walk.x": delta(self._finite(users, "users", "x_m"), CENTIMETRE),
            "walk.y": delta(self._finite(users, "users", "y_m"), CENTIMETRE),
            "walk.z": delta(heights_m, CENTIMETRE),
        }

    def _steps(self, steps: pd.DataFrame, duration_us: int) -> dict[str, Column]:
        """Step by step, in each drone by drone: its reward and its command."""
        steps = steps.sort_values(["step", "drone"])
        count = len(steps) // self.drones
        grid = np.divmod(np.arange(count * self.drones), self.drones)
        whole = len(steps) == len(grid[0]) and all(
            np.array_equal(steps[name].to_numpy(), values)
            for name, values in zip(("step", "drone"), grid, strict=True)
        )
        self._expect(whole, "steps", "not a row for each step and drone")
        self._expect(count * self.step_us == duration_us, "steps", "not those of the whole episode")
        return {
            "step.reward": floats(self._finite(steps, "steps", "reward")),
            "step.told": codes(self._codes(steps, "steps", "action", Action, none=len(Action))),
            "step.taken": codes(self._codes(steps, "steps", "action_taken", Action)),
        }

    def _batteries(
        self, number: int, steps: pd.DataFrame, events: dict[str, Whole]
    ) -> dict[str, Column]:
        if self.capacity_us is None:
            return {}
        counts, times, values = [], [], []
        begins_with = batteries_before_us(self.run, number)
        for drone in range(self.drones):
            own = steps[steps["drone"] == drone].sort_values("step")
            records = self._us(own, "steps", "battery_s", 0)
            mine = (events["drone"] == drone) & (events["user"] < 0)
            told = [
                (int(t), KINDS[kind])
                for t, kind in zip(events["t_us"][mine], events["kind"][mine], strict=True)
            ]
            knots = battery_knots(
                begins_with[drone],
                [(self.step_us * (k + 1), int(b)) for k, b in enumerate(records)],
                told,
                self.capacity_us,
                self.full_charge_us,
            )
            counts.append(len(knots))
            times += [t for t, _ in knots]
            values += [value for _, value in knots]
        return {
            "battery.count": plain(counts),
            "battery.t_us": delta(times),
            "battery.us": delta(values),
        }

    # ---- what episodes have in common

    def common(self, episodes: Sequence[int]) -> dict[str, Any]:
        """What a page is told of the run, once the blocks of its episodes are made."""
        scenario, manifest, world = self.scenario, self.run.manifest, self.run.map
        kbps = scenario.drones.bandwidth_kbps
        return {
            "format": FORMAT,
            "scenario": manifest["scenario"],
            "policy": manifest["policy"],
            "seed": str(manifest["seed"]),
            "world_seed": str(self.run.settings.world_seed),
            "drones": self.drones,
            "users": self.users,
            "services": self.services,
            "step_us": self.step_us,
            "footprint_m": scenario.drones.footprint_radius_m,
            "bandwidth_bps": None if kbps is None else round(kbps * 1000),
            "capacity_us": self.capacity_us,
            "pads": scenario.stations.pads,
            "three_d": scenario.three_d,
            "map": {key: world[key] for key in ("size_m", "cells", "stations", "clusters")}
            | {
                "cell_height_m": [
                    [round(h, 2) for h in column] for column in world["cell_height_m"]
                ]
            },
            "kinds": KINDS,
            "modes": [mode.name.lower() for mode in Mode],
            "actions": [action.name.lower() for action in Action],
            "record_phase": int(Phase.RECORD),
            "profiles": self.profiles,
            "episodes": [self._measured(number) for number in episodes],
        }

    def _measured(self, number: int) -> dict[str, Any]:
        row = self._row(number)
        return {
            name: None if isinstance(row[name], float) and math.isnan(row[name]) else row[name]
            for name in EPISODES
        } | {"duration_us": round(row["duration_s"] * US)}

    # ---- what tables must be

    def _error(self, table: str, problem: str) -> PolicyError:
        return PolicyError(f"{self.run.folder / table}.parquet: {problem}")

    def _expect(self, holds: bool, table: str, problem: str) -> None:
        if not holds:
            raise self._error(table, problem)

    def _finite(self, frame: pd.DataFrame, table: str, name: str) -> NDArray[np.float64]:
        values: NDArray[np.float64] = frame[name].to_numpy(np.float64)
        fits = bool((np.isfinite(values) & (np.abs(values) < 1e9)).all())
        self._expect(fits, table, f"{name}: empty or far too large")
        return values

    def _us(self, frame: pd.DataFrame, table: str, name: str, lowest: int) -> Whole:
        us = _whole(self._finite(frame, table, name) * US)
        self._expect(bool((us >= lowest).all()), table, f"{name}: below {lowest / US:g} s")
        return us

    def _within(self, frame: pd.DataFrame, table: str, name: str, end: int) -> None:
        values = frame[name].to_numpy()
        within = bool(((values >= 0) & (values < end)).all())
        self._expect(within, table, f"{name}: not of this run (0 to {end - 1})")

    def _codes(
        self, frame: pd.DataFrame, table: str, name: str, words: Any, none: int | None = None
    ) -> Whole:
        code = frame[name].map({word.name.lower(): int(word) for word in words})
        if none is not None:
            code = code.where(frame[name].notna(), none)
        unknown = frame[name][code.isna()]
        self._expect(unknown.empty, table, f"{name}: {next(iter(unknown), None)!r} is not known")
        return _whole(code.to_numpy(np.float64))


NOTHING: frozenset[str] = frozenset()


def _whole(values: NDArray[np.float64]) -> Whole:
    return np.rint(values).astype(np.int64)


def _event_columns(events: dict[str, Whole]) -> dict[str, Column]:
    return {
        "t_us": delta(events["t_us"]),
        "phase": codes(events["phase"]),
        "kind": codes(events["kind"]),
        "drone": plain(events["drone"]),
        "user": plain(events["user"]),
        "request": plain(events["request_id"]),
        "station": plain(events["station"]),
    }
