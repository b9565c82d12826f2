"""The engine against an independent simulator by fixed time steps (``tests/reference``).

Both fly the same random small scenarios on the same sample path with the same commands, some of
them masked or no action at all: 2D and 3D, with and without battery, stations with queues, crashes,
respawns and removals, position noise, drones with and without ceiling, unlimited and tight
bandwidth, static and walking users, all demands, both timings.

The reference notices everything at the first tick at or after it happens, so each moment is late by
less than dt, and what the two must have in common follows:

- Modes, actions, positions, returns and attachments at the ends of steps are the same, unless
  something else happens within dt of them: asked for at the finest dt.
- A battery: a landing noticed late costs up to dt, its charge starts up to dt late; the end of a
  charge is late by as much as its start, by dt / rate for what is missing and by dt for the tick,
  and so is the start of the next in the queue. After n charges at stations that is at most
  n (1 + rate) dt. A drone takes off full, so in the air nothing is left of it.
- Attached time: a union of n intervals, sampled at every dt, measures wrong by less than n dt. That
  does not depend on the demand. With bandwidth for everybody and requests at the start only,
  served time is the attached time up to what is required: the same bound holds for each user.
- The rest is discontinuous: of two requests that compete for bandwidth, or two drones that reach a
  user, less than dt apart, the other may come first; a service that lacks less than dt when
  coverage ends waits out the whole gap. Such a swap has a size that does not depend on dt and a
  probability in proportion to dt: the mean over scenarios still converges with slope 1, but the few
  scenarios with a swap would decide the fit. So at each dt the tenth of the scenarios that is
  furthest off is left out of the pooled error (not out of any other check), and each scenario by
  itself has to keep, at the finest dt, to dt for each event that starts or ends a service.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.base import EpisodeLog, RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.model.rules import Action, Mode, Phase
from desim_uav.sample_path import SamplePath, draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.reference.fixed_step import US, Inputs, Request, Result, simulate, simulate_on

DTS_S = (0.5, 0.25, 0.125, 0.0625)
FINEST_S = DTS_S[-1]
SEEDS = range(32)
MORE_SEEDS = range(32, 400)
MEASURES = ("served_s", "qoe1", "qoe2", "qoe3", "battery_s")


def scenario_of(seed: int) -> dict[str, Any]:
    rng = np.random.default_rng([7, seed])

    def pick(*options: Any) -> Any:
        return options[rng.integers(len(options))]

    cells = (int(rng.integers(5, 9)), int(rng.integers(5, 9)))
    cell_m, step_s = pick((240.0, 60.0), (240.0, 60.0), (200.0, 40.0), (150.0, 60.0))
    three_d = bool(seed % 2)
    limited = seed % 4 != 1
    noisy = limited and seed % 3 == 0
    drones = int(rng.integers(2, 5))
    demand = (
        {"kind": "continuous"},
        {"kind": "dynamic", "think_time_s": 90.0, "none": 0.2},
        {"kind": "static"},
        {"kind": "poisson", "rate_per_hour": 25.0},
        {"kind": "dynamic", "think_time_s": 40.0},
    )[seed % 5]
    size_m = [cells[0] * cell_m, cells[1] * cell_m]
    battery = {
        "kind": "endurance",
        "autonomy_min": pick(3.7, 4.3, 5.6, 6.0, 7.1),
        "return_below": pick(0.3, 0.5, 0.7),
        "on_crash": pick("respawn", "respawn", "respawn", "remove"),
        "respawn_after_min": pick(0.0, 0.5, 1.2, 2.0),
    }
    return {
        "map": {
            "size_m": size_m,
            "cells": list(cells),
            "dimensions": 3 if three_d else 2,
            "levels": {"min_altitude_m": 20.0, "step_m": 20.0},
            "obstacles": {"coverage": [0.1, 0.3], "height_m": [15.0, 70.0]} if three_d else None,
        },
        "drones": {
            "count": drones,
            "footprint_radius_m": pick(1.2, 1.6, 2.1) * cell_m,
            "bandwidth_kbps": pick(None, 1000.0, 300.0),
            "motion": {
                "kind": "bang_coast_bang",
                "timing": pick("fill_epoch", "minimum_time"),
            },
            "battery": battery if limited else None,
        },
        "stations": {
            "count": pick(1, 2, 3) if limited else 0,
            "radius_m": 0.3 * min(size_m),
            "pads": pick(1, 1, 2),
            "full_charge_min": pick(1.3, 2.6, 5.0),
        },
        "users": {
            "count": int(rng.integers(10, 25)),
            "clusters": {"count": 4, "radius_m": [cell_m, 2 * cell_m]},
            "mobility": {"kind": "static"}
            if seed % 7 == 3
            else {"kind": "random_walk", "speed_mps": pick(1.4, 3.0), "leg_s": pick(60.0, 25.0)},
        },
        "demand": demand,
        "position_noise": {"probability": 0.4, "sigma_cells": 1.0} if noisy else None,
        "episode": {"steps": 15, "step_s": step_s},
    }


def inputs_of(world: World, path: SamplePath, ceilings: tuple[bool, ...]) -> Inputs:
    """The world and its sample path in plain numbers; which of equal ways home is the engine's."""
    scenario, grid = world.scenario, world.grid
    motion, battery = scenario.drones.motion, scenario.drones.battery
    levels = tuple(grid.levels_under_ceiling if low else len(grid.levels_m) for low in ceilings)

    def plan(node: tuple[int, int, int], count: int) -> list[tuple[int, int, int]]:
        way = world.planner.plan(node, count == grid.levels_under_ceiling)
        assert way is not None
        return list(way.hops)

    legs = np.array(path.walks.legs, float)
    legs[:, 0] /= US
    requests = [Request(int(due), int(need), int(bps)) for due, _, need, bps in path.requests.rows]
    dies = battery is None or battery.on_crash == "remove"
    return Inputs(
        cell_m=grid.cell_m,
        height_m=grid.height_m,
        levels_m=grid.levels_m,
        level_step_m=grid.level_step_m,
        three_d=scenario.map.dimensions == 3,
        levels=levels,
        stations=world.stations,
        starts=world.starts,
        radius_m=scenario.drones.footprint_radius_m,
        bandwidth_bps=world.bandwidth_bps,
        max_speed_mps=motion.max_speed_mps,
        max_acceleration_mps2=motion.max_acceleration_mps2,
        fill_epoch=motion.timing == "fill_epoch",
        capacity_us=None if battery is None else world.capacity_us,
        return_below=0.0 if battery is None else battery.return_below,
        respawn_after_us=None if dies else round(battery.respawn_after_min * 60 * US),
        charge_us=round(scenario.stations.full_charge_min * 60 * US),
        pads=scenario.stations.pads,
        steps=scenario.episode.steps,
        step_us=world.step_us,
        legs=split(legs, path.walks.offsets),
        requests=split(requests, path.requests.offsets),
        after_previous=path.requests.after_previous,
        position_error=path.position_error,
        respawn=path.respawn,
        plan=plan,
    )


