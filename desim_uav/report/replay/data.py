"""A run in the compact form of a page: common data, and a block for each episode."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from desim_uav.model.catalogue import Catalogue
from desim_uav.model.geometry.city import City
from desim_uav.model.rules import GROUNDED, US, Action, Mode, Phase, Variant
from desim_uav.model.services import COMPUTING
from desim_uav.records import EPISODES
from desim_uav.report.batteries import battery_curve, charges_before
from desim_uav.report.links import full_service_s, links_content, mean_rate_bps
from desim_uav.report.replay.checks import Checks, Whole, whole
from desim_uav.report.replay.columns import Column, codes, delta, floats, pack, plain
from desim_uav.report.replay.flights import Flights
from desim_uav.report.run import Run, Tables
from desim_uav.report.tracks import Track
from desim_uav.rules import words
from desim_uav.rules.words import EVENT_KINDS, LEADS_TO
from desim_uav.user_group import streets_of

if TYPE_CHECKING:
    import pandas as pd

CENTIMETRE = 0.01

KINDS = EVENT_KINDS
"""The kinds of events; a page refers to them by their index."""

TAKING = {"enter": 1, "attach": 2, "serve": 3, "refuse": 3}
"""The order within a phase: these events come after all others, in the order of the numbers."""

OF_LINKS = {"class", "handover", "ping_pong", "outage", "outage_end"}
OF_PAIRS = {"conflict", "clear"}
OF_REQUESTS = {*KINDS[:6], "stage", "late", "compute", "computed", "move"}
OF_UPDATES = {EVENT_KINDS[kind] for kind in words.OF_UPDATES}
NO_DRONE = OF_REQUESTS | {"outage", "outage_end", "generate", "drop"}
NAMES_DRONE = ({*KINDS} - NO_DRONE) | {"serve", "stop", "move"}
NAMES_USER = {*KINDS[:10]} | OF_REQUESTS | OF_LINKS | OF_UPDATES
NAMES_REQUEST = OF_REQUESTS
NAMES_STATION = {"land", "charge", "charged", "respawn"}


class Encoder:
    """Makes the blocks of a run's episodes, and then the data that they have in common."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.scenario = run.scenario
        self.drones = self.scenario.drone_count
        self.senders = self.drones + len(self.scenario.access_points)
        self.users = len(run.map["users"])
        self.services = list(self.scenario.services)
        self.step_us = round(self.scenario.episode.step_s * US)
        variants = [each for each in run.world.actions if isinstance(each, Variant)]
        self.actions = [action.name.lower() for action in (*Action, *variants)]
        self.types = [run.world.type_of(drone) for drone in range(self.drones)]
        self.check = Checks(run)
        self.flights = Flights(self.check)

    # ---- one episode

    def episode(self, number: int, tables: Tables) -> bytes:
        """Return the block of an episode. Raises PolicyError for tables that do not fit."""
        duration_us = round(float(self._row(number)["duration_s"]) * US)
        taken = self._updates(number)
        updates = len(next(iter(taken.values())).values) if taken else 0
        events = self._events(tables["events"], len(tables["requests"]), updates, duration_us)
        columns = self._requests(tables["requests"]) | taken
        columns |= {f"event.{name}": column for name, column in _event_columns(events).items()}
        columns |= self.flights.legs(tables["legs"])
        columns |= self._walks(tables["users"])
        columns |= self._steps(tables["steps"], duration_us)
        columns |= self._batteries(number, tables, events, duration_us)
        return pack(columns)

    def _row(self, number: int) -> dict[str, Any]:
        episodes = self.run.table("episodes")
        rows = episodes[episodes["episode"] == number].to_dict("records")
        self.check.expect(
            len(rows) == 1, "episodes", f"episode {number} has {len(rows)} rows, not one"
        )
        row = cast("dict[str, Any]", rows[0])
        duration_s = row["duration_s"]
        self.check.expect(
            0 < duration_s <= 1e9, "episodes", f"episode {number}: duration_s: {duration_s}"
        )
        return row

    def _requests(self, requests: pd.DataFrame) -> dict[str, Column]:
        requests = requests.sort_values("request_id")
        numbers = requests["request_id"].to_numpy()
        self.check.expect(
            np.array_equal(numbers, np.arange(len(numbers))),
            "requests",
            "request_id: not numbered from 0 in each episode",
        )
        self.check.within(requests, "requests", "user", self.users)
        service = requests["service"].map({name: k for k, name in enumerate(self.services)})
        unknown = requests["service"][service.isna()]
        self.check.expect(
            unknown.empty,
            "requests",
            f"service: {next(iter(unknown), None)!r} is not in scenario.yaml",
        )
        required_us = full_service_s(requests) * US
        self.check.expect(bool((required_us >= 0.999).all()), "requests", "requested_s: below 1 µs")
        volumes = np.zeros(len(numbers))
        if "requested_mbit" in requests:
            volumes = requests["requested_mbit"].fillna(0.0).to_numpy(float)
        return {
            "request.user": plain(requests["user"]),
            "request.service": codes(service),
            "request.t_us": delta(self.check.us(requests, "requests", "t_request_s", 0)),
            "request.required_us": floats(np.minimum(required_us, 1e18)),
            "request.mbit": floats(volumes),
            "request.bandwidth_bps": plain(self._bandwidth_bps(requests)),
        } | self._deadlines(requests)

    def _deadlines(self, requests: pd.DataFrame) -> dict[str, Column]:
        """Return the deadlines of requests in µs, -1 for those without one; none without tasks."""
        if not self.run.world.services.has_tasks:
            return {}
        deadlines_s = requests.assign(deadline_s=requests["deadline_s"].fillna(-1 / US))
        return {
            "request.deadline_us": delta(self.check.us(deadlines_s, "requests", "deadline_s", -1))
        }

    def _bandwidth_bps(self, requests: pd.DataFrame) -> Whole:
        bps = mean_rate_bps(requests)
        self.check.expect(
            bool(((bps >= 0) & (bps <= 1e12)).all()), "requests", "bandwidth_kbps: out of range"
        )
        return whole(bps)

    def _updates(self, number: int) -> dict[str, Column]:
        """Return when each update of an episode was taken; no column if there are no sensors."""
        if not self.run.world.senses:
            return {}
        updates = self.run.of("updates", number).sort_values("update")
        self.check.expect(
            np.array_equal(updates["update"].to_numpy(), np.arange(len(updates))),
            "updates",
            "update: not numbered from 0 in each episode",
        )
        return {"update.t_us": delta(self.check.us(updates, "updates", "t_generated_s", 0))}

    def _events(
        self, events: pd.DataFrame, requests: int, updates: int, duration_us: int
    ) -> dict[str, Whole]:
        """Return the events in the order of the page, with -1 for missing numbers."""
        kind = events["kind"].map({name: k for k, name in enumerate(KINDS)})
        unknown = events["kind"][kind.isna()]
        self.check.expect(
            unknown.empty, "events", f"kind: {next(iter(unknown), None)!r} is not known"
        )
        columns: dict[str, Whole] = {
            name: events[name].fillna(-1).to_numpy(np.int64)
            for name in ("t_us", "phase", "drone", "user", "request_id", "station")
        }
        columns["kind"] = kind.to_numpy(np.int64)
        columns["link_class"] = np.full(len(events), -1, np.int64)
        if self.run.world.graded:
            columns["link_class"] = events["link_class"].fillna(-1).to_numpy(np.int64)
        columns["other"] = np.full(len(events), -1, np.int64)
        if self.scenario.separation_m is not None:
            columns["other"] = events["other"].fillna(-1).to_numpy(np.int64)
        if self.run.world.services.several_stages:
            columns["stage"] = events["stage"].fillna(-1).to_numpy(np.int64)
        if self.run.world.senses:
            columns["update"] = events["update"].fillna(-1).to_numpy(np.int64)
        limits = {
            "t_us": (NOTHING, duration_us + 1),
            "phase": (NOTHING, max(Phase) + 1),
            "drone": (NAMES_DRONE, self.senders),
            "other": (OF_PAIRS, self.drones),
            "user": (NAMES_USER, self.users),
            "request_id": (NAMES_REQUEST, requests),
            "station": (NAMES_STATION, len(self.run.map["stations"])),
        }
        if "update" in columns:
            limits["update"] = (OF_UPDATES, updates)
        if "stage" in columns:
            limits["stage"] = ({"stage"}, max(map(len, self.run.world.services.stages)))
        for name, (kinds, end) in limits.items():
            values = columns[name]
            needed = np.isin(columns["kind"], [KINDS.index(word) for word in sorted(kinds)])
            lowest = np.where(needed, 0, -1) if kinds else np.zeros(len(values), np.int64)
            within = bool(((values >= lowest) & (values < end)).all())
            self.check.expect(within, "events", f"{name}: not of this run (0 to {end - 1})")
        flown = (columns["user"] < 0) & (columns["drone"] >= self.drones)
        self.check.expect(not flown.any(), "events", "drone: an access point does not fly")
        rank = np.array([TAKING.get(name, 0) for name in KINDS])[columns["kind"]]
        order = np.lexsort((rank, columns["phase"], columns["t_us"]))
        return {name: values[order] for name, values in columns.items()}

    def _walks(self, users: pd.DataFrame) -> dict[str, Column]:
        """Return the way points of all walks, user by user."""
        self.check.within(users, "users", "user", self.users)
        users = users.sort_values(["user", "t_s"], kind="stable")
        user = users["user"].to_numpy(np.int64)
        first = np.searchsorted(user, np.arange(self.users + 1))
        self.check.expect(bool((np.diff(first) > 0).all()), "users", "a user has no way point")
        heights_m = self.check.finite(users, "users", "z_m")[first[:-1]]
        return {
            "walk.count": plain(np.diff(first)),
            "walk.t_us": delta(self.check.us(users, "users", "t_s", 0)),
            "walk.x": delta(self.check.finite(users, "users", "x_m"), CENTIMETRE),
            "walk.y": delta(self.check.finite(users, "users", "y_m"), CENTIMETRE),
            "walk.z": delta(heights_m, CENTIMETRE),
        }

    def _steps(self, steps: pd.DataFrame, duration_us: int) -> dict[str, Column]:
        """Return the ends of steps, and the rewards and commands by step and drone."""
        steps = steps.sort_values(["step", "drone"])
        count = len(steps) // self.drones
        grid = np.divmod(np.arange(count * self.drones), self.drones)
        complete = len(steps) == len(grid[0]) and all(
            np.array_equal(steps[name].to_numpy(), values)
            for name, values in zip(("step", "drone"), grid, strict=True)
        )
        self.check.expect(complete, "steps", "not a row for each step and drone")
        ends_us = self.check.us(steps, "steps", "t_s", 0).reshape(count, self.drones)
        begins_us = np.concatenate((np.zeros(1, np.int64), ends_us[:-1, 0]))
        lasts_us = ends_us[:, 0] - begins_us
        fit = (lasts_us > 0) if self.scenario.decisions.by_event else (lasts_us == self.step_us)
        same = ends_us == ends_us[:, :1]
        self.check.expect(bool(fit.all() and same.all()), "steps", "t_s: not the ends of steps")
        self.check.expect(
            count > 0 and bool((ends_us[-1] == duration_us).all()),
            "steps",
            "they do not cover the whole episode",
        )
        return {
            "step.t_us": delta(ends_us[:, 0]),
            "step.reward": floats(self.check.finite(steps, "steps", "reward")),
            "step.told": codes(
                self.check.codes(steps, "steps", "action", self.actions, none=len(self.actions))
            ),
            "step.taken": codes(self.check.codes(steps, "steps", "action_taken", self.actions)),
        }

    def _batteries(
        self, number: int, tables: Tables, events: dict[str, Whole], duration_us: int
    ) -> dict[str, Column]:
        if not self.scenario.limited_battery:
            return {}
        counts, times, values = [], [], []
        steps, legs = tables["steps"], tables["legs"]
        begins_with = charges_before(self.run, number)
        for drone, drone_type in enumerate(self.types):
            if not drone_type.limited:
                counts.append(0)
                continue
            own = steps[steps["drone"] == drone].sort_values("step")
            self.check.us(own, "steps", "battery_s", 0)
            records = [
                (round(t_s * US), round(left_s * drone_type.drain_per_s))
                for t_s, left_s in zip(own["t_s"], own["battery_s"], strict=True)
            ]
            mine = (events["drone"] == drone) & (events["user"] < 0)
            happened = [
                (int(t), KINDS[kind])
                for t, kind in zip(events["t_us"][mine], events["kind"][mine], strict=True)
            ]
            knots = battery_curve(
                drone_type,
                Track(legs[legs["drone"] == drone], self.run, drone),
                begins_with[drone],
                records,
                happened,
                duration_us,
            )
            counts.append(len(knots))
            times += [t for t, _ in knots]
            values += [drone_type.hover_us(value) for _, value in knots]
        return {
            "battery.count": plain(counts),
            "battery.t_us": delta(times),
            "battery.us": delta(values),
        }

    # ---- the data that episodes have in common

    def common(self, episodes: Sequence[int]) -> dict[str, Any]:
        """Return the common data of a run, after the blocks of its episodes were made."""
        scenario, manifest, world = self.scenario, self.run.manifest, self.run.map
        return links_content(self.run.world) | {
            "scenario": manifest["scenario"],
            "name": manifest.get("name", ""),
            "policy": manifest["policy"],
            "seed": str(manifest["seed"]),
            "world_seed": str(self.run.settings.world_seed),
            "fork": fork_in(manifest),
            "drones": self.drones,
            "senders": self.senders,
            "users": self.users,
            "groups": list(scenario.group_names),
            "group_of": list(scenario.group_numbers) if scenario.group_names else [],
            "services": self.services,
            "computed": computed_stages(self.run.world.services),
            "senses": list(self.run.world.senses),
            "step_us": self.step_us,
            "by_event": scenario.decisions.by_event,
            "pads": scenario.stations.pads,
            "three_d": scenario.three_d,
            "wind_mps": list(scenario.wind_mps),
            "separation_m": scenario.separation_m,
            "map": {key: world[key] for key in ("size_m", "cells", "stations", "clusters")}
            | {
                "cell_height_m": [
                    [round(h, 2) for h in column] for column in world["cell_height_m"]
                ],
                "streets": [np.round(line, 1).tolist() for line in streets_of(scenario)],
                "buildings": buildings_of(self.run.world.grid.city),
                "attribution": self.run.world.attribution,
                "zones": [
                    {"polygon_m": zone.polygon_m, "altitude_m": zone.altitude_m}
                    for zone in scenario.map.no_fly
                ],
            },
            "kinds": KINDS,
            "leads_to": {kind: int(mode) for kind, mode in LEADS_TO.items()},
            "modes": [mode.name.lower() for mode in Mode],
            "grounded": sorted(map(int, GROUNDED)),
            "actions": self.actions,
            "record_phase": int(Phase.RECORD),
            "profiles": self.flights.profiles,
            "powers": self.flights.powers,
            "episodes": [self._measured(number) for number in episodes],
        }

    def _measured(self, number: int) -> dict[str, Any]:
        row = self._row(number)
        return {
            name: None if isinstance(row[name], float) and math.isnan(row[name]) else row[name]
            for name in EPISODES
        } | {"duration_us": round(row["duration_s"] * US)}


