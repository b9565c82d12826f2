"""The map of a learned policy is what the policy does."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.quiver import Quiver

from desim_uav.errors import PolicyError, UsageError
from desim_uav.experiment.train.course import table_of
from desim_uav.learning.training import Training
from desim_uav.model.rules import MOVES, Mode, actions
from desim_uav.model.state import Observation
from desim_uav.policies.tabular import Greedy, read_table
from desim_uav.report.figures import policy_figure
from desim_uav.report.figures.policy import SYMBOLS, UNTRIED, Reading
from desim_uav.rules.observations import Position
from desim_uav.scenario.load import load
from desim_uav.shipped import find_table, scenario_path
from desim_uav.world import build_world
from tests.masks import mask
from tests.rows import features_of


def table(name):
    return read_table(find_table(name))


def drawn_at(axes, read):
    """What stands in each cell: an arrow's direction, or a symbol; and its colour."""
    found, cell_of = {}, read.world.grid.cell_of
    for arrows in (c for c in axes.collections if isinstance(c, Quiver)):
        for (x, y), u, v, colour in zip(
            arrows.XY, arrows.U, arrows.V, arrows.get_facecolor(), strict=True
        ):
            found[cell_of(x, y)] = (float(np.sign(u)), float(np.sign(v))), tuple(colour)
    for action, (symbol, _) in SYMBOLS.items():
        for marks in axes.collections:
            if marks.get_gid() == action.name:
                for (x, y), colour in zip(marks.get_offsets(), marks.get_facecolor(), strict=True):
                    found[cell_of(x, y)] = symbol, tuple(colour)
    return found


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "battery_min", "level"),
    [("case8.npz", 15, 0), ("case8.npz", 5, 1), ("case8.npz", 30, 0), ("case1.npz", None, None)],
)
def test_each_cell_shows_what_the_policy_does_there(name, battery_min, level):
    figure = policy_figure(table(name), name, battery_min, level)
    read = Reading(table(name), name)
    world, policy = read.world, Greedy(name)
    policy.begin(world, None)
    shown = 0
    for drone in range(world.scenario.drones.count):
        found = drawn_at(figure.axes[drone], read)
        for cell, (what, _) in found.items():
            charge_s = None if battery_min is None else 60.0 * battery_min
            legal = allowed(world, cell, level, charge_s)
            seen = Observation(
                *(drone, 0, 30, cell, level or 0, Mode.FLYING, charge_s),
                *(world.facts.capacity_s, None, 0, 0, 0.0),
            )
            seen = seen._replace(features=features_of(Position(), seen, world.facts))
            action = world.actions[policy.act(seen, legal)]
            dx, dy, _ = MOVES.get(action, (0, 0, 0))
            assert what == ((dx, dy) if dx or dy else SYMBOLS[action][0])
            shown += 1
    assert shown > 50 or battery_min == 30


def allowed(world, cell, level, charge_s):
    """As the model says it: home at or below a fifth, charging on a station's lowest level."""
    if charge_s is None:
        return (True,) * 5
    at_station = cell in world.stations and level == 0 and charge_s < 1800
    return mask(actions(True, True), Mode.FLYING, charge_s <= 360, at_station)


def test_the_shade_is_the_value_of_that_action():
    read = Reading(table("case8.npz"), "case8.npz")
    figure = policy_figure(table("case8.npz"), "case8.npz", 15, 0, drone=1)
    (image,) = figure.axes[0].images
    q = table("case8.npz").q[1].reshape(10, 10, 2, 31, 9)[:, :, 0, 15]
    for (ix, iy), value in np.ndenumerate(image.get_array().filled(np.nan).T):
        legal = allowed(read.world, (ix, iy), 0, 900.0)
        best = max(v for v, may in zip(q[ix, iy], legal, strict=True) if may)
        assert np.isnan(value) or value == pytest.approx(best)


