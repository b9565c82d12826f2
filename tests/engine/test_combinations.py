"""Tasks and sensors with everything else: saved states, forks, episodes that are carried over.

Each kind of service is combined with each kind of fleet. Both engines play two episodes alike, in
which the drones carry over what they do, and a state that one of them has saved leads to the same
rest in both.
"""

from __future__ import annotations

from collections import Counter
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import desim_uav as du
from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import ENGINES, make_engine
from desim_uav.engine.compiled.forks import Forks
from desim_uav.env import UavParallelEnv
from desim_uav.rules.words import AIMS
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.engine.helpers import merged, some_command
from tests.engine.random_radio import audited
from tests.engine.test_saved import check
from tests.env.test_free_state_files import of_any, turns, whole_turns
from tests.selection import by_default
from tests.verification.engines import differences, engines

RADIO = {"kind": "link_classes", "power_dbm": 14, "bandwidth_mhz": 1, "sharing": "equal"}
TASK = {"kind": "compute", "input_mbit": [0.2, 1], "cycles_per_bit": [1000], "output_mbit": [0.5]}
LATE = {"deadline_s": 15, "on_deadline": "drop"}
READING = {"kind": "collect", "updates": {"kind": "poisson", "mean_s": 9}, "size_mbit": [0.5, 3]}
BACKHAUL = {"kind": "capacity", "kbps": 900}


def tasks(service: dict[str, Any], sender: dict[str, Any], **more: Any) -> dict[str, Any]:
    """What a scenario of tasks has; ``sender`` is for drones and access points."""
    processor = {"ghz": 0.1, **sender.pop("processor", {})}
    return {
        "services": {"task": TASK | service},
        "demand": {"kind": "dynamic", "think_time_s": 5, "mix": {"task": 1}},
        "users": {"processor": {"ghz": 0.05, "transmit_w": 0.1}},
        "sender": {"processor": processor, **sender},
        **more,
    }


def sensors(service: dict[str, Any], sender: dict[str, Any], **more: Any) -> dict[str, Any]:
    """The users and services that make a scenario one of sensors."""
    return {
        "services": {"reading": READING | service},
        "demand": {"kind": "sensing", "service": "reading"},
        "reward": {"kind": "age"},
        "sender": sender,
        **more,
    }


GROUND = {"delivered": "ground", "age_limit_s": 60}
SHARES = {"kind": "commanded", "shares": [0, 0.5, 1]}

SERVICES: dict[str, dict[str, Any]] = {
    "first come": tasks({}, {"processor": {"on_ground": True}}),
    "shared processors": tasks(LATE, {"processor": {"sharing": "processor_sharing"}}),
    "earliest deadline": tasks(
        LATE | {"on_deadline": "leave"}, {"processor": {"sharing": "earliest_deadline"}}
    ),
    "computed alone": tasks({}, {}, offloading="never"),
    "shortest": tasks({"handover": "restart"}, {}, offloading="shortest"),
    "split": tasks({}, {}, offloading="split"),
    "commanded": tasks({}, {}, offloading=SHARES),
    "relayed": tasks({"output_mbit": [4]}, {"backhaul": BACKHAUL}),
    "migrating": tasks({"handover": "migrate"}, {"backhaul": BACKHAUL}, offloading=SHARES),
    "uplink band": tasks(LATE, {"radio": RADIO | {"uplink_mhz": 0.4}}, offloading="split"),
    "at the drone": sensors({"keeps": "last", "preempt": True}, {}),
    "at the ground": sensors(GROUND, {"store_mbit": 12}),
    "over backhauls": sensors(
        GROUND | {"sends": "last"},
        {"backhaul": BACKHAUL, "store_mbit": 12, "radio": RADIO | {"uplink_mhz": 0.4}},
    ),
}

