"""The draws of an episode, and what is left to no chance."""

from __future__ import annotations

import numpy as np
import pytest

from desim_uav.engine.compiled.paths import paths_of
from desim_uav.model.mobility.mobility import Static
from desim_uav.model.mobility.walking import RowWalks
from desim_uav.rowcode.views import View
from desim_uav.rules.rows import Path
from desim_uav.sample_path import SamplePaths, draw, draw_all
from desim_uav.scenario.load import load
from desim_uav.shipped import scenario_path
from desim_uav.world import build_world


def world_of(case, *overrides):
    return build_world(load(scenario_path(case), overrides), 0)


def test_what_is_left_to_no_chance_is_asked_for_once(monkeypatch):
    asked = []
    walks = Static.walks
    monkeypatch.setattr(Static, "walks", lambda *given: asked.append(1) or walks(*given))
    world = world_of("case1")
    paths = [draw(world, 0, episode) for episode in range(3)]
    assert len(asked) == 1
    assert [path.episode for path in paths] == [0, 1, 2]
    assert paths[0].walks is paths[2].walks
    packed, _ = paths_of(draw_all(world, 0, range(3)))
    single, _ = paths_of(draw_all(world, 0, [0]))
    assert packed.size == single.size + 2 * Path.words


def test_what_is_drawn_is_drawn_for_each_episode():
    world = world_of("case8")
    one, other = draw(world, 0, 0), draw(world, 0, 1)
    assert not np.array_equal(one.walks.legs, other.walks.legs)
    assert not np.array_equal(one.requests.rows[:10], other.requests.rows[:10])
    packed, (_, at) = paths_of(draw_all(world, 0, [0, 1]))
    assert 0 < at < packed.size
    assert View(packed, Path, at).legs == [], "legs of random walks are not packed"


@pytest.mark.parametrize("case", ["case1", "case4", "case6", "case8", "case9"])
def test_what_is_packed_is_what_was_drawn(case):
    """Left to chance are respawn places (4), requests (6), walks (8) and position errors (9)."""
    world = world_of(case)
    packed, starts = paths_of(draw_all(world, 3, range(5, 9)))
    for episode, at in enumerate(starts.tolist(), start=5):
        path, row = draw(world, 3, episode), View(packed, Path, at)
        walking = path.walking
        assert row.stepwise == isinstance(walking, RowWalks)
        if isinstance(walking, RowWalks):
            assert (row.streams == walking.states.view(np.int64).reshape(-1)).all()
        else:
            assert (row.legs_at == walking.offsets).all()
            assert (row.legs.array == walking.legs).all()
        rows, offsets, _ = path.requests
        assert (row.due_us == rows[:, 0]).all() and (row.services == rows[:, 1]).all()
        assert (row.drawn == rows[:, 2:].reshape(-1)).all()
        assert (row.asks_at == offsets).all()
        assert (row.follows == path.requests.follows).all()
        assert (row.respawns == path.respawn.reshape(-1)).all()
        assert row.respawns_drawn == path.respawn.shape[1]
        assert (row.errors.size > 0) == (path.position_error is not None)
        if path.position_error is not None:
            assert (row.errors == path.position_error.reshape(-1)).all()


def test_one_path_is_packed_as_it_is_among_others():
    world = world_of("case9")
    one, _ = paths_of(SamplePaths.of(draw(world, 0, 7)))
    same, _ = paths_of(draw_all(world, 0, [7]))
    assert (one == same).all()
