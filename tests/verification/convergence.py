"""The whole engine against a simulator with fixed time steps that shares no code with it.

That is ``tests/reference/fixed_step.py``. What the two must have in common, and why the error goes
with dt, stands in ``tests/engine/test_against_fixed_step.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from desim_uav.engine.base import EpisodeLog, RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.model.rules import Action
from desim_uav.sample_path import SamplePath, draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.reference import by_event as stepped_by_event
from tests.reference import fixed_step, free, free_by_event
from tests.reference.energy import Charger, Rotor
from tests.reference.inputs import NEVER, US, Inputs, Processor, Request, Result, Sensing
from tests.reference.scenario import access_points_of, association_of, links_of
from tests.verification.asked import commands_of, decisions_of, totals, totals_of
from tests.verification.figure import Exact, Figure
from tests.verification.space import space_of

DTS_S = (0.5, 0.25, 0.125, 0.0625)
FINEST_S = DTS_S[-1]
COARSE_S = (1.0, 0.5, 0.25)
"""Steps that show a slope in little time."""
SEEDS = range(32)
MEASURES = ("served_s", "qoe1", "qoe2", "qoe3", "battery_s")
Scenarios = Callable[[int], dict[str, Any]]
"""Random scenarios as mappings, by their seeds."""


def figures(quick: bool = False) -> Iterator[Figure]:
    """The slope of the error over dt, log over log."""
    yield from slopes(range(10), 0.4, DTS_S[:3]) if quick else slopes(range(96), 0.25)


def slopes(
    seeds: range,
    tolerance: float,
    dts_s: tuple[float, ...] = DTS_S,
    scenarios: Scenarios | None = None,
    measures: Sequence[str] = MEASURES,
) -> Iterator[Figure]:
    """Of each measure, pooled over scenarios, by default those of ``scenario_of``."""
    for measure, errors in pooled_errors(seeds, dts_s, scenarios, measures).items():
        found = slope(errors, dts_s)
        yield Exact(f"{measure}: order of the error in dt", found, 1.0, tolerance, cases=len(seeds))


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
                "return_timing": "fill_epoch" if seed % 5 == 1 else "minimum_time",
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


def energetic(seed: int) -> dict[str, Any]:
    """A scenario as that of ``scenario_of``, with a battery whose flights take energy."""
    mapping, rng = scenario_of(seed), np.random.default_rng([9, seed])
    battery = mapping["drones"]["battery"]
    if battery is not None:
        minutes = battery.pop("autonomy_min")
        capacity_wh = minutes * Rotor().power_w(0.0, 0.0) / 60
        battery |= {
            "kind": "rotary_wing",
            "capacity_wh": capacity_wh,
            "climb": bool(rng.random() < 0.7),
            "electronics_w": float(rng.choice([0.0, 25.0])),
        }
        if rng.random() < 0.6:
            del mapping["stations"]["full_charge_min"]
            mapping["stations"]["charging"] = {
                "kind": "cc_cv",
                "power_w": capacity_wh * 3600 / 90,
                "taper_from": float(rng.choice([0.5, 0.8])),
                "full_at": float(rng.choice([0.9, 0.97])),
            }
    return mapping


def cruising(seed: int) -> dict[str, Any]:
    """A scenario as that of ``energetic``, in which each command chooses a cruise speed."""
    mapping = energetic(seed)
    speeds = [[6.0, 8.3, 12.0], [6.5, 20.0], [9.25]][seed % 3]
    mapping["drones"]["motion"] |= {"cruise": speeds, "max_speed_mps": 20.0}
    return mapping


def windy(seed: int) -> dict[str, Any]:
    """A scenario as that of ``energetic``, with wind and drones that are quick enough for it."""
    mapping, rng = energetic(seed), np.random.default_rng([10, seed])
    mapping["drones"]["motion"]["max_speed_mps"] = 12.0
    strength, towards = rng.uniform(1.0, 5.0), rng.uniform(0.0, 2 * math.pi)
    mapping["wind_mps"] = [strength * math.cos(towards), strength * math.sin(towards)]
    return mapping


def asked_by_event(seed: int) -> dict[str, Any]:
    """A scenario of ``scenario_of`` or ``energetic``, in which drones are asked by event."""
    mapping = (energetic, scenario_of)[seed // 2 % 2](seed)
    mapping["drones"]["motion"]["timing"] = "fill_epoch" if seed % 8 == 7 else "minimum_time"
    return by_event(mapping, seed)


def by_event(mapping: dict[str, Any], seed: int) -> dict[str, Any]:
    """The same scenario with drones that are asked by event, and a reward that is paid to them."""
    patience_s = float(np.random.default_rng([11, seed]).choice([20.0, 45.0, 77.0]))
    battery = mapping["drones"]["battery"]
    if battery is not None:
        battery["respawn_after_min"] += patience_s / 60
    mapping["reward"] = {"kind": "coverage"}
    mapping["decisions"] = {"kind": "event", "patience_s": patience_s}
    mapping["episode"] |= {"steps": 12, "carry_over": False}
    return mapping


def inputs_of(
    mapping: dict[str, Any], world: World, path: SamplePath, ceilings: tuple[bool, ...]
) -> Inputs:
    """The world and its sample path in plain numbers; which of equal ways home is the engine's.

    Radio links are taken from the scenario as its mapping describes them.
    """
    scenario, grid = world.scenario, world.grid
    motion, battery = scenario.drones.motion, scenario.drones.battery
    levels = tuple(grid.levels_under_ceiling if low else len(grid.levels_m) for low in ceilings)

    def plan(node: tuple[int, int, int], count: int) -> list[tuple[int, int, int]]:
        way = world.only_type.planner.plan(node, count == grid.levels_under_ceiling)
        assert way is not None
        return list(way.hops)

    legs = np.array(path.walks.legs.tolist())
    legs[:, 0] /= US
    kinds, offered = kinds_of(mapping, world), mapping.get("services", {})
    requests = [
        task_of(offered[world.services.names[service]], due, *values)
        if kinds[service] == "compute"
        else request_of(kinds[service], due, *values)
        for due, service, *values in path.requests.rows.tolist()
    ]
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
        links=links_of(mapping, world.links[0].bandwidth_hz),
        max_speed_mps=motion.max_speed_mps,
        max_acceleration_mps2=motion.max_acceleration_mps2,
        fill_epoch=motion.timing == "fill_epoch",
        returns_fill_epoch=motion.return_timing == "fill_epoch",
        capacity=None if battery is None else world.only_type.capacity,
        return_below=0.0 if battery is None else battery.return_below,
        respawn_after_us=None if dies else round(battery.respawn_after_min * 60 * US),
        charge_us=round(scenario.stations.full_charge_min * 60 * US),
        pads=scenario.stations.pads,
        steps=scenario.episode.steps,
        step_us=world.step_us,
        legs=split(legs, path.walks.offsets),
        requests=split(requests, path.requests.offsets),
        follows=path.requests.follows,
        position_error=path.position_error,
        respawn=path.respawn,
        plan=plan,
        cruise=motion.cruise or (),
        users_height_m=world.homes[:, 2],
        association=association_of(mapping),
        access_points=access_points_of(mapping),
        wind_mps=tuple(mapping.get("wind_mps", (0.0, 0.0))),
        patience_us=world.patience_us if world.by_event else None,
        **energy_of(mapping),
        **services_of(mapping, world),
    )


def energy_of(mapping: dict[str, Any]) -> dict[str, Any]:
    """The rotor and the charger that a scenario's mapping describes, if it has them."""
    battery, charging = mapping["drones"]["battery"] or {}, mapping["stations"].get("charging")
    if battery.get("kind") != "rotary_wing":
        return {}
    found = {"rotor": Rotor(climbs=battery["climb"], electronics_w=battery["electronics_w"])}
    if charging is not None:
        rate = charging["power_w"] / (battery["capacity_wh"] * 3600)
        found["charger"] = Charger(rate, charging["taper_from"], charging["full_at"])
    return found


