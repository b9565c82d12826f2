"""What the built-in policies do with their drones, and how policies are found."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from desim_uav.engine.base import EpisodeLog
from desim_uav.errors import PolicyError, SimulationError
from desim_uav.experiment.command import label_of
from desim_uav.experiment.run import play, run
from desim_uav.model.random.streams import Purpose, Streams
from desim_uav.model.rules import Action, Mode
from desim_uav.model.state import Observation
from desim_uav.policies import Policy, load_policy
from desim_uav.policies.base import file_of, parts
from desim_uav.policies.baseline import ring
from desim_uav.world import World
from tests.engine.helpers import HOP_US, US, count, seen, strip

Cell = tuple[int, int]


def square(starts: Sequence[Cell], cells: Cell = (10, 10), **changes: Any) -> World:
    return strip(starts, cells=cells, **changes)


def one_episode(world: World, policy: Policy | str) -> EpisodeLog:
    if isinstance(policy, str):
        policy = load_policy(policy)
    ((log, _),) = play(world, policy, "mine", seed=0, keep_events=True)
    return log


def flown(world: World, policy: Policy | str, drone: int = 0) -> list[Cell]:
    """The cells of a drone at its start and after each step."""
    log = one_episode(world, policy)
    places = [world.grid.cell_of(s.x_m, s.y_m) for s in log.steps if s.drone == drone]
    return [world.starts[drone], *places]


def observed(drone: int = 0, **changes: Any) -> Observation:
    seen_now = Observation(drone, 0, 30, (0, 0), 0, Mode.FLYING, 1800.0, 1800.0, 0.0, 0, 0, 0.0)
    return seen_now._replace(**changes)


# ---- the baseline's lines


def test_the_ring_of_the_papers_map():
    top = [(2, 7), (3, 7), (4, 7), (5, 7), (6, 7), (7, 7)]
    right = [(7, 6), (7, 5), (7, 4), (7, 3), (7, 2)]
    bottom = [(6, 2), (5, 2), (4, 2), (3, 2), (2, 2)]
    left = [(2, 3), (2, 4), (2, 5), (2, 6)]
    assert ring(10, 10) == top + right + bottom + left


def test_the_ring_of_maps_with_little_room():
    assert ring(6, 6) == [(2, 3), (3, 3), (3, 2), (2, 2)]
    assert ring(6, 7) == [(2, 4), (3, 4), (3, 3), (3, 2), (2, 2), (2, 3)]
    assert ring(3, 3) == [(0, 2), (1, 2), (2, 2), (2, 1), (2, 0), (1, 0), (0, 0), (0, 1)]


@pytest.mark.parametrize("cells", [(5, 5), (5, 12), (12, 5), (3, 8), (4, 4)])
def test_below_six_cells_the_ring_is_the_edge_of_the_map(cells: Cell):
    nx, ny = cells
    around = ring(nx, ny)
    assert around[:2] == [(0, ny - 1), (1, ny - 1)], "clockwise from the north-west corner"
    edge = {(x, y) for x in range(nx) for y in range(ny) if x in (0, nx - 1) or y in (0, ny - 1)}
    assert set(around) == edge
    assert len(around) == len(edge)


@pytest.mark.parametrize(
    "cells", [(10, 10), (6, 6), (9, 6), (5, 5), (3, 7), (3, 3), (2, 2), (2, 6)]
)
def test_a_ring_is_closed_and_goes_clockwise(cells: Cell):
    around = ring(*cells)
    doubled_area = 0
    for (x0, y0), (x1, y1) in zip(around, around[1:] + around[:1], strict=True):
        assert abs(x1 - x0) + abs(y1 - y0) == 1
        doubled_area += x0 * y1 - x1 * y0
    assert doubled_area < 0


@pytest.mark.parametrize(
    ("start", "first"),
    [
        ((5, 9), [(5, 8), (5, 7), (6, 7), (7, 7), (7, 6), (7, 5)]),
        ((9, 9), [(8, 9), (7, 9), (7, 8), (7, 7), (7, 6)]),
        ((0, 0), [(1, 0), (2, 0), (2, 1), (2, 2), (2, 3)]),
        ((0, 4), [(1, 4), (2, 4), (2, 5)]),
        ((2, 7), [(3, 7), (4, 7)]),
        ((2, 6), [(2, 7), (3, 7)]),
        ((6, 2), [(5, 2), (4, 2)]),
        # As far from two sides of the ring: top before right before bottom before left.
        ((5, 5), [(5, 6), (5, 7), (6, 7)]),
        ((4, 5), [(4, 6), (4, 7), (5, 7)]),
        ((5, 4), [(6, 4), (7, 4), (7, 3)]),
        ((4, 4), [(4, 3), (4, 2), (3, 2)]),
    ],
)
def test_drone_0_flies_to_the_nearest_cell_of_the_ring_and_around(start: Cell, first: list[Cell]):
    cells = flown(square([start], steps=30), "baseline")
    assert cells[1 : 1 + len(first)] == first
    around = ring(10, 10)
    on = next(k for k, cell in enumerate(cells) if cell in around)
    at = around.index(cells[on])
    assert cells[on:] == [around[(at + k) % 20] for k in range(31 - on)]


def test_drone_0_flies_around_a_small_map():
    assert flown(square([(1, 1)], cells=(3, 3), steps=10), "baseline") == [
        (1, 1), (1, 2), (2, 2), (2, 1), (2, 0), (1, 0), (0, 0), (0, 1), (0, 2), (1, 2), (2, 2),
    ]  # fmt: skip


def test_odd_drones_sweep_columns_and_even_ones_rows():
    starts = [(5, 9), (8, 3), (1, 3), (0, 0), (6, 9)]
    world = square(starts, steps=40)
    for drone, axis in ((1, 1), (2, 0), (3, 1), (4, 0)):
        cells = flown(world, "baseline", drone)
        along = [cell[axis] for cell in cells]
        assert {cell[1 - axis] for cell in cells} == {starts[drone][1 - axis]}
        steps = np.diff(along)
        assert set(np.abs(steps)) == {1}, "it never stands still"
        turns = [along[k + 1] for k in range(39) if steps[k] != steps[k + 1]]
        assert set(turns) == {0, 9}, "it turns at both edges, and nowhere else"


@pytest.mark.parametrize("cells", [(1, 6), (6, 1), (1, 1), (2, 5), (5, 2), (2, 2)])
def test_on_a_narrow_map_nobody_leaves_it(cells: Cell):
    world = square([(0, 0)] * 3, cells=cells, steps=20)
    log = one_episode(world, "baseline")
    assert count(log, "blocked") == 0
    if max(cells) > 1:
        assert len({(s.x_m, s.y_m) for s in log.steps if s.drone == 0}) > 1


# ---- the baseline's battery


@pytest.mark.parametrize(("autonomy_min", "at_s"), [(30, 240), (20, 180), (10, 60), (40, 360)])
def test_the_baseline_returns_at_15_percent(autonomy_min: float, at_s: int):
    # Of 270 s the first decision epoch at or below is at 240 s; of 180 it is at 180 s; of 90, 60.
    steps = autonomy_min - at_s // 60 + 1
    world = square(
        [(5, 4)], steps=steps, battery={"autonomy_min": autonomy_min, "return_below": 1.0}
    )
    log = one_episode(world, "baseline")
    taken = [step.action_taken for step in log.steps]
    assert taken.index(Action.GOTO_CHARGING_STATION) == steps - 1
    assert log.steps[-2].charge == at_s * US


def test_the_baseline_returns_as_soon_as_it_may():
    # It would at 240 s, but may from 180 s (10 %) on.
    world = square([(5, 4)], steps=28, battery={"autonomy_min": 30, "return_below": 0.1})
    log = one_episode(world, "baseline")
    taken = [step.action_taken for step in log.steps]
    assert taken.index(Action.GOTO_CHARGING_STATION) == 27
    assert log.steps[26].charge == 180 * US


def test_the_baseline_charges_and_flies_back_to_its_lines():
    # Stations on (5, 9), (8, 3) and (1, 3). After 26 steps, with 240 s left, drone 0 is on (7, 5)
    # of the ring, 3 hops from (8, 3): it lands at 1560 + 93 s, charges 1653 / 6 = 275.5 s, and
    # flies at 1980 s, the 34th epoch, by (7, 3) on. Drones 1 and 2, column 4 and row 0, go home to
    # (5, 9), and to a station of row 3.
    world = square(
        [(5, 9), (4, 4), (4, 0)],
        steps=45,
        battery={"autonomy_min": 30},
        stations={"count": 3, "radius_m": 960},
        timing="fill_epoch",
    )
    assert world.stations == ((5, 9), (8, 3), (1, 3))
    log = one_episode(world, "baseline")
    for drone in range(3):
        own = [step for step in log.steps if step.drone == drone]
        taken = [step.action_taken for step in own]
        assert taken.index(Action.GOTO_CHARGING_STATION) == 26
        assert all(step.mode is not Mode.CRASHED for step in own)
    assert log.charges == 3
    (t_us, _, _, _, _, _, station), *_ = (e for e in seen(log, "land") if e[3] == 0)
    assert (t_us, station) == (1560 * US + 3 * HOP_US, 1)
    cells = [flown(world, "baseline", drone) for drone in range(3)]
    assert cells[0][26] == (7, 5)
    assert cells[0][33:37] == [(8, 3), (7, 3), (7, 2), (6, 2)]

    def after_charge(drone: int) -> list[Cell]:
        own = [step for step in log.steps if step.drone == drone]
        last = max(k for k, step in enumerate(own) if step.mode is Mode.CHARGED)
        return cells[drone][last + 1 :]

    column = after_charge(1)
    assert column[:2] == [(5, 9), (4, 9)]
    assert column[2:5] == [(4, 8), (4, 7), (4, 6)]
    row = after_charge(2)
    assert row[0] in ((8, 3), (1, 3))
    assert row[1:4] == [(row[0][0], y) for y in (2, 1, 0)]
    assert {y for _, y in row[4:]} == {0}
    assert set(np.abs(np.diff([x for x, _ in row[3:]]))) == {1}


def test_the_way_back_to_the_ring_is_x_first():
    # From a station in a corner the nearest cell of the ring is two east and two north.
    world = square(
        [(7, 7)], steps=40, battery={"autonomy_min": 30}, stations={"count": 1, "radius_m": 0}
    )
    policy = load_policy("baseline")
    policy.begin(world, Streams(0, Purpose.LEARNER))
    mask = (True,) * len(world.actions)
    way = [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2)]
    acts = [world.actions[policy.act(observed(cell=cell), mask)] for cell in way]
    right, forward = Action.RIGHT, Action.FORWARD
    assert acts == [right, right, forward, forward, forward]


def test_a_drone_that_believes_it_is_off_its_line_flies_back():
    world = square([(5, 9), (8, 3), (1, 3)], steps=40)
    policy = load_policy("baseline")
    policy.begin(world, Streams(0, Purpose.LEARNER))
    mask = (True,) * len(world.actions)

    def act(drone: int, cell: Cell) -> Action:
        return world.actions[policy.act(observed(drone, cell=cell), mask)]

    assert act(1, (6, 5)) is Action.RIGHT
    assert act(1, (9, 5)) is Action.LEFT
    assert act(2, (4, 5)) is Action.BACKWARD
    assert act(2, (4, 0)) is Action.FORWARD


def test_what_is_forced_is_done():
    world = square([(5, 4)], battery={"autonomy_min": 30})
    policy = load_policy("baseline")
    policy.begin(world, Streams(0, Purpose.LEARNER))
    for forced in range(len(world.actions)):
        mask = tuple(k == forced for k in range(len(world.actions)))
        assert policy.act(observed(battery_s=100.0), mask) == forced


# ---- the baseline among buildings


def test_the_baseline_climbs_over_buildings_and_stays_up():
    # Drone 1 sweeps column 0, with 50 m in its middle: up to 60 m, over, and on at that height.
    levels = {"min_altitude_m": 20, "step_m": 20}
    map_ = {
        "size_m": [720, 1680],
        "cells": [3, 7],
        "dimensions": 3,
        "levels": levels,
        "obstacles": {"cells": [[0, 3, 50]]},
    }
    world = strip([(2, 0), (0, 1)], steps=20, map=map_)
    policy = load_policy("baseline")
    assert policy.ceiling is False
    log = one_episode(world, policy)
    own = [step for step in log.steps if step.drone == 1]
    places = [(*world.grid.cell_of(step.x_m, step.y_m), step.z_m) for step in own]
    over = next(k for k, place in enumerate(places) if place[:2] == (0, 3))
    climb = places[over - 3 : over + 2]
    assert [z for *_, z in climb] == [20, 40, 60, 60, 60]
    assert climb[0][:2] == climb[1][:2] == climb[2][:2], "straight up in front of it"
    assert all(z == 60 for *_, z in places[over:]), "it descends no further than it must"
    assert {y for _, y, _ in places} == set(range(7))
    assert count(log, "blocked") == 0


def test_the_ring_too_goes_over_buildings():
    map_ = {
        "size_m": [720, 720],
        "cells": [3, 3],
        "dimensions": 3,
        "levels": {"min_altitude_m": 20, "step_m": 20},
        "obstacles": {"cells": [[1, 2, 20]]},
    }
    # A building of 20 m is entered above 20 m only: at 40 m, for which it takes one climb.
    world = strip([(0, 2)], steps=4, map=map_)
    log = one_episode(world, "baseline")
    assert [step.action_taken for step in log.steps] == [
        Action.UP, Action.RIGHT, Action.RIGHT, Action.BACKWARD,
    ]  # fmt: skip
    assert log.steps[-1].z_m == 40


# ---- random


@pytest.mark.parametrize(
    "mask",
    [
        (True,) * 9,
        (True,) * 5 + (False,) * 4,
        (True, False, True, False, False, False, True, True, False),
        (False,) * 8 + (True,),
    ],
)
def test_random_is_uniform_over_the_mask(mask: tuple[bool, ...]):
    policy = load_policy("random")
    policy.begin(square([(1, 1), (2, 2)]), Streams(5, Purpose.LEARNER, 0))
    counts = np.bincount([policy.act(observed(), mask) for _ in range(9000)], minlength=9)
    allowed = np.array(mask)
    assert counts[~allowed].sum() == 0
    if allowed.sum() > 1:
        assert stats.chisquare(counts[allowed]).pvalue > 1e-3


def test_random_actions_do_not_depend_on_the_one_before():
    policy = load_policy("random")
    policy.begin(square([(1, 1)]), Streams(6, Purpose.LEARNER, 0))
    mask = (True,) * 5
    drawn = [policy.act(observed(), mask) for _ in range(10_001)]
    pairs = np.zeros((5, 5))
    np.add.at(pairs, (drawn[:-1], drawn[1:]), 1)
    assert stats.chi2_contingency(pairs).pvalue > 1e-3


def test_random_drones_have_streams_of_their_own():
    def drawn(drones: int, episode: int) -> list[int]:
        policy = load_policy("random")
        policy.begin(square([(1, 1)] * drones), Streams(5, Purpose.LEARNER, episode))
        acts = [
            [policy.act(observed(drone), (True,) * 9) for drone in range(drones)] for _ in range(50)
        ]
        return [of_all[0] for of_all in acts]

    assert drawn(1, 0) == drawn(3, 0)
    assert drawn(1, 0) != drawn(1, 1)
    policy = load_policy("random")
    policy.begin(square([(1, 1)] * 2), Streams(5, Purpose.LEARNER, 0))
    mask = (True,) * 9
    pairs = [[policy.act(observed(drone), mask) for drone in (0, 1)] for _ in range(50)]
    assert any(a != b for a, b in pairs)


def test_random_never_asks_for_what_it_may_not():
    battery = {"autonomy_min": 5, "return_below": 0.8, "respawn_after_min": 1}
    world = square([(4, 4)] * 4, steps=60, battery=battery, stations={"full_charge_min": 3})
    log = one_episode(world, "random")
    assert all(step.action is step.action_taken for step in log.steps)
    assert len({step.action for step in log.steps}) == len(world.actions)
    assert log.charges > 0


# ---- hover


def test_hover_hovers():
    world = square([(4, 4)], steps=4, battery={"autonomy_min": 3, "respawn_after_min": 0})
    log = one_episode(world, "hover")
    assert {step.action for step in log.steps} == {Action.HOVER}
    assert log.distance_m == 0.0
    assert log.crashes == 1


# ---- script


@pytest.fixture
def script(tmp_path: Path) -> Callable[[str], str]:
    numbers = iter(range(100))

    def write(text: str) -> str:
        file = tmp_path / f"script{next(numbers)}.csv"
        file.write_text(text)
        return f"script:{file}"

    return write


def test_a_script_says_what_to_do_and_else_it_is_hover(script: Callable[[str], str]):
    name = script("step,drone,action\n0,0,right\n2,0,forward\n2,1,left\n7,1,left\n")
    world = square([(4, 4), (6, 6)], steps=4)
    right, left, forward, hover = Action.RIGHT, Action.LEFT, Action.FORWARD, Action.HOVER
    policy = load_policy(name)
    for log, _ in play(world, policy, name, seed=0, episodes=2):
        taken = [[s.action_taken for s in log.steps if s.drone == drone] for drone in (0, 1)]
        assert taken == [[right, hover, forward, hover], [hover, hover, left, hover]]


def test_a_script_says_once_that_an_episode_is_shorter(
    script: Callable[[str], str], capsys: pytest.CaptureFixture[str]
):
    name = script("step,drone,action\n1,0,right\n2,0,forward\n3,0,left\n")
    list(play(square([(4, 4)], steps=2), load_policy(name), name, seed=0, episodes=2))
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{name.removeprefix('script:')}:3: 2 of 3 actions are never taken" in line
    assert line.endswith("an episode has the steps 0 to 1")


def test_a_script_has_its_columns_in_any_order(script: Callable[[str], str]):
    name = script("action,step,note,drone\nRight,0,x,0\n")
    log = one_episode(square([(4, 4)], steps=1), name)
    assert log.steps[0].action_taken is Action.RIGHT


def test_a_script_may_ask_for_what_is_masked(script: Callable[[str], str]):
    name = script("step,drone,action\n0,0,goto_charging_station\n")
    log = one_episode(square([(4, 4)], steps=1, battery={"autonomy_min": 30}), name)
    assert log.steps[0].action is Action.GOTO_CHARGING_STATION
    assert log.steps[0].action_taken is Action.HOVER


@pytest.mark.parametrize(
    ("text", "line", "told"),
    [
        ("step,drone,action\n0,0,right\n1,0,foward\n", 3, "did you mean 'forward'?"),
        ("step,drone,action\n0,x,right\n", 2, "drone"),
        ("step,drone,action\n0,0,right\n0,1,left\n-1,0,right\n", 4, "step"),
        ("step,drone,action\n0.5,0,right\n", 2, "step"),
        ("step,drone,action\n0,0\n", 2, "action"),
        ("step,drone\n0,0\n", 1, "no column 'action'"),
        ("", 1, "no column 'step'"),
        ("step,drone,action\n0,0,right\n1,0,right\n0,0,left\n", 4, "two actions"),
    ],
)
def test_a_script_that_cannot_be_read(
    text: str, line: int, told: str, script: Callable[[str], str]
):
    name = script(text)
    with pytest.raises(PolicyError) as error:
        load_policy(name)
    assert f"{name.removeprefix('script:')}:{line}" in str(error.value)
    assert told in str(error.value)


@pytest.mark.parametrize(
    ("text", "line", "told"),
    [
        ("step,drone,action\n0,0,right\n1,1,right\n", 3, "drone: 1: must be from 0 to 0"),
        ("step,drone,action\n0,0,up\n", 2, "'up' is not an action of this scenario"),
        ("step,drone,action\n0,0,right\n1,0,charge\n", 3, "'charge' is not an action"),
    ],
)
def test_a_script_that_does_not_fit_the_scenario(
    text: str, line: int, told: str, script: Callable[[str], str]
):
    name = script(text)
    with pytest.raises(PolicyError) as error:
        one_episode(square([(4, 4)], steps=1), name)
    assert f"{name.removeprefix('script:')}:{line}" in str(error.value)
    assert told in str(error.value)


@pytest.mark.parametrize("name", ["script", "script:", "script:nowhere.csv"])
def test_a_script_without_a_file(name: str):
    with pytest.raises(PolicyError, match="script"):
        load_policy(name)


# ---- policies of a user's own


class Steady:
    """Always to the right."""

    ceiling = True

    def begin(self, world: World, streams: Streams, carried: bool) -> None:
        pass

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        return int(Action.RIGHT)


class Failing(Steady):
    """Fails at the third step of the second episode."""

    episode = -1

    def begin(self, world: World, streams: Streams, carried: bool) -> None:
        self.episode += 1

    def act(self, observation: Observation, mask: Sequence[bool]) -> int:
        if (self.episode, observation.step) == (1, 2):
            raise ZeroDivisionError("so it is")
        return 0


class FailingAtOnce(Steady):
    def begin(self, world: World, streams: Streams, carried: bool) -> None:
        raise KeyError("nothing")


class Vague(Steady):
    def act(self, observation: Observation, mask: Sequence[bool]) -> Any:
        return None


class Numpy(Steady):
    def act(self, observation: Observation, mask: Sequence[bool]) -> Any:
        return np.int64(2)


class Refusing(Steady):
    def begin(self, world: World, streams: Streams, carried: bool) -> None:
        raise PolicyError("it does not fit")


class Deaf:
    """No policy: it cannot act."""

    ceiling = True

    def begin(self, world: World, streams: Streams, carried: bool) -> None:
        pass


HERE = "tests.policies.test_policies"


def test_a_class_of_ones_own():
    log = one_episode(square([(4, 4)], steps=3), f"{HERE}:Steady")
    assert [step.x_m for step in log.steps] == [1320, 1560, 1800]


def test_numpy_numbers_are_commands():
    log = one_episode(square([(4, 4)], steps=1), Numpy())
    assert log.steps[0].action_taken is Action.RIGHT


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("baselin", "unknown policy 'baselin' (did you mean 'baseline'?)"),
        (
            "RANDOM",
            "allowed: baseline, clairvoyant, dispatcher, greedy, hover, mlp, planner, random, "
            "rllib, rollout, sb3, script, shielded, table, tour",
        ),
        ("", "unknown policy"),
        (f"{HERE}:Deaf", "no method 'act'"),
        (f"{HERE}:Nobody", "Nobody"),
        (f"{HERE}:HERE", "is not a class"),
        ("no_such_module:Mine", "no_such_module"),
        ("hover:file.csv", "hover:file.csv"),
    ],
)
def test_a_policy_that_cannot_be_had(name: str, told: str):
    with pytest.raises(PolicyError) as error:
        load_policy(name)
    assert told in str(error.value)


def test_a_policy_that_fails_is_one_clear_error():
    with pytest.raises(SimulationError) as error:
        run(square([(4, 4)], steps=4), Failing(), "mine:Failing", seed=0, episodes=3)
    told = str(error.value)
    assert "'mine:Failing'" in told
    assert "episode 1, step 2" in told
    assert "ZeroDivisionError: so it is" in told
    assert isinstance(error.value.__cause__, ZeroDivisionError)


def test_a_policy_that_fails_as_an_episode_begins():
    with pytest.raises(SimulationError, match=r"episode -1: KeyError"):
        run(square([(4, 4)], steps=1), FailingAtOnce(), "mine", seed=0, warmup=1)


def test_a_policy_that_says_nothing():
    with pytest.raises(SimulationError, match=r"episode 0, step 0: it returned None for drone 0"):
        one_episode(square([(4, 4)], steps=1), Vague())


NONE_OF_ACTIONS = (
    *(99, -1, 5, 1.7, 2.0, True, np.True_, math.nan, None, b"up"),
    *(np.float32(1), np.array(1.0), np.array(True), [2], [], np.array([2]), {"drone": 1}, 1j),
)
SAYS = (
    "; allowed: the index of an action, a whole number: 0 (forward), 1 (backward), 2 (right), "
    "3 (left), 4 (hover)"
)


def told_by(world: World, policy: Any) -> str:
    """What a run says that this policy ends."""
    with pytest.raises(SimulationError) as error:
        run(world, load_policy(policy), "mine:Policy", seed=0)
    return str(error.value)


@pytest.mark.parametrize("answer", NONE_OF_ACTIONS, ids=repr)
def test_what_is_no_command_is_refused(answer: Any):
    """Whoever returns it: a function, a method for each drone, or one for all of them."""
    world = square([(4, 4), (2, 2)], steps=3)

    class Own(Steady):
        def act(self, observation: Observation, mask: Sequence[bool]) -> Any:
            return answer if (observation.step, observation.drone) == (1, 1) else 4

    class Joint(Own):
        def act_jointly(self, observations: Any, masks: Any) -> Any:
            return [4, 4] if observations[0].step == 0 else (4, answer)

    where = f"policy 'mine:Policy' in episode 0, step 1: it returned {answer!r} for drone 1"
    for policy in (Own().act, Own, Joint):
        assert told_by(world, policy) == where + SAYS


@pytest.mark.parametrize(
    "answers", [None, 4, [4], [4, 4, 4], "44", {0: 4, 1: 4}, np.array(4), np.array([4])], ids=repr
)
def test_commands_for_other_drones_than_there_are(answers: Any):
    class Joint(Steady):
        def act_jointly(self, observations: Any, masks: Any) -> Any:
            return answers

    told = told_by(square([(4, 4), (2, 2)], steps=1), Joint())
    assert told == (
        f"policy 'mine:Policy' in episode 0, step 0: it returned {answers!r}; allowed: a list with "
        "a command for each of 2 drone(s)"
    )


def test_all_that_is_a_command():
    """Whole numbers of any kind, and actions themselves."""
    kinds = (2, np.int8(2), np.uint64(2), np.array(2), Action.RIGHT)
    for answer in kinds:
        log = one_episode(square([(4, 4)], steps=1), load_policy(lambda seen, mask, a=answer: a))
        assert log.steps[0].action_taken is Action.RIGHT
    for answers in ([2, 2], (2, 2), np.array([2, 2]), np.array([2, 2], np.uint8)):

        class Joint(Steady):
            def act_jointly(self, observations: Any, masks: Any, given: Any = answers) -> Any:
                return given

        log = one_episode(square([(4, 4), (2, 2)], steps=1), Joint())
        assert [step.action_taken for step in log.steps] == [Action.RIGHT] * 2
    masked = one_episode(square([(4, 4)], steps=1, battery={"autonomy_min": 9}), Masked())
    assert masked.steps[0].action_taken is Action.HOVER, "a forbidden action is no error"


class Masked(Steady):
    def act(self, observation: Observation, mask: Sequence[bool]) -> Any:
        return mask.index(False)


def test_what_a_policy_itself_calls_an_error_stays_it():
    with pytest.raises(PolicyError, match="it does not fit"):
        one_episode(square([(4, 4)], steps=1), Refusing())


@pytest.mark.parametrize(
    ("name", "kind", "file"),
    [
        ("baseline", "baseline", None),
        ("sb3:a/b.zip", "sb3", "a/b.zip"),
        ("script:b.csv", "script", "b.csv"),
        ("mine.npz", "table", "mine.npz"),
        ("a:b/mine.npz", "table", "a:b/mine.npz"),
        ("table:mine.npz", "table", "mine.npz"),
        ("rllib:here", "rllib", "here/desim_uav.npz"),
        ("rllib:npz.npz", "rllib", "npz.npz/desim_uav.npz"),
        ("rllib:here/desim_uav.npz", "rllib", "here/desim_uav.npz"),
        ("rllib", "rllib", None),
        ("module:Class", "module", None),
    ],
)
def test_the_file_that_a_name_holds(name: str, kind: str, file: str | None):
    assert parts(name)[0] == kind
    assert file_of(name) == (None if file is None else Path(file))


def test_a_run_is_called_by_its_policys_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    for name, label in (
        ("baseline", "baseline"),
        ("sb3:a/b.zip", "sb3-b"),
        ("a/mine.npz", "table-mine"),
        ("a/policy.npz", "table-a"),
        ("rllib:a/checkpoint", "rllib-checkpoint"),
        ("rllib:a/checkpoint/desim_uav.npz", "rllib-checkpoint"),
        ("policy.npz", f"table-{tmp_path.name}"),
    ):
        assert label_of(name) == label
