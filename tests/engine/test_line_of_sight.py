"""Links with line of sight by draws and past buildings, and with shadowing, in both engines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from desim_uav.engine.choose import ENGINES, make_engine
from desim_uav.engine.des import Simulation
from desim_uav.engine.episode import Engine
from desim_uav.model.rules import Action
from desim_uav.sample_path import SamplePath, draw
from desim_uav.scenario.load import from_mapping
from desim_uav.world import World, build_world
from tests.audit.invariants import audit
from tests.engine.helpers import before_end, events, fly, path_of, seen, some_command
from tests.engine.towns import RADIO, WORLDS, told, town

pytestmark = pytest.mark.thorough
"""Both engines compile the kernels of lines of sight, which takes long."""


def flown(engine: Engine, path: SamplePath, hover: bool = False) -> list[Any]:
    """The events of an episode under random commands, or without any moves."""
    rng = np.random.default_rng(5)
    shown = engine.reset(path)
    while not (shown.terminated or shown.truncated):
        shown = engine.step(
            [0 if hover else some_command(engine.world, m, rng) for m in shown.masks]
        )
    return [tuple(event) for event in engine.log.events or ()]


@pytest.mark.parametrize("name", WORLDS)
def test_both_engines_and_the_audit_agree(name: str) -> None:
    world = town(**WORLDS[name])
    path = draw(world, 1, 0)
    one = flown(Simulation(world, told(world), audit=audit), path)
    assert len(one) > 100
    assert flown(make_engine("batch", world, told(world)), path) == one


@pytest.mark.parametrize("interference", ["none", "co_channel"])
def test_the_audit_agrees_where_legs_begin_within_a_step(interference: str) -> None:
    """One flies back in several hops; one crashes, and disturbs the links of another no more.

    The latter has charged for two minutes. At the crash it flies to the next cell, where its links
    have other draws.
    """
    world = town(
        radio={"interference": interference},
        battery={"autonomy_min": 4.3, "return_below": 1.0},
        stations={"count": 1, "radius_m": 0},
    )
    simulation = Simulation(world, told(world), audit=audit)
    hover, ahead, *others = (
        world.actions.index(one)
        for one in (Action.HOVER, Action.FORWARD, Action.GOTO_CHARGING_STATION, Action.CHARGE)
    )
    shown, serving = simulation.reset(draw(world, 1, 0)), []
    while not (shown.terminated or shown.truncated):
        first = [one if shown.masks[d][one] else hover for d, one in enumerate(others)]
        first[1] = {3: hover, 4: ahead}.get(len(serving), first[1])
        shown = simulation.step([*first, hover])
        serving.append([drone.serving for drone in simulation.state.senders])
    within = {event[2] for event in simulation.log.events or () if event[0] % 60_000_000}
    assert {"arrive", "land", "crash"} <= within
    assert [bool(one) for one in serving[4][1:]] == [True, False]


@pytest.mark.parametrize("name", ["drawn", "shadowing alone"])
def test_the_audit_notices_other_draws(name: str) -> None:
    world = town(**WORLDS[name])
    path = draw(world, 1, 0)
    simulation = Simulation(world, told(world), audit=audit)
    simulation.reset(path)
    simulation.drawn = replace(path, link_key=path.link_key + np.uint64(1))
    with pytest.raises(AssertionError, match="classes of"):
        for _ in range(6):
            simulation.step([0] * 3)


@pytest.mark.parametrize("engine", ENGINES)
def test_one_more_drone_leaves_the_links_of_others_as_they_are(engine: str) -> None:
    """Drones that hover at the same places have the same links, whoever else there is."""
    links = []
    for count in (3, 4):
        world = town(count)
        found = flown(make_engine(engine, world, told(world)), draw(world, 1, 0), hover=True)
        kinds = ("enter", "exit", "class")
        links.append([row for row in found if row[2] in kinds and row[3] < 3])
    assert links[0] == links[1]
    assert len(links[0]) > 20


@pytest.mark.parametrize("engine", ENGINES)
def test_one_more_drone_leaves_the_links_of_an_access_point_as_they_are(engine: str) -> None:
    """Its number among all that transmit is another one then, but not its number in draws."""
    point = {"at_m": [600, 600], "height_m": 20, "radio": RADIO}
    links = []
    for count in (1, 2):
        world = town(count, access_points=[point])
        found = flown(make_engine(engine, world, told(world)), draw(world, 1, 0), hover=True)
        kinds = ("enter", "exit", "class")
        links.append([row[:3] + row[4:] for row in found if row[2] in kinds and row[3] == count])
    assert links[0] == links[1]
    assert len(links[0]) > 20


def test_episodes_and_seeds_have_draws_of_their_own() -> None:
    world = town()
    keys = [tuple(draw(world, seed, e).link_key.tolist()) for seed in (1, 2) for e in (0, 1)]
    assert len(set(keys)) == 4
    assert not draw(
        town(**{"radio": {"line_of_sight": "mean", "shadowing": None}}), 1, 0
    ).link_key.any()


def street(users: Sequence[tuple[float, float]], roof_m: float = 50.0) -> World:
    """A drone at (50, 50), 60 m high; a house on (200 to 300, 0 to 100), and users behind it.

    Links with line of sight lose 20 dB less, and have 2 bit/s/Hz instead of 1.
    """
    radio = {
        "kind": "link_classes",
        "power_dbm": 100,
        "bandwidth_mhz": 1,
        "noise_figure_db": 0,
        "noise_dbm_per_hz": -60,
        "path_loss": {
            "kind": "al_hourani",
            **{"a": 10, "b": 0.1, "eta_los_db": 0, "eta_nlos_db": 20},
        },
        "carrier_ghz": 0.1,
        "line_of_sight": "buildings",
        "classes": [{"snr_db": 0, "bit_s_hz": 1}, {"snr_db": 20, "bit_s_hz": 2}],
        "sharing": "equal",
    }
    scenario = {
        "map": {
            "size_m": [600, 400],
            "cells": [6, 4],
            "dimensions": 3,
            "levels": {"min_altitude_m": 60},
            "obstacles": {"cells": [[2, 0, roof_m]]},
        },
        "drones": {"count": 1, "radio": radio, "battery": None, "start_cells": [[0, 0]]},
        "stations": {"count": 0},
        "users": {"positions_m": users, "max_height_m": 0, "mobility": {"kind": "static"}},
        "services": {"upload": {"kind": "transfer", "volume_mbit": [1]}},
        "demand": {"kind": "static", "mix": {"upload": 1}},
        "episode": {"steps": 2, "step_s": 60},
    }
    return build_world(from_mapping(scenario), 0)


@pytest.mark.usefixtures("every_engine")
class TestByHand:
    """Flights of every engine."""

    def test_a_walker_comes_out_from_behind_a_house(self) -> None:
        """The line to (450, y) leaves the house at its corner (200, 100) if y - 50 = 8 / 3 * 50.

        It is above the house at x = 300 only if its height there, 60 m * 150 / 400, exceeds the
        roof, which it does not. The walker is there after 83.333333 s at 1 m/s.
        """
        world = street([(450.0, 100.0)])
        log = fly(world, path_of(world, walks={0: [(0.0, 450.0, 100.0, 0.0, 1.0)]}))
        assert [event[:5] for event in before_end(log) if event[2] == "class"] == [
            event[:5] for event in events("83333333 4 class 0 0")
        ]

    def test_a_low_house_hides_nobody(self) -> None:
        """At x = 300, where it is lowest above the house, the line is 22.5 m high."""
        for roof_m, changes in ((22.0, 0), (23.0, 1)):
            world = street([(450.0, 100.0)], roof_m)
            log = fly(world, path_of(world, walks={0: [(0.0, 450.0, 100.0, 0.0, 1.0)]}))
            assert len(seen(log, "class")) == changes

    def test_a_user_without_a_drone_takes_the_strongest_whatever_the_margin(self) -> None:
        """Of two drones that differ by less than the margin, the user is closer to the first."""
        radio = {
            "line_of_sight": "mean",
            "shadowing": None,
            "path_loss": {"kind": "free_space"},
            "interference": "none",
        }
        world = town(
            2,
            radio=radio,
            association={"kind": "a3", "hysteresis_db": 6},
            users={"positions_m": [(330.0, 360.0)], "mobility": {"kind": "static"}},
        )
        attached = seen(fly(world, path_of(world)), "attach")
        assert [event[3] for event in attached] == [0]


@pytest.mark.parametrize("engine", ENGINES)
def test_a_learner_sees_how_good_links_are(engine: str) -> None:
    """The mean efficiency of the links to attached users, over that of the best class."""
    world = town(observation={"kind": "local"}, radio={"power_dbm": 24}, association="strongest")
    flying = make_engine(engine, world, told(world))
    shown = flying.reset(draw(world, 1, 0))
    names = [feature.name for feature in world.scenario.observation.features(world.facts)]
    bits = [0.0, *(one.bit_s_hz for one in world.scenario.drones.radio.ladder)]  # type: ignore[attr-defined]
    found, covered_alone = [], True
    for _ in range(5):
        shown = flying.step([0, 0, 0])
        for drone, observation in enumerate(shown.observations):
            own = [u for u in flying.state.users if u.holder == drone]  # type: ignore[attr-defined]
            covered_alone &= all(sum(c >= 0 for c in u.covering) < 2 for u in own)
            mean = np.mean([bits[int(u.classes[drone])] for u in own]) / bits[-1] if own else 0.0
            found.append(observation.features[names.index("link_quality")])
            assert found[-1] == pytest.approx(mean, abs=1e-12)
    assert len(set(found)) > 5 and not covered_alone
    assert "link_quality" not in [
        feature.name
        for feature in world.scenario.observation.features(world.facts._replace(graded=False))
    ]