def buildings_of(city: City) -> list[dict[str, Any]]:
    """Return the convex pieces of buildings: corners, height, and the edges without a wall."""
    return [
        {"polygon_m": np.round(piece, 1).tolist(), "height_m": round(roof_m, 1)}
        | ({"inner": np.flatnonzero(inner).tolist()} if inner.any() else {})
        for piece, roof_m, inner in zip(
            city.pieces_m, city.roofs_m.tolist(), city.inner, strict=True
        )
    ]


def fork_in(manifest: dict[str, Any]) -> dict[str, int] | None:
    """Return the episode and the time at which a branch of a run begins; None for other runs."""
    fork: Any = manifest.get("fork")
    names = ("episode", "t_us") if isinstance(fork, dict) else ()
    numbers: dict[str, Any] = {name: fork.get(name) for name in names}
    if not numbers or not all(
        type(value) is int and 0 <= value < 2**53 for value in numbers.values()
    ):
        return None
    return numbers


NOTHING: frozenset[str] = frozenset()


def computed_stages(services: Catalogue) -> list[list[int]]:
    """Return for each stage of each service whether a processor does it; [] if there are no tasks.

    Services are in the order of their names in the scenario.
    """
    if not services.has_tasks:
        return []
    return [[int(line == COMPUTING) for line, *_ in stages] for stages in services.stages]


def _event_columns(events: dict[str, Whole]) -> dict[str, Column]:
    more = {name: plain(events[name]) for name in ("stage", "update") if name in events}
    return more | {
        "t_us": delta(events["t_us"]),
        "phase": codes(events["phase"]),
        "kind": codes(events["kind"]),
        "drone": plain(events["drone"]),
        "user": plain(events["user"]),
        "request": plain(events["request_id"]),
        "station": plain(events["station"]),
        "link_class": plain(events["link_class"]),
        "other": plain(events["other"]),
    }
