"""Drones that come too near to each other: by hand, against a sampler, and in both engines."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from desim_uav.engine.base import EpisodeLog, FlownLeg, RunSettings
from desim_uav.engine.choose import make_engine
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError
from desim_uav.experiment import tables
from desim_uav.model.motion.motion import BangCoastBang, Transit
from desim_uav.model.rules import Mode
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, loads, scenario_hash
from desim_uav.world import World, build_world
from tests.audit.invariants import audit
from tests.engine.helpers import (
    HOVER_WH,
    US,
    Flight,
    events,
    fly,
    in_3d,
    path_of,
    scenarios,
    seen,
    some_command,
    strip,
)
from tests.model.energy.test_energy_of_legs import space_of
from tests.selection import by_default
from tests.verification.engines import differences, engines

HOP_S = 240 / 8.3 + 8.3 / 4

every_engine = pytest.mark.usefixtures("every_engine")


def separated(text: str) -> list[Any]:
    """Events of pairs: lines of time, kind, drone and the other drone."""
    rows = [line.split() for line in text.strip().splitlines()]
    return [(int(t), 13, kind, int(one), -1, -1, -1, int(two)) for t, kind, one, two in rows]


# ---- by hand


@every_engine
def test_two_drones_meet_and_fly_on():
    # Both end on x = 1080 after HOP_US. 100 m apart, each has 50 m to go: the last 8.3² / 8 m take
    # 8.3 / 4 s, and those before are flown at 8.3 m/s. Then they part, in the same way.
    apart_s = 8.3 / 4 + (50 - 8.3**2 / 8) / 8.3
    met_us, parted_us = round((HOP_S - apart_s) * US), round((60 + apart_s) * US)
    world = strip([(3, 0), (5, 0)], steps=2, separation_m=100)
    log = fly(world, path_of(world), "right right", "left left")
    assert seen(log, "conflict", "clear") == separated(f"""
        {met_us}     conflict  0  1
        {parted_us}  clear     0  1
    """)
    assert log.apart == (1, parted_us - met_us, 0.0)


@every_engine
def test_drones_that_pass_are_near_for_a_moment():
    # Drone 0 flies to the east over cell 4, drone 1 hovers 240 m to the north of it. The distance
    # is least at the end of the leg, and 250 m where sqrt(250² - 240²) = 70 m are left.
    world = strip([(3, 0), (4, 1)], cells=(9, 2), steps=2, separation_m=250)
    log = fly(world, path_of(world), "right right", "hover hover")
    last_s = 8.3 / 4 + (70 - 8.3**2 / 8) / 8.3
    assert seen(log, "conflict", "clear") == separated(f"""
        {round((HOP_S - last_s) * US)}  conflict  0  1
        {round((60 + last_s) * US)}     clear     0  1
    """)
    assert log.apart is not None
    assert log.apart.least_m == 240.0


@every_engine
def test_drones_that_fly_side_by_side_keep_their_distance():
    # When drone 0 is told to fly to where drone 1 is, it is not there yet.
    world = strip([(3, 0), (4, 0)], steps=3, separation_m=100)
    log = fly(world, path_of(world), "hover right right", "hover right right")
    assert log.apart == (0, 0, pytest.approx(240.0, abs=1e-9))


@every_engine
def test_at_just_the_least_distance_drones_are_clear():
    world = strip([(3, 0), (4, 0)], steps=1, separation_m=240)
    log = fly(world, path_of(world))
    assert seen(log, "conflict") == []
    assert log.apart == (0, 0, 240.0)


@every_engine
def test_a_conflict_from_the_start_ends_with_a_landing():
    # Both begin over the station. Drone 1 has 30 of 60 s when it lands, and is full after 150 s
    # more; it takes off into another conflict at the next step.
    battery = {"autonomy_min": 10, "return_below": 1.0}
    world = strip([(4, 0), (4, 0)], steps=5, battery=battery, separation_m=50)
    log = fly(world, path_of(world), "", "hover charge hover hover hover")
    assert seen(log, "conflict", "clear") == separated(f"""
        0            conflict  0  1
        {60 * US}    clear     0  1
        {120 * US}   conflict  0  1
    """)
    assert [event[0] for event in seen(log, "charged")] == [90 * US]
    assert log.apart == (2, 240 * US, 0.0)


@every_engine
def test_a_crash_ends_a_conflict():
    battery = {"autonomy_min": 0.75, "on_crash": "remove"}
    world = strip([(4, 0), (4, 0), (0, 0)], steps=1, battery=battery, separation_m=50)
    log = fly(world, path_of(world))
    assert seen(log, "conflict", "clear") == separated(f"""
        0            conflict  0  1
        {45 * US}    clear     0  1
    """)


@every_engine
def test_altitudes_count():
    world = in_3d([[2, 1, 25.0]], [(0, 0), (0, 0)], steps=2, separation_m=15)
    log = fly(world, path_of(world), "", "up hover", ceiling=False)
    (_, clear) = seen(log, "conflict", "clear")
    # 20 m take 20 / 8.3 + 8.3 / 4 s. The last 5 m are flown at a deceleration of 4 m/s².
    assert clear[0] == round((20 / 8.3 + 8.3 / 4 - math.sqrt(2 * 5 / 4)) * US)


@every_engine
def test_the_higher_index_hovers():
    # Drone 1 would meet drone 0 on cell 4, and then drone 0 flies to where it hovers.
    world = strip([(3, 0), (5, 0)], steps=2, separation_m=100, on_conflict="hover_higher_index")
    log = fly(world, path_of(world), "right right", "left left")
    left_s = 8.3 / 4 + (100 - 8.3**2 / 8) / 8.3
    assert seen(log, "depart", "blocked", "conflict") == [
        *((*event, -1) for event in events(f"""
                   0  10  depart   0
                   0  10  blocked  1
            {60 * US} 10  depart   0
            {60 * US} 10  blocked  1
        """)),
        *separated(f"{round((60 + HOP_S - left_s) * US)}  conflict  0  1"),
    ]  # fmt: skip


@every_engine
def test_drones_that_are_too_near_may_part_and_fly_side_by_side():
    world = strip([(4, 0), (4, 0)], steps=2, separation_m=100, on_conflict="hover_higher_index")
    log = fly(world, path_of(world), "hover right", "right right")
    assert seen(log, "blocked") == []
    assert [event[2] for event in seen(log, "conflict", "clear")] == ["conflict", "clear"]


FREELY = {"motion": {"space": "free", "max_speed_mps": 10, "max_acceleration_mps2": 5}}
"""In d metres, of at least 20, such drones take d / 10 + 2 s."""


def fly_freely(world: World, *told: list[list[float]]) -> EpisodeLog:
    """An episode in which each drone hears a list of commands, and then hovers."""
    flight = Flight(world)
    shown = flight.engine.reset(path_of(world))
    while not shown.truncated:
        own = [one[shown.step] if shown.step < len(one) else [0.0, 0.0] for one in told]
        shown = flight.engine.step(own)
    return flight.engine.log


@every_engine
def test_free_drones_pass_each_other():
    # Drone 0 flies 580 m to the east in 60 s, and passes drone 1, which hovers 150 m aside of
    # x = 410, at a distance below 170 m on the 80 m before and after: after 210 and 370 m.
    world = strip([(0, 0), (1, 1)], cells=(9, 2), steps=1, separation_m=170, drones=FREELY)
    where = [[(410 - 360) / 580, (270 - 360) / 580]]
    moved = strip([(0, 0), (1, 1)], cells=(9, 2), steps=2, separation_m=170, drones=FREELY)
    log = fly_freely(moved, [[0.0, 0.0], [1.0, 0.0]], where)
    assert seen(log, "conflict", "clear") == separated("""
         82000000  conflict  0  1
         98000000  clear     0  1
    """)
    assert log.apart == (1, 16 * US, pytest.approx(150.0, abs=1e-9))
    assert fly_freely(world, [[0.5, 0.0]], [[0.0, 1.0]]).apart.conflicts == 0


@every_engine
def test_a_free_drone_with_the_higher_index_hovers():
    # Drone 1 would meet drone 0. In the next step it may fly away.
    told = {"separation_m": 100, "on_conflict": "hover_higher_index", "drones": FREELY}
    world = strip([(1, 0), (4, 0)], steps=2, **told)
    log = fly_freely(world, [[0.5, 0.0]], [[-1.0, 0.0], [0.5, 0.0]])
    assert seen(log, "depart", "blocked") == [
        (*event, -1)
        for event in events(f"""
                   0  10  depart   0
                   0  10  blocked  1
            {60 * US} 10  depart   1
        """)
    ]
    assert log.apart.conflicts == 0
    assert [leg.to_m[0] for leg in log.legs if leg.drone == 1] == [1080, 1370]


def test_tables_have_columns_for_it():
    world = strip([(3, 0), (5, 0)], steps=2, separation_m=100)
    log = fly(world, path_of(world), "right right", "left left")
    found = tables.episodes_table([log], world, tables.requests_table([log], world))
    assert found["conflicts"].tolist() == [1]
    assert found["conflict_s"].tolist() == [log.apart.conflict_us / US]
    assert found["least_distance_m"].tolist() == [0.0]
    rows = tables.events_table([log], world)
    assert rows[rows["kind"] == "conflict"]["other"].tolist() == [1]
    plain = fly(strip([(3, 0), (5, 0)]), path_of(strip([(3, 0), (5, 0)])))
    assert "other" not in tables.events_table([plain], world)
    assert plain.apart is None
    alone = strip(separation_m=100)
    log = fly(alone, path_of(alone))
    row = tables.episodes_table([log], alone, tables.requests_table([log], alone))
    assert row["least_distance_m"].isna().all()


def test_a_scenario_without_the_keys_has_the_hash_that_it_had():
    plain = loads("{separation_m: null, on_conflict: log}")
    assert scenario_hash(plain) == scenario_hash(loads("{}"))
    assert scenario_hash(loads("separation_m: 5")) != scenario_hash(loads("{}"))


# ---- a motion of one's own


@dataclass(frozen=True)
class InPieces(BangCoastBang):
    """The same flights, with their phases in ten pieces each."""

    def fastest_transit(self, distance_m: float) -> Transit:
        """Return a transit in minimum time, whose phases are divided."""
        whole = super().fastest_transit(distance_m)
        pieces = []
        for piece, following in pairwise(whole.profile):
            for part in range(10):
                after = part / 10 * (following[0] - piece[0])
                speed = piece[2] + piece[3] * after
                flown = piece[1] + (piece[2] + speed) / 2 * after
                pieces.append([piece[0] + after, flown, speed, piece[3]])
        return whole._replace(profile=np.array([*pieces, whole.profile[-1]]))


@every_engine
def test_a_motion_may_have_many_pieces():
    own = {"kind": f"{__name__}:InPieces", "timing": "minimum_time"}
    apart = []
    for changes in ({}, {"drones": {"motion": own}}):
        world = strip([(3, 0), (5, 0)], steps=2, separation_m=100, **changes)
        log = fly(world, path_of(world), "right right", "left left")
        apart.append(seen(log, "conflict", "clear"))
    assert len(apart[0]) == 2
    assert [row[0] for row in apart[0]] == pytest.approx([row[0] for row in apart[1]], abs=1)


# ---- against a sampler


class Sampler:
    """Where drones are, from the legs and events of a log, by formulas of its own."""

    def __init__(self, log: EpisodeLog, drones: int, acceleration: float) -> None:
        self.legs: dict[int, list[Any]] = defaultdict(list)
        for leg in log.legs:
            self.legs[leg.drone].append(leg)
        self.a = acceleration
        self.off: dict[int, list[tuple[float, bool]]] = {d: [(-1.0, False)] for d in range(drones)}
        for leg in log.legs:
            if leg.t_us <= 0:
                on_ground = leg.mode not in (Mode.FLYING, Mode.RETURNING)
                self.off[leg.drone][0] = (-1.0, on_ground)
        for t_us, _, kind, drone, *_ in log.events or ():
            if kind in ("land", "crash", "decide", "respawn"):
                self.off[drone].append((t_us, kind in ("land", "crash")))

    def place(self, drone: int, t_us: float) -> np.ndarray | None:
        """The place of a drone in the air, or None."""
        if [off for at, off in self.off[drone] if at <= t_us][-1]:
            return None
        leg = [leg for leg in self.legs[drone] if leg.t_us <= t_us][-1]
        start, stop = np.array(leg.from_m), np.array(leg.to_m)
        length, t = float(np.linalg.norm(stop - start)), (t_us - leg.t_us) / US
        if t >= leg.duration_us / US or length == 0.0:
            return stop
        return start + (stop - start) * self.way_m(leg, length, t) / length

    def way_m(self, leg: FlownLeg, length: float, t: float) -> float:
        """How far a leg leads in so many seconds."""
        lasts = leg.duration_us / US
        at = self.a * lasts
        v = (at - math.sqrt(max(0.0, at * at - 4 * self.a * length))) / 2
        ramp = v / self.a
        if t < ramp:
            return self.a * t * t / 2
        if t > lasts - ramp:
            return length - self.a * (lasts - t) ** 2 / 2
        return v * (t - ramp / 2)

    def distance(self, one: int, two: int, t_us: float) -> float:
        """The distance of two drones in the air, or inf."""
        first, second = self.place(one, t_us), self.place(two, t_us)
        return (
            math.inf if first is None or second is None else float(np.linalg.norm(first - second))
        )

    def least_m(self, one: int, two: int, end_us: int) -> float:
        """The least distance of two drones, by samples that get closer three times."""
        times = np.arange(0, end_us, US // 4).astype(float)
        for _ in range(3):
            found = [self.distance(one, two, t) for t in times]
            best = int(np.argmin(found))
            low, high = times[max(0, best - 1)], times[min(len(times) - 1, best + 1)]
            times = np.linspace(low, high, 101)
        return min(found)

    def changes(
        self, one: int, two: int, least_m: float, end_us: int
    ) -> Iterator[tuple[float, bool]]:
        """When two drones come too near and part, as far as a sample every quarter second shows."""
        times = np.arange(0, end_us + 1, US // 4)
        near = [self.distance(one, two, t) < least_m for t in times]
        if near[0]:
            yield 0.0, True
        for (low, high), (was, now) in zip(pairwise(times), pairwise(near), strict=True):
            if was != now:
                low_us, high_us = float(low), float(high)
                while high_us - low_us > 0.05:
                    middle = (low_us + high_us) / 2
                    if (self.distance(one, two, middle) < least_m) == was:
                        low_us = middle
                    else:
                        high_us = middle
                yield high_us, now


class FreeSampler(Sampler):
    """Where drones are that fly freely, by the limits of the reference."""

    def __init__(self, log: EpisodeLog, world: World) -> None:
        super().__init__(log, world.scenario.drone_count, math.nan)
        wind = world.scenario.wind_mps
        self.spaces = [space_of(world.type_of(d).space.limits, wind) for d in self.off]

    def way_m(self, leg: FlownLeg, length: float, t: float) -> float:
        return self.spaces[leg.drone].leg(leg.from_m, leg.to_m).flown_m(t)


def flown(seed: int, free: bool = False, **changes: Any) -> tuple[World, EpisodeLog]:
    """An episode of several drones on a small map, with batteries and wind, audited.

    ``free``: drones fly freely, and some of their batteries are of energy.
    """
    rng = np.random.default_rng([14, seed])
    three_d = bool(seed % 2)
    rotary = {"kind": "rotary_wing", "capacity_wh": 4 * HOVER_WH}
    mapping: dict[str, Any] = {
        "map": {
            "size_m": [960, 720],
            "cells": [4, 3],
            "dimensions": 3 if three_d else 2,
            "obstacles": {"cells": [[3, 0, 45.0]]} if three_d else None,
        },
        "drones": {
            "count": 4,
            "start_cells": [[0, 0], [1, 1], [1, 2], [3, 2]],
            "motion": {
                "timing": ["minimum_time", "fill_epoch"][seed % 3 == 2],
                "max_speed_mps": 12,
                "space": "free" if free else "cells",
            },
            "battery": {
                **({"autonomy_min": 4}, rotary)[free and seed % 3 > 0],
                "return_below": 1.0,
                "respawn_after_min": 1,
            },
        },
        "stations": {"count": 2, "radius_m": 240, "full_charge_min": 1.2},
        "users": {"count": 1, "clusters": {"count": 1, "radius_m": [50, 90]}},
        "episode": {"steps": 12},
        "wind_mps": [[0, 0], [3.5, -1.5]][seed % 2],
        "separation_m": float(rng.uniform(20, 330)),
        **changes,
    }
    world = build_world(from_mapping(mapping), seed)
    engine = Simulation(world, RunSettings((False,) * 4, False, keep_events=True), audit=audit)
    shown = engine.reset(draw(world, seed, 0))
    while not shown.truncated:
        shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
    return world, engine.log


def pairs_of(log: EpisodeLog) -> dict[tuple[int, int], list[tuple[int, bool]]]:
    """The events of each pair: times, and whether they are too near from then on."""
    found: dict[tuple[int, int], list[tuple[int, bool]]] = defaultdict(list)
    for event in log.events or ():
        if event[2] in ("conflict", "clear"):
            found[event[3], event[-1]].append((event[0], event[2] == "conflict"))
    return found


@pytest.mark.parametrize("seed", by_default(range(3), range(30)))
def test_against_a_sampler(seed: int):
    world, log = flown(seed)
    check(world, log, Sampler(log, 4, 4.0))


@pytest.mark.parametrize("seed", by_default(range(3), range(20)))
@pytest.mark.parametrize("on_conflict", ["log", "hover_higher_index"])
def test_free_flight_against_a_sampler(seed: int, on_conflict: str):
    world, log = flown(seed, free=True, on_conflict=on_conflict)
    check(world, log, FreeSampler(log, world))


def check(world: World, log: EpisodeLog, sampler: Sampler) -> None:
    """Check the instants and the least distance of a log against a sampler."""
    least_m, found = world.scenario.separation_m, pairs_of(log)
    nearest = math.inf
    for pair in combinations(range(4), 2):
        exact = found.get(pair, [])
        states = [state for _, state in exact]
        assert states == [bool((k + 1) % 2) for k in range(len(states))], "they alternate"
        seen_ = [
            t for t in sampler.changes(*pair, least_m, log.duration_us) if t[0] < log.duration_us
        ]
        sure = list(exact)
        if len(exact) > len(seen_):  # some are too short for the sampler, but they are there
            sure = []
            for (t_us, state), (next_us, _) in zip(
                exact, [*exact[1:], (10**15, False)], strict=True
            ):
                sure.append((t_us, state))
                if len(sure) > 1 and t_us - sure[-2][0] < US // 4:
                    middle = (t_us + sure[-2][0]) / 2
                    assert (sampler.distance(*pair, middle) < least_m) == sure[-2][1]
                    if len(sure) > len(seen_) or abs(sure[-2][0] - seen_[len(sure) - 2][0]) > 2:
                        sure = sure[:-2]
                assert next_us >= t_us
        assert [state for _, state in sure] == [state for _, state in seen_]
        assert [t for t, _ in sure] == pytest.approx([t for t, _ in seen_], abs=1.0)
        nearest = min(nearest, sampler.least_m(*pair, log.duration_us))
    assert log.apart is not None
    assert log.apart.least_m == pytest.approx(nearest, abs=1e-2)


@pytest.mark.parametrize("seed", by_default(range(3), range(60)))
@pytest.mark.parametrize("on_conflict", ["log", "hover_higher_index"])
def test_measures_are_what_the_events_add_up_to(seed: int, on_conflict: str):
    _, log = flown(seed, on_conflict=on_conflict)
    total_us = conflicts = 0
    for rows in pairs_of(log).values():
        conflicts += sum(state for _, state in rows)
        ends = [t for t, _ in rows] + [log.duration_us] * (len(rows) % 2)
        total_us += sum(b - a for a, b in zip(ends[::2], ends[1::2], strict=True))
    assert log.apart is not None
    assert log.apart[:2] == (conflicts, total_us)


def test_giving_way_makes_conflicts_fewer():
    both = [
        [flown(k, on_conflict=way)[1].apart for k in range(4)]
        for way in ("log", "hover_higher_index")
    ]
    logged, given_ = ([each.conflicts for each in found if each] for found in both)
    assert sum(given_) < sum(logged)


# ---- both engines


def play(scenario: dict[str, Any], least_m: float, way: str, seed: int) -> None:
    with_kernels = {**scenario["drones"], "admission": {"kind": "first_come"}}
    keys = {"drones": with_kernels, "separation_m": least_m, "on_conflict": way}
    try:
        world = build_world(from_mapping({**scenario, **keys}), seed)
    except ScenarioError:
        assume(False)
    one, other = engines(world, (True,) * world.scenario.drones.count)
    for episode in range(3):
        assert not differences(one, other, seed, episode)


@pytest.mark.thorough
@settings(max_examples=60, deadline=None)
@given(
    scenarios(),
    st.sampled_from([15.0, 100.0, 240.0, 500.0]),
    st.sampled_from(["log", "hover_higher_index"]),
    st.integers(0, 999),
)
def test_both_engines_are_equal(scenario: dict[str, Any], least_m: float, way: str, seed: int):
    play(scenario, least_m, way, seed)


@pytest.mark.thorough
def test_a_saved_state_goes_on_in_the_other_engine():
    world, log = flown(3)
    told = RunSettings((False,) * 4, False, keep_events=True)
    first, second = (make_engine(name, world, told) for name in ("des", "batch"))
    rng = np.random.default_rng([14, 3])
    rng.uniform(20, 330)
    shown = first.reset(draw(world, 3, 0))
    while not shown.truncated:
        if shown.step == 6:
            second.restore(first.save())
            first, second = second, first
        shown = first.step([some_command(world, mask, rng) for mask in shown.masks])
    assert first.log.apart == log.apart
    assert first.log.events == log.events