def services_of(mapping: dict[str, Any], world: World) -> dict[str, Any]:
    """The processors and the sensors that a scenario's mapping describes."""
    drones, users = mapping["drones"], mapping["users"]
    senders = [*[drones] * drones["count"], *mapping.get("access_points", ())]
    if "processor" not in drones and isinstance(users, dict):
        return {}
    groups = [users] if isinstance(users, dict) else users
    clocks = [
        round(group.get("processor", {}).get("ghz", 0.0) * 1e6)
        for group in groups
        for _ in range(group["count"])
    ]
    sensors = [
        sensing_of(mapping["services"][group["demand"]["service"]])
        if group.get("demand", {}).get("kind") == "sensing"
        else None
        for group in groups
        for _ in range(group["count"])
    ]
    store_mbit = drones.get("store_mbit")
    return {
        "processors": [processor_of(each["processor"]) for each in senders if "processor" in each],
        "clocks": clocks,
        "offloading": mapping.get("offloading", "always"),
        "sensors": sensors,
        "store_ubit": math.inf if store_mbit is None else store_mbit * 1e12,
    }


def processor_of(given: dict[str, Any]) -> Processor:
    """A processor as its mapping describes it."""
    clock = round(given["ghz"] * 1e6)
    return Processor(given["cores"], clock, given["sharing"], given["on_ground"])