FREE = {
    "kind": "bang_coast_bang",
    "space": "free",
    "max_speed_mps": 12,
    "climb_mps": 5,
    "descent_mps": 4,
    "vertical_mps2": 2,
    "margin_m": 5,
}
CELLS = {"kind": "bang_coast_bang"}
EVENT = {"decisions": {"kind": "event", "patience_s": 25}}
POINT = {"at_m": [500, 200], "height_m": 30, "radio": RADIO}

FLEETS: dict[str, dict[str, Any]] = {
    "by clock": {},
    "by event": EVENT,
    "free": {"motions": [FREE]},
    "free, by event": {"motions": [FREE], **EVENT},
    "mixed": {"motions": [FREE, CELLS]},
    "mixed, by event": {"motions": [CELLS, FREE], **EVENT},
    "types": {"motions": [CELLS, {**CELLS, "max_speed_mps": 9}]},
    "access points": {"access_points": [POINT]},
    "access points, free, by event": {"access_points": [POINT], "motions": [FREE], **EVENT},
}

CASES = [f"{service}: {fleet}" for service, fleet in product(SERVICES, FLEETS)]
FEW = [f"{service}: {[*FLEETS][k % len(FLEETS)]}" for k, service in enumerate(SERVICES)]
"""Each service once, and each fleet at least once."""


def scenario_of(case: str) -> dict[str, Any]:
    """The scenario of a service and a fleet, by their names."""
    names = case.split(": ")
    service, fleet = dict(SERVICES[names[0]]), dict(FLEETS[names[1]])
    sender, motions = service.pop("sender"), fleet.pop("motions", [CELLS])
    battery = {"kind": "rotary_wing", "capacity_wh": 8, "return_below": 1.0}
    lasting = {"on_crash": "respawn", "respawn_after_min": 1.5}
    own = {key: one for key, one in sender.items() if key != "store_mbit"}
    drones = [
        {"name": f"type{k}", "count": 2 if len(motions) == 1 else 1, "radio": RADIO}
        | {"motion": motion, "battery": battery | lasting | {"capacity_wh": 8 + 3 * k}}
        | sender
        for k, motion in enumerate(motions)
    ]
    points = [point | own for point in fleet.pop("access_points", [])]
    base = {
        "map": {"size_m": [720, 720], "cells": [3, 3], "dimensions": 2},
        "stations": {"count": 1, "pads": 1, "full_charge_min": 1},
        "users": {"count": 8, "mobility": {"kind": "random_walk", "speed_mps": 12, "leg_s": 20}},
        "reward": {"kind": "coverage_battery"},
        "association": "strongest",
        "episode": {"steps": 5, "carry_over": True},
    }
    return merged(base, {**service, **fleet, "drones": drones, "access_points": points})


def world_of(case: str) -> World:
    """The world of a service and a fleet."""
    return build_world(from_mapping(scenario_of(case)), 1)


@pytest.mark.parametrize("case", by_default(FEW, CASES, at_most=26))
def test_both_engines_and_their_saved_states_agree(case: str) -> None:
    world = world_of(case)
    one, other = engines(world, (True,) * world.scenario.drone_count)
    for episode in range(2):
        assert differences(one, other, 3, episode) == []
    check(world, CASES.index(case))


# ---- forks: of an engine, of a run, of an environment, and of a planner


@pytest.mark.parametrize("case", by_default(FEW[:3], CASES, at_most=9))
def test_forks_of_an_engine_go_on_as_it_does(case: str) -> None:
    """Copies in both engines, and the compiled forks that a planner steps."""
    world, rng = world_of(case), np.random.default_rng(5)
    given = RunSettings((True,) * world.scenario.drone_count, True, keep_steps=False)
    own = [make_engine(name, world, given) for name in ENGINES]
    for engine in own:
        shown = engine.reset(draw(world, 1, 0))
    for _ in range(2):
        commands = [some_command(world, mask, rng) for mask in shown.masks]
        shown, _ = (engine.step(commands) for engine in own)
    engine: Any = own[1]
    forks, each = Forks(engine, 2), [*(one.fork(1)[0] for one in own), own[0]]
    forks.take()
    while not (shown.terminated or shown.truncated):
        commands = [some_action(world, mask, rng) for mask in shown.masks]
        told = [one.step(commands) for one in each]
        indices, aims = heard(each[0], shown.step)
        while forks.step(indices, aims=aims) > 0:
            forks.more_room()
            forks.take()
        shown = engine.step(commands)
        assert all(other == shown for other in told)
        assert {one.measures() for one in each} == {engine.measures()}
        assert (forks.outputs.numbers[:, 1:4] == list(engine.measures())).all()