def split(rows: Any, offsets: np.ndarray) -> list[Any]:
    return [rows[a:b] for a, b in pairwise(offsets.tolist())]


@dataclass(frozen=True)
class Case:
    """One episode as the engine ran it."""

    world: World
    inputs: Inputs
    commands: list[list[int]]
    log: EpisodeLog

    def count(self, *kinds: str) -> int:
        return sum(event[2] in kinds for event in self.log.events)

    @property
    def smooth(self) -> bool:
        """Bandwidth for everybody at once, and all requests at the start?"""
        once = all(len(own) <= 1 for own in self.inputs.requests)
        at_start = self.inputs.after_previous and all(
            request.due_us == 0 for own in self.inputs.requests for request in own
        )
        asked_bps = sum(r.bandwidth_bps for own in self.inputs.requests for r in own)
        return asked_bps <= self.inputs.bandwidth_bps and once and at_start


@cache
def case_of(seed: int) -> Case:
    """Fly a scenario with random commands, some of them masked or no action at all."""
    return flown(seed, scenario_of(seed), episodes=1)[0]


def flown(seed: int, mapping: dict[str, Any], episodes: int) -> list[Case]:
    world = build_world(from_mapping(mapping), seed)
    rng = np.random.default_rng([8, seed])
    ceilings = tuple(bool(rng.random() < 0.6) for _ in world.starts)
    carry_over = world.scenario.episode.carry_over
    engine = Simulation(world, RunSettings(ceilings, carry_over, keep_events=True))
    cases = []
    for episode in range(episodes):
        path = draw(world, seed, episode)
        snapshot, commands = engine.reset(path), []
        while not snapshot.truncated:
            commands.append([chosen(rng, world, mask) for mask in snapshot.masks])
            snapshot = engine.step(commands[-1])
        cases.append(Case(world, inputs_of(world, path, ceilings), commands, engine.log))
    return cases