def sensing_of(service: dict[str, Any]) -> Sensing:
    """How a sensor keeps updates of a service, as its mapping describes it."""
    at_will = service["updates"]["kind"] == "at_will"
    return Sensing(
        buffer=service.get("buffer", 10),
        keeps=service.get("keeps", "newest"),
        preempt=bool(service.get("preempt", False)),
        preempts_all=service.get("preempt", False) == "all",
        sends_last=service.get("sends", "first") == "last",
        at_ground=service.get("delivered", "drone") == "ground",
        wait_us=round(service["updates"]["wait_s"] * US) if at_will else 0,
    )


def kinds_of(mapping: dict[str, Any], world: World) -> list[str]:
    """The kind of each service."""
    services = mapping.get("services", {})
    return [services.get(name, {}).get("kind", "hold") for name in world.services.names]


def request_of(kind: str, due_us: int, one: int, two: int, *more: int) -> Request:
    """What a request of a service of this kind asks for, given the values that it has drawn."""
    if kind in ("transfer", "collect"):
        return Request(due_us, 0, two, one, up=kind == "collect")
    if kind.endswith(":Exchange"):
        return Request(due_us, 0, 0, one, (Request(0, 0, 0, two),))
    if kind.endswith(":Survey"):
        bit_min, confirm_us, confirm_bps = more[:3]
        then = (Request(0, 0, 0, one * bit_min // 60), Request(0, confirm_us, confirm_bps))
        return Request(due_us, one, two, 0, then)
    if kind.endswith(":Rounds"):
        return Request(due_us, one, two, 0, (Request(0, more[0], more[1]),))
    return Request(due_us, one, two)


def task_of(service: dict[str, Any], due_us: int, *drawn: int) -> Request:
    """What a task asks for, given the numbers that it has drawn; of the rates, one is held."""
    bits, cycles_per_bit, result_bits, bps = (*drawn, 0)[:4]
    deadline_s = service.get("deadline_s")
    return Request(
        due_us,
        0,
        bps,
        bits * 10**6,
        (
            Request(0, 0, 0, cycles=bits * cycles_per_bit),
            *[Request(0, 0, bps, result_bits * 10**6)] * any(service["output_mbit"]),
        ),
        deadline_us=NEVER if deadline_s is None else round(deadline_s * US),
        on_deadline=service.get("on_deadline", "count"),
        restarts=service.get("handover", "resume") == "restart",
        migrates=service.get("handover", "resume") == "migrate",
        up=True,
    )


def split(rows: Any, offsets: np.ndarray) -> list[Any]:
    return [rows[a:b] for a, b in pairwise(offsets.tolist())]


@dataclass(frozen=True)
class Case:
    """One episode as the engine ran it."""

    world: World
    inputs: Inputs
    commands: list[list[Any]]
    """Of each step for all drones or, by event, of each drone at its decisions."""
    log: EpisodeLog
    space: free.Space | None

    def count(self, *kinds: str) -> int:
        return sum(event[2] in kinds for event in self.log.events)

    @property
    def smooth(self) -> bool:
        """Bandwidth for everybody at once, and all requests at the start?"""
        once = all(len(own) <= 1 for own in self.inputs.requests)
        at_start = all(self.inputs.follows) and all(
            request.due_us == 0 for own in self.inputs.requests for request in own
        )
        asked_bps = sum(r.bandwidth_bps for own in self.inputs.requests for r in own)
        return asked_bps <= self.world.links[0].bandwidth_hz and once and at_start


def case_of(seed: int, scenarios: Scenarios | None = None) -> Case:
    """Fly a scenario with random commands, some of them masked or no action at all."""
    return _case_of(seed, scenarios or scenario_of)


@cache
def _case_of(seed: int, scenarios: Scenarios) -> Case:
    return flown(seed, scenarios(seed), episodes=1)[0]


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
        while not (snapshot.truncated or snapshot.terminated):
            if world.scenario.free:
                commands.append([wished(rng, world) for _ in snapshot.masks])
                snapshot = engine.step([numbers_of(command, world) for command in commands[-1]])
            else:
                commands.append([chosen(rng, world, mask) for mask in snapshot.masks])
                snapshot = engine.step(commands[-1])
        if world.by_event:
            commands = commands_of(engine.log, commands)
        inputs = inputs_of(mapping, world, path, ceilings)
        space = space_of(mapping, world, ceilings) if world.scenario.free else None
        cases.append(Case(world, inputs, commands, engine.log, space))
    return cases


def wished(rng: np.random.Generator, world: World) -> list[float]:
    """A command of a drone that flies freely: a displacement, whether to charge, and a speed."""
    east, north, up = rng.uniform(-1.2, 1.2, 3).round(3).tolist()
    told = [east, north, up if world.scenario.three_d else 0.0, float(rng.choice([-1.0, 1.0]))]
    return [
        *told,
        *(rng.uniform(-1.2, 1.2, int("aim_cruise" in world.commands.names)).round(3).tolist()),
    ]


def numbers_of(command: list[float], world: World) -> list[float]:
    """The numbers of such a command that the engine takes."""
    east, north, up, charge, *speed = command
    rises = [up] if world.scenario.three_d else []
    wish = [charge] if world.scenario.limited_battery else []
    return [east, north, *rises, *speed, *wish]


def chosen(rng: np.random.Generator, world: World, mask: tuple[bool, ...]) -> int:
    if rng.random() < 0.1:
        return int(rng.integers(-1, len(mask) + 1))
    weight = np.array([float(allowed) for allowed in mask])
    for index, action in enumerate(world.actions):
        weight[index] *= {Action.GOTO_CHARGING_STATION: 4.0, Action.CHARGE: 4.0}.get(action, 1.0)
    return int(rng.choice(len(mask), p=weight / weight.sum()))


@cache
def sampled(seed: int, dt_s: float, scenarios: Scenarios | None = None) -> Result:
    case = case_of(seed, scenarios)
    if case.space is not None:
        freely = free_by_event if case.world.by_event else free
        return freely.simulate(case.inputs, case.space, case.commands, dt_s)
    by_cells = stepped_by_event if case.world.by_event else fixed_step
    return by_cells.simulate(case.inputs, case.commands, dt_s)


def exact_measures(case: Case) -> dict[str, float]:
    """The measures of the model, from the engine's requests and attachments."""
    requests = case.log.requests
    stages = [len(own) for own in case.world.services.stages]
    share = [share_of(one, stages[one.service]) for one in requests]
    unserved = [r.t_end_us - r.t_request_us - r.served_us for r in requests]
    asked = totals(*decisions_of(case.log, case.inputs)) if case.world.by_event else {}
    return {
        "served_s": sum(r.served_us for r in requests) / US,
        "delivered_mbit": sum(r.sent_ubit for r in requests) / 1e12,
        "qoe1": 100.0 * float(np.mean(share)) if share else 0.0,
        "qoe2": float(np.mean(unserved)) / case.world.step_us if share else 0.0,
        "qoe3": 100.0 * case.log.attached_us / (len(case.inputs.legs) * case.world.horizon_us),
        "battery_s": sum((step.charge or 0) for step in case.log.steps) / US,
        **asked,
    }


def share_of(one: Any, stages: int) -> float:
    """Which share of a request has been done; its user's own part is one more stage."""
    if one.outcome.name == "COMPLETED":
        return 1.0
    if one.own_us == 0:
        return float((one.stage + one.done / one.required) / stages)
    if one.part == 0.0:
        return float(one.own_share)
    return float((one.stage + one.done / one.required + one.own_share) / (stages + 1))


def sampled_measures(result: Result) -> dict[str, float]:
    records = [record for step in result.records for record in step]
    return {
        "served_s": sum(r.served_us for r in result.requests) / US,
        "delivered_mbit": sum(r.delivered_ubit for r in result.requests) / 1e12,
        "qoe1": result.qoe1,
        "qoe2": result.qoe2,
        "qoe3": result.qoe3,
        "battery_s": sum((record.charge or 0) for record in records) / US,
        **(totals_of(result) if result.decisions else {}),
    }


def pooled_errors(
    seeds: range,
    dts_s: tuple[float, ...],
    scenarios: Scenarios | None = None,
    measures: Sequence[str] = MEASURES,
) -> dict[str, np.ndarray]:
    """For each measure and dt the mean error over scenarios, less the tenth furthest off."""
    errors = np.empty((len(dts_s), len(measures), len(seeds)))
    for column, seed in enumerate(seeds):
        case = case_of(seed, scenarios)
        exact = exact_measures(case)
        for row, dt_s in enumerate(dts_s):
            close = sampled_measures(sampled(seed, dt_s, scenarios))
            errors[row, :, column] = [abs(close[name] - exact[name]) for name in measures]
    kept = np.sort(errors, axis=-1)[..., : math.ceil(0.9 * len(seeds))].mean(axis=-1)
    return dict(zip(measures, kept.T, strict=True))


def slope(errors: np.ndarray, dts_s: tuple[float, ...]) -> float:
    return float(np.polyfit(np.log(dts_s), np.log(errors), 1)[0])