def some_action(world: World, mask: tuple[bool, ...], rng: np.random.Generator) -> Any:
    """A random command that is numbers or an index, as forks are told no others."""
    command = some_command(world, mask, rng)
    return command if np.ndim(command) else int(np.clip(command, 0, len(mask) - 1))


def heard(engine: Any, step: int) -> tuple[Any, Any]:
    """The indices (2, drones) and the numbers (2, drones, AIMS) of a step's commands, twice."""
    drones = len(engine.drones)
    indices, aims = np.array(engine.state.history), np.array(engine.state.aims)
    aims = aims.reshape(-1, drones, AIMS)[step] if len(aims) else np.zeros((drones, AIMS))
    return indices.reshape(-1, drones)[[step, step]], np.stack([aims, aims])


@pytest.mark.parametrize("case", by_default(FEW[6:8], FEW))
def test_a_run_that_is_forked_to_its_own_policy_is_the_run(case: str) -> None:
    scenario = scenario_of(case)
    given = {"seed": 4, "episodes": 2, "progress": False}
    run = du.run(scenario, policy="hover", events=True, **given)
    found = du.counterfactual(scenario, policy="hover", to="hover", fork=(0, 2), **given)
    names = ["requests", "steps", "episodes", "events"]
    names += ["updates", "sensors"] if world_of(case).senses else []
    for name in names:
        table = getattr(run, name)
        assert len(table)
        assert getattr(found.other, name).equals(table), name
        assert getattr(found.original, name).equals(table), name


@pytest.mark.parametrize("case", by_default(FEW[4:5], FEW))
def test_an_environment_goes_on_from_a_file_in_the_other_engine(case: str, tmp_path: Path) -> None:
    scenario, file = world_of(case).scenario, tmp_path / "state.npz"
    one, other = (UavParallelEnv(scenario, engine=name, world_seed=1) for name in ENGINES)
    for seed in range(3):  # also in later episodes, in which the drones go on with what they did
        turns(one, 5, seed)
        one.save().write(file)
        np.testing.assert_equal(of_any(other.restore(file)), of_any(one._present()))
        twin = one.fork(1)[0]
        np.testing.assert_equal(whole_turns(other, 8, seed), whole_turns(twin, 8, seed))


@pytest.mark.thorough
@pytest.mark.parametrize("case", ["migrating: access points", "over backhauls: by clock"])
def test_a_planner_tries_commands_in_both_engines_alike(case: str) -> None:
    told = []
    for engine in ENGINES:
        run = du.run(
            scenario_of(case),
            {"episode.steps": 3},
            policy="rollout:hover+samples=2+horizon=2",
            engine=engine,
            progress=False,
        )
        told.append((run.requests, run.steps, run.episodes))
    for one, two in zip(*told, strict=True):
        assert one.equals(two)


# ---- checks of the checks


@pytest.mark.parametrize("case", by_default([], FEW, at_most=5))
def test_no_event_breaks_a_rule(case: str) -> None:
    """Most of these worlds have crashes, landings and handovers."""
    counted: Counter[str] = Counter()
    for log in audited(world_of(case)):
        counted.update(event[2] for event in log.events or ())
        counted["restarts"] += sum(one.restarts for one in log.requests)
    kinds = {
        "computed",
        "late",
        "move",
        "restarts",
        "crash",
        "land",
        "deliver",
        "lose",
        "drop",
        "handover",
    }
    assert len(kinds & {*+counted}) >= 2, counted