def chosen(rng: np.random.Generator, world: World, mask: tuple[bool, ...]) -> int:
    if rng.random() < 0.1:
        return int(rng.integers(-1, len(mask) + 1))
    weight = np.array([float(allowed) for allowed in mask])
    for index, action in enumerate(world.actions):
        weight[index] *= {Action.GOTO_CHARGING_STATION: 4.0, Action.CHARGE: 4.0}.get(action, 1.0)
    return int(rng.choice(len(mask), p=weight / weight.sum()))


@cache
def sampled(seed: int, dt_s: float) -> Result:
    case = case_of(seed)
    return simulate(case.inputs, case.commands, dt_s)


def exact_measures(case: Case) -> dict[str, float]:
    """The measures of the model, from the engine's requests and attachments."""
    requests = case.log.requests
    share = [r.served_us / r.required_us for r in requests]
    unserved = [r.t_end_us - r.t_request_us - r.served_us for r in requests]
    return {
        "served_s": sum(r.served_us for r in requests) / US,
        "qoe1": 100.0 * float(np.mean(share)) if share else 0.0,
        "qoe2": float(np.mean(unserved)) / (60 * US) if share else 0.0,
        "qoe3": 100.0 * case.log.attached_us / (len(case.inputs.legs) * case.world.horizon_us),
        "battery_s": sum((step.battery_us or 0) for step in case.log.steps) / US,
    }


def sampled_measures(result: Result) -> dict[str, float]:
    records = [record for step in result.records for record in step]
    return {
        "served_s": sum(r.served_us for r in result.requests) / US,
        "qoe1": result.qoe1,
        "qoe2": result.qoe2,
        "qoe3": result.qoe3,
        "battery_s": sum((record.battery_us or 0) for record in records) / US,
    }


def check_discrete(case: Case, result: Result, dt_s: float) -> None:
    """What has to be the same, not only close."""
    held = holders_at_step_ends(case)
    for step in case.log.steps:
        record = result.records[step.step][step.drone]
        at = f"step {step.step}, drone {step.drone}"
        assert record.mode == step.mode.name.lower(), at
        assert record.action_taken == step.action_taken.name.lower(), at
        assert record.attached == held[step.step].get(step.drone, ()), at
        assert len(record.attached) == step.attached_users, at
        if record.mode == "crashed":  # noticed late, at speed
            far = case.inputs.max_speed_mps * dt_s
            assert record.position_m[:2] == pytest.approx((step.x_m, step.y_m), abs=far), at
            continue
        where = (step.x_m, step.y_m, step.z_m)
        assert record.position_m == pytest.approx(where, abs=1e-4), at
        if record.mode != "returning":
            assert record.return_us == step.return_us, at
    assert result.crashes == case.log.crashes
    assert result.charges == case.log.charges