def test_what_nothing_was_learned_of_is_told():
    """A short training: what has still its first value was never visited, or worth nothing."""
    for initial in ("random", "zero", 2.5):
        overrides = ["learning.episodes=3", f"learning.initial_q={initial}", "users.count=12"]
        scenario = load(scenario_path("case5"), overrides)
        training = Training(build_world(scenario, 0), 0)
        before = training.q.mean(axis=1, dtype=np.float32)
        training.play(3)
        learned = table_of(training)
        changed = (learned.q != before).reshape(-1, 10, 10, 2, 31, 9)
        read = Reading(learned, "learned")
        for battery_min in (5, 25, 29):
            shown = read.slice(0, battery_min, 0)
            assert (shown.learned == changed[0, :, :, 0, battery_min].any(axis=2)).all()
            for cell in np.argwhere(shown.learned):
                ix, iy = cell
                best = shown.action[ix, iy]
                assert shown.tried[ix, iy] == changed[0, ix, iy, 0, battery_min, best]
        assert 0 < changed[0].any(axis=4).mean() < 0.1


def test_untried_actions_have_a_colour_of_their_own():
    figure = policy_figure(table("case8.npz"), "case8.npz", 15, 0, drone=0)
    read = Reading(table("case8.npz"), "case8.npz")
    shown = read.slice(0, 15, 0)
    for cell, (_, colour) in drawn_at(figure.axes[0], read).items():
        assert (to_rgba(colour) == to_rgba(UNTRIED)) == (not shown.tried[cell])
    assert not shown.tried[shown.learned].all()


def test_half_the_battery_and_the_lowest_level_unless_asked_for():
    text = policy_figure(table("case8.npz"), "mine").get_suptitle()
    assert text == "mine: q_learning, case8, world seed 0; 15 min left, at 20 m"


@pytest.mark.parametrize(
    ("name", "asked", "message"),
    [
        ("case8.npz", {"battery_min": 31}, "^battery_min: 31: case8.npz has 0 to 30"),
        ("case8.npz", {"level": 2}, "^level: 2: case8.npz has 0 to 1"),
        ("case8.npz", {"drone": 3}, "^drone: 3: case8.npz has the drones 0 to 2"),
        ("case1.npz", {"battery_min": 3}, "case1.npz has no battery_min in its states"),
        ("case1.npz", {"level": 0}, "case1.npz has no level in its states"),
    ],
)
def test_states_that_are_not_there(name, asked, message):
    with pytest.raises(UsageError, match=message):
        policy_figure(table(name), name, **asked)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"features": [["x", 9], ["y", 9]]}, "a map shows states of cell_x, .*not of x, y"),
        ({"features": [["cell_x", 4], ["cell_y", 19]]}, "are not those of its scenario"),
        ({"scenario_yaml": "users: {count: -1}"}, "its scenario cannot be read"),
        ({"scenario_yaml": None}, "its scenario cannot be read"),
        ({"world_seed": 5}, "no longer gives the world of the training"),
    ],
)
def test_a_table_that_has_no_place_on_a_map(changes, message):
    found = table("case1.npz")
    with pytest.raises(PolicyError, match=message):
        policy_figure(replace(found, about=found.about | changes), "case1.npz")


def test_actions_that_a_shield_forbids_are_not_shown():
    """A table that always likes best to hover: far from stations, a shielded drone cannot."""
    hovering = {}
    for shielded in (False, True):
        scenario = load(scenario_path("case4"), {"drones.shielded": shielded})
        learned = table_of(Training(build_world(scenario, 0), 0))
        liked = learned.q.copy()
        hover = learned.about["actions"].index("hover")
        liked[..., hover] = liked.max() + 1.0
        shown = Reading(replace(learned, q=liked), "hovering").slice(0, 4, 0)
        hovering[shielded] = shown.action == hover
    assert hovering[False].all()
    assert 0.1 < hovering[True].mean() < 0.9
