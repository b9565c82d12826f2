"""The best discounted return of one drone without a battery."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desim_uav.engine.base import RunSettings
from desim_uav.engine.des import Simulation
from desim_uav.errors import ScenarioError, UsageError
from desim_uav.model.rules import Action
from desim_uav.optimum.discounted import optimal_return, policy_return
from desim_uav.sample_path import draw
from desim_uav.scenario.load import from_mapping, load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world
from tests.engine.helpers import in_3d, strip
from tests.experiment.test_optimum_process import lone_drones
from tests.selection import by_default

GAMMA = 0.9
R1 = {"reward": {"kind": "coverage"}}


def of_a_row(**changes):
    """Five cells in a row; one of three users on cell 2, two on cell 4."""
    users = [(600, 120), (1080, 100), (1080, 140)]
    return strip(users=users, cells=(5, 1), steps=40, **R1 | changes)


def test_by_hand():
    """From cell 0 on: nothing, a third, nothing, two thirds forever; nearer from cell 1 on."""
    values, commands = optimal_return(of_a_row(), GAMMA)
    at_4 = 2 / 3 / (1 - GAMMA)
    at_3 = at_4
    at_2 = GAMMA * at_3
    at_1 = 1 / 3 + GAMMA * at_2
    assert values[:, 0] == pytest.approx([GAMMA * at_1, at_1, at_2, at_3, at_4], abs=1e-12)
    right, hover = Action.RIGHT, Action.HOVER
    assert commands[:, 0].tolist() == [right, right, right, right, hover]


def test_impatience():
    """With γ = 0 the next step is all that counts: one user now, not two the step after."""
    values, commands = optimal_return(of_a_row(), 0.0)
    assert values[:, 0] == pytest.approx([0, 1 / 3, 1 / 3, 2 / 3, 2 / 3], abs=1e-15)
    assert commands[2, 0] == Action.HOVER


def test_a_given_policy():
    """Always east, which at the edge is a hover; always west; and a command that is blocked."""
    world = of_a_row()
    east, best = np.full((5, 1), Action.RIGHT), optimal_return(world, GAMMA)[0]
    assert policy_return(world, GAMMA, east) == pytest.approx(best, abs=1e-12)
    west = policy_return(world, GAMMA, np.full((5, 1), Action.LEFT))
    assert west[:, 0] == pytest.approx([0, 0, 0, 1 / 3, GAMMA / 3], abs=1e-15)
    north = policy_return(world, GAMMA, np.full((5, 1), Action.FORWARD))
    assert north[:, 0] == pytest.approx(np.array([0, 0, 1, 0, 2]) / 3 / (1 - GAMMA), abs=1e-12)


def test_in_3d():
    """Over the tower's neighbours at the lowest level, around it or above; nowhere inside it."""
    buildings = [[1, 0, 30], [0, 1, 60], [2, 1, 60]]
    world = in_3d(buildings, [(0, 0)], (3, 2), users=[(600, 120)], radius_m=100.0, **R1)
    values, commands = optimal_return(world, GAMMA)
    assert values.shape == commands.shape == (3, 2, 3)
    assert np.isnan(values[1, 0, 0]) and commands[1, 0, 0] == -1
    assert commands[0, 0, 0] == world.actions.index(Action.UP)
    best = 1 / (1 - GAMMA)  # up, right, right: paid from the third step on
    assert values[0, 0, 0] == pytest.approx(GAMMA**2 * best, abs=1e-12)
    assert values[2, 0, 2] == pytest.approx(best, abs=1e-12)


@pytest.mark.parametrize("gamma", by_default([0.95], [0.0, 0.5, 0.95, 0.999_999]))
@settings(max_examples=10, deadline=None)
@given(scenario=lone_drones(), seed=st.integers(0, 2**20))
def test_the_equations_of_bellman(gamma, scenario, seed):
    """value = max (reward + γ value), and no table of commands is worth more anywhere."""
    scenario["drones"]["battery"] = None
    scenario["stations"] = {"count": 0, "radius_m": 0}
    try:
        world = build_world(from_mapping(scenario), 0)
    except ScenarioError:
        return
    values, commands = optimal_return(world, gamma)
    scale = 1e-8 / (1 - gamma)
    known = ~np.isnan(values)
    assert (commands >= 0).tolist() == known.tolist()
    greedy = policy_return(world, gamma, commands)
    assert greedy[known] == pytest.approx(values[known], abs=scale)
    rng = np.random.default_rng(seed)
    other = policy_return(world, gamma, rng.integers(len(world.actions), size=values.shape))
    assert (other[known] <= values[known] + scale).all()
    # The values are those of one look ahead, each action tried in turn.
    ahead = np.full(values.shape, -np.inf)
    for action in range(len(world.actions)):
        once = commands.copy()
        for place in np.argwhere(known):
            once[tuple(place)] = action
            ahead[tuple(place)] = max(
                ahead[tuple(place)], policy_return(world, gamma, once)[tuple(place)]
            )
            once[tuple(place)] = commands[tuple(place)]
        if known.sum() > 12:
            return
    assert values[known] == pytest.approx(ahead[known], abs=scale)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**20), st.sampled_from(["fill_epoch", "minimum_time"]))
def test_as_the_engine_pays(seed, timing):
    """A random table of commands flown: its return is the discounted sum of the rewards."""
    rng = np.random.default_rng(seed)
    users = (rng.random((9, 2)) * 960).tolist()
    world = strip(users=users, cells=(4, 4), radius_m=300.0, steps=400, timing=timing, **R1)
    policy = rng.integers(len(world.actions), size=(4, 4))
    engine = Simulation(world, RunSettings((True,), carry_over=False))
    shown = engine.reset(draw(world, 0, 0))
    start, paid = shown.observations[0].cell, 0.0
    while not shown.truncated:
        discount = GAMMA**shown.step
        shown = engine.step([int(policy[shown.observations[0].cell])])
        paid += discount * shown.rewards[0]
    assert policy_return(world, GAMMA, policy)[start] == pytest.approx(paid, abs=1e-12)


def test_case_1():
    world = build_world(load(scenario_path("case1"), []), 0)
    values, commands = optimal_return(world, 0.95)
    assert values.shape == (10, 10)
    cell, steps = world.starts[0], 0
    while commands[cell] != Action.HOVER:
        dx, dy = {Action.RIGHT: (1, 0), Action.LEFT: (-1, 0), Action.FORWARD: (0, 1)}.get(
            Action(commands[cell]), (0, -1)
        )
        cell, steps = (cell[0] + dx, cell[1] + dy), steps + 1
    assert steps < 20 and values[cell] == pytest.approx(values.max())


def test_what_is_refused():
    battery = strip(battery={})
    with pytest.raises(UsageError, match=r"^drones\.battery: "):
        optimal_return(battery, 0.9)
    with pytest.raises(ValueError, match=r"gamma must be in \[0, 1\), not 1"):
        optimal_return(of_a_row(), 1.0)
