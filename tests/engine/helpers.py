"""Small worlds to be worked by hand, flights over them, and what an event log adds up to."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from hypothesis import strategies as st

from desim_uav.engine.base import EpisodeLog, Event, RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.engine.des.audit import audit
from desim_uav.model.admission import Waiting
from desim_uav.model.demand import Requests
from desim_uav.model.mobility import Walks
from desim_uav.model.rules import MOVES, Action, Outcome, Phase
from desim_uav.model.state import Snapshot
from desim_uav.sample_path import SamplePath
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world

US = 1_000_000
HOP_US = 30_990_663
"""A hop of 240 m in minimum time: 240 / 8.3 + 8.3 / 4 = 30.990662650602 s."""


# ---- worlds, sample paths and flights


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A mapping with the sections of another laid over its own."""
    return {
        key: {**base.get(key, {}), **value} if isinstance(value, Mapping) else value
        for key, value in {**base, **changes}.items()
    }


def strip(
    starts: Sequence[Sequence[int]] = ((0, 0),),
    users: Sequence[Sequence[float]] = ((0.0, 0.0),),
    cells: tuple[int, int] = (9, 1),
    steps: int = 3,
    radius_m: float = 100.0,
    battery: Mapping[str, Any] | None = None,
    stations: Mapping[str, Any] | None = None,
    timing: str = "minimum_time",
    bandwidth_kbps: float | None = None,
    **changes: Any,
) -> World:
    """Cells of 240 m, in a row along x unless told otherwise; a lone station in the middle."""
    base = {
        "map": {"size_m": [240 * cells[0], 240 * cells[1]], "cells": cells, "dimensions": 2},
        "drones": {
            "count": len(starts),
            "start_cells": starts,
            "footprint_radius_m": radius_m,
            "bandwidth_kbps": bandwidth_kbps,
            "motion": {"kind": "bang_coast_bang", "timing": timing},
            "battery": None if battery is None else {"kind": "endurance", **battery},
        },
        "stations": {"count": 0 if battery is None else 1, "radius_m": 0, **(stations or {})},
        "users": {"positions_m": users, "mobility": {"kind": "static"}},
        "demand": {"kind": "continuous"},
        "episode": {"steps": steps, "step_s": 60},
    }
    return build_world(from_mapping(merged(base, changes)), 0)


Ask = tuple[float, float, float]
"""(time or think time in s, required s, kbit/s)."""
Leg = tuple[float, float, float, float, float]
"""(from s, x, y, vx, vy)."""


def path_of(
    world: World,
    asks: Mapping[int, Sequence[Ask]] | None = None,
    *,
    thinking: bool = False,
    walks: Mapping[int, Sequence[Leg]] | None = None,
    error: Any = None,
    respawn: Any = None,
    episode: int = 0,
) -> SamplePath:
    """A sample path told in full: users stand at home and ask for nothing, unless said here.

    ``error``: for each drone the (x, y) in cells by which it is wrong at each decision epoch.
    """
    legs: list[list[float]] = []
    rows: list[list[int]] = []
    leg_offsets, row_offsets = [0], [0]
    for user, (x, y, _) in enumerate(world.homes.tolist()):
        own = (walks or {}).get(user, [(0.0, x, y, 0.0, 0.0)])
        legs += [[t * US, *rest] for t, *rest in own]
        leg_offsets.append(len(legs))
        for t_s, need_s, kbps in (asks or {}).get(user, ()):
            rows.append([round(t_s * US), 0, round(need_s * US), round(kbps * 1000)])
        row_offsets.append(len(rows))
    drones, epochs = world.scenario.drones.count, world.scenario.episode.steps + 1
    errors = None
    if error is not None:
        errors = np.zeros((drones, epochs, 2))
        for drone, of_drone in enumerate(error):
            errors[drone, : len(of_drone)] = of_drone
    places = np.zeros((drones, epochs), np.int64)
    if respawn is not None:
        for drone, of_drone in enumerate(respawn):
            places[drone, : len(of_drone)] = of_drone
    return SamplePath(
        episode,
        Walks(np.array(legs, float), np.array(leg_offsets)),
        Requests(np.array(rows, np.int64).reshape(-1, 4), np.array(row_offsets), thinking),
        errors,
        places,
    )