def holders_at_step_ends(case: Case) -> list[dict[int, tuple[int, ...]]]:
    """Who was attached to each drone when a step was recorded, from the engine's events."""
    ends, holders = [], {}
    events = [event for event in case.log.events if event[2] in ("attach", "detach")]
    position = 0
    for step in range(1, case.inputs.steps + 1):
        until = (step * case.inputs.step_us, Phase.ATTACHMENT)
        while position < len(events) and events[position][:2] <= until:
            _, _, kind, drone, user, *_ = events[position]
            position += 1
            if kind == "attach":
                holders[user] = drone
            elif holders.get(user) == drone:
                del holders[user]
        drones = range(len(case.inputs.starts))
        ends.append({d: tuple(sorted(u for u in holders if holders[u] == d)) for d in drones})
    return ends


def check_battery(case: Case, result: Result, dt_s: float) -> None:
    """Late by n (1 + rate) dt at most on the ground, and not at all in the air."""
    if case.inputs.capacity_us is None:
        return
    rate = case.inputs.capacity_us / case.inputs.charge_us
    begun = sorted(event[0] for event in case.log.events if event[2] == "charge")
    for step in case.log.steps:
        record = result.records[step.step][step.drone]
        charges = sum(t_us <= step.t_us for t_us in begun)
        airborne = record.mode in ("flying", "returning")
        bound_us = 1.0 if airborne else charges * (1.0 + rate) * dt_s * US + charges + 1.0
        assert abs(record.battery_us - step.battery_us) <= bound_us, (step.step, step.drone)


def check_coverage(case: Case, result: Result, dt_s: float) -> None:
    """A union of n intervals sampled at every dt."""
    bound_us = dt_s * US * case.count("attach")
    assert abs(result.attached_us - case.log.attached_us) <= bound_us


def check_service(case: Case, result: Result, dt_s: float) -> None:
    """For each user where service follows coverage alone; in sum, dt a start or end, elsewhere."""
    exact, close = exact_measures(case), sampled_measures(result)
    if case.smooth:
        sampled_us = {request.user: request.served_us for request in result.requests}
        for request in case.log.requests:
            intervals = sum(
                event[2] == "attach" and event[4] == request.user for event in case.log.events
            )
            error_us = abs(sampled_us[request.user] - request.served_us)
            assert error_us <= dt_s * US * intervals, request.user
    assert len(result.requests) == len(case.log.requests)
    assert result.suppressed == case.log.suppressed
    changes = case.count("serve", "stop", "complete")
    requests = max(len(case.log.requests), 1)
    shortest_us = min((request.required_us for request in case.log.requests), default=US)
    bound_s = dt_s * changes
    assert abs(close["served_s"] - exact["served_s"]) <= bound_s
    assert abs(close["qoe1"] - exact["qoe1"]) <= 100 * bound_s * US / shortest_us / requests
    assert abs(close["qoe2"] - exact["qoe2"]) <= (bound_s + dt_s * requests) / 60 / requests


def check_at_finest(seed: int) -> None:
    case, result = case_of(seed), sampled(seed, FINEST_S)
    check_discrete(case, result, FINEST_S)
    check_battery(case, result, FINEST_S)
    check_coverage(case, result, FINEST_S)
    check_service(case, result, FINEST_S)


def pooled_errors(seeds: range) -> dict[str, np.ndarray]:
    """For each measure and dt the mean error over scenarios, less the tenth furthest off."""
    errors = np.empty((len(DTS_S), len(MEASURES), len(seeds)))
    for column, seed in enumerate(seeds):
        exact = exact_measures(case_of(seed))
        for row, dt_s in enumerate(DTS_S):
            close = sampled_measures(sampled(seed, dt_s))
            errors[row, :, column] = [abs(close[name] - exact[name]) for name in MEASURES]
    kept = np.sort(errors, axis=-1)[..., : math.ceil(0.9 * len(seeds))].mean(axis=-1)
    return dict(zip(MEASURES, kept.T, strict=True))


