"""Small worlds to be worked by hand, flights over them, their logs, and random scenarios."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from hypothesis import strategies as st

from desim_uav import sample_path
from desim_uav.engine.base import ClosedRequest, EpisodeLog, Event, RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.engine.des import Simulation
from desim_uav.engine.episode import Engine
from desim_uav.model.admission import Waiting
from desim_uav.model.demand.demand import Requests
from desim_uav.model.geometry.coverage import WalkLeg
from desim_uav.model.mobility.mobility import Walks
from desim_uav.model.rules import MOVES, Action, Phase, kind_of
from desim_uav.model.state import Snapshot
from desim_uav.rowcode.views import records
from desim_uav.sample_path import SamplePath
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.audit.invariants import audit
from tests.engine.replay import check_log

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
        "reward": {"kind": "multi_service"},
        "episode": {"steps": steps, "step_s": 60},
    }
    return build_world(from_mapping(merged(base, changes)), 0)


def radio(**changes: Any) -> dict[str, Any]:
    """A radio with 1 MHz whose only class has 1 bit/s/Hz, from 50 dB on."""
    return {
        "kind": "link_classes",
        "power_dbm": 100,
        "bandwidth_mhz": 1,
        "noise_figure_db": 0,
        "noise_dbm_per_hz": -60,
        "path_loss": {"kind": "log_distance", "exponent": 2, "at_1m_db": 0},
        "classes": [{"snr_db": 50, "bit_s_hz": 1}],
        "sharing": "equal",
        **changes,
    }


def returning(steps: int = 5, **changes: Any) -> World:
    """A station on cell 4 (x = 1080), 600 s of battery, 2 s charged a second."""
    battery = {"autonomy_min": 10, "return_below": 1.0}
    return strip(steps=steps, battery=battery, **changes)


def column(battery: dict[str, Any], **changes: Any) -> World:
    """A column of nine with stations 0 on (0, 7) and 1 on (0, 1); 93 s of battery."""
    battery = {"autonomy_min": 1.55, "return_below": 1.0, **battery}
    changes = {"starts": [(0, 4)], "users": [(120, 1080), (120, 360)], **changes}
    return strip(cells=(1, 9), battery=battery, stations={"count": 2, "radius_m": 720}, **changes)


def in_3d(buildings: list[list[float]], starts: Any, cells: Any = (3, 2), **changes: Any) -> World:
    """Levels 20 m apart over buildings given as (cell x, cell y, height)."""
    size_m = [240 * cells[0], 240 * cells[1]]
    levels = {"min_altitude_m": 20, "step_m": 20}
    relief = {"dimensions": 3, "levels": levels, "obstacles": {"cells": buildings}}
    map_ = {"size_m": size_m, "cells": cells, **relief}
    return strip(starts, cells=cells, map=map_, **changes)


Ask = tuple[float, ...]
"""(time or think time in s, required s, kbit/s), and the number of the service if it is not 0.