class Flight:
    """An engine on a world, told what to do in words: a text of actions for each drone."""

    def __init__(
        self,
        world: World,
        *,
        carry_over: bool = False,
        ceiling: bool = True,
        check: Callable[[Simulation], None] | None = audit,
    ) -> None:
        ceilings = (ceiling,) * world.scenario.drones.count
        self.world = world
        self.engine = Simulation(world, RunSettings(ceilings, carry_over, True), audit=check)
        self.shown: list[Snapshot] = []

    def episode(self, path: SamplePath, *told: str) -> EpisodeLog:
        """Fly an episode; missing actions are hover. ``shown`` holds its snapshots."""
        wanted = [text.split() for text in told]
        shown = self.engine.reset(path)
        self.shown = [shown]
        while not (shown.terminated or shown.truncated):
            shown = self.engine.step(
                [
                    self.command(wanted[d][shown.step] if shown.step < len(wanted[d]) else "hover")
                    if d < len(wanted)
                    else self.command("hover")
                    for d in range(self.world.scenario.drones.count)
                ]
            )
            self.shown.append(shown)
        return self.engine.log

    def command(self, word: str) -> int:
        """The index of an action by its name (``goto`` for short), or a number as it stands."""
        if word.lstrip("-").isdigit():
            return int(word)
        name = {"goto": "GOTO_CHARGING_STATION"}.get(word, word.upper())
        return self.world.actions.index(Action[name])


def fly(world: World, path: SamplePath, *told: str, **settings: Any) -> EpisodeLog:
    """One audited episode."""
    return Flight(world, **settings).episode(path, *told)


@dataclass(frozen=True)
class Loss:
    """An admission: what does not fit at once is refused for good."""

    def scan(
        self, waiting: Sequence[Waiting], free_bps: float
    ) -> tuple[list[Waiting], list[Waiting]]:
        served: list[Waiting] = []
        refused: list[Waiting] = []
        for request in waiting:
            fits = request.bandwidth_bps <= free_bps
            free_bps -= request.bandwidth_bps if fits else 0
            (served if fits else refused).append(request)
        return served, refused


# ---- event logs as they are written in a test


def events(text: str) -> list[Event]:
    """Lines of time (in µs), phase, kind, drone, user, request, station; ``-`` or nothing: none."""
    rows = []
    for line in text.strip().splitlines():
        t_us, phase, kind, *ids = line.split()
        concerned = [-1 if i == "-" else int(i) for i in ids] + [-1] * (4 - len(ids))
        rows.append((int(t_us), int(phase), kind, *concerned))
    return rows  # type: ignore[return-value]


def seen(log: EpisodeLog, *kinds: str) -> list[Event]:
    """A log's events of these kinds (none given: all but the decisions), phases as numbers."""
    assert log.events is not None
    return [
        (t_us, int(phase), kind, *ids)  # type: ignore[misc]
        for t_us, phase, kind, *ids in log.events
        if (kind in kinds if kinds else kind != "decide")
    ]


# ---- what a log adds up to


@dataclass
class Told:
    """A request as the events tell it."""

    user: int
    t_request_us: int
    served_us: int = 0
    attached_us: int = 0
    interruptions: int = 0
    t_first_us: int | None = None
    t_end_us: int = -1
    outcome: Outcome = Outcome.NEVER_SERVED


PHASES = {
    "complete": {Phase.COMPLETION},
    "exit": {Phase.EXIT, Phase.COVERAGE},
    "arrive": {Phase.ARRIVAL},
    "charged": {Phase.ARRIVAL, Phase.COMMAND},  # the latter where the battery was full
    "land": {Phase.ARRIVAL, Phase.COMMAND},
    "charge": {Phase.ARRIVAL, Phase.COMMAND},
    "enter": {Phase.ENTRY, Phase.COVERAGE},
    "request": {Phase.REQUEST},
    "deplete": {Phase.DEPLETION},
    "crash": {Phase.DEPLETION},
    "attach": {Phase.ATTACHMENT, Phase.COVERAGE},
    "detach": {Phase.EXIT, Phase.DEPLETION, Phase.COVERAGE},
    "serve": {Phase.ATTACHMENT, Phase.ADMISSION},
    "stop": {Phase.COMPLETION, Phase.EXIT, Phase.DEPLETION, Phase.RECORD, Phase.COVERAGE},
    "respawn": {Phase.RESPAWN},
    "decide": {Phase.COMMAND},
    "depart": {Phase.COMMAND, Phase.ARRIVAL},
    "blocked": {Phase.COMMAND, Phase.ARRIVAL},
}
"""When things of a kind happen. An admission scan belongs to the attachment phase, or to 12."""