def slope(errors: np.ndarray) -> float:
    return float(np.polyfit(np.log(DTS_S), np.log(errors), 1)[0])


@pytest.mark.parametrize("seed", SEEDS)
def test_agrees_at_the_finest_dt(seed: int) -> None:
    check_at_finest(seed)


@pytest.mark.parametrize("dt_s", DTS_S)
def test_coverage_is_within_dt_an_interval(dt_s: float) -> None:
    """At every dt, wherever it finds the drones in the same modes: coverage knows of no swap."""
    compared = 0
    for seed in SEEDS:
        case, result = case_of(seed), sampled(seed, dt_s)
        modes = [result.records[step.step][step.drone].mode for step in case.log.steps]
        if modes == [step.mode.name.lower() for step in case.log.steps]:
            check_coverage(case, result, dt_s)
            check_battery(case, result, dt_s)
            compared += 1
    assert compared >= 0.9 * len(SEEDS)


@pytest.mark.parametrize("measure", MEASURES)
def test_converges_with_slope_one(measure: str) -> None:
    errors = pooled_errors(SEEDS)[measure]
    assert 0.7 <= slope(errors) <= 1.4, errors


def test_the_scenarios_have_everything_in_them() -> None:
    """A check of the checks: what nobody flies nobody compares."""
    cases = [case_of(seed) for seed in SEEDS]
    steps = [step for case in cases for step in case.log.steps]
    assert {step.mode for step in steps} == set(Mode)
    assert sum(case.count("respawn") for case in cases) >= 3
    assert sum(case.count("blocked") for case in cases) >= 20
    assert sum(case.smooth for case in cases) >= 3
    assert sum(case.log.suppressed for case in cases) >= 10
    assert sum(case.log.queueing_us > 0 for case in cases) >= 3
    assert any(step.action is not step.action_taken for step in steps)
    assert {case.inputs.three_d for case in cases} == {True, False}
    assert {case.inputs.fill_epoch for case in cases} == {True, False}
    assert {case.inputs.position_error is None for case in cases} == {True, False}
    noisy = [case for case in cases if case.inputs.position_error is not None]
    assert any(step.mode is Mode.RETURNING for case in noisy for step in case.log.steps)


def carried_over(seed: int) -> None:
    mapping = scenario_of(seed)
    mapping["episode"] |= {"steps": 5, "carry_over": True}
    cases = flown(seed, mapping, episodes=4)
    results = simulate_on([(case.inputs, case.commands) for case in cases], FINEST_S)
    for case, result in zip(cases, results, strict=True):
        check_discrete(case, result, FINEST_S)
        check_coverage(case, result, FINEST_S)


@pytest.mark.parametrize("seed", [2, 3, 8, 10, 12, 24])
def test_drones_are_carried_over_alike(seed: int) -> None:
    """Mid-return, in a queue, half charged, crashed: the next episode goes on from there."""
    carried_over(seed)


@pytest.mark.slow
def test_agrees_at_the_finest_dt_in_many_scenarios() -> None:
    """All but the few in which two events at the finest dt are still too close to tell apart."""
    disagreeing = {}
    for seed in MORE_SEEDS:
        try:
            check_at_finest(seed)
        except AssertionError as error:
            disagreeing[seed] = str(error)
    assert len(disagreeing) <= 0.01 * len(MORE_SEEDS), disagreeing


@pytest.mark.slow
def test_converges_with_slope_one_in_many_scenarios() -> None:
    slopes = {name: slope(errors) for name, errors in pooled_errors(MORE_SEEDS).items()}
    assert all(0.8 <= found <= 1.25 for found in slopes.values()), slopes


@pytest.mark.slow
@pytest.mark.parametrize("seed", [seed for seed in range(25, 200) if seed % 4 != 1])
def test_drones_are_carried_over_alike_in_many_scenarios(seed: int) -> None:
    carried_over(seed)
