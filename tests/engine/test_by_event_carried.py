"""Drones that are asked by event, from one episode into the next: by hand, and at random."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from desim_uav import UavEnv
from desim_uav.engine.base import Carried, EpisodeLog, RunSettings
from desim_uav.engine.choose import ENGINES, make_engine
from desim_uav.engine.des import Simulation
from desim_uav.engine.episode import Engine
from desim_uav.env.carried_drones import checked
from desim_uav.errors import ScenarioError
from desim_uav.learning.training import Training
from desim_uav.model.rules import Mode
from desim_uav.model.state import Snapshot
from desim_uav.sample_path import SamplePath, draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.audit.invariants import audit
from tests.engine import random_all
from tests.engine.helpers import (
    HOP_US,
    US,
    Flight,
    check_log,
    events,
    path_of,
    seen,
    some_command,
    strip,
)
from tests.engine.test_by_event import asked, by_event, times
from tests.selection import by_default
from tests.verification.engines import differences, engines

every_engine = pytest.mark.usefixtures("every_engine")
WIDE = {"autonomy_min": 10, "return_below": 1.0, "respawn_after_min": 0.75}


def carried(**changes: Any) -> Flight:
    """A flight over a strip whose episodes last for 120 s, unless told otherwise."""
    return Flight(by_event(**{"steps": 2, **changes}), carry_over=True)


# ---- by hand: two cells are 30.99 s apart, and a hover lasts for 45 s


@every_engine
def test_a_move_goes_on_in_the_next_episode_and_its_decision_falls_due_when_it_is_over():
    # It sets out at 106.98 s. After 13.02 s it is 99.4 m on its way from x = 600 to x = 840: 100 m
    # or less from the user at 690 until it comes to 790, and from the one at 1000 from 900 on.
    flight = carried(users=[(690, 120), (800, 120), (1000, 120)])
    before = flight.episode(path_of(flight.world), "right hover right right")
    (drone,) = flight.engine.carried() or ()
    assert (drone.node, drone.hop, drone.taken) == ((2, 0, 0), (1, 0, 0), flight.command("right"))
    assert (drone.age_us, drone.rest_us) == (75 * US - 2 * HOP_US, 17_971_989)
    assert drone.age_us + drone.rest_us == HOP_US
    after = flight.episode(path_of(flight.world, episode=1), "hover right")
    due_us = drone.rest_us
    # 8.3 m/s; the ramps take 4.15 / 2 s more than the cruise speed would.
    at_m = {metres: round((metres / 8.3 + 8.3 / 8) * US) - drone.age_us for metres in (100, 190)}
    assert seen(after, "enter", "exit", "depart", "arrive")[:5] == events(f"""
               0   4  enter   0  0
        {at_m[100]}   4  enter   0  1
        {at_m[190]}   2  exit    0  0
        {due_us}   3  arrive  0
        {due_us}  10  depart  0
    """)
    assert asked(flight, 0) == [due_us, due_us + HOP_US, due_us + HOP_US + 45 * US]
    assert times(flight) == [0, *asked(flight, 0), 120 * US]
    assert before.distance_m + after.distance_m == pytest.approx(4 * 240.0)
    assert after.legs[0].t_us == -drone.age_us
    assert after.legs[0].duration_us == HOP_US


@every_engine
def test_a_drone_on_its_way_is_forced_and_the_others_are_asked_at_once():
    flight = carried(starts=[(0, 0), (8, 0)], steps=1)
    # Drone 0 flies again from 30.99 s on. Drone 1 hovers for 45 s, and for 15 s of the next 45.
    flight.episode(path_of(flight.world), "right right", "hover hover hover")
    flight.episode(path_of(flight.world, episode=1), "right hover", "left")
    first, second = flight.shown[:2]
    assert [sum(mask) for mask in first.masks] == [1, 1]
    assert second.t_us == 2 * HOP_US - 60 * US
    assert [sum(mask) > 1 for mask in second.masks] == [True, False]
    told = flight.engine.log.steps[:2]
    assert [step.action for step in told] == [None, None]
    assert [step.action_taken.name for step in told] == ["RIGHT", "HOVER"]
    assert asked(flight, 0) == [2 * HOP_US - 60 * US, 2 * HOP_US - 15 * US]
    assert asked(flight, 1) == [30 * US]


@every_engine
def test_elapsed_time_is_that_since_the_episode_began():
    flight = carried(steps=1)
    flight.episode(path_of(flight.world), "hover right")
    engine, world = flight.engine, flight.world
    shown = engine.reset(path_of(world, episode=1))
    (one,) = engine.entries("observations")
    assert (int(one.forced), int(one.elapsed_us)) == (1, 0)
    shown = engine.step([flight.command("left")])  # a command to which it does not listen
    (one,) = engine.entries("observations")
    assert shown.t_us == 45 * US + HOP_US - 60 * US
    assert (int(one.forced), int(one.elapsed_us)) == (0, shown.t_us)


@every_engine
def test_patience_goes_on_and_so_does_that_after_a_blocked_move():
    flight = carried(steps=1)
    for told in ("hover hover", "left left"):  # the strip ends at its west
        flight.engine.carry(None)
        flight.episode(path_of(flight.world), told)
        (drone,) = flight.engine.carried() or ()
        assert (drone.hop, drone.age_us, drone.rest_us) == (None, 15 * US, 30 * US)
        flight.episode(path_of(flight.world, episode=1), "hover right")
        assert asked(flight, 0) == [30 * US]
        flight.episode(path_of(flight.world, episode=2))
        assert asked(flight, 0)[0] == HOP_US - 30 * US


@every_engine
def test_a_drone_that_is_free_when_the_episode_ends_is_asked_when_the_next_one_begins():
    flight = carried(steps=3)  # 180 s are four times its patience
    for episode in range(2):
        flight.episode(path_of(flight.world, episode=episode))
        assert asked(flight, 0) == [0, 45 * US, 90 * US, 135 * US]
        assert times(flight)[-1] == 180 * US
    assert (flight.engine.carried() or ())[0].rest_us == 0


@every_engine
def test_a_charge_goes_on_and_the_drone_is_asked_when_it_is_full():
    # It needs 45 s for the 45 s that it has hovered, of which 15 s are of the first episode.
    stations = {"full_charge_min": 10}
    flight = carried(starts=[(4, 0)], battery=WIDE, stations=stations, steps=1)
    flight.episode(path_of(flight.world), "hover charge")
    second = flight.episode(path_of(flight.world, episode=1), "hover right")
    assert [event[0] for event in seen(second, "charged")] == [30 * US]
    assert asked(flight, 0) == [30 * US]
    (drone,) = flight.engine.carried() or ()
    assert (drone.mode, drone.age_us, drone.rest_us) == (Mode.FLYING, 30 * US, HOP_US - 30 * US)
    assert drone.charge == 600 * US


@every_engine
def test_a_queue_goes_on_and_its_drones_are_asked_in_turn():
    # Drone 0 lands at 45 s. Drone 1, which is one cell away, at 45 + 30.99 s, on the only pad.
    stations = {"full_charge_min": 10}
    flight = carried(starts=[(4, 0), (3, 0)], battery=WIDE, stations=stations, steps=1)
    flight.episode(path_of(flight.world), "hover charge", "hover goto")
    log = flight.episode(path_of(flight.world, episode=1))
    landed_us, full_us = 45 * US + HOP_US - 60 * US, 30 * US
    later_us = 2 * full_us + 15 * US + HOP_US  # it has used 45 s and the hop
    assert seen(log, "land", "charge", "charged") == events(f"""
        {landed_us}  3  land     1  -  -  0
        {full_us}  3  charged  0  -  -  0
        {full_us}  3  charge   1  -  -  0
    """)
    assert asked(flight, 0) == [full_us]
    third = flight.episode(path_of(flight.world, episode=2))
    assert [event[0] for event in seen(third, "charged")] == [later_us - 60 * US]
    assert asked(flight, 1)[0] == later_us - 60 * US


@every_engine
def test_a_battery_may_end_in_a_move_that_began_in_the_episode_before():
    # 70 s last for 25 s of a flight that begins at 45 s: 15 s in this episode, 10 s in the next.
    battery = {"autonomy_min": 70 / 60, "return_below": 0.1, "respawn_after_min": 0.75}
    flight = carried(starts=[(1, 0)], battery=battery, steps=1)
    flight.episode(path_of(flight.world), "hover right")
    second = flight.episode(path_of(flight.world, episode=1, respawn=[[0]]))
    assert seen(second, "arrive", "crash", "respawn") == events("""
        10000000  6  crash    0
        55000000  9  respawn  0  -  -  0
    """)
    assert asked(flight, 0) == [55 * US]
    fallen_m = second.steps[0].x_m - 360
    assert fallen_m == pytest.approx(25 * 8.3 - 8.3**2 / 8)


@every_engine
def test_downtime_goes_on_and_the_new_drone_is_asked_at_once():
    battery = {"autonomy_min": 50 / 60, "return_below": 0.1, "respawn_after_min": 0.75}
    flight = carried(starts=[(1, 0)], battery=battery, steps=1)
    flight.episode(path_of(flight.world))
    second = flight.episode(path_of(flight.world, episode=1, respawn=[[0]]))
    assert [event[0] for event in seen(second, "respawn")] == [35 * US]
    assert asked(flight, 0) == [35 * US]
    assert times(flight) == [0, 35 * US, 60 * US]


def test_there_are_no_more_epochs_than_foreseen():
    # A hover that is over after 1 µs is the first of 13 hovers of 5 s in 60 s.
    decisions = {"kind": "event", "patience_s": 5 - 1e-6}
    flight = Flight(strip(decisions=decisions, steps=1), carry_over=True)
    most = 0
    for episode in range(4):
        flight.episode(path_of(flight.world, episode=episode))
        most = max(most, len(flight.shown) - 1)
    assert most == 13 <= flight.world.most_epochs


# ---- three episodes are, to the drones, one of three times the length

PARTS = 3


def random_world(seed: int, **episode: Any) -> World:
    """A random world by event whose drones are carried over, in fleets of all kinds."""
    for k in range(seed, seed + 600_000, 10_000):
        made = random_all.one_of_all(k)
        made["episode"] |= {"carry_over": True, **episode}
        for drones in made["drones"]:
            if episode and drones["battery"] is not None:
                drones["battery"]["on_crash"] = "respawn"
        if made.get("decisions", {}).get("kind") == "event":
            try:
                return build_world(from_mapping(made), seed)
            except ScenarioError:
                continue
    raise AssertionError(f"no scenario from seed {seed} on is accepted")


def engine_on(world: World) -> Simulation:
    told = RunSettings((True,) * world.scenario.drone_count, carry_over=True, keep_events=True)
    return Simulation(world, told, audit=audit)


def whole_and_parts(world: World, long: World, seed: int) -> tuple[SamplePath, list[SamplePath]]:
    """The sample path of a long episode and those of its parts, as far as drones are concerned."""
    steps, drones = world.scenario.episode.steps, world.scenario.drone_count
    stations = max(len(world.stations), 1)
    places = np.random.default_rng(seed).integers(stations, size=(drones, 1))
    whole = draw(long, seed, 0)
    error = whole.position_error
    parts = [
        replace(
            draw(world, seed, part),
            position_error=None if error is None else error[:, part * steps :][:, : steps + 1],
            respawn=np.repeat(places, world.most_epochs + 1, axis=1),
        )
        for part in range(PARTS)
    ]
    return replace(whole, respawn=np.repeat(places, long.most_epochs + 1, axis=1)), parts


def decided(engine: Engine, path: SamplePath, since_us: int, seed: int) -> dict[Any, Any]:
    """What drones know and may do whenever they are free, by time and drone.

    What they are told depends on the time and the drone alone.
    """
    shown, known = engine.reset(path), {}
    alone = {"step": 0, "steps": 0, "attached_users": 0, "served_requests": 0, "bandwidth_khz": 0}
    while not (shown.terminated or shown.truncated):
        t_us, commands = shown.t_us + since_us, []
        for d, (one, mask) in enumerate(zip(shown.observations, shown.masks, strict=True)):
            if engine.drones[d].waits:
                told = one._replace(**alone, served=(), asking=(), features=())
                known[t_us, d] = told, mask, engine.position_m(d)
            commands.append(
                some_command(engine.world, mask, np.random.default_rng([seed, t_us, d]))
            )
        shown = engine.step(commands)
    return known


FLOWN = {"depart", "blocked", "arrive", "land", "charge", "charged", "deplete", "crash", "respawn"}


def flown(log: EpisodeLog, since_us: int = 0) -> list[tuple[Any, ...]]:
    """Return what each drone did in an episode, and the times at which it was asked."""
    kinds = {*FLOWN, "decide"}
    return [(e[0] + since_us, *e[1:7]) for e in log.events or () if e[2] in kinds]


def check_parts(seed: int, met: Counter[str]) -> None:
    steps = int(np.random.default_rng(seed).integers(1, 5))
    world, long = random_world(seed, steps=steps), random_world(seed, steps=PARTS * steps)
    whole, parts = whole_and_parts(world, long, seed)
    one, other = engine_on(long), engine_on(world)
    wanted, found, flights, logs = decided(one, whole, 0, seed), {}, [], []
    for part, path in enumerate(parts):
        since_us = part * world.horizon_us
        found |= decided(other, path, since_us, seed)
        flights += flown(other.log, since_us)
        logs.append(other.log)
        count_carried(other.carried(), met)
    assert found == wanted
    assert flights == flown(one.log)
    for name in ("crashes", "charges", "queueing_us"):
        assert sum(getattr(log, name) for log in logs) == getattr(one.log, name)
    distance_m = sum(log.distance_m for log in logs)
    assert distance_m == pytest.approx(one.log.distance_m, rel=1e-12, abs=1e-9)


def count_carried(drones: Carried | None, met: Counter[str]) -> None:
    for drone in drones or ():
        met[drone.mode.name] += 1
        met["moves"] += drone.rest_us > 0 and drone.hop is not None
        flies = drone.free is not None and drone.free[:3] != drone.free[3:6]
        met["flies freely"] += drone.rest_us > 0 and flies
        met["hovers"] += drone.rest_us > 0 and drone.hop is None and not flies


@pytest.mark.thorough
@pytest.mark.parametrize("first", by_default((), range(0, 40, 10), 1))
def test_three_episodes_are_to_drones_one_of_three_times_the_length(first: int):
    met: Counter[str] = Counter()
    for seed in range(first, first + 10):
        check_parts(seed, met)
    assert min(met[what] for what in ("moves", "flies freely", "hovers", "CHARGING")) > 0, met


# ---- both engines


@pytest.mark.thorough
@pytest.mark.parametrize("first", by_default((), range(0, 120, 20), 1))
def test_engines_are_equal_in_random_scenarios_and_no_event_breaks_a_rule(first: int):
    met: Counter[str] = Counter()
    for seed in range(first, first + 20):
        world = random_world(seed)
        one, other = engines(world, (True,) * world.scenario.drone_count)
        for episode in range(3):
            assert not differences(one, other, seed, episode), seed
            count_carried(one.carried(), met)
        if seed % 4 == 0:
            decided(audited := engine_on(world), draw(world, seed, 0), 0, seed)
            decided(audited, draw(world, seed, 1), 0, seed)
            check_log(world, audited.log)
    assert min(met[what] for what in ("moves", "flies freely", "hovers", "CHARGING")) > 0, met


def played(engine: Engine, seed: int, episodes: range) -> list[Any]:
    """All there is to see of some episodes under random commands."""
    found: list[Any] = []
    for episode in episodes:
        rng = np.random.default_rng([seed, episode])
        found.append(engine.reset(draw(engine.world, seed, episode)))
        while not (found[-1].terminated or found[-1].truncated):
            masks = found[-1].masks
            found.append(engine.step([some_command(engine.world, mask, rng) for mask in masks]))
        found += [engine.log.events, engine.log.legs, engine.log.steps, engine.carried()]
    return found


def check_another_goes_on(world: World, one: str, other: str, seed: int) -> None:
    told = RunSettings((True,) * world.scenario.drone_count, carry_over=True, keep_events=True)
    first, second = (make_engine(name, world, told) for name in (one, other))
    played(first, seed, range(2))
    second.carry(first.carried())
    assert played(first, seed, range(2, 4)) == played(second, seed, range(2, 4))
    # A state that was saved just after the boundary, and one at the end of an episode.
    first.reset(draw(world, seed, 4))
    saved = first.save()
    assert second.restore(saved) == first.latest
    assert second.save().digest() == saved.digest()
    rng, again = np.random.default_rng(seed), np.random.default_rng(seed)
    assert _finished(first, rng) == _finished(second, again)
    second.restore(first.save())
    assert played(first, seed, range(5, 6)) == played(second, seed, range(5, 6))


def _finished(engine: Engine, rng: np.random.Generator) -> list[Snapshot | None]:
    found = [engine.latest]
    while (shown := engine.latest) and not (shown.terminated or shown.truncated):
        found.append(engine.step([some_command(engine.world, mask, rng) for mask in shown.masks]))
    return found


@pytest.mark.parametrize("other", ["des", "batch"])
def test_another_engine_goes_on(other: str):
    world = by_event(
        starts=[(0, 0), (4, 0), (8, 0)],
        users=[(x, 120) for x in range(60, 2160, 60)],
        battery=WIDE,
        stations={"full_charge_min": 5},
        steps=2,
    )
    check_another_goes_on(world, "des", other, 3)


@pytest.mark.thorough
@pytest.mark.parametrize("names", [("des", "batch"), ("batch", "des"), ("batch", "batch")])
def test_another_engine_goes_on_in_random_scenarios(names: tuple[str, str]):
    for seed in range(200, 212):
        check_another_goes_on(random_world(seed), *names, seed)


# ---- learners


def learned(engine: str) -> np.ndarray[Any, Any]:
    made = {
        "map": {"size_m": [720, 720], "cells": [3, 3], "dimensions": 2},
        "drones": {
            "count": 2,
            "motion": {"timing": "minimum_time"},
            "battery": {"autonomy_min": 6, "return_below": 0.7, "respawn_after_min": 1},
        },
        "stations": {"count": 1, "radius_m": 0, "full_charge_min": 3},
        "users": {"count": 6, "clusters": {"count": 1}},
        "decisions": {"kind": "event", "patience_s": 20},
        "episode": {"steps": 5, "carry_over": True},
        "learning": {"restart_every": 7},
    }
    training = Training(build_world(from_mapping(made), 0), 0, engine)
    waiting = 0
    while training.episode < 30:
        training.play(1)
        waiting += sum(lesson.state >= 0 for lesson in training.remember().pending)
    assert waiting > 30, "most decisions wait for the next episode"
    return training.q.copy()


@pytest.mark.thorough
def test_learners_learn_the_same_on_both_engines():
    one, other = map(learned, ENGINES)
    assert np.abs(one).sum() > 0
    assert (one == other).all()


# ---- states of drones from a file

FORGED: dict[str, tuple[int, dict[int, Any]]] = {
    "as it was": (0, {}),
    "a hover, as it was": (1, {}),
    "longer": (0, {10: 17_971_990}),
    "another action": (0, {11: 0}),
    "no action": (0, {11: 99}),
    "no number": (0, {10: "x"}),
    "another way": (0, {4: [-1, 0, 0]}),
    "off the map": (0, {1: [8, 0, 0]}),
    "more patience": (1, {10: 45_000_000}),
    "in a queue": (1, {0: int(Mode.QUEUED), 1: [4, 0, 0]}),
    "crashed": (1, {0: int(Mode.CRASHED), 8: [120.0, 120.0]}),
}


@pytest.mark.parametrize("name", FORGED)
def test_states_that_no_drone_can_be_in_are_refused(name: str):
    flight = carried(starts=[(0, 0), (4, 0)], battery=WIDE)
    flight.episode(path_of(flight.world), "right hover hover right hover right")
    plain = json.loads(json.dumps(flight.engine.carried()))
    assert [drone[10] for drone in plain] == [17_971_989, 15_000_000]
    drone, changes = FORGED[name]
    for place, value in changes.items():
        plain[drone][place] = value
    if "as it was" in name:
        assert checked(plain, flight.world, (True, True)) == flight.engine.carried()
    else:
        with pytest.raises(ValueError, match=r"\w"):
            checked(plain, flight.world, (True, True))


# ---- environments

ASKED = {
    "decisions": {"kind": "event", "patience_s": 30},
    "drones.motion.timing": "minimum_time",
    "episode.steps": 4,
}


@pytest.mark.thorough
def test_environments_play_whole_episodes_and_begin_where_the_last_one_ended():
    env = UavEnv("case8", ASKED, world_seed=0)
    rng, forced = np.random.default_rng(0), 0
    for episode in range(6):
        held = env.session.engine.carried() if episode else None
        rests = [drone.rest_us for drone in held or ()]
        _, info = env.reset(seed=1 if episode == 0 else None)
        masks = info["action_mask"].reshape(3, -1)
        assert info["elapsed_steps"] == 0.0
        assert all(mask.sum() == 1 for mask, rest in zip(masks, rests, strict=False) if rest > 0)
        forced += sum(rest > 0 for rest in rests)
        over = False
        while not over:
            masks = info["action_mask"].reshape(3, -1)
            action = [int(rng.choice(np.flatnonzero(mask))) for mask in masks]
            _, _, terminated, truncated, info = env.step(np.array(action))
            over = terminated or truncated
        assert terminated or info["sim_time_s"] == 240.0
    assert forced > 0


@pytest.mark.thorough
def test_a_state_file_goes_on_after_the_boundary(tmp_path: Path):
    one, other = (UavEnv("case8", ASKED, world_seed=0) for _ in range(2))
    rng = np.random.default_rng(5)
    info = one.reset(seed=2)[1]
    for _ in range(40):
        masks = info["action_mask"].reshape(3, -1)
        action = np.array([int(rng.choice(np.flatnonzero(mask))) for mask in masks])
        *_, terminated, truncated, info = one.step(action)
        if terminated or truncated:
            info = one.reset()[1]
    one.save().write(tmp_path / "state.npz")
    other.restore(tmp_path / "state.npz")
    masks = info["action_mask"].reshape(3, -1)
    action = np.array([int(rng.choice(np.flatnonzero(mask))) for mask in masks])
    ours, theirs = one.step(action), other.step(action)
    assert ours[1] == theirs[1]
    assert ours[4]["sim_time_s"] == theirs[4]["sim_time_s"]
