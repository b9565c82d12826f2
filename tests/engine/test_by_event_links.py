"""Links beside decisions by event: lines of sight, levels, interference, access points.

Legs begin and end at different times, so links are looked at in spans that begin within the legs of
others. Worlds by hand are flown by both engines.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from desim_uav import UavEnv, UavParallelEnv, UavParallelVectorEnv
from desim_uav.engine.base import RunSettings
from desim_uav.engine.choose import ENGINES, make_engine
from desim_uav.learning.training import Training
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, load
from desim_uav.world import World, build_world
from tests.engine.helpers import (
    HOP_US,
    US,
    Flight,
    before_end,
    check_that_the_other_engine_goes_on,
    events,
    path_of,
    seen,
    some_command,
)
from tests.engine.helpers import radio as usual_radio
from tests.engine.random_asked import cut, scenario, together, world_of
from tests.engine.random_radio import audited
from tests.engine.replay import check_log
from tests.engine.test_by_event import asked
from tests.selection import by_default
from tests.verification.engines import SUMS, differences, engines, row

pytestmark = pytest.mark.thorough
"""Both engines compile the kernels of links in the air, which takes long."""

ASKED = {"kind": "event", "patience_s": 45}
SPEED, RAMP_S, RAMP_M = 8.3, 8.3 / 4, 8.3 * 8.3 / 8
"""The fastest flight of a hop, how long a drone takes to reach it, and how far it comes then."""


def radio(**changes: Any) -> dict[str, Any]:
    """The radio of ``test_access_points``, whose only class begins at 30 dB here."""
    return usual_radio(**{"classes": [{"snr_db": 30, "bit_s_hz": 1}], **changes})


def road(
    starts: Sequence[int], places: Sequence[tuple[float, float]], links: Any = None, **changes: Any
) -> World:
    """Cells of 240 m along x, over which drones fly at 20 m and hover for 45 s."""
    scenario = {
        "map": {
            "size_m": [2400, 240],
            "cells": [10, 1],
            "dimensions": 2,
            "levels": {"min_altitude_m": 20},
        },
        "drones": {
            "count": len(starts),
            "start_cells": [[x, 0] for x in starts],
            "radio": radio(**(links or {})),
            "motion": {"timing": "minimum_time"},
            "battery": None,
        },
        "stations": {"count": 0},
        "users": {"positions_m": places, "mobility": {"kind": "static"}},
        "services": {"upload": {"kind": "transfer", "volume_mbit": [1]}},
        "demand": {"kind": "static", "mix": {"upload": 1}},
        "decisions": ASKED,
        "episode": {"steps": 2, "step_s": 60},
        **changes,
    }
    return build_world(from_mapping(scenario), 0)


def flown_m(t_s: float, hop_m: float = 240.0) -> float:
    """How far a drone has flown so long after it began a hop."""
    lasts_s = hop_m / SPEED + RAMP_S
    if t_s <= RAMP_S:
        return 2.0 * t_s * t_s
    if t_s <= lasts_s - RAMP_S:
        return RAMP_M + SPEED * (t_s - RAMP_S)
    return hop_m - 2.0 * max(lasts_s - t_s, 0.0) ** 2


def street() -> World:
    """A drone 60 m high at (50, 150), and a house on (200 to 300, 0 to 100) with a roof at 50 m.

    Links with line of sight lose 20 dB less, and have 2 bit/s/Hz instead of 1.
    """
    links = {
        "path_loss": {
            "kind": "al_hourani",
            **{"a": 10, "b": 0.1, "eta_los_db": 0, "eta_nlos_db": 20},
        },
        "carrier_ghz": 0.1,
        "line_of_sight": "buildings",
        "classes": [{"snr_db": 0, "bit_s_hz": 1}, {"snr_db": 20, "bit_s_hz": 2}],
    }
    city = {
        "size_m": [600, 400],
        "cells": [6, 4],
        "dimensions": 3,
        "levels": {"min_altitude_m": 60},
        "obstacles": {"cells": [[2, 0, 50]]},
    }
    users = {"positions_m": [(450, 150)], "max_height_m": 0, "mobility": {"kind": "static"}}
    drones = {
        "count": 1,
        "start_cells": [[0, 1]],
        "radio": radio(**links),
        "motion": {"timing": "minimum_time"},
        "battery": None,
    }
    return road([0], [], map=city, users=users, drones=drones)


def mast(x: float, **changes: Any) -> dict[str, Any]:
    """An access point of 20 m, in the middle of the road."""
    return {"at_m": [x, 120.0], "height_m": 20, "radio": radio(**changes)}


@pytest.mark.usefixtures("every_engine")
class TestByHand:
    """Flights of every engine."""

    def test_a_user_goes_out_of_sight_behind_a_house(self) -> None:
        """The line to (450, 150) passes the corner (200, 100) where the drone is at y = 70.

        From y = 150 to 50 it takes 100 / 8.3 + 8.3 / 4 = 14.123193 s. It is at y = 70 so long
        before it arrives, or after it has set out again, as 20 m take: 3.447139 s.
        """
        flight = Flight(street())
        log = flight.episode(path_of(flight.world), "hover backward forward hover")
        hop_us, near_us = 14_123_193, 3_447_138.554
        out_us, back_us = 45 * US + hop_us - near_us, 45 * US + hop_us + near_us
        assert [event[:5] for event in before_end(log, "class")] == [
            event[:5]
            for event in events(f"""
                {round(out_us)}  2 class 0 0
                {round(back_us)} 4 class 0 0
            """)
        ]
        assert asked(flight, 0)[:4] == [0, 45 * US, 45 * US + hop_us, 45 * US + 2 * hop_us]

    def test_a_handover_within_the_legs_of_two_drones(self) -> None:
        """Drone 0 comes from 360 m since 30.990663 s, drone 1 goes from 1,080 m since 45 s.

        Both are equally far from 840 m where 480 - 8.3 (t - 30.990663) and 240 + 8.3 (t - 45) meet,
        both less what they lose while they speed up.
        """
        world = road([0, 4], [(840.0, 120.0)], association="strongest")
        flight = Flight(world)
        told = "right right right hover hover", "hover hover right right hover"
        log = flight.episode(path_of(world), *told)
        t_us = ((480 - 240) / SPEED + HOP_US / US + 45 + RAMP_S) / 2 * US
        (handed,) = seen(log, "handover")
        assert handed[:5] == (round(t_us), 7, "handover", 0, 0)
        assert asked(flight, 0)[:3] == [0, HOP_US, 2 * HOP_US]
        assert asked(flight, 1)[:3] == [0, 45 * US, 45 * US + HOP_US]

    def test_a_time_to_trigger_goes_on_from_leg_to_leg(self) -> None:
        """As above, but 10 s later, when drone 0 is on its next leg, past the user."""
        a3 = {"kind": "a3", "hysteresis_db": 0, "time_to_trigger_ms": 10_000}
        world = road([0, 4], [(840.0, 120.0)], association=a3)
        flight = Flight(world)
        told = "right right right hover hover", "hover hover right right hover"
        log = flight.episode(path_of(world), *told)
        t_us = ((480 - 240) / SPEED + HOP_US / US + 45 + RAMP_S) / 2 * US
        (handed,) = seen(log, "handover")
        assert handed[:5] == (round(t_us) + 10 * US, 7, "handover", 0, 0)
        assert handed[0] > 2 * HOP_US

    def test_an_access_point_beside_a_drone(self) -> None:
        """The drone is asked every 45 s; the point is looked at after 60 s, in between.

        The walker enters its footprint, of a radius of 315.594677 m, after 73.762129 s. It is
        attached to it, which is closer than the drone, and leaves that of the drone at 95.594677 m.
        """
        near = {"classes": [{"snr_db": 50, "bit_s_hz": 1}]}
        world = road([4], [(1000.0, 120.0)], near, access_points=[mast(1500, **near)])
        walk = {0: [(0.0, 1000.0, 120.0, 2.5, 0.0)]}
        flight = Flight(world)
        log = flight.episode(path_of(world, walks=walk))
        reach_m = np.sqrt(10**5 - 400.0)
        enters_us = round((1500 - reach_m - 1000) / 2.5 * US)
        assert enters_us == 73_762_129
        assert [event[:5] for event in before_end(log)] == [
            event[:5]
            for event in events(f"""
                           0 4 enter  0 0
                           0 7 attach 0 0
                {enters_us} 4 enter  1 0
            """)
        ]
        assert asked(flight, 0) == [0, 45 * US, 90 * US]
        assert [tuple(row)[:4] for row in log.point_steps] == [
            (0, 45 * US, 0, 0),
            (1, 90 * US, 0, 0),
            (2, 120 * US, 0, 0),
        ]

    def test_a_user_passes_from_a_drone_to_an_access_point(self) -> None:
        """The drone flies away from 1,080 m since 45 s; both are equally far from 1,200 m then."""
        world = road([4], [(1200.0, 120.0)], access_points=[mast(1400)], association="strongest")
        flight = Flight(world)
        log = flight.episode(path_of(world), "hover left hover")
        (handed,) = seen(log, "handover")
        t_us = 45 * US + (RAMP_S + (80 - RAMP_M) / SPEED) * US
        assert handed[:5] == (round(t_us), 7, "handover", 1, 0)

    def test_two_drones_and_an_access_point_disturb_one_another(self) -> None:
        """The class of the link to drone 0 changes where its ratio passes 3 dB, by bisection.

        Drone 1 comes nearer since 30.990663 s, in the middle of a hover of drone 0, and drone 0
        flies on from 45 s.
        """
        classes = [{"snr_db": -30, "bit_s_hz": 0.1}, {"snr_db": 3, "bit_s_hz": 1}]
        on_air = {"classes": classes, "interference": "co_channel"}
        user = (860.0, 120.0)
        world = road([2, 6], [user], on_air, access_points=[mast(2000, **on_air)])
        flight = Flight(world)
        log = flight.episode(path_of(world), "hover hover right", "left left left left")

        def ratio_db(t_us: float) -> float:
            legs = t_us - HOP_US * np.arange(3)
            one_m = 1560.0 - sum(flown_m(leg / US) for leg in legs if leg > 0)
            own_m = 600.0 + (flown_m((t_us - 45 * US) / US) if t_us > 45 * US else 0.0)
            levels_mw = [10**10 / ((x - user[0]) ** 2 + 400) for x in (own_m, one_m, 2000.0)]
            return float(10 * np.log10(levels_mw[0] / (levels_mw[1] + levels_mw[2] + 1.0))) - 3.0

        grid = np.arange(0.0, 3 * HOP_US, US / 4)
        ratios = [ratio_db(t_us) for t_us in grid]
        turns = [k for k in range(len(grid) - 1) if (ratios[k] < 0) != (ratios[k + 1] < 0)]
        found_us = [brentq(ratio_db, grid[k], grid[k + 1], xtol=1e-3) for k in turns]
        changes = [e for e in seen(log, "class") if e[3] == 0 and e[0] < 3 * HOP_US]
        assert len(changes) == len(found_us) >= 2
        assert [event[0] for event in changes] == pytest.approx(found_us, abs=1)


# ---- whole steps


def tables(name: str, world: World, seed: int) -> list[Any]:
    """All that is logged of an episode with random commands."""
    told = RunSettings((True,) * world.scenario.drone_count, False, keep_events=True)
    engine, rng = make_engine(name, world, told), np.random.default_rng(seed)
    shown, found = engine.reset(draw(world, 1, 0)), []
    while not (shown.terminated or shown.truncated):
        found.append((shown.masks, shown.observations, shown.rewards))
        shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
    log = engine.log
    sums = [getattr(log, name) for name in SUMS]
    return [found, log.events, log.legs, log.steps, [row(r) for r in log.requests], sums]


@pytest.mark.parametrize("first", by_default((), range(0, 40, 10), 1))
def test_drones_that_are_asked_together_fly_as_by_clock(first: int) -> None:
    """If all legs are whole steps, event by event and bit for bit."""
    for seed in range(first, first + 10):
        by_clock, by_event = (together(seed, decided) for decided in ("clock", "event"))
        name = ENGINES[seed % 2]
        assert tables(name, by_event, seed) == tables(name, by_clock, seed), seed


# ---- other spans


def events_of(world: World, seed: int) -> list[Any]:
    """The events of an episode with random commands."""
    told = RunSettings((True,) * world.scenario.drone_count, False, keep_events=True)
    engine, rng = make_engine("des", world, told), np.random.default_rng(seed)
    shown = engine.reset(draw(world, 1, 0))
    while not (shown.terminated or shown.truncated):
        shown = engine.step([some_command(world, mask, rng) for mask in shown.masks])
    return list(engine.log.events or ())


def test_where_spans_are_cut_does_not_matter() -> None:
    """Access points are looked at for 60, 120 and 240 s at a time."""
    found = 0
    for seed in range(12):
        often, seldom, rarely = (events_of(cut(seed, longer), seed) for longer in (1, 2, 4))
        assert often == seldom == rarely, seed
        found += len(often)
    assert found > 5_000


# ---- random scenarios


def unlike(seed: int) -> list[str]:
    """In what two episodes of both engines differ."""
    world = world_of(seed)
    one, other = engines(world, (bool(seed % 2),) * world.scenario.drone_count)
    return [name for episode in range(2) for name in differences(one, other, seed, episode)]


@pytest.mark.parametrize("first", by_default((), range(0, 120, 20), 1))
def test_engines_agree_in_many_random_scenarios(first: int) -> None:
    found = {seed: unlike(seed) for seed in range(first, first + 20)}
    assert {seed: names for seed, names in found.items() if names} == {}


@pytest.mark.parametrize("first", [120, pytest.param(140, marks=pytest.mark.slow)])
def test_no_event_breaks_a_rule(first: int) -> None:
    """The audit after each event, and the log read by rules of its own."""
    for seed in range(first, first + 20):
        world = world_of(seed)
        for log in audited(world):
            check_log(world, log)


def test_the_scenarios_have_everything_in_them() -> None:
    found = Counter(kind for seed in range(120) for kind in _kinds(scenario(seed)))
    names = ("drawn", "buildings", "shadowing", "interference", "points", "strongest", "a3")
    assert all(found[name] >= 12 for name in names), found


def _kinds(made: Mapping[str, Any]) -> set[str]:
    own, association = made["drones"]["radio"], made["association"]
    kind = association if isinstance(association, str) else association["kind"]
    return {
        own["line_of_sight"],
        kind,
        *(["shadowing"] if own["shadowing"] else []),
        *(["interference"] if own["interference"] != "none" else []),
        *(["points"] if made["access_points"] else []),
    }


# ---- saved states and environments


@pytest.mark.parametrize("name", ENGINES)
def test_the_other_engine_goes_on_from_a_saved_state(name: str) -> None:
    """In the middle of legs. In some of these scenarios, marks of links have to be made anew."""
    for seed in (0, 2, 4, 8, 14, 17, 25, 36, 41, 45):
        check_that_the_other_engine_goes_on(world_of(seed), name, seed)


LINKED = {
    "decisions": {"kind": "event", "patience_s": 25},
    "drones.motion.timing": "minimum_time",
    "drones.radio.line_of_sight": "drawn",
    "drones.radio.shadowing": {"los_db": 2, "nlos_db": 6},
    "access_points": [
        {
            "at_m": [700, 700],
            "height_m": 20,
            "radio": {"kind": "link_classes", "interference": "co_channel", "sharing": "equal"},
        }
    ],
    "observation.kind": "local",
    "episode.steps": 6,
}
"""The scenario ``interference``, decided by event, with all that changes links."""

PARTS = ("observation", "action_mask")


def steps_of(engine: str) -> list[Any]:
    """What an environment shows in two whole episodes of random allowed actions."""
    env, rng, found = UavEnv("interference", LINKED, engine=engine), np.random.default_rng(3), []
    for episode in range(2):
        _, info = env.reset(seed=episode)
        over = False
        while not over:
            masks = info["action_mask"].reshape(env.drones, -1)
            action = np.array([rng.choice(np.flatnonzero(mask)) for mask in masks])
            seen_now, reward, ended, cut, info = env.step(action)
            found.append((seen_now.tobytes(), float(reward), info["sim_time_s"]))
            over = ended or cut
    return found


def test_an_environment_plays_whole_episodes_alike_on_both_engines() -> None:
    one, other = (steps_of(engine) for engine in ENGINES)
    assert one == other
    assert len(one) > 60


def test_many_environments_play_whole_episodes_as_one_does() -> None:
    """Each row of the compiled ones, until its first episode is over."""
    many = UavParallelVectorEnv("interference", 2, LINKED, world_seed=0)
    each = [UavParallelEnv("interference", LINKED, world_seed=0) for _ in range(2)]
    rng, epochs = np.random.default_rng(0), 0
    many.reset(seed=7)
    for k, env in enumerate(each):
        env.reset(seed=7 + k)
    while all(env.agents for env in each):
        actions = rng.integers(5, size=(2, many.drones))
        rows, paid, *ends, told = many.step(actions)
        for k, env in enumerate(each):
            agents = zip(env.agents, actions[k].tolist(), strict=True)
            seen_now, rewards, *over, _ = env.step(dict(agents))
            alone = {part: np.stack([of[part] for of in seen_now.values()]) for part in PARTS}
            assert (rows[k] == alone["observation"]).all()
            assert (told["action_mask"][k] == alone["action_mask"]).all()
            assert paid[k].tolist() == list(rewards.values())
            for ended, ours in zip(ends, over, strict=True):
                assert ended[k].tolist() == list(ours.values())
        epochs += 1
    assert epochs > 20


def learned(engine: str) -> np.ndarray[Any, Any]:
    """The Q-table after three episodes, with a reward that counts whom links serve."""
    changes = {**LINKED, "observation.kind": "position", "reward": {"kind": "qoe"}}
    training = Training(build_world(load("interference", changes), 0), 0, engine)
    while training.episode < 3:
        training.play(3 - training.episode)
    return training.q.copy()


def test_learners_learn_the_same_on_both_engines() -> None:
    one, other = map(learned, ENGINES)
    assert np.abs(one).sum() > 0
    assert (one == other).all()