Of a transfer a bit is required for each second. All values of a service's lists can follow, which
then replace the time and the bandwidth."""
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
        for t_s, need_s, kbps, *rest in (asks or {}).get(user, ()):
            number, *values = rest or (0,)
            values = values or [round(need_s * US), round(kbps * 1000)]
            values += [0] * (world.services.draws - len(values))
            rows.append([round(t_s * US), int(number), *map(int, values)])
        row_offsets.append(len(rows))
    drones, epochs = world.scenario.drone_count, world.scenario.episode.steps + 1
    errors = None
    if error is not None:
        errors = np.zeros((drones, epochs, 2))
        for drone, of_drone in enumerate(error):
            errors[drone, : len(of_drone)] = of_drone
    places = np.zeros((drones, world.most_epochs + 1), np.int64)
    if respawn is not None:
        for drone, of_drone in enumerate(respawn):
            places[drone, : len(of_drone)] = of_drone
    return SamplePath(
        episode,
        Walks(records(WalkLeg, legs), np.array(leg_offsets)),
        Requests(
            np.array(rows, np.int64).reshape(-1, 2 + world.services.draws),
            np.array(row_offsets),
            thinking,
        ),
        errors,
        places,
    )


class Flight:
    """An engine on a world, told what to do in words: a text of actions for each drone.

    It is the SimPy engine, under audit, unless the fixture ``every_engine`` names another one.
    """

    flown_by: ClassVar = "des"

    def __init__(
        self,
        world: World,
        *,
        carry_over: bool = False,
        ceiling: bool = True,
        check: Callable[[Simulation], None] | None = audit,
    ) -> None:
        ceilings = (ceiling,) * world.scenario.drone_count
        self.world = world
        told = RunSettings(ceilings, carry_over, keep_events=True)
        self.engine: Engine = (
            Simulation(world, told, audit=check)
            if self.flown_by == "des"
            else make_engine(self.flown_by, world, told)
        )
        self.shown: list[Snapshot] = []

    def episode(self, path: SamplePath, *told: str) -> EpisodeLog:
        """Fly an episode; missing actions are hover. ``shown`` holds its snapshots.

        Its log is checked for what every log must be (``check_log``).
        """
        wanted = [text.split() for text in told]
        shown = self.engine.reset(path)
        self.shown = [shown]
        while not (shown.terminated or shown.truncated):
            shown = self.engine.step(
                [
                    self.command(wanted[d][shown.step] if shown.step < len(wanted[d]) else "hover")
                    if d < len(wanted)
                    else self.command("hover")
                    for d in range(self.world.scenario.drone_count)
                ]
            )
            self.shown.append(shown)
        check_log(self.world, self.engine.log, path)
        return self.engine.log

    def command(self, word: str) -> int:
        """The index of an action by its name (``goto`` for short), or a number as it stands."""
        if word.lstrip("-").isdigit():
            return int(word)
        name = {"goto": "GOTO_CHARGING_STATION"}.get(word, word.upper())
        return [action.name for action in self.world.actions].index(name)


def fly(world: World, path: SamplePath, *told: str, **settings: Any) -> EpisodeLog:
    """One audited episode."""
    return Flight(world, **settings).episode(path, *told)


@dataclass(frozen=True)
class Loss:
    """An admission: what does not fit at once is refused for good."""

    def scan(
        self, waiting: Sequence[Waiting], free_hz: float
    ) -> tuple[list[Waiting], list[Waiting]]:
        served: list[Waiting] = []
        refused: list[Waiting] = []
        for request in waiting:
            fits = request.needs_hz <= free_hz
            free_hz -= request.needs_hz if fits else 0
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


def before_end(log: EpisodeLog, *kinds: str) -> list[Event]:
    """As ``seen``, less the rows of phase 8 in which the end of the episode lets everybody go."""
    end = (log.duration_us, Phase.RECORD)
    letting_go = {"stop", "close", "exit", "detach"}
    return [e for e in seen(log, *kinds) if not (e[:2] == end and e[2] in letting_go)]


def the(log: EpisodeLog) -> ClosedRequest:
    """The one request of an episode."""
    (request,) = log.requests
    return request


def count(log: EpisodeLog, *kinds: str) -> int:
    """How many events of these kinds a log holds."""
    assert log.events is not None
    return sum(event[2] in kinds for event in log.events)


# ---- random scenarios


HOVER_WH = 168.484218 / 60
"""What a rotary wing takes in a minute of hovering, in Wh."""

AND_MORE_WALKS: list[dict[str, Any]] = []
AND_MORE_DEMANDS: list[dict[str, Any]] = []
"""Further models of random scenarios, which take long to compile (see ``all_models``)."""

ALL_WALKS: list[dict[str, Any]] = [
    {"kind": "random_waypoint", "speed_mps": [0.5, 9], "pause_s": [0, 30]},
    {"kind": "random_waypoint", "start": "home"},
    {"kind": "gauss_markov", "mean_mps": 4, "step_s": 7.5},
    {"kind": "manhattan", "street_m": 120, "speed_mps": [1, 9]},
    {"kind": "manhattan", "street_m": 240, "start": "home"},
    {"kind": "group", "groups": 3, "radius_m": 40, "step_s": 25},
    {"kind": "levy", "flight_m": [5, 900], "pause_s": [1, 90], "speed_mps": 5},
]
ALL_DEMANDS: list[dict[str, Any]] = [
    {"kind": "profile", "profiles": [[[0, 200], [0.05, 20]], [[0.1, 90]]]},
    {
        "kind": "profile",
        "shape": "linear",
        "begins_at_h": 23.95,
        "profiles": [[[0, 300], [12, 0]]],
    },
]


@contextmanager
def all_models() -> Iterator[None]:
    """Let random scenarios have all models of mobility and demand, which takes long to compile."""
    few = AND_MORE_WALKS[:], AND_MORE_DEMANDS[:]
    AND_MORE_WALKS[:], AND_MORE_DEMANDS[:] = ALL_WALKS, ALL_DEMANDS
    try:
        yield
    finally:
        AND_MORE_WALKS[:], AND_MORE_DEMANDS[:] = few


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
        *AND_MORE_DEMANDS,
    )
    mobility = pick(
        {"kind": "static"},
        {"kind": "random_walk"},
        {"kind": "random_walk", "speed_mps": 6, "leg_s": 20},
        *(m for m in AND_MORE_WALKS if m["kind"] != "manhattan" or step_s != 35.5),
    )
    battery = {
        "kind": "endurance",
        "autonomy_min": pick(1, 1.5, 2.2, 3.7, 5, 8),
        "return_below": pick(0.2, 0.5, 0.8, 1.0),
        "on_crash": pick("respawn", "respawn", "remove", "end_episode"),
        "respawn_after_min": pick(0, 0.4, 1, 2.3),
    }
    in_joules = draw(st.booleans())
    if in_joules:
        battery |= {
            "kind": "rotary_wing",
            "capacity_wh": HOVER_WH * battery.pop("autonomy_min"),
            "climb": pick(True, True, False),
            "electronics_w": pick(0, 0, 45.5),
        }
    charging = {
        "constant": {"full_charge_min": pick(0.7, 2, 5)},
        "cc_cv": {
            "full_charge_min": pick(0.7, 3),
            "taper_from": pick(0.0, 0.8, 0.9),
            "full_at": pick(0.5, 0.99),
        },
        "power": {"power_w": pick(300, 2500.5)},
        "swap": {"minutes": pick(0.3, 1, 2.6)},
    }
    way = pick("key", "key", *charging)
    if way == "power" and not in_joules:
        way = "swap"
    kind = "cc_cv" if way == "power" else way
    charges = (
        charging["constant"] if way == "key" else {"charging": {"kind": kind, **charging[way]}}
    )
    timing = pick("minimum_time", "minimum_time", "fill_epoch")
    wind_mps = pick([0, 0], [0, 0], [3.1, 0], [-1.5, 2.75])
    # Against the wind, a slower flight does not fit into a step.
    cruise = pick(None, None, [8.3] if any(wind_mps) else [5, 6.5, 8.3])
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
            "admission": {"kind": pick("first_come", "first_come", f"{__name__}:Loss")},
            "motion": {"kind": "bang_coast_bang", "timing": timing, "cruise": cruise},
            "battery": battery if limited else None,
        },
        "stations": {
            "count": stations,
            "radius_m": 0 if stations < 2 else size_m[1] / 3,
            "pads": pick(1, 1, 2),
            **charges,
        },
        "users": {
            "count": draw(st.integers(1, 16)),
            "clusters": {"count": 2, "radius_m": [60, 400]},
            "mobility": mobility,
        },
        "demand": demand,
        "wind_mps": wind_mps,
        "position_noise": pick(None, {"probability": 0.5, "sigma_cells": 2}),
        "episode": {
            "steps": pick(1, 4, 8, 12, 16),
            "step_s": step_s,
            "carry_over": draw(st.booleans()),
        },
    }


def some_command(world: World, mask: tuple[bool, ...], rng: np.random.Generator) -> Any:
    """Mostly something allowed, eager to move and to charge; sometimes anything at all."""
    flies = world.free and (not world.mixed or mask[world.actions.index(Action.FLY)])
    if flies and rng.random() < 0.8:
        numbers = rng.uniform(-1.2, 1.2, len(world.commands.names))
        if "aim_charge" in world.commands.names:
            numbers[-1] = rng.choice([-1.0, 1.0])
        return numbers.round(3).tolist()
    if rng.random() < 0.15:
        return int(rng.integers(-2, len(mask) + 2))
    weights = [
        allowed * (3.0 if action in MOVES else 1.0 if action is Action.HOVER else 4.0)
        for action, allowed in zip(map(kind_of, world.actions), mask, strict=True)
    ]
    return int(rng.choice(len(mask), p=np.array(weights) / sum(weights)))


def check_that_the_other_engine_goes_on(world: World, name: str, seed: int) -> None:
    """Save a flight of an engine after four steps, and fly on in both engines alike."""
    told = RunSettings((True,) * world.scenario.drone_count, False, keep_events=True)
    engine, rng = make_engine(name, world, told), np.random.default_rng(seed)
    shown = engine.reset(sample_path.draw(world, 1, 0))
    for _ in range(4):
        if not (shown.terminated or shown.truncated):
            shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
    saved, other = engine.save(), make_engine({"des": "batch", "batch": "des"}[name], world, told)
    other.restore(saved)
    while not (shown.terminated or shown.truncated):
        commands = [some_command(world, mask, rng) for mask in shown.masks]
        shown = engine.step(commands)
        assert shown == other.step(commands)
    assert engine.log.events == other.log.events
    assert engine.log.steps == other.log.steps