def check_log(world: World, log: EpisodeLog) -> None:
    """Replay an episode from its events alone: requests and totals must be what they add up to."""
    assert log.events is not None
    keys = [(t_us, phase, drone, user) for t_us, phase, _, drone, user, *_ in log.events]
    assert keys == sorted(keys)
    users = len(world.homes)
    attached: list[tuple[int, int] | None] = [None] * users
    open_of: dict[int, int] = {}
    told: dict[int, Told] = {}
    running: dict[int, tuple[int, int]] = {}
    spells: defaultdict[int, list[tuple[int, int, int]]] = defaultdict(list)
    bandwidth = {request.request_id: request.bandwidth_bps for request in log.requests}
    in_use = [0] * world.scenario.drones.count
    attached_us = bandwidth_us = 0

    def count_attached(user: int, since_us: int, now_us: int) -> None:
        request = told[open_of[user]]
        request.attached_us += now_us - max(since_us, request.t_request_us)

    for t_us, phase, kind, drone, user, request_id, _ in sorted(log.events, key=_let_go_first):
        assert 0 <= t_us <= log.duration_us
        assert phase in PHASES[kind], f"{kind} in phase {phase}"
        if kind == "request":
            assert request_id == len(told), "requests are numbered as they open"
            assert user not in open_of, "a second open request"
            told[request_id], open_of[user] = Told(user, t_us), request_id
        elif kind == "attach":
            assert attached[user] is None
            attached[user] = (drone, t_us)
        elif kind == "detach":
            held = attached[user]
            assert held is not None and held[0] == drone
            attached[user] = None
            attached_us += t_us - held[1]
            if user in open_of:
                count_attached(user, held[1], t_us)
        elif kind == "serve":
            held = attached[user]
            assert held is not None and held[0] == drone and open_of[user] == request_id
            assert request_id not in running
            running[request_id] = (drone, t_us)
            in_use[drone] += bandwidth[request_id]
            assert in_use[drone] <= world.bandwidth_bps
        elif kind == "stop":
            by, since_us = running.pop(request_id)
            assert by == drone
            in_use[drone] -= bandwidth[request_id]
            bandwidth_us += bandwidth[request_id] * (t_us - since_us)
            if t_us > since_us:
                spells[request_id].append((drone, since_us, t_us))
        elif kind == "complete":
            held = attached[user]
            assert held is not None
            count_attached(user, held[1], t_us)
            told[request_id].t_end_us, told[request_id].outcome = t_us, Outcome.COMPLETED
            del open_of[user]
    assert not running, "served beyond the end"
    for user, held in enumerate(attached):
        if held is not None:
            attached_us += log.duration_us - held[1]
            if user in open_of:
                count_attached(user, held[1], log.duration_us)

    assert log.attached_us == attached_us
    assert log.bandwidth_us_bps == bandwidth_us
    assert len(log.requests) == len(told)
    for number, request in enumerate(log.requests):
        was, of_request = told[number], spells[number]
        was.served_us = sum(stop - start for _, start, stop in of_request)
        if was.outcome is not Outcome.COMPLETED:
            was.t_end_us = log.duration_us
            was.outcome = Outcome.UNFINISHED if of_request else Outcome.NEVER_SERVED
        was.t_first_us = of_request[0][1] if of_request else None
        was.interruptions = sum(a[2] < b[1] for a, b in pairwise(of_request))
        if was.outcome is Outcome.UNFINISHED:
            was.interruptions += of_request[-1][2] < log.duration_us
        drones = [drone for drone, *_ in of_request]
        assert request.request_id == number
        assert request.drones == [d for k, d in enumerate(drones) if k == 0 or drones[k - 1] != d]
        assert was == Told(
            request.user,
            request.t_request_us,
            request.served_us,
            request.attached_us,
            request.interruptions,
            request.t_first_us,
            request.t_end_us,
            request.outcome,
        )
        open_us = request.t_end_us - request.t_request_us
        assert request.served_us <= request.attached_us <= open_us
        assert request.served_us <= request.required_us
        assert (request.served_us == request.required_us) == (was.outcome is Outcome.COMPLETED)


def _let_go_first(event: Event) -> tuple[int, int, bool]:
    """In phase 11 a log has drone after drone; but a user is let go before it is taken."""
    t_us, phase, kind, *_ = event
    return t_us, phase, phase == Phase.COVERAGE and kind == "attach"


def count(log: EpisodeLog, *kinds: str) -> int:
    """How many events of these kinds a log holds."""
    assert log.events is not None
    return sum(event[2] in kinds for event in log.events)


# ---- random scenarios


@st.composite
def scenarios(draw: st.DrawFn) -> dict[str, Any]:
    """Small and eventful: short batteries, narrow bands, wrong positions, buildings."""

    def pick(*options: Any) -> Any:
        return draw(st.sampled_from(options))

    cells = draw(st.tuples(st.integers(1, 7), st.integers(1, 7)))
    three_d, limited = draw(st.booleans()), draw(st.sampled_from([True, True, True, False]))
    step_s = pick(60, 60, 35.5, 90)
    stations = draw(st.integers(1, 2)) if limited else 0
    demand = pick(
        {"kind": "continuous"},
        {"kind": "static", "none": 0.3},
        {"kind": "dynamic", "think_time_s": 45, "none": 0.2},
        {"kind": "dynamic", "think_time_s": 5},
        {"kind": "poisson", "rate_per_hour": 40},
        {"kind": "poisson", "rate_per_hour": 400, "none": 0.1},
    )
    mobility = pick(
        {"kind": "static"},
        {"kind": "random_walk"},
        {"kind": "random_walk", "speed_mps": 6, "leg_s": 20},
    )
    battery = {
        "kind": "endurance",
        "autonomy_min": pick(1, 1.5, 2.2, 3.7, 5, 8),
        "return_below": pick(0.2, 0.5, 0.8, 1.0),
        "on_crash": pick("respawn", "respawn", "remove", "end_episode"),
        "respawn_after_min": pick(0, 0.4, 1, 2.3),
    }
    timing = pick("minimum_time", "minimum_time", "fill_epoch")
    levels = {"min_altitude_m": 20, "step_m": pick(10, 20)}
    obstacles = {"coverage": [0.0, 0.3], "height_m": [5, 60]}
    size_m = [240 * cells[0], 240 * cells[1]] if step_s != 35.5 else [160 * n for n in cells]
    return {
        "map": {
            "size_m": size_m,
            "cells": list(cells),
            "dimensions": 3 if three_d else 2,
            **({"levels": levels, "obstacles": obstacles} if three_d else {}),
        },
        "drones": {
            "count": draw(st.integers(1, 4)),
            "footprint_radius_m": pick(90, 180, 300, 600),
            "bandwidth_kbps": pick(None, 1000, 2500, 300),
            "motion": {"kind": "bang_coast_bang", "timing": timing},
            "battery": battery if limited else None,
        },
        "stations": {
            "count": stations,
            "radius_m": 0 if stations < 2 else size_m[1] / 3,
            "pads": pick(1, 1, 2),
            "full_charge_min": pick(0.7, 2, 5),
        },
        "users": {
            "count": draw(st.integers(1, 16)),
            "clusters": {"count": 2, "radius_m": [60, 400]},
            "mobility": mobility,
        },
        "demand": demand,
        "position_noise": pick(None, {"probability": 0.5, "sigma_cells": 2}),
        "episode": {
            "steps": pick(1, 4, 8, 12, 16),
            "step_s": step_s,
            "carry_over": draw(st.booleans()),
        },
    }


def some_command(world: World, mask: tuple[bool, ...], rng: np.random.Generator) -> int:
    """Mostly something allowed, eager to move and to charge; sometimes anything at all."""
    if rng.random() < 0.15:
        return int(rng.integers(-2, len(mask) + 2))
    weights = [
        allowed * (3.0 if action in MOVES else 1.0 if action is Action.HOVER else 4.0)
        for action, allowed in zip(world.actions, mask, strict=True)
    ]
    return int(rng.choice(len(mask), p=np.array(weights) / sum(weights)))
